import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt
from recordings import GRAINS, grains_of, make_frames, make_scene, record

from warpgrains.errors import InputError
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recording import Recording

COLOR, ORIENTATIONS = "primvars:displayColor:indices", "orientations"


@pytest.fixture
def recording(tmp_path):
    return record(tmp_path / "run.usdc", make_frames(4), color_by="speed", forces=True)


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


OTHER_CODES = "has other time codes than the grains' positions"
OUTSIDE = "extent does not contain all grains or bands"
FAR = "float32 coordinates are 0.0625 m apart there, but the smallest radius is 0.031 m"

OF_AN_ATTRIBUTE = [
    ("Grains.velocities", put(Vt.Vec3fArray(2), 1), "velocities hold 2 values, not 5 for 5 grains (frame 1)"),
    ("Grains.velocities", shift, f"Grains.velocities {OTHER_CODES}"),
    (
        "Grains.velocities",
        put(Vt.Vec3fArray(5, Gf.Vec3f(np.inf)), 2),
        "velocities are not all finite (frame 2)",
    ),
    ("Grains.ids", put([0, 1]), "ids hold 2 values, not 5 for 5 grains (frame 0 and 3 more)"),
    ("Grains.ids", remove, "ids hold 0 values, not 5 for 5 grains (frame 0 and 3 more)"),
    ("Grains.ids", put([0, 1, 2, 3, 3]), "ids are not unique: 1 of 5 repeat another"),
    ("Grains.ids", put([4, 3, 2, 1, 0], 2), "ids change with time"),
    ("Grains.widths", put([0.1, 0.2]), "widths hold 2 values, not 5 for 5 grains (frame 0 and 3 more)"),
    (
        "Grains.widths",
        put([0.1, 0.2, -0.1, 0.2, 0.2]),
        "widths are not all positive and finite (frame 0 and 3 more)",
    ),
    (f"Grains.{COLOR}", put([0, 1, 2], 2), f"{COLOR} hold 3 values, not 5 for 5 grains (frame 2)"),
    (f"Grains.{COLOR}", drop(2), f"Grains.{COLOR} {OTHER_CODES}"),
    (f"Grains.{COLOR}", put([0, 1, 64, 3, 4], 2), f"{COLOR} are not all below 64 (frame 2)"),
    ("Grains.points", edit((3, 1), np.nan, 2), "points are not all finite (frame 2)"),
    ("Grains.points", edit((3, 1), -1e6, 2), f"points are rounded: {FAR} (frame 2)"),
    ("Grains.points", drop(), "the grains have no time samples"),
    ("Grains.extent", drop(2), f"Grains.extent {OTHER_CODES}"),
    ("Grains.extent", edit((0, 0), 0.0, 3), f"{OUTSIDE} (frame 3)"),
    ("Grains.extent", edit(..., np.nan, 3), f"{OUTSIDE} (frame 3)"),
    ("Grains.extent", put(Vt.Vec3fArray(1), 3), "extent is not two corners (frame 3)"),
    ("Grains.primvars:speed", put([0.1], 1), "primvars:speed hold 1 values, not 5 for 5 grains (frame 1)"),
    (
        "Grains.warpgrains:mass",
        put([1.0]),
        "warpgrains:mass hold 1 values, not 5 for 5 grains (frame 0 and 3 more)",
    ),
    ("Forces.points", drop(3), f"Forces.points {OTHER_CODES}"),
    ("Forces.faceVertexCounts", put([4, 4], 1), "points hold 20 values, not 8 for 2 bands (frame 1)"),
    (
        "Forces.faceVertexIndices",
        put([0, 1], 1),
        "faceVertexIndices hold 2 values, not 20 for 20 corners (frame 1)",
    ),
    ("Forces.primvars:force", put([0.1], 1), "primvars:force hold 1 values, not 5 for 5 bands (frame 1)"),
    ("Forces.primvars:grain", drop(3), f"Forces.primvars:grain {OTHER_CODES}"),
    (
        "Forces.primvars:neighbour",
        put([1], 1),
        "primvars:neighbour hold 1 values, not 5 for 5 bands (frame 1)",
    ),
    ("Forces.extent", put(Vt.Vec3fArray(2), 1), f"{OUTSIDE} (frame 1)"),
    ("Walls/Outer.points", edit((0, 0), np.inf, 0), f"Outer.points {OTHER_CODES}"),
]
OF_ROTATION = [
    ("primvars:angle", put([0.1], 1), "primvars:angle hold 1 values, not 5 for 5 grains (frame 1)"),
    (ORIENTATIONS, drop(1), f"Grains.{ORIENTATIONS} {OTHER_CODES}"),
    (ORIENTATIONS, put(Vt.QuathArray(2), 1), f"{ORIENTATIONS} hold 2 values, not 5 for 5 grains (frame 1)"),
    (ORIENTATIONS, put(Vt.QuathArray(5), 1), f"{ORIENTATIONS} are not those of the angles (frame 1)"),
]


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


