"""Damaged recordings: `check` names what is wrong, and readers refuse what no recording has."""

import re

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt
from recordings import GRAINS, grains_of, make_frames, make_scene, record
from walled_scenes import BOXES, DRIVEN, PISTON, STILL, boxed, pressed

from warpgrains import Simulation
from warpgrains.base.errors import InputError
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recording import Recording

COLOR = "primvars:displayColor:indices"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Return the bytes of recordings: points, discs that rotate, walls that move, and grains that appear."""
    folder, discs = tmp_path_factory.mktemp("recordings"), make_scene(friction=0.3)
    points = record(folder / "points.usdc", make_frames(4), forces=True)
    discs = record(folder / "discs.usdc", make_frames(4), discs, draw_as="discs")
    walls, mobile = folder / "walls.usdc", pressed(9, walls=[PISTON, DRIVEN, STILL], pressure=None)
    Simulation(mobile).run(steps=40, record=walls, fps=20)  # 5 frames
    flow = {"sources": [{"region": {}, "radius": (0.05, 0.1), "density": 1.0, "count": 2}]}
    born, scene = folder / "born.usdc", make_scene(np.full(3, 0.1), **flow)
    Simulation(scene).run(steps=6, record=born, fps=50)  # 4 frames, the first one of 3 grains
    return {path.stem: path.read_bytes() for path in (points, discs, walls, born)}


@pytest.fixture
def damaged(tmp_path, recordings):
    """Return a function that damages a recording."""

    def apply(damage, form="points"):
        path = tmp_path / "run.usdc"
        path.write_bytes(recordings[form])
        stage = Usd.Stage.Open(str(path))
        damage(stage)
        stage.Save()
        return path

    return apply


def put(values, *at):
    """Return the damage that sets the values of an attribute, for all frames or at one."""
    return lambda own: own.Set(values, *at)


def drop(*at):
    return lambda own: own.ClearAtTime(*at) if at else own.Clear()


def edit(place, number, at):
    """Return the damage that sets a number in the array of a frame."""

    def apply(own):
        values = np.array(own.Get(at))
        values[place] = number
        own.Set(Vt.Vec3fArray.FromNumpy(values), at)

    return apply


def remove(own):
    own.GetPrim().RemoveProperty(own.GetName())


def shift(own):
    own.ClearAtTime(1)
    own.Set(Vt.Vec3fArray(5), 1.5)


def within(place, damage):
    return lambda stage: damage(stage.GetAttributeAtPath(f"/World/{place}"))


def leave_a_gap_in_time(stage):
    for attribute in grains_of(stage).GetPrim().GetAttributes():
        attribute.ClearAtTime(1)


def begin_at_one(stage):
    for attribute in grains_of(stage).GetPrim().GetAttributes():
        for code in reversed(attribute.GetTimeSamples()):
            attribute.Set(attribute.Get(code), code + 1)
            attribute.ClearAtTime(code)


def scale(name, number):
    """Return a damage of a scale: a text instead of a number."""

    def damage(stage):
        layer = stage.GetRootLayer()
        data = layer.customLayerData
        data["warpgrains"][name][number] = "x"
        layer.customLayerData = data

    return damage


CODES = "has other time codes than the grains' positions"
OUTSIDE = "does not contain all grains, bands or points"
LARGER = "is larger than that of all grains, bands or points"
ALL = "(frame 0 and 3 more)"
FAR = "float32 coordinates are 0.0625 m apart there, but the smallest radius is 0.031 m"
OF_POINTS = [
    ("Grains.velocities", put(Vt.Vec3fArray(2), 1), "hold 2 values, not 5 for 5 grains (frame 1)"),
    ("Grains.velocities", shift, CODES),
    ("Grains.velocities", put([Gf.Vec3f(np.inf)] * 5, 2), "are not all finite (frame 2)"),
    ("Grains.ids", put([0, 1]), f"hold 2 values, not 5 for 5 grains {ALL}"),
    ("Grains.ids", remove, f"hold 0 values, not 5 for 5 grains {ALL}"),
    ("Grains.primvars:id", remove, f"hold 0 values, not 5 for 5 grains {ALL}"),
    ("Grains.ids", put([0, 1, 2, 3, 3]), "are not unique: 1 of 5 repeat another"),
    ("Grains.ids", put([4, 3, 2, 1, 0], 2), "change with time"),
    ("Grains.widths", put([0.1, 0.2]), f"hold 2 values, not 5 for 5 grains {ALL}"),
    ("Grains.widths", put([0.1, 0.2, -0.1, 0.2, 0.2]), f"are not all positive and finite {ALL}"),
    (f"Grains.{COLOR}", put([0, 1, 2], 2), "hold 3 values, not 5 for 5 grains (frame 2)"),
    (f"Grains.{COLOR}", drop(2), CODES),
    (f"Grains.{COLOR}", put([0, 1, 64, 3, 4], 2), "are not all below 64 (frame 2)"),
    ("Grains.points", edit((3, 1), np.nan, 2), "are not all finite (frame 2)"),
    ("Grains.points", edit((3, 1), -1e6, 2), f"are rounded: {FAR} (frame 2)"),
    ("Grains.extent", drop(2), CODES),
    ("Grains.extent", edit((0, 0), 0.0, 3), f"{OUTSIDE} (frame 3)"),
    ("Grains.extent", edit((0, 0), -2.0, 3), f"{LARGER} (frame 3)"),
    ("Grains.extent", edit(..., np.nan, 3), f"{OUTSIDE} (frame 3)"),
    ("Grains.extent", put(Vt.Vec3fArray(1), 3), "is not two corners (frame 3)"),
    ("Grains.primvars:speed", put([0.1], 1), "hold 1 values, not 5 for 5 grains (frame 1)"),
    ("Grains.warpgrains:mass", put([1.0]), f"hold 1 values, not 5 for 5 grains {ALL}"),
    ("Forces.points", drop(3), CODES),
    ("Forces.faceVertexIndices", put([0, 1], 1), "hold 2 values, not 20 for 20 corners (frame 1)"),
    ("Forces.primvars:force", put([0.1], 1), "hold 1 values, not 5 for 5 bands (frame 1)"),
    ("Forces.primvars:grain", drop(3), CODES),
    ("Forces.primvars:neighbour", put([1], 1), "hold 1 values, not 5 for 5 bands (frame 1)"),
    ("Forces.extent", put(Vt.Vec3fArray(2), 1), f"{OUTSIDE} (frame 1)"),
    ("Walls/Outer.points", edit((0, 0), np.inf, 0), CODES),
]
OF_DISCS = [
    ("Grains.primvars:angle", put([0.1], 1), "hold 1 values, not 5 for 5 grains (frame 1)"),
    ("Grains.orientations", drop(1), CODES),
    ("Grains.orientations", put(Vt.QuathArray(2), 1), "hold 2 values, not 5 for 5 grains (frame 1)"),
    ("Grains.orientations", put(Vt.QuathArray(5), 1), "are not those of the angles (frame 1)"),
    ("Grains.protoIndices", put([0, 0], 0), "hold 2 values, not 5 for 5 grains (frame 0)"),
    ("Grains.protoIndices", put([0, 16, 0, 0, 0], 1), "are not all below 16 (frame 1)"),
]
OF_BORN = [
    ("Grains.ids", put([0, 1, 2, 3, 3], 2), "are not unique (frame 2)"),
    ("Grains.ids", put([0, 1, 2], 2), "hold 3 values, not 5 for 5 grains (frame 2)"),
    ("Grains.widths", put([0.1] * 3, 2), "hold 3 values, not 5 for 5 grains (frame 2)"),
    ("Grains.warpgrains:radius", put([0.1] * 3, 2), "hold 3 values, not 5 for 5 grains (frame 2)"),
    ("Grains.warpgrains:mass", drop(1), CODES),
]
NO_NUMBER = "it must be a number"
OTHER_ENDS = "startTimeCode and endTimeCode are 0 and 2, but the frames are 0 and 3"
OF_THE_STAGE = [
    (within("Grains.points", drop()), "the grains have no time samples"),
    (within("Forces.faceVertexCounts", put([4, 4], 1)), "points hold 20 values, not 8 for 2 bands (frame 1)"),
    (lambda stage: stage.RemovePrim(GRAINS), "no UsdGeom.Points or PointInstancer at /World/Grains"),
    (leave_a_gap_in_time, "the time codes of the grains are not 0, 1, 2, ..."),
    (begin_at_one, "the time codes of the grains are not 0, 1, 2, ..."),
    (lambda stage: stage.SetEndTimeCode(2), OTHER_ENDS),
    (lambda stage: stage.SetFramesPerSecond(24), "timeCodesPerSecond 50 differs from framesPerSecond 24"),
    (lambda stage: UsdGeom.SetStageUpAxis(stage, "Z"), "upAxis is Z, not Y"),
    (lambda stage: stage.ClearMetadata("metersPerUnit"), "metersPerUnit is 0.01, not 1"),
    (lambda stage: stage.ClearMetadata("kilogramsPerUnit"), "kilogramsPerUnit is missing"),
    (lambda stage: stage.ClearDefaultPrim(), "defaultPrim is missing"),
    (lambda stage: stage.RemovePrim("/World/Walls"), "no walls at /World/Walls"),
    (scale("colors", "low"), f"the scale of colors is damaged: low of colors is 'x': {NO_NUMBER}"),
    (scale("forces", "force"), f"the scale of forces is damaged: force of forces is 'x': {NO_NUMBER}"),
]


@pytest.mark.parametrize(
    ("form", "place", "damage", "problem"),
    [
        *(("points", *each) for each in OF_POINTS),
        *(("discs", *each) for each in OF_DISCS),
        *(("born", *each) for each in OF_BORN),
    ],
)
def test_names_the_attribute_that_is_broken(damaged, form, place, damage, problem):
    found = inspect_recording(damaged(within(place, damage), form))
    name = place.rpartition("/")[2] if problem == CODES else place.partition(".")[2]
    assert f"{name} {problem}" in found


@pytest.mark.parametrize(("damage", "problem"), OF_THE_STAGE)
def test_names_what_is_broken(damaged, damage, problem):
    assert problem in inspect_recording(damaged(damage))


def test_walls_are_inspected(damaged):
    for half, problem in {0.0: OUTSIDE, 9.0: LARGER}.items():
        wrong = put([Gf.Vec3f(-half), Gf.Vec3f(half)])
        assert f"Outer: extent {problem} {ALL}" in inspect_recording(
            damaged(within("Walls/Outer.extent", wrong))
        )


def shift_by(number, at):
    """Return the damage that adds a number to all values of a frame; for None, of all frames."""

    def apply(own):
        kind = type(own.Get(at or 0))
        values = kind.FromNumpy(np.array(own.Get(at or 0)) + np.array(number, np.float32))
        own.Set(values) if at is None else own.Set(values, at)

    return apply


@pytest.mark.parametrize(
    ("place", "damage", "wall", "off", "frame"),
    [
        ("Walls/Segment0.points", shift_by((0.25, 0, 0), 3), "Segment0", 0.25, 3),
        ("Walls/Segment1.points", shift_by((0, 0.125, 0), 2), "Segment1", 0.125, 2),
        ("Walls.warpgrains:places", shift_by(0.5, 4), "Segment1", 0.5, 4),
        ("Walls/Disc2.points", shift_by((0, 0.5, 0), None), "Disc2", 0.5, 0),
        ("Walls.warpgrains:thickness", put(0.03), "Outer", 0.03 - 0.014 * 1.04, 0),
    ],
)
def test_walls_are_drawn_where_they_are(damaged, place, damage, wall, off, frame):
    found = inspect_recording(damaged(within(place, damage), "walls"))
    (line,) = [each for each in found if each.startswith(f"{wall}: points")]
    distance, number = re.fullmatch(r".* up to (\S+) m from where the wall is \(frame (\d)\)", line).groups()
    assert (float(distance), int(number)) == (pytest.approx(off, rel=0.03), frame)


@pytest.mark.parametrize("kind", BOXES)
def test_walls_of_every_kind_are_drawn_where_they_are(tmp_path, kind):
    """Also in a recording that begins later."""
    simulation = Simulation(boxed(kind, 30))
    simulation.run(steps=13)
    simulation.run(steps=20, record=tmp_path / "run.usdc", fps=47.0)
    assert inspect_recording(tmp_path / "run.usdc") == []


def test_instances_are_inspected_at_their_size(damaged):
    wider = within("Grains.scales", put([Gf.Vec3f(1.5)] * 5))
    assert f"extent {OUTSIDE} {ALL}" in inspect_recording(damaged(wider, "discs"))


@pytest.mark.parametrize("values", [[0, 1, 2, 3, 3], [0, 1, 2], [-1, 0, 1, 2, 3]])
def test_ids_that_no_recording_has_are_refused_by_readers(damaged, values):
    recording = Recording(damaged(within("Grains.ids", put(values, 2)), "born"))
    assert recording.frame(1, contacts=False).id.tolist() == [0, 1, 2, 3, 4]
    with pytest.raises(InputError, match="ids of frame 2 are not in ascending order"):
        recording.frame(2, contacts=False)


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (leave_a_gap_in_time, "holds frame 1 at time code 2: it must be 1"),
        (begin_at_one, "holds frame 0 at time code 1: it must be 0"),
        (lambda stage: stage.SetTimeCodesPerSecond(5e-324), "is damaged: OverflowError"),
        (lambda stage: stage.SetTimeCodesPerSecond(0), "frames per second is 0.0"),
        (scale("colors", "high"), f"high of colors is 'x': {NO_NUMBER}"),
        (scale("forces", "width"), f"width of forces is 'x': {NO_NUMBER}"),
        (within("Grains.velocities", put(Vt.Vec3fArray(3), 3)), "is damaged"),
        (within("Grains.points", put(Vt.Vec3fArray(3), 3)), "is damaged|has shape|of the grains"),
        (within("Grains.warpgrains:mass", put([1.0])), "is damaged|has shape"),
        (within("Forces.primvars:neighbour", put([5] * 5, 3)), "a grain or a wall that does not exist"),
        (within("Forces.primvars:neighbour", put([-4] * 5, 3)), "a grain or a wall that does not exist"),
    ],
)
def test_what_no_recording_has_is_refused_by_readers(damaged, damage, complaint):
    path = damaged(damage)
    for read in (lambda found: found.frame(-1), lambda found: found.to_pandas("contacts")):
        with pytest.raises(InputError, match=complaint):
            read(Recording(path))
