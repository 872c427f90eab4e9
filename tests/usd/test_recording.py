import re
from dataclasses import replace
from itertools import product

import lightusd
import numpy as np
import pytest
from command import exit_code, require_refusal
from pxr import Usd, UsdGeom, UsdValidation
from recordings import (
    GRAINS,
    RADIUS,
    grains_of,
    make_contacts,
    make_frames,
    make_scene,
    moment,
    moments,
    record,
    recorder_of,
)
from walled_scenes import boxed

import warpgrains
from warpgrains import Recording, Scene, Segment, Simulation
from warpgrains.analysis.snapshot import snapshot, snapshot_of
from warpgrains.drawing.colorings import speed_scale
from warpgrains.drawing.frames import FrameTimes
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.errors import InputError, OutputError
from warpgrains.scene.toml import read_parameters
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.grains import position_of
from warpgrains.usd.recorder import log_of, recover

FRICTION = make_scene(friction=0.3)
DRAWINGS = {
    "points": (None, {}),
    "discs": (None, {"draw_as": "discs", "color_by": "radius"}),
    "spheres": (None, {"draw_as": "spheres"}),
    "forces": (None, {"draw_as": "discs", "color_by": "pressure", "forces": True}),
    "rotation": (FRICTION, {"draw_as": "discs", "color_by": "spin", "forces": True}),
}
drawn = pytest.mark.parametrize(("scene", "options"), DRAWINGS.values(), ids=list(DRAWINGS))


class TestTimes:
    @pytest.mark.parametrize(
        ("dt", "wanted", "rate", "steps"),
        [
            (0.01, 24, 24, [0, 5, 9, 13, 17, 21, 25]),
            (0.01, 25, 25, [0, 4, 8, 12]),
            (0.01, 30, 30, [0, 4, 7, 10]),
            (0.01, 50, 50, [0, 2, 4, 6]),
            (0.01, 60, 60, [0, 2, 4, 5, 7, 9, 10]),
            (0.01, 100, 100, [0, 1, 2, 3]),
            (0.01, 1e6, 100, [0, 1, 2, 3]),
            (0.001, 60, 60, [0, 17, 34, 50]),
            (1 / 60, 60, 60, [0, 1, 2, 3]),
            (1 / 3, 24, 3, [0, 1, 2, 3]),
            (np.float64(0.1), 10, 10, [0, 1, 2, 3]),
        ],
    )
    def test_frames_lie_in_steps(self, dt, wanted, rate, steps):
        times = FrameTimes.of(dt, wanted)
        assert times.rate == pytest.approx(rate, rel=1e-15)
        assert [times.step(k) for k in range(len(steps))] == steps
        assert FrameTimes(dt, times.rate).step(10**5) == pytest.approx(10**5 / rate / dt, abs=1)

    @pytest.mark.parametrize("fps", [24, 25, 30, 50, 60])
    def test_frames_show_the_path_at_their_times(self, fps):
        """Grains that fly and spin freely are, in every frame, where they are at its time."""
        flight = {"velocity": [(0.1, -0.2)], "spin": 3.0, "gravity": (0.0, 0.0), "friction": 0.3}
        simulation = Simulation(Scene(position=[(1.0, 0.3)], radius=0.1, mass=1.0, radius_out=2.0, **flight))
        times = FrameTimes.of(0.01, fps)
        for k in range(2 * fps + 1):
            simulation.advance(times.step(k) - simulation.steps) if times.step(k) > simulation.steps else None
            now = snapshot_of(simulation, times.left(k))
            assert now.time == times.time(k) == pytest.approx(k / fps, rel=1e-12)
            # a hundredth step adds up to 200 roundings of 1e-16
            assert np.allclose(now.position, [(1.0, 0.3)] + k / fps * now.velocity, rtol=0, atol=1e-13)
            assert np.allclose(now.angle, k / fps * 3.0, rtol=0, atol=1e-12)
            if (k * 100) % fps == 0:
                assert np.array_equal(now.position, simulation.position)

    def test_rate_that_is_lowered_is_reported(self, tmp_path):
        simulation = Simulation(Scene.load("annulus"))
        with pytest.warns(UserWarning, match="fps 1000 cannot be met: .* of 0.01 s there are 100") as warned:
            simulation.run(steps=1, record=tmp_path / "run.usdc", fps=1000)
        assert [warning.filename for warning in warned] == [__file__]

    def test_recordings_play_in_real_time(self, tmp_path):
        Simulation(Scene.load("annulus")).run(duration=1.0, record=tmp_path / "run.usdc", fps=24)
        stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
        assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == stage.GetEndTimeCode() == 24