OF_THE_STAGE = [
    (lambda stage: stage.RemovePrim(GRAINS), "no UsdGeom.Points or PointInstancer at /World/Grains"),
    (leave_a_gap_in_time, "the time codes of the grains are not 0, 1, 2, ..."),
    (begin_at_one, "the time codes of the grains are not 0, 1, 2, ..."),
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
    (scale("colors", "low"), "the scale of colors is damaged: low of colors is 'x': it must be a number"),
    (scale("forces", "force"), "the scale of forces is damaged: force of forces is 'x': it must be a number"),
]


def within(place, damage):
    return lambda stage: damage(stage.GetAttributeAtPath(f"/World/{place}"))


def damaged(path, damage):
    stage = Usd.Stage.Open(str(path))
    damage(stage)
    stage.Save()
    return path


@pytest.mark.parametrize(
    ("damage", "problem"),
    [*((within(place, damage), problem) for place, damage, problem in OF_AN_ATTRIBUTE), *OF_THE_STAGE],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_names_what_is_broken(recording, damage, problem):
    assert problem in inspect_recording(damaged(recording, damage))


@pytest.mark.parametrize(("name", "damage", "problem"), OF_ROTATION)
def test_names_what_is_broken_of_rotation(tmp_path, name, damage, problem):
    recording = record(tmp_path / "run.usdc", make_frames(3), make_scene(friction=0.3), draw_as="discs")
    assert problem in inspect_recording(damaged(recording, within(f"Grains.{name}", damage)))


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (leave_a_gap_in_time, "holds frame 1 at time code 2: it must be 1"),
        (begin_at_one, "holds frame 0 at time code 1: it must be 0"),
        (lambda stage: stage.SetTimeCodesPerSecond(5e-324), "is damaged: OverflowError"),
        (lambda stage: stage.SetTimeCodesPerSecond(0), "frames per second is 0.0"),
        (scale("colors", "high"), "high of colors is 'x': it must be a number"),
        (scale("forces", "width"), "width of forces is 'x': it must be a number"),
        (within("Grains.velocities", put(Vt.Vec3fArray(3), 3)), "is damaged"),
        (within("Grains.points", put(Vt.Vec3fArray(3), 3)), "is damaged|has shape|of the grains"),
        (within("Grains.warpgrains:mass", put([1.0])), "is damaged|has shape"),
        (within("Forces.primvars:neighbour", put([5] * 5, 3)), "a grain or a wall that does not exist"),
        (within("Forces.primvars:neighbour", put([-4] * 5, 3)), "a grain or a wall that does not exist"),
    ],
)
def test_what_no_recording_has_is_refused_by_readers(recording, damage, complaint):
    damaged(recording, damage)
    for read in (lambda found: found.frame(-1), lambda found: found.to_pandas("contacts")):
        with pytest.raises(InputError, match=complaint):
            read(Recording(recording))


def test_spheres_are_inspected_too(tmp_path):
    recording = record(tmp_path / "run.usdc", make_frames(2), draw_as="spheres")
    stage = Usd.Stage.Open(str(recording))
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath(GRAINS))
    wider = 1.5 * np.array(instancer.GetScalesAttr().Get())
    instancer.GetScalesAttr().Set(Vt.Vec3fArray.FromNumpy(wider))
    instancer.GetProtoIndicesAttr().Set([0, 0], 0)
    instancer.GetProtoIndicesAttr().Set([0, 16, 0, 0, 0], 1)
    stage.Save()
    assert inspect_recording(recording) == [
        "protoIndices hold 2 values, not 5 for 5 grains (frame 0)",
        "extent does not contain all grains or bands (frame 0 and 1 more)",
        "protoIndices are not all below 16 (frame 1)",
    ]
