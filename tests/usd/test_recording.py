"""Recordings as other programs read them: when frames are, and where grains, walls and images are in them."""

from itertools import product
from types import SimpleNamespace

import lightusd
import numpy as np
import pytest
from command import exit_code, require_refusal
from pxr import Usd, UsdGeom, UsdValidation
from recordings import (
    GRAINS,
    RADIUS,
    grains_of,
    make_frames,
    make_scene,
    opened,
    record,
)
from walled_scenes import boxed

import warpgrains
from warpgrains import InputError, Recording, Scene, Simulation
from warpgrains.analysis.snapshot import snapshot, snapshot_of
from warpgrains.analysis.vtk import export
from warpgrains.drawing.chains import ChainScale
from warpgrains.drawing.colorings import pressure_scale
from warpgrains.drawing.frames import FrameTimes
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.pictures.film import draw_film
from warpgrains.scene.state import first_state
from warpgrains.scene.toml import read_parameters
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.grains import position_of
from warpgrains.usd.recorder import log_of

DRAWINGS = {
    "points": (".usdc", 0.0, {}),
    "points as text": (".usda", 0.0, {}),
    "discs in a package": (".usdz", 0.0, {"draw_as": "discs", "color_by": "radius"}),
    "spheres": (".usdc", 0.0, {"draw_as": "spheres"}),
    "forces as text": (".usda", 0.0, {"draw_as": "discs", "color_by": "pressure", "forces": True}),
    "rotation": (".usdc", 0.3, {"draw_as": "discs", "color_by": "spin", "forces": True}),
}


def require_validity(path):
    """Check that our check and USD's validators find nothing."""
    assert inspect_recording(path) == []
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))
    assert [error.GetMessage() for error in errors] == []


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

    @pytest.mark.parametrize("fps", [24, 50])
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
        """And what is recorded plays in real time."""
        simulation = Simulation(Scene.load("annulus"))
        with pytest.warns(UserWarning, match="fps 1000 cannot be met: .* of 0.01 s there are 100") as warned:
            simulation.run(duration=0.5, record=tmp_path / "run.usdc", fps=1000)
        assert [warning.filename for warning in warned] == [__file__]
        stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
        assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 100
        assert stage.GetEndTimeCode() == 50


@pytest.mark.parametrize(("suffix", "friction", "options"), DRAWINGS.values(), ids=DRAWINGS)
def test_every_frame_equals_the_float32_state_and_passes_checks(tmp_path, suffix, friction, options):
    """As an independent reader, our check and USD's validators see it."""
    frames, scene = make_frames(7), make_scene(mass=RADIUS / 3.0, friction=friction)
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
    require_validity(path)
    stage = Usd.Stage.Open(str(path))
    for name, exact in (("mass", scene.mass), ("radius", RADIUS)):
        assert np.array_equal(grains[f"warpgrains:{name}"], exact)
        assert np.array_equal(grains[f"primvars:{name}"], exact.astype(np.float32))
    primvars = [own for prim in stage.TraverseAll() for own in UsdGeom.PrimvarsAPI(prim).GetPrimvars()]
    doubles = [own.GetName() for own in primvars if str(own.GetTypeName()).startswith("double")]
    assert doubles == []  # Blender reads no primvar after the first one


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("shear", {"draw_as": "discs"}),
        ("everywhere", {"draw_as": "spheres", "color_by": "radius"}),
        ("walls", {}),
        ("ramp", {}),
    ],
)
def test_a_box_is_recorded_with_images_and_read_back_without(tmp_path, kind, options):
    """Points are in the box, and go on beyond it for `Recording`; float32 rounds them by 6e-8."""
    path, simulation = tmp_path / "run.usdc", Simulation(boxed(kind, 80))
    simulation.run(steps=40, record=path, fps=20, forces=True, **options)
    now, found = snapshot(simulation), Recording(path).frame(-1)
    require_validity(path)
    assert found.position == pytest.approx(now.position, abs=6e-8)
    assert np.array_equal(found.pair, now.pair)
    assert np.array_equal(found.wall, now.wall)
    assert found.force == pytest.approx(now.force, rel=6e-8)
    stage = Usd.Stage.Open(str(path))
    prim, end, n = stage.GetPrimAtPath(GRAINS), stage.GetEndTimeCode(), now.n
    points, radius = position_of(prim).Get(end), prim.GetAttribute("primvars:radius").Get(end)
    points, period, high = np.array(points)[:, :2], now.scene.period.lengths, np.array([1.0, 0.7])
    assert ((points[:n] >= -6e-8) & (points[:n] <= high + 6e-8)).all()
    ways = np.unique(np.array([*product((-1, 0, 1), repeat=2)]) * period, axis=0)
    images = np.concatenate([np.zeros((0, 2)), *(points[:n] + way for way in ways if way.any())])
    reach = np.resize(now.scene.radius, len(images))[:, np.newaxis]
    crosses = ((images + reach > 0.0) & (images - reach < high)).all(axis=1)
    expected = np.column_stack([images, reach])[crosses]
    shown = np.column_stack([points, radius])[n:]
    assert shown[np.lexsort(shown.T)] == pytest.approx(expected[np.lexsort(expected.T)], abs=2e-7)
    assert len(expected) or kind == "ramp"


