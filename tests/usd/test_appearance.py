"""What a recording shows: colors and raw values of grains, force chains, material, light and camera."""

import matplotlib
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdUtils
from recordings import GRAINS, RADIUS, bands_of, make_contacts, make_frames, make_scene, moment, record

from warpgrains import Disc, Scene, Segment, Simulation
from warpgrains.drawing.chains import CHAIN_COLOR, ChainScale
from warpgrains.drawing.colorings import COLORINGS, pressure, pressure_scale, speed_scale, spin_scale
from warpgrains.drawing.colors import LEVELS, PALETTE, GrainColors, colormap, encoded, linear
from warpgrains.usd.recording import Recording, painter_of

FORCES = "/World/Forces"
HALF_STEP = 0.5 / (LEVELS - 1)  # of a scale


@pytest.mark.parametrize("name", sorted(own.colormap for own in COLORINGS.values()))
def test_colormaps_are_those_of_matplotlib(name):
    share = np.linspace(0.0, 1.0, 1001)
    assert np.allclose(colormap(name, share), matplotlib.colormaps[name](share)[:, :3], atol=0.025)
    assert np.array_equal(colormap(name, np.array([-1.0, 7.0])), colormap(name, np.array([0.0, 1.0])))


def test_linear_colors_are_encoded_back():
    assert np.allclose(encoded(linear(PALETTE)), PALETTE, atol=1e-6)  # float32 in between


def test_pressure_is_force_over_circumference():
    pairs = {"pair": np.array([(0, 1), (0, 4)]), "force": np.array([3.0, 5.0])}
    now = moment(
        *make_frames(1)[0], **pairs, wall=np.array([(1, 0), (3, 1)]), wall_force=np.array([2.0, 7.0])
    )
    total = np.array([3 + 5, 3 + 2, 0, 7, 5])
    assert np.array_equal(pressure(now), total / (2 * np.pi * RADIUS))


def test_scales_come_from_the_scene():
    scene = make_scene(gravity=(0, -10), drag=0.0)
    assert speed_scale(scene) == pytest.approx(np.sqrt(2 * 10 * 2.0))
    assert speed_scale(make_scene(gravity=(0, -10), drag=5.0)) == pytest.approx(10 * 1.0 / 5.0)
    assert speed_scale(make_scene(gravity=(0, 0), velocity=np.full((5, 2), 3.0))) == pytest.approx(3 * 2**0.5)
    assert pressure_scale(scene) == pytest.approx(5 * 10 / 1.0)
    assert ChainScale.of(scene).force == pytest.approx(50 * 2 * RADIUS.mean())
    thrown = make_scene(gravity=(0, 0), velocity=np.full((5, 2), 3.0))
    assert pressure_scale(thrown) == pytest.approx(3 * 2**0.5 / 0.01 / (2 * np.pi * RADIUS.mean()))
    assert pressure_scale(make_scene(gravity=(0, 0))) == pytest.approx(1 / 0.01**2 / (2 * np.pi))


def test_scales_reach_what_walls_inside_give_to_grains_at_rest():
    at_rest = {"gravity": (0, 0), "friction": 0.3}
    piston = Segment((-1.0, 1.6), (1.0, 1.6), velocity=(0.3, -0.4))
    blade = Segment((-1.5, 0.0), (-0.7, 0.0), angular_velocity=-2.0)
    scene = make_scene(walls=[piston, blade], **at_rest)
    assert speed_scale(scene) == pytest.approx(2.0 * 0.4)  # of the ends of the blade
    assert spin_scale(scene) == pytest.approx(0.5 * 0.8 / 0.1)
    roller = Disc((0.0, 1.6), 0.1, angular_velocity=7.0)
    assert speed_scale(make_scene(walls=[piston, roller], **at_rest)) == pytest.approx(7.0 * 0.1)
    smooth = make_scene(walls=[piston, roller], gravity=(0, 0))  # whose spin moves no grain
    assert speed_scale(smooth) == pytest.approx(0.5)
    lid = Segment((-1.0, 1.6), (1.0, 1.6), force=-60.0, mass=3.0, friction=0.0)
    driven = make_scene(walls=[lid], **at_rest)
    assert speed_scale(driven) == pytest.approx(np.sqrt(2 * 60.0 * 4.0 / (3.0 + 5.0)))
    assert pressure_scale(driven) == pytest.approx(4 * 60.0 / 2.0)
    assert ChainScale.of(driven).force == pytest.approx(120 * 2 * RADIUS.mean())
    assert pressure_scale(driven.replace(gravity=(0, -1000))) == pytest.approx(5 * 1000 / 1.0)