@pytest.mark.parametrize("suffix", RECORDINGS)
@drawn
def test_every_frame_equals_the_float32_state_and_passes_checks(tmp_path, suffix, scene, options):
    """As an independent reader, our check and USD's validators see it."""
    frames = make_frames(7)
    path = record(tmp_path / f"run{suffix}", frames, scene, **options)
    grains = lightusd.load(str(path)).prim_at(GRAINS)
    places = "points" if options.get("draw_as", "points") == "points" else "positions"
    for name, state in ((places, frames[:, 0]), ("velocities", frames[:, 1])):
        attribute = grains.attribute(name)
        assert attribute.timesamples.times == tuple(range(7))
        for code, expected in enumerate(state):
            value = np.asarray(attribute.get(code))
            assert np.array_equal(value[:, :2], expected.astype(np.float32))
            assert not value[:, 2].any()
    assert inspect_recording(path) == []
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))
    assert [error.GetMessage() for error in errors] == []


@pytest.mark.parametrize("kind", ["shear", "everywhere", "walls", "closed"])
@pytest.mark.parametrize("options", [{}, {"draw_as": "discs"}, {"draw_as": "spheres", "color_by": "radius"}])
def test_a_box_is_recorded_with_images_and_read_back_without(tmp_path, kind, options):
    """Points are in the box, and go on beyond it for `Recording`; float32 rounds them by 6e-8."""
    path, simulation = tmp_path / "run.usdc", Simulation(boxed(kind, 80))
    simulation.run(steps=40, record=path, fps=20, forces=True, **options)
    now, found = snapshot(simulation), Recording(path).frame(-1)
    assert inspect_recording(path) == []
    stage, validators = Usd.Stage.Open(str(path)), UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetMessage() for error in errors] == []
    assert found.position == pytest.approx(now.position, abs=6e-8)
    assert np.array_equal(found.pair, now.pair)
    assert np.array_equal(found.wall, now.wall)
    assert found.force == pytest.approx(now.force, rel=6e-8)
    prim, end, n = stage.GetPrimAtPath(GRAINS), stage.GetEndTimeCode(), now.n
    points, radius = position_of(prim).Get(end), prim.GetAttribute("primvars:radius").Get(end)
    points, period, high = np.array(points)[:, :2], now.scene.period, np.array([1.0, 0.7])
    assert ((points[:n] >= -6e-8) & (points[:n] <= high + 6e-8)).all()
    ways = np.unique(np.array([*product((-1, 0, 1), repeat=2)]) * period, axis=0)
    images = np.concatenate([np.zeros((0, 2)), *(points[:n] + way for way in ways if way.any())])
    reach = np.resize(now.scene.radius, len(images))[:, np.newaxis]
    crosses = ((images + reach > 0.0) & (images - reach < high)).all(axis=1)
    expected = np.column_stack([images, reach])[crosses]
    shown = np.column_stack([points, radius])[n:]
    assert shown[np.lexsort(shown.T)] == pytest.approx(expected[np.lexsort(expected.T)], abs=2e-7)
    assert len(expected) or kind == "closed"


@pytest.mark.parametrize("suffix", RECORDINGS)
def test_an_independent_reader_reads_what_is_static(tmp_path, suffix):
    stage = lightusd.load(str(record(tmp_path / f"run{suffix}", make_frames(3))))
    grains, scene = stage.prim_at(GRAINS), make_scene()
    assert np.array_equal(grains["ids"], np.arange(len(RADIUS)))
    assert np.array_equal(grains["widths"], (2 * RADIUS).astype(np.float32))
    assert (stage.up_axis, stage.meters_per_unit, stage.default_prim_path) == ("Y", 1.0, "World")
    assert (stage.start_time, stage.end_time) == (0.0, 2.0)
    assert stage.time_codes_per_second == stage.frames_per_second == 50.0
    kept = stage.custom_layer_data["warpgrains"]
    scale = {"quantity": "speed", "unit": "m/s", "colormap": "viridis", "low": 0.0}
    assert kept.pop("colors") == scale | {"high": speed_scale(scene)}
    assert read_parameters(kept.pop("parameters"))["dt"] == scene.dt
    texts = {"version": warpgrains.__version__, "name": "example", "scene": scene.text}
    assert kept == {**texts, "draw_as": "points", "first_step": 0}
    assert scene.text in stage.doc