@pytest.mark.parametrize("suffix", RECORDINGS)
def test_an_independent_reader_reads_what_is_static(tmp_path, suffix):
    path = record(tmp_path / f"run{suffix}", make_frames(3), color_by="pressure", forces=True)
    stage, scene = lightusd.load(str(path)), make_scene()
    grains = stage.prim_at(GRAINS)
    assert np.array_equal(grains["ids"], np.arange(len(RADIUS)))
    assert np.array_equal(grains["widths"], (2 * RADIUS).astype(np.float32))
    assert (stage.up_axis, stage.meters_per_unit, stage.default_prim_path) == ("Y", 1.0, "World")
    assert (stage.start_time, stage.end_time) == (0.0, 2.0)
    assert stage.time_codes_per_second == stage.frames_per_second == 50.0
    kept = stage.custom_layer_data["warpgrains"]
    look = {"color_by": "pressure", "forces": True}
    scale = {"quantity": "pressure", "unit": "N/m", "colormap": "YlOrBr", "low": 0.0}
    assert kept.pop("colors") == scale | {"high": pressure_scale(scene)}
    assert kept.pop("forces") == {"unit": "N", "force": ChainScale.of(scene).force, "width": RADIUS.min()}
    assert read_parameters(kept.pop("parameters"))["dt"] == scene.dt
    texts = {"version": warpgrains.__version__, "name": "example", "scene": scene.text}
    assert kept == {**texts, "draw_as": "points", "first_step": 0, "slow": 1.0, "look": look}
    assert scene.text in stage.doc


def test_one_width_where_all_grains_are_equal(tmp_path):
    path = record(tmp_path / "run.usdc", make_frames(1, 3), make_scene(np.full(3, 0.1)))
    stage = Usd.Stage.Open(str(path))
    grains = grains_of(stage)
    assert grains.GetWidthsInterpolation() == "constant"
    assert list(grains.GetWidthsAttr().Get()) == [np.float32(0.2)]


@pytest.mark.parametrize(("draw_as", "radius_in"), [("discs", 0.0), ("spheres", 0.5)])
def test_instances_and_walls_have_the_radii_of_the_scene(tmp_path, draw_as, radius_in):
    stage = opened(tmp_path / "run.usdc", 1, make_scene(radius_in=radius_in), draw_as=draw_as)
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath(GRAINS))
    scales = np.array(instancer.GetScalesAttr().Get())
    assert np.array_equal(scales, np.repeat(RADIUS.astype(np.float32)[:, np.newaxis], 3, axis=1))
    for prototype in instancer.GetPrototypesRel().GetTargets():
        points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath(prototype)).GetPointsAttr().Get())
        across = points if draw_as == "spheres" else points[:, :2]
        assert np.linalg.norm(across, axis=1).max() == pytest.approx(1.0, rel=1e-6)
    walls = {"Outer": (min, 2.0)} | ({"Inner": (max, 0.5)} if radius_in else {})
    found = stage.GetPrimAtPath("/World/Walls").GetChildren()
    assert [prim.GetName() for prim in found] == list(walls)
    for prim, (end, radius) in zip(found, walls.values(), strict=True):
        points = np.array(prim.GetAttribute("points").Get())
        assert end(np.linalg.norm(points[:, :2], axis=1)) == pytest.approx(radius, rel=1e-6)
        height = RADIUS.mean() * (0.24 if draw_as == "discs" else 1.0)
        assert np.abs(points[:, 2]) == pytest.approx(np.full(len(points), height), rel=1e-6)


