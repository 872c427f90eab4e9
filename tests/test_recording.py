import re
from fractions import Fraction
from types import SimpleNamespace

import lightusd
import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdValidation, Vt

import warpgrains
from warpgrains.errors import SceneError
from warpgrains.inspection import inspect_recording
from warpgrains.recording import Recorder, recording_rate, recording_stride

GRAINS = "/World/Grains"


def make_scene(radius, radius_in=0.5, dt=0.01):
    return SimpleNamespace(
        radius=np.asarray(radius, dtype=float),
        radius_in=radius_in,
        radius_out=2.0,
        dt=dt,
        name="example",
        text='# grains of "many" sizes\n[time]\ndt = 0.01\n',
    )


def make_frames(count, grains, seed=0):
    """Positions and velocities, shape (count, 2, grains, 2), that float32 cannot hold exactly."""
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (count, 2, grains, 2))


def record(path, radius, frames, **scene):
    with Recorder(path, make_scene(radius, **scene), 60) as recorder:
        for position, velocity in frames:
            recorder.record(position, velocity)
    return path


RADIUS = np.array([0.1, 0.07, 0.031, 0.1, 0.2])


@pytest.fixture
def recording(tmp_path):
    return record(tmp_path / "run.usdc", RADIUS, make_frames(4, len(RADIUS)))


class TestStride:
    @pytest.mark.parametrize(
        ("dt", "wanted", "stride", "rate"),
        [
            (0.01, 60, 2, 50.0),
            (0.01, 100, 1, 100.0),
            (0.01, 1e6, 1, 100.0),
            (0.001, 60, 17, float(Fraction(1000, 17))),
            (1e-5, 60, 1667, float(Fraction(100_000, 1667))),
            (1 / 60, 60, 1, float(1 / Fraction(repr(1 / 60)))),
            (np.float64(0.1), 10, 1, 10.0),
        ],
    )
    def test_is_counted(self, dt, wanted, stride, rate):
        assert recording_stride(dt, wanted) == stride
        assert recording_rate(dt, stride) == rate

    @pytest.mark.parametrize("wanted", [0, -60, float("nan"), float("inf")])
    def test_refuses_a_rate_that_is_none(self, wanted):
        with pytest.raises(SceneError, match="frames per second"):
            recording_stride(0.01, wanted)


@pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usdz"])
class TestIndependentReader:
    def test_every_frame_equals_the_float32_state(self, tmp_path, suffix):
        frames = make_frames(7, len(RADIUS))
        path = record(tmp_path / f"run{suffix}", RADIUS, frames)
        grains = lightusd.load(str(path)).prim_at(GRAINS)
        for name, state in (("points", frames[:, 0]), ("velocities", frames[:, 1])):
            attribute = grains.attribute(name)
            assert attribute.timesamples.times == tuple(range(7))
            for code, expected in enumerate(state):
                value = np.asarray(attribute.get(code))
                assert np.array_equal(value[:, :2], expected.astype(np.float32))
                assert not value[:, 2].any()

    def test_reads_what_is_static(self, tmp_path, suffix):
        path = record(tmp_path / f"run{suffix}", RADIUS, make_frames(3, len(RADIUS)))
        stage = lightusd.load(str(path))
        grains = stage.prim_at(GRAINS)
        assert np.array_equal(grains["ids"], np.arange(len(RADIUS)))
        assert np.array_equal(grains["widths"], (2 * RADIUS).astype(np.float32))
        assert (stage.up_axis, stage.meters_per_unit, stage.default_prim_path) == ("Y", 1.0, "World")
        assert (stage.start_time, stage.end_time) == (0.0, 2.0)
        assert stage.time_codes_per_second == stage.frames_per_second == 50.0
        kept = stage.custom_layer_data["warpgrains"]
        assert kept == {
            "version": warpgrains.__version__,
            "name": "example",
            "scene": make_scene(RADIUS).text,
        }
        assert make_scene(RADIUS).text in stage.doc