def test_one_width_where_all_grains_are_equal(stage_of):
    stage = stage_of(1, make_scene(np.full(3, 0.1)))
    assert grains_of(stage).GetWidthsInterpolation() == "constant"
    assert list(grains_of(stage).GetWidthsAttr().Get()) == [np.float32(0.2)]


@drawn
def test_no_primvar_is_a_double(stage_of, scene, options):
    """Blender reads no primvar after the first one. Other attributes hold the bits of the scene."""
    scene = (scene or make_scene()).replace(mass=RADIUS / 3.0)
    stage = stage_of(1, scene, **options)
    primvars = [own for prim in stage.TraverseAll() for own in UsdGeom.PrimvarsAPI(prim).GetPrimvars()]
    assert not [own.GetName() for own in primvars if str(own.GetTypeName()).startswith("double")]
    grains = stage.GetPrimAtPath(GRAINS)
    for name, exact in (("mass", scene.mass), ("radius", RADIUS)):
        assert np.array_equal(grains.GetAttribute(f"warpgrains:{name}").Get(), exact)
        assert np.array_equal(grains.GetAttribute(f"primvars:{name}").Get(), exact.astype(np.float32))


@pytest.mark.parametrize("draw_as", ["discs", "spheres"])
def test_instances_have_the_radii_of_the_grains(stage_of, draw_as):
    stage = stage_of(draw_as=draw_as)
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath(GRAINS))
    scales = np.array(instancer.GetScalesAttr().Get())
    assert np.array_equal(scales, np.repeat(RADIUS.astype(np.float32)[:, np.newaxis], 3, axis=1))
    for prototype in instancer.GetPrototypesRel().GetTargets():
        points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath(prototype)).GetPointsAttr().Get())
        across = points if draw_as == "spheres" else points[:, :2]
        assert np.linalg.norm(across, axis=1).max() == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("walls", [{"Outer": (min, 2.0), "Inner": (max, 0.5)}, {"Outer": (min, 2.0)}])
def test_walls_stand_where_the_scene_says(stage_of, walls):
    stage = stage_of(1, make_scene(radius_in=0.5 if "Inner" in walls else 0.0))
    found = stage.GetPrimAtPath("/World/Walls").GetChildren()
    assert [prim.GetName() for prim in found] == list(walls)
    for prim, (end, radius) in zip(found, walls.values(), strict=True):
        points, normals = (np.array(prim.GetAttribute(name).Get()) for name in ("points", "normals"))
        assert end(np.linalg.norm(points, axis=1)) == pytest.approx(radius, rel=1e-6)
        assert np.array_equal(normals, np.tile([0, 0, 1], (len(points), 1)))


def test_the_arrays_handed_in_may_be_reused(tmp_path):
    frames = make_frames(3)
    buffer = np.empty_like(frames[0])
    with recorder_of(tmp_path / "run.usdc") as recorder:
        for frame in frames:
            buffer[:] = frame
            recorder.record(moment(*buffer))
    stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
    written = np.array([grains_of(stage).GetPointsAttr().Get(code) for code in range(3)])
    assert np.array_equal(written[:, :, :2], frames[:, 0].astype(np.float32))


def test_a_run_without_frames_leaves_nothing(tmp_path):
    with pytest.raises(ValueError, match="no frame was recorded"), recorder_of(tmp_path / "run.usdc"):
        pass
    assert list(tmp_path.iterdir()) == []


FAR, UNIT = np.full((5, 2), 1e39), np.full(5, -1e39)
LARGE = {name: 1e37 * make_contacts()[name] for name in ("force", "wall_force")}
LARGER = {name: 10.0 * force for name, force in LARGE.items()}
TOO_LARGE = [
    ({"velocity": FAR}, {}, None, "the velocity of a grain is 1e+39"),
    ({"spin": UNIT}, {}, FRICTION, "the spin of a grain is 1e+39"),
    ({"angle": UNIT}, {}, FRICTION, "the angle of a grain is 1e+39"),
    (LARGE, {"forces": True}, None, "the pressure of a grain is 4.99e+38"),
    (LARGE, {"color_by": "pressure"}, None, "the pressure of a grain is 4.99e+38"),
    (LARGER, {"forces": True}, None, "a force is 1.83e+39"),  # not the pressure that follows from it
]
"""Fields of a snapshot, options, a scene, and the complaint."""