def test_neighbours_in_the_palette_differ():
    colors = GrainColors(make_scene(), "palette")
    assert colors.scale is None
    assert (np.diff(colors.still) != 0).all()


@pytest.mark.parametrize("color_by", ["speed", "pressure"])
def test_colors_run_from_nothing_to_the_scale_and_no_further(color_by):
    scene = make_scene()
    velocity = speed_scale(scene) * np.array([[0, 0], [0, 1 / 3], [-1, 0], [7, 0], [0, 0]])
    wall = pressure_scale(scene) * 2 * np.pi * RADIUS * np.array([0, 1 / 3, 1, 7, 0])
    at_wall = {"wall": np.stack([np.arange(5), np.zeros(5, int)], axis=1), "wall_force": wall}
    now = moment(scene.position, velocity, scene, **at_wall)
    colors = GrainColors(scene, color_by)
    assert colors.levels(now).tolist() == [0, 21, 63, 63, 0]
    expected = matplotlib.colormaps[COLORINGS[color_by].colormap](np.array([0.0, 1 / 3, 1.0, 1.0, 0.0]))[
        :, :3
    ]
    assert np.allclose(colors.of(now), expected, atol=0.025 + HALF_STEP)


def test_a_scene_without_a_scale_has_the_lowest_color():
    scene = make_scene(np.full(5, 0.1), gravity=(0, 0))
    now = moment(scene.position, scene.velocity, scene)
    for color_by in ("radius", "speed", "pressure"):
        assert GrainColors(scene, color_by).levels(now).tolist() == [0] * 5


@pytest.mark.parametrize("draw_as", ["discs", "spheres", "points"])
@pytest.mark.parametrize(
    ("color_by", "codes"), [("palette", 0), ("radius", 0), ("speed", 3), ("pressure", 3)]
)
def test_grains_have_their_colors_and_only_what_changes_is_written_each_frame(
    tmp_path, color_by, codes, draw_as
):
    frames = make_frames(3)
    path = record(tmp_path / "run.usdc", frames, color_by=color_by, draw_as=draw_as)
    stage = Usd.Stage.Open(str(path))
    grains = stage.GetPrimAtPath(GRAINS)
    indices = ["primvars:displayColor:indices"] + ["protoIndices"] * (draw_as != "points")
    assert [grains.GetAttribute(name).GetNumTimeSamples() for name in indices] == [codes] * len(indices)
    assert grains.GetAttribute("primvars:displayColor").GetNumTimeSamples() == 0
    recording, colors = Recording(path), GrainColors(make_scene(), color_by)
    assert recording.scale == colors.scale
    table = UsdGeom.PrimvarsAPI(grains).GetPrimvar("displayColor")
    for number, state in enumerate(frames):
        expected = colors.of(moment(*state, **make_contacts(number)))
        shown = encoded(np.array(table.ComputeFlattened(number)))
        assert np.allclose(shown, expected, atol=1e-6)  # float32, linear and back
        assert np.array_equal(painter_of(recording).color(recording.frame(number, contacts=False)), expected)