class TestStage:
    def test_passes_both_checkers(self, recording):
        assert inspect_recording(recording) == []
        validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
        errors = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(recording)))
        assert [error.GetMessage() for error in errors] == []

    def test_one_width_where_all_grains_are_equal(self, tmp_path):
        path = record(tmp_path / "run.usdc", np.full(3, 0.1), make_frames(1, 3))
        stage = Usd.Stage.Open(str(path))
        points = grains_of(stage)
        assert points.GetWidthsInterpolation() == "constant"
        assert list(points.GetWidthsAttr().Get()) == [np.float32(0.2)]
        assert inspect_recording(path) == []

    @pytest.mark.parametrize(("radius_in", "walls"), [(0.5, ["Outer", "Inner"]), (0.0, ["Outer"])])
    def test_walls_stand_where_the_scene_says(self, tmp_path, radius_in, walls):
        path = record(tmp_path / "run.usdc", RADIUS, make_frames(1, len(RADIUS)), radius_in=radius_in)
        stage = Usd.Stage.Open(str(path))
        assert [prim.GetName() for prim in stage.GetPrimAtPath("/World/Walls").GetChildren()] == walls
        reach = {
            name: np.linalg.norm(
                stage.GetPrimAtPath(f"/World/Walls/{name}").GetAttribute("points").Get(), axis=1
            )
            for name in walls
        }
        assert reach["Outer"].min() == pytest.approx(2.0, rel=1e-6)
        if radius_in:
            assert reach["Inner"].max() == pytest.approx(0.5, rel=1e-6)

    def test_camera_sees_the_outer_wall(self, recording):
        stage = Usd.Stage.Open(str(recording))
        frustum = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera")).GetCamera().frustum
        assert frustum.projectionType == Gf.Frustum.Perspective
        for corner in ((2.04, 0, 0), (0, 2.04, 0), (-2.04, 0, 0), (0, -2.04, 0)):
            assert frustum.Intersects(Gf.Vec3d(corner))
        assert not frustum.Intersects(Gf.Vec3d(2.3, 0, 0))


class TestNothingHalfWritten:
    @pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
    def test_a_block_left_by_an_exception_leaves_nothing(self, tmp_path, error):
        def frames_until_the_error():
            yield from make_frames(2, len(RADIUS))
            raise error

        with pytest.raises(error):
            record(tmp_path / "run.usdc", RADIUS, frames_until_the_error())
        assert list(tmp_path.iterdir()) == []

    def test_an_earlier_file_stays_until_the_new_one_is_whole(self, recording):
        before = recording.read_bytes()
        with pytest.raises(KeyboardInterrupt), Recorder(recording, make_scene(RADIUS), 60):
            raise KeyboardInterrupt
        assert recording.read_bytes() == before
        record(recording, RADIUS, make_frames(2, len(RADIUS)))
        assert recording.read_bytes() != before
        assert list(recording.parent.iterdir()) == [recording]

    def test_frames_lost_in_writing_are_noticed(self, tmp_path, monkeypatch):
        monkeypatch.setattr(Sdf.Layer, "Export", lambda layer, name: Usd.Stage.CreateNew(name).Save())
        with pytest.raises(OSError, match="holds 0 frames of 1"):
            record(tmp_path / "run.usdc", RADIUS, make_frames(1, len(RADIUS)))
        assert list(tmp_path.iterdir()) == []

    def test_the_arrays_handed_in_may_be_reused(self, tmp_path):
        frames = make_frames(3, len(RADIUS))
        buffer = np.empty_like(frames[0])
        with Recorder(tmp_path / "run.usdc", make_scene(RADIUS), 60) as recorder:
            for frame in frames:
                buffer[:] = frame
                recorder.record(*buffer)
        stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
        points = grains_of(stage).GetPointsAttr()
        written = np.array([points.Get(code) for code in range(3)])
        assert np.array_equal(written[:, :, :2], frames[:, 0].astype(np.float32))

    def test_arrays_of_another_shape_are_refused(self, tmp_path):
        recorder = Recorder(tmp_path / "run.usdc", make_scene(RADIUS), 60)
        with pytest.raises(ValueError, match=re.escape("(5, 2), not (4, 2)")):
            recorder.record(np.zeros((4, 2)), np.zeros((5, 2)))
        with pytest.raises(ValueError, match="nothing was recorded"):
            recorder.close()


class TestOutput:
    @pytest.mark.parametrize("name", ["run.obj", "run", "run.usd"])
    def test_unknown_suffix(self, tmp_path, name):
        with pytest.raises(SceneError, match=re.escape("must end in .usdc, .usda, .usdz")):
            Recorder(tmp_path / name, make_scene(RADIUS), 60)

    def test_folder_that_does_not_exist(self, tmp_path):
        with pytest.raises(SceneError, match="absent' cannot be written: No such file"):
            Recorder(tmp_path / "absent" / "run.usdc", make_scene(RADIUS), 60)

    def test_folder_that_is_a_file(self, tmp_path):
        (tmp_path / "file").touch()
        with pytest.raises(SceneError, match="file' cannot be written: Not a directory"):
            Recorder(tmp_path / "file" / "run.usdc", make_scene(RADIUS), 60)

    def test_folder_that_refuses_files(self):
        with pytest.raises(SceneError, match="'/proc' cannot be written"):
            Recorder("/proc/run.usdc", make_scene(RADIUS), 60)

    def test_output_that_is_a_folder(self, tmp_path):
        (tmp_path / "run.usdc").mkdir()
        with pytest.raises(SceneError, match="is a folder"):
            Recorder(tmp_path / "run.usdc", make_scene(RADIUS), 60)


