"""Damaged recordings: `check` names what is wrong, and readers refuse what no recording has."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt
from recordings import GRAINS, grains_of, make_frames, make_scene, record

from warpgrains.errors import InputError
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recording import Recording

COLOR, ORIENTATIONS = "primvars:displayColor:indices", "orientations"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Return the bytes of two recordings: points, and discs that rotate."""
    folder, discs = tmp_path_factory.mktemp("recordings"), make_scene(friction=0.3)
    points = record(folder / "points.usdc", make_frames(4), forces=True)
    discs = record(folder / "discs.usdc", make_frames(4), discs, draw_as="discs")
    return {path.stem: path.read_bytes() for path in (points, discs)}


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


def put(place, values, *at):
    """Return the damage that sets the values of an attribute, for all frames or at one."""
    return lambda stage: stage.GetAttributeAtPath(f"/World/{place}").Set(values, *at)


def drop(place, *at):
    def damage(stage):
        attribute = stage.GetAttributeAtPath(f"/World/{place}")
        attribute.ClearAtTime(*at) if at else attribute.Clear()

    return damage


def edit(place, entry, number, at):
    """Return the damage that sets a number in the array of a frame."""

    def damage(stage):
        attribute = stage.GetAttributeAtPath(f"/World/{place}")
        values = np.array(attribute.Get(at))
        values[entry] = number
        attribute.Set(Vt.Vec3fArray.FromNumpy(values), at)

    return damage


def remove_ids(stage):
    stage.GetPrimAtPath(GRAINS).RemoveProperty("ids")


def shift_velocities(stage):
    drop("Grains.velocities", 1)(stage)
    put("Grains.velocities", Vt.Vec3fArray(5), 1.5)(stage)


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


OTHER_CODES = "has other time codes than the grains' positions"
OTHER_TIMES = "the time codes of the grains are not 0, 1, 2, ..."
OUTSIDE = "extent does not contain all grains or bands"
FAR = "float32 coordinates are 0.0625 m apart there, but the smallest radius is 0.031 m"
NO_NUMBER = "it must be a number"