BELT = Segment((-1e38, -5e37), (1e38, -5e37), velocity=(9e36, 0.0))
BESIDE_BELT = {"radius": 1e37, "radius_out": 1.5e38, "walls": [BELT], "dt": 1.0, "gravity": (0.0, 0.0)}
UNITS = [
    (1e-45, {}, "choose another unit of length"),
    (1e45, {}, "choose another unit of length"),
    (1.0, {"mass": 1e38, "dt": 0.01, "position": [(0.0, -1.9)]}, "a force is .*: a recording holds at most"),
    (1.0, {"mass": 1e39}, "the mass of a grain is .*: a recording"),
    (1e38, BESIDE_BELT, "a point of a wall is .*: a recording holds at most"),
]


class TestOutput:
    @pytest.mark.parametrize(("fields", "options", "scene", "complaint"), TOO_LARGE)
    def test_numbers_that_float32_cannot_hold(self, tmp_path, fields, options, scene, complaint):
        recorder = recorder_of(tmp_path / "run.usdc", scene, **options)
        with pytest.raises(InputError, match=re.escape(f"{complaint}: a recording holds at most")), recorder:
            recorder.record(replace(next(moments(make_frames(1), scene)), **fields))

    def test_what_is_no_recording_is_not_replaced(self, tmp_path, capfd):
        path = tmp_path / "run.usdc"
        for content in (b"", b"old", b"PXR-USDC" + bytes(200), b"#usda 1.0\n", b"PK\x03\x04"):
            path.write_bytes(content)
            assert exit_code("run", "annulus", "--steps", 1, "-o", path) == 2
            require_refusal(capfd, "not a recording of warpgrains")
            assert path.read_bytes() == content
        assert list(tmp_path.iterdir()) == [path]

    def test_the_stage_of_someone_else_is_not_replaced(self, tmp_path):
        stage = Usd.Stage.CreateNew(str(tmp_path / "run.usdc"))
        stage.DefinePrim("/House", "Xform")
        stage.Save()
        before = (tmp_path / "run.usdc").read_bytes()
        log_of(tmp_path / "run.usdc").touch()
        for write in (recorder_of, lambda path: recover(log_of(path))):
            with pytest.raises(OutputError, match="refusing to overwrite"):
                write(tmp_path / "run.usdc")
        assert (tmp_path / "run.usdc").read_bytes() == before

    @pytest.mark.parametrize(
        ("far", "step"), [(1e6, "0.0625"), (3e3, "0.000244"), (1e3, None), (-1e6, "0.0625"), (1.0, None)]
    )
    def test_positions_that_float32_rounds_too_much(self, tmp_path, far, step):
        """At 1e6 m, grains of 1 cm overlapped by 1.9 radii; near the origin, they may be in such a circle."""
        scene = Scene(position=[(0.0, far)], radius=0.01, mass=1.0, radius_out=1e6 + 1.0, gravity=(0.0, 0.0))
        simulation, path = Simulation(scene), tmp_path / "run.usdc"
        if step is None:
            simulation.run(steps=1, record=path)
            assert inspect_recording(path) == []
            return
        place = re.escape(f"(0, {far:g})")
        with pytest.raises(InputError, match=rf"grain 0 is at {place} m: .* are {step} m apart there"):
            simulation.run(steps=1, record=path)
        assert not list(tmp_path.iterdir())

    @pytest.mark.parametrize(("unit", "fields", "complaint"), UNITS)
    def test_units_that_float32_cannot_hold(self, tmp_path, unit, fields, complaint):
        grain = {"position": [(0.0, 0.5 * unit)], "radius": 0.1 * unit, "mass": 1.0}
        simulation = Simulation(Scene(**grain | {"radius_out": 2.0 * unit, "dt": unit} | fields))
        with pytest.raises(InputError, match=complaint):
            simulation.run(steps=300, record=tmp_path / "run.usdc", forces=True)
        assert not (tmp_path / "run.usdc").exists()