@pytest.mark.parametrize("draw_as", ["discs", "spheres", "points"])
def test_raw_values_stand_beside_the_colors(tmp_path, draw_as):
    frames = make_frames(2)
    path = record(tmp_path / "run.usdc", frames, color_by="radius", forces=True, draw_as=draw_as)
    stage = Usd.Stage.Open(str(path))
    grains = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(GRAINS))
    assert np.array_equal(grains.GetPrimvar("radius").Get(), RADIUS.astype(np.float32))
    for number, (position, velocity) in enumerate(frames):
        contacts = make_contacts(number)
        now = moment(position, velocity, **contacts)
        speed, raw_pressure = (grains.GetPrimvar(name).Get(number) for name in ("speed", "pressure"))
        assert np.array_equal(speed, np.hypot(*velocity.T).astype(np.float32))
        assert np.array_equal(raw_pressure, pressure(now).astype(np.float32))
        force = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(FORCES)).GetPrimvar("force").Get(number)
        expected = np.concatenate([contacts["force"], contacts["wall_force"]])
        assert np.array_equal(force, expected.astype(np.float32))


@pytest.mark.parametrize("draw_as", ["discs", "spheres"])
@pytest.mark.parametrize("color_by", ["speed", "radius", "palette"])
def test_prototypes_have_about_the_colors_of_their_grains(tmp_path, draw_as, color_by):
    frames = make_frames(1)
    stage = Usd.Stage.Open(str(record(tmp_path / "run.usdc", frames, color_by=color_by, draw_as=draw_as)))
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath(GRAINS))
    shapes = [stage.GetPrimAtPath(path) for path in instancer.GetPrototypesRel().GetTargets()]
    assert len(shapes) == (len(PALETTE) if color_by == "palette" else 16)
    color = np.array([UsdGeom.Mesh(shape).GetDisplayColorPrimvar().Get()[0] for shape in shapes])
    shown = encoded(color[np.array(instancer.GetProtoIndicesAttr().Get(0))])
    exact = GrainColors(make_scene(), color_by).of(moment(*frames[0]))
    assert np.allclose(shown, exact, atol=1e-6 if color_by == "palette" else 0.06)


@pytest.mark.parametrize("draw_as", ["points", "discs", "spheres"])
def test_few_prims_stand_for_any_number_of_grains(tmp_path, draw_as):
    scene = make_scene(np.full(300, 0.01))
    path = record(tmp_path / "run.usdc", make_frames(1, 300), scene, draw_as=draw_as)
    stage = Usd.Stage.Open(str(path))
    prims = list(stage.Traverse())
    assert len(prims) <= 12
    points = [str(prim.GetPath()) for prim in prims if prim.IsA(UsdGeom.Points)]
    assert points == ([GRAINS] if draw_as == "points" else [])
    kinds = {prim.GetName(): Usd.ModelAPI(prim).GetKind() for prim in prims}
    assert {name: kind for name, kind in kinds.items() if kind} == {
        "World": "component",
        "Grains": "subcomponent",
        "Walls": "subcomponent",
    }


def test_the_file_says_what_its_colors_and_chains_mean(tmp_path):
    path = record(tmp_path / "run.usdc", make_frames(1), color_by="pressure", forces=True)
    told = Sdf.Layer.FindOrOpen(str(path)).customLayerData["warpgrains"]
    high = pressure_scale(make_scene())
    scale = {"quantity": "pressure", "unit": "N/m", "colormap": "cividis", "low": 0.0, "high": high}
    assert told["colors"] == scale
    assert told["forces"] == {"unit": "N", "force": ChainScale.of(make_scene()).force, "width": RADIUS.min()}


@pytest.mark.parametrize("draw_as", ["discs", "spheres", "points"])
def test_everything_has_a_material_that_reads_its_color(tmp_path, draw_as):
    stage = Usd.Stage.Open(str(record(tmp_path / "run.usdc", make_frames(1), forces=True, draw_as=draw_as)))
    drawn = [prim for prim in stage.TraverseAll() if prim.IsA(UsdGeom.Gprim)]
    assert len(drawn) == 3 + (1 if draw_as == "points" else 16)
    for prim in drawn:
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        surface = material.ComputeSurfaceSource()[0]
        assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
        source = surface.GetInput("diffuseColor").GetConnectedSources()[0][0].source
        assert source.GetInput("varname").Get() == "displayColor"
    assert any(prim.IsA(UsdLux.DistantLight) for prim in stage.Traverse())


