import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt
from recordings import GRAINS, grains_of, make_frames, record

from warpgrains.analysis.recording import Recording
from warpgrains.errors import InputError
from warpgrains.usd.check import inspect_recording


@pytest.fixture
def recording(tmp_path):
    return record(tmp_path / "run.usdc", make_frames(4), color_by="speed", forces=True)


def forces_of(stage):
    return UsdGeom.Mesh(stage.GetPrimAtPath("/World/Forces"))


def drop_the_grains(stage):
    stage.RemovePrim(GRAINS)


def shorten_velocities(stage):
    grains_of(stage).GetVelocitiesAttr().Set(Vt.Vec3fArray(2), 1)


def shift_velocities(stage):
    velocities = grains_of(stage).GetVelocitiesAttr()
    velocities.ClearAtTime(1)
    velocities.Set(Vt.Vec3fArray(5), 1.5)


def shorten_ids(stage):
    grains_of(stage).GetIdsAttr().Set([0, 1])


def drop_the_ids(stage):
    grains_of(stage).GetPrim().RemoveProperty("ids")


def repeat_an_id(stage):
    grains_of(stage).GetIdsAttr().Set([0, 1, 2, 3, 3])


def change_the_ids(stage):
    grains_of(stage).GetIdsAttr().Set([4, 3, 2, 1, 0], 2)


def shorten_widths(stage):
    grains_of(stage).GetWidthsAttr().Set([0.1, 0.2])


def make_a_width_negative(stage):
    grains_of(stage).GetWidthsAttr().Set([0.1, 0.2, -0.1, 0.2, 0.2])


def shorten_colors(stage):
    grains_of(stage).GetDisplayColorPrimvar().SetIndices([0, 1, 2], 2)


def drop_a_color(stage):
    grains_of(stage).GetDisplayColorPrimvar().GetIndicesAttr().ClearAtTime(2)


def name_a_color_beyond_the_table(stage):
    grains_of(stage).GetDisplayColorPrimvar().SetIndices([0, 1, 64, 3, 4], 2)


def put_a_nan_in_points(stage):
    points = grains_of(stage).GetPointsAttr()
    broken = np.array(points.Get(2))
    broken[3, 1] = np.nan
    points.Set(Vt.Vec3fArray.FromNumpy(broken), 2)


def put_an_infinity_in_velocities(stage):
    grains_of(stage).GetVelocitiesAttr().Set(Vt.Vec3fArray(5, Gf.Vec3f(np.inf)), 2)


def put_a_point_far_away(stage):
    points = grains_of(stage).GetPointsAttr()
    far = np.array(points.Get(2))
    far[3, 1] = -1e6
    points.Set(Vt.Vec3fArray.FromNumpy(far), 2)


def drop_an_extent(stage):
    grains_of(stage).GetExtentAttr().ClearAtTime(2)


def tighten_an_extent(stage):
    extent = grains_of(stage).GetExtentAttr()
    low, high = extent.Get(3)
    extent.Set([low + Gf.Vec3f(1e-6, 0, 0), high], 3)


def leave_a_gap_in_time(stage):
    for attribute in grains_of(stage).GetPrim().GetAttributes():
        attribute.ClearAtTime(1)


def begin_at_one(stage):
    for attribute in grains_of(stage).GetPrim().GetAttributes():
        for code in reversed(attribute.GetTimeSamples()):
            attribute.Set(attribute.Get(code), code + 1)
            attribute.ClearAtTime(code)


def end_too_early(stage):
    stage.SetEndTimeCode(2)


def lie_about_the_rate(stage):
    stage.SetFramesPerSecond(24)


def turn_upright(stage):
    UsdGeom.SetStageUpAxis(stage, "Z")


def measure_in_centimetres(stage):
    stage.ClearMetadata("metersPerUnit")


def weigh_in_nothing(stage):
    stage.ClearMetadata("kilogramsPerUnit")


def forget_the_default(stage):
    stage.ClearDefaultPrim()


def drop_all_frames(stage):
    grains_of(stage).GetPointsAttr().Clear()


def drop_forces_of_a_frame(stage):
    forces_of(stage).GetPointsAttr().ClearAtTime(3)


def shorten_segments(stage):
    forces_of(stage).GetFaceVertexCountsAttr().Set([4, 4], 1)


def shorten_raw_forces(stage):
    UsdGeom.PrimvarsAPI(forces_of(stage)).GetPrimvar("force").Set([0.1], 1)


def shorten_raw_speeds(stage):
    UsdGeom.PrimvarsAPI(grains_of(stage)).GetPrimvar("speed").Set([0.1], 1)


def shorten_exact_masses(stage):
    grains_of(stage).GetPrim().GetAttribute("warpgrains:mass").Set([1.0])


def lose_the_grains_of_forces(stage):
    UsdGeom.PrimvarsAPI(forces_of(stage)).GetPrimvar("grain").GetAttr().ClearAtTime(3)