def test_what_is_no_recording_is_not_replaced(tmp_path, capfd):
    path, link, house = (tmp_path / f"{name}.usdc" for name in ("run", "link", "house"))
    link.symlink_to(path)
    stage = Usd.Stage.CreateNew(str(house))
    stage.DefinePrim("/House", "Xform")
    stage.Save()
    of_someone_else = house.read_bytes()
    for content in (b"", b"old", b"PXR-USDC" + bytes(200), b"#usda 1.0\n", b"PK\x03\x04", of_someone_else):
        path.write_bytes(content)
        log_of(path).touch()
        run = ["run", "annulus", "--steps", 1, "-o"]
        for command in ([*run, path], [*run, link], ["recover", log_of(path)]):
            assert exit_code(*command) == 2
            require_refusal(capfd, "not a recording of warpgrains")
        assert path.read_bytes() == content
    assert {*tmp_path.iterdir()} == {path, link, log_of(path), house}


def test_positions_that_float32_does_not_round_too_much(tmp_path):
    """At 1e6 m, grains of 1 cm overlapped by 1.9 radii; nearer to the origin, they may be there."""
    scene = Scene(position=[(0.0, 1e3)], radius=0.01, mass=1.0, radius_out=1e6 + 1.0, gravity=(0.0, 0.0))
    Simulation(scene).run(steps=1, record=tmp_path / "run.usdc")
    assert inspect_recording(tmp_path / "run.usdc") == []


@pytest.mark.parametrize(
    ("kind", "friction", "options"),
    [
        ("", 0.0, {"color_by": "id"}),
        ("x", 0.3, {"draw_as": "discs", "color_by": "radius"}),
        ("", 0.3, {"draw_as": "spheres", "color_by": "speed"}),
    ],
)
def test_grains_that_come_and_go_keep_their_ids(tmp_path, kind, friction, options):
    """Frames have different lengths, and are read back with radii, masses, ids and contacts."""
    path, times = tmp_path / "run.usdc", []
    seen = SimpleNamespace(every=10, observe=lambda now: times.append(snapshot(now)), flush=lambda: None)
    above = {"region": {"y": (0.5, 0.65)}, "radius": (0.02, 0.04), "density": 80.0, "rate": 200.0}
    flows = {"sources": [above | {"velocity": (1.5, 0.0)}], "sinks": [{"region": {"y": (0.0, 0.1)}}]}
    scene = boxed("walls", 20, periodic=kind, friction=friction, gravity=(0.0, -9.81), walls=(), **flows)
    simulation = Simulation(scene, state=first_state(scene))
    simulation.run(steps=100, record=path, fps=20, forces=True, observer=seen, **options)
    require_validity(path)
    recording = Recording(path)
    found = [recording.frame(k) for k in range(len(recording))]
    assert len({now.n for now in times}) > 5
    for now, then in zip(times, found, strict=True):
        assert np.array_equal(then.id, now.id)
        assert then.position == pytest.approx(now.position, abs=2e-7)  # as float32
        for name in ("radius", "mass"):
            assert np.array_equal(getattr(then.scene, name), getattr(now.scene, name))
        assert np.array_equal(then.pair, now.pair)
        assert np.array_equal(then.wall, now.wall)
        assert then.force == pytest.approx(now.force, rel=6e-8)
    stage = Usd.Stage.Open(str(path))
    prim, radius = stage.GetPrimAtPath(GRAINS), {}
    for code, now in enumerate(times):
        ids = np.array(prim.GetAttribute("ids").Get(code))
        sizes = np.array(prim.GetAttribute("primvars:radius").Get(code))
        assert np.array_equal(ids[: now.n], now.id)
        assert len(position_of(prim).Get(code)) == len(ids) >= now.n
        own = dict(zip(ids[: now.n].tolist(), sizes[: now.n].tolist(), strict=True))
        assert radius | own == own | radius  # each id has one radius in all frames
        radius |= own
    assert len(radius) > times[-1].n
    table = recording.to_pandas()
    assert table.groupby("id")["radius"].nunique().max() == 1
    assert recording.to_xarray().sizes == {"time": len(times), "grain": len(radius)}
    with pytest.raises(InputError, match=r"position: frames of .* have different grains: use frame"):
        recording.position  # noqa: B018
    assert draw_film(path, tmp_path / "run.gif") == [*range(len(times))]
    assert export(path, tmp_path / "run.pvd") == len(times)