def grains_of(stage):
    return UsdGeom.Points(stage.GetPrimAtPath(GRAINS))


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


def repeat_an_id(stage):
    grains_of(stage).GetIdsAttr().Set([0, 1, 2, 3, 3])


def shorten_widths(stage):
    grains_of(stage).GetWidthsAttr().Set([0.1, 0.2])


def make_a_width_negative(stage):
    grains_of(stage).GetWidthsAttr().Set([0.1, 0.2, -0.1, 0.2, 0.2])


def shorten_colours(stage):
    grains_of(stage).GetDisplayColorPrimvar().Set(Vt.Vec3fArray(3))


def put_a_nan_in_points(stage):
    points = grains_of(stage).GetPointsAttr()
    broken = np.array(points.Get(2))
    broken[3, 1] = np.nan
    points.Set(Vt.Vec3fArray.FromNumpy(broken), 2)


def put_an_infinity_in_velocities(stage):
    grains_of(stage).GetVelocitiesAttr().Set(Vt.Vec3fArray(5, Gf.Vec3f(np.inf)), 2)


def drop_an_extent(stage):
    grains_of(stage).GetExtentAttr().ClearAtTime(2)


def tighten_an_extent(stage):
    extent = grains_of(stage).GetExtentAttr()
    low, high = extent.Get(3)
    extent.Set([low + Gf.Vec3f(1e-6, 0, 0), high], 3)


def leave_a_gap_in_time(stage):
    grains = grains_of(stage)
    for attribute in (grains.GetPointsAttr(), grains.GetVelocitiesAttr(), grains.GetExtentAttr()):
        attribute.ClearAtTime(1)


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


class TestInspection:
    @pytest.mark.parametrize(
        ("damage", "problem"),
        [
            (drop_the_grains, "there is no UsdGeom.Points at /World/Grains"),
            (shorten_velocities, "velocities hold 2 values, not 5 as points ask for (frame 1)"),
            (shift_velocities, "velocities and points have different time codes"),
            (shorten_ids, "ids hold 2 values, not 5 as points ask for (frame 0 and 3 more)"),
            (repeat_an_id, "ids are not unique: 1 of 5 repeat another"),
            (shorten_widths, "widths hold 2 values, not 5 as points ask for (frame 0 and 3 more)"),
            (make_a_width_negative, "widths are not all positive and finite"),
            (
                shorten_colours,
                "primvars:displayColor hold 3 values, not 5 as points ask for (frame 0 and 3 more)",
            ),
            (put_a_nan_in_points, "points are not all finite (frame 2)"),
            (put_an_infinity_in_velocities, "velocities are not all finite (frame 2)"),
            (drop_an_extent, "extent and points have different time codes"),
            (tighten_an_extent, "extent does not cover the discs (frame 3)"),
            (leave_a_gap_in_time, "the time codes of points are not consecutive integers"),
            (end_too_early, "startTimeCode and endTimeCode are 0 and 2, the frames 0 to 3"),
            (lie_about_the_rate, "timeCodesPerSecond 50 differs from framesPerSecond 24"),
            (turn_upright, "upAxis is Z, not Y"),
            (measure_in_centimetres, "metersPerUnit is 0.01, not 1"),
            (weigh_in_nothing, "kilogramsPerUnit is not stated"),
            (forget_the_default, "there is no defaultPrim"),
            (drop_all_frames, "points have no frames"),
        ],
        ids=lambda value: getattr(value, "__name__", ""),
    )
    def test_names_what_is_broken(self, recording, damage, problem):
        stage = Usd.Stage.Open(str(recording))
        damage(stage)
        stage.Save()
        assert problem in inspect_recording(recording)

    def test_refuses_what_is_not_usd(self, tmp_path):
        with pytest.raises(SceneError, match=r"absent\.usdc' does not exist"):
            inspect_recording(tmp_path / "absent.usdc")
        (tmp_path / "text.usdc").write_text("not a stage")
        with pytest.raises(SceneError, match=r"text\.usdc' is not a USD file"):
            inspect_recording(tmp_path / "text.usdc")
        (tmp_path / "text.obj").write_text("not a stage")
        with pytest.raises(SceneError, match=r"text\.obj' is not a USD file"):
            inspect_recording(tmp_path / "text.obj")

    def test_refuses_half_a_file(self, recording):
        recording.write_bytes(recording.read_bytes()[:-200])
        with pytest.raises(SceneError, match="is not a USD file"):
            inspect_recording(recording)