def test_viewers_find_the_camera(tmp_path):
    stage = Usd.Stage.Open(str(record(tmp_path / "run.usdc", make_frames(1))))
    camera = stage.GetPrimAtPath(f"/World/{UsdUtils.GetPrimaryCameraName()}")
    assert camera.IsA(UsdGeom.Camera)
    assert stage.GetRootLayer().customLayerData["cameraSettings"] == {"boundCamera": str(camera.GetPath())}


@pytest.mark.parametrize(
    ("frame", "center", "half"), [(None, (0.0, 0.0), 2.08), ("-0.5,-0.25,1.5,0.75", (0.5, 0.25), 1.0)]
)
def test_the_camera_shows_the_extent_or_the_frame(tmp_path, frame, center, half):
    path = tmp_path / "run.usdc"
    Simulation(Scene.load("annulus")).run(steps=1, record=path, frame=frame)
    stage = Usd.Stage.Open(str(path))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/main_cam")).GetCamera(0)
    x, y, distance = camera.transform.ExtractTranslation()
    assert (x, y) == center
    assert distance * camera.verticalAperture / camera.focalLength / 2.0 == pytest.approx(half, rel=1e-5)


class TestForceChains:
    @pytest.fixture
    def recording(self, tmp_path):
        self.frames = make_frames(3)
        return record(tmp_path / "run.usdc", self.frames, forces=True)

    def test_join_centres_and_walls(self, recording):
        for code in range(3):
            (ends, _), position = bands_of(recording, code), self.frames[code, 0]
            pairs = [position[[0, 1]], position[[1, 2]], position[[0, 4]]]
            assert np.allclose(ends[:3], pairs, atol=1e-6)  # float32
            for grain, side, (centre, foot) in zip((0, 3), (1, -1), ends[3:], strict=True):
                outwards = position[grain] / np.linalg.norm(position[grain])
                assert np.allclose(centre, position[grain], atol=1e-6)
                assert np.allclose(foot, position[grain] + side * RADIUS[grain] * outwards, atol=1e-6)

    def test_are_as_wide_as_their_forces_up_to_half_the_smallest_grain(self, recording):
        contacts = make_contacts(seed=1)
        force = np.concatenate([contacts["force"], contacts["wall_force"]])
        expected = np.minimum(force / ChainScale.of(make_scene()).force, 1.0) * RADIUS.min()
        assert np.allclose(bands_of(recording, 1)[1], expected, atol=1e-6)  # float32

    @pytest.mark.parametrize(("draw_as", "height"), [("discs", 0.24), ("spheres", 1.0), ("points", 1.0)])
    def test_are_in_front_of_the_grains(self, tmp_path, draw_as, height):
        path = record(tmp_path / "run.usdc", make_frames(1), forces=True, draw_as=draw_as)
        stage = Usd.Stage.Open(str(path))
        bands = UsdGeom.Mesh(stage.GetPrimAtPath(FORCES))
        depth = np.array(bands.GetPointsAttr().Get(0))[:, 2]
        assert np.allclose(depth, 1.05 * height * RADIUS.max())
        assert np.allclose(bands.GetDisplayColorPrimvar().Get()[0], linear(np.array(CHAIN_COLOR)))

    def test_may_be_none(self, tmp_path):
        Simulation(Scene.load("annulus")).run(steps=1, record=tmp_path / "run.usdc", forces=True)
        assert bands_of(tmp_path / "run.usdc", 0)[0].shape == (0, 2, 2)
        assert Recording(tmp_path / "run.usdc").frame(0).force.shape == (0,)