OF_POINTS = [
    (put("Grains.velocities", Vt.Vec3fArray(2), 1), "velocities hold 2 values, not 5 for 5 grains (frame 1)"),
    (shift_velocities, f"Grains.velocities {OTHER_CODES}"),
    (put("Grains.velocities", [Gf.Vec3f(np.inf)] * 5, 2), "velocities are not all finite (frame 2)"),
    (put("Grains.ids", [0, 1]), "ids hold 2 values, not 5 for 5 grains (frame 0 and 3 more)"),
    (remove_ids, "ids hold 0 values, not 5 for 5 grains (frame 0 and 3 more)"),
    (put("Grains.ids", [0, 1, 2, 3, 3]), "ids are not unique: 1 of 5 repeat another"),
    (put("Grains.ids", [4, 3, 2, 1, 0], 2), "ids change with time"),
    (put("Grains.widths", [1, 2]), "widths hold 2 values, not 5 for 5 grains (frame 0 and 3 more)"),
    (put("Grains.widths", [1, 2, -1, 2, 2]), "widths are not all positive and finite (frame 0 and 3 more)"),
    (put(f"Grains.{COLOR}", [0, 1, 2], 2), f"{COLOR} hold 3 values, not 5 for 5 grains (frame 2)"),
    (drop(f"Grains.{COLOR}", 2), f"Grains.{COLOR} {OTHER_CODES}"),
    (put(f"Grains.{COLOR}", [0, 1, 64, 3, 4], 2), f"{COLOR} are not all below 64 (frame 2)"),
    (edit("Grains.points", (3, 1), np.nan, 2), "points are not all finite (frame 2)"),
    (edit("Grains.points", (3, 1), -1e6, 2), f"points are rounded: {FAR} (frame 2)"),
    (drop("Grains.points"), "the grains have no time samples"),
    (drop("Grains.extent", 2), f"Grains.extent {OTHER_CODES}"),
    (edit("Grains.extent", (0, 0), 0.0, 3), f"{OUTSIDE} (frame 3)"),
    (edit("Grains.extent", ..., np.nan, 3), f"{OUTSIDE} (frame 3)"),
    (put("Grains.extent", Vt.Vec3fArray(1), 3), "extent is not two corners (frame 3)"),
    (put("Grains.primvars:speed", [0.1], 1), "primvars:speed hold 1 values, not 5 for 5 grains (frame 1)"),
    (drop("Forces.points", 3), f"Forces.points {OTHER_CODES}"),
    (put("Forces.faceVertexCounts", [4, 4], 1), "points hold 20 values, not 8 for 2 bands (frame 1)"),
    (
        put("Forces.faceVertexIndices", [0, 1], 1),
        "faceVertexIndices hold 2 values, not 20 for 20 corners (frame 1)",
    ),
    (put("Forces.primvars:force", [0.1], 1), "primvars:force hold 1 values, not 5 for 5 bands (frame 1)"),
    (drop("Forces.primvars:grain", 3), f"Forces.primvars:grain {OTHER_CODES}"),
    (
        put("Forces.primvars:neighbour", [1], 1),
        "primvars:neighbour hold 1 values, not 5 for 5 bands (frame 1)",
    ),
    (put("Forces.extent", Vt.Vec3fArray(2), 1), f"{OUTSIDE} (frame 1)"),
    (edit("Walls/Outer.points", (0, 0), np.inf, 0), f"Outer.points {OTHER_CODES}"),
    (lambda stage: stage.RemovePrim(GRAINS), "no UsdGeom.Points or PointInstancer at /World/Grains"),
    (
        lambda stage: stage.SetEndTimeCode(2),
        "startTimeCode and endTimeCode are 0 and 2, but the frames are 0 and 3",
    ),
    (lambda stage: stage.SetFramesPerSecond(24), "timeCodesPerSecond 50 differs from framesPerSecond 24"),
    (lambda stage: UsdGeom.SetStageUpAxis(stage, "Z"), "upAxis is Z, not Y"),
    (lambda stage: stage.ClearMetadata("metersPerUnit"), "metersPerUnit is 0.01, not 1"),
    (lambda stage: stage.ClearMetadata("kilogramsPerUnit"), "kilogramsPerUnit is missing"),
    (lambda stage: stage.ClearDefaultPrim(), "defaultPrim is missing"),
    (lambda stage: stage.RemovePrim("/World/Walls"), "no walls at /World/Walls"),
    (scale("colors", "low"), f"the scale of colors is damaged: low of colors is 'x': {NO_NUMBER}"),
    (scale("forces", "force"), f"the scale of forces is damaged: force of forces is 'x': {NO_NUMBER}"),
    (leave_a_gap_in_time, OTHER_TIMES),
    (begin_at_one, OTHER_TIMES),
    (
        put("Grains.warpgrains:mass", [1.0]),
        "warpgrains:mass hold 1 values, not 5 for 5 grains (frame 0 and 3 more)",
    ),
]
OF_DISCS = [
    (put("Grains.primvars:angle", [0.1], 1), "primvars:angle hold 1 values, not 5 for 5 grains (frame 1)"),
    (drop(f"Grains.{ORIENTATIONS}", 1), f"Grains.{ORIENTATIONS} {OTHER_CODES}"),
    (
        put(f"Grains.{ORIENTATIONS}", Vt.QuathArray(2), 1),
        f"{ORIENTATIONS} hold 2 values, not 5 for 5 grains (frame 1)",
    ),
    (
        put(f"Grains.{ORIENTATIONS}", Vt.QuathArray(5), 1),
        f"{ORIENTATIONS} are not those of the angles (frame 1)",
    ),
    (put("Grains.protoIndices", [0, 0], 0), "protoIndices hold 2 values, not 5 for 5 grains (frame 0)"),
    (put("Grains.protoIndices", [0, 16, 0, 0, 0], 1), "protoIndices are not all below 16 (frame 1)"),
    (put("Grains.scales", [Gf.Vec3f(1.5)] * 5), f"{OUTSIDE} (frame 0 and 3 more)"),
]


@pytest.mark.parametrize(
    ("form", "damage", "problem"),
    [*(("points", *each) for each in OF_POINTS), *(("discs", *each) for each in OF_DISCS)],
)
def test_names_what_is_broken(damaged, form, damage, problem):
    assert problem in inspect_recording(damaged(damage, form))


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (leave_a_gap_in_time, "holds frame 1 at time code 2: it must be 1"),
        (begin_at_one, "holds frame 0 at time code 1: it must be 0"),
        (lambda stage: stage.SetTimeCodesPerSecond(5e-324), "is damaged: OverflowError"),
        (lambda stage: stage.SetTimeCodesPerSecond(0), "frames per second is 0.0"),
        (scale("colors", "high"), f"high of colors is 'x': {NO_NUMBER}"),
        (scale("forces", "width"), f"width of forces is 'x': {NO_NUMBER}"),
        (put("Grains.velocities", Vt.Vec3fArray(3), 3), "is damaged"),
        (put("Grains.points", Vt.Vec3fArray(3), 3), "is damaged|has shape|of the grains"),
        (put("Grains.warpgrains:mass", [1.0]), "is damaged|has shape"),
        (put("Forces.primvars:neighbour", [5] * 5, 3), "a grain or a wall that does not exist"),
        (put("Forces.primvars:neighbour", [-4] * 5, 3), "a grain or a wall that does not exist"),
    ],
)
def test_what_no_recording_has_is_refused_by_readers(damaged, damage, complaint):
    path = damaged(damage)
    for read in (lambda found: found.frame(-1), lambda found: found.to_pandas("contacts")):
        with pytest.raises(InputError, match=complaint):
            read(Recording(path))