def shorten_the_neighbors_of_forces(stage):
    UsdGeom.PrimvarsAPI(forces_of(stage)).GetPrimvar("neighbour").Set([1], 1)


def shrink_the_extent_of_forces(stage):
    forces_of(stage).GetExtentAttr().Set(Vt.Vec3fArray(2), 1)


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (drop_the_grains, "no UsdGeom.Points or PointInstancer at /World/Grains"),
        (shorten_velocities, "velocities hold 2 values, not 5 for 5 grains (frame 1)"),
        (shift_velocities, "Grains.velocities has other time codes than the grains' positions"),
        (shorten_ids, "ids hold 2 values, not 5 for 5 grains (frame 0 and 3 more)"),
        (drop_the_ids, "ids hold 0 values, not 5 for 5 grains (frame 0 and 3 more)"),
        (repeat_an_id, "ids are not unique: 1 of 5 repeat another"),
        (change_the_ids, "ids change with time"),
        (shorten_widths, "widths hold 2 values, not 5 for 5 grains (frame 0 and 3 more)"),
        (make_a_width_negative, "widths are not all positive and finite"),
        (shorten_colors, "primvars:displayColor:indices hold 3 values, not 5 for 5 grains (frame 2)"),
        (
            drop_a_color,
            "Grains.primvars:displayColor:indices has other time codes than the grains' positions",
        ),
        (name_a_color_beyond_the_table, "primvars:displayColor:indices are not all below 64 (frame 2)"),
        (put_a_nan_in_points, "points are not all finite (frame 2)"),
        (
            put_a_point_far_away,
            "points are rounded: float32 coordinates are 0.0625 m apart there,"
            " but the smallest radius is 0.031 m (frame 2)",
        ),
        (put_an_infinity_in_velocities, "velocities are not all finite (frame 2)"),
        (drop_an_extent, "Grains.extent has other time codes than the grains' positions"),
        (tighten_an_extent, "extent does not contain all grains or bands (frame 3)"),
        (leave_a_gap_in_time, "the time codes of the grains are not 0, 1, 2, ..."),
        (begin_at_one, "the time codes of the grains are not 0, 1, 2, ..."),
        (end_too_early, "startTimeCode and endTimeCode are 0 and 2, but the frames are 0 to 3"),
        (lie_about_the_rate, "timeCodesPerSecond 50 differs from framesPerSecond 24"),
        (turn_upright, "upAxis is Z, not Y"),
        (measure_in_centimetres, "metersPerUnit is 0.01, not 1"),
        (weigh_in_nothing, "kilogramsPerUnit is missing"),
        (forget_the_default, "defaultPrim is missing"),
        (drop_all_frames, "the grains have no time samples"),
        (drop_forces_of_a_frame, "Forces.points has other time codes than the grains' positions"),
        (shorten_segments, "points hold 20 values, not 8 for 2 bands (frame 1)"),
        (shorten_raw_forces, "primvars:force hold 1 values, not 5 for 5 bands (frame 1)"),
        (lose_the_grains_of_forces, "Forces.primvars:grain has other time codes than the grains' positions"),
        (shorten_the_neighbors_of_forces, "primvars:neighbour hold 1 values, not 5 for 5 bands (frame 1)"),
        (shorten_raw_speeds, "primvars:speed hold 1 values, not 5 for 5 grains (frame 1)"),
        (shorten_exact_masses, "warpgrains:mass hold 1 values, not 5 for 5 grains (frame 0 and 3 more)"),
        (shrink_the_extent_of_forces, "extent does not contain all grains or bands (frame 1)"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_names_what_is_broken(recording, damage, problem):
    stage = Usd.Stage.Open(str(recording))
    damage(stage)
    stage.Save()
    assert problem in inspect_recording(recording)


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (leave_a_gap_in_time, "holds frame 1 at time code 2: it must be 1"),
        (begin_at_one, "holds frame 0 at time code 1: it must be 0"),
        (lambda stage: stage.SetTimeCodesPerSecond(5e-324), "is damaged: OverflowError"),
        (lambda stage: stage.SetTimeCodesPerSecond(0), "frames per second is 0.0"),
    ],
    ids=["a gap", "a later start", "endless frames", "no rate"],
)
def test_times_that_no_recording_has_are_refused(recording, damage, complaint):
    stage = Usd.Stage.Open(str(recording))
    damage(stage)
    stage.Save()
    with pytest.raises(InputError, match=complaint):
        Recording(recording)


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


def test_refuses_what_is_not_usd(tmp_path):
    with pytest.raises(InputError, match=r"absent\.usdc' does not exist"):
        inspect_recording(tmp_path / "absent.usdc")
    for name in ("text.usdc", "text.obj"):
        (tmp_path / name).write_text("not a stage")
        with pytest.raises(InputError, match=f"{name}' is not a USD file"):
            inspect_recording(tmp_path / name)


def test_refuses_half_a_file(recording):
    recording.write_bytes(recording.read_bytes()[:-200])
    with pytest.raises(InputError, match="is not a USD file"):
        inspect_recording(recording)
