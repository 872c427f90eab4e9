"""What a recording shows: colors and numbers of grains, force chains, material, light and camera."""

import matplotlib
import numpy as np
import pytest
from numpy.testing import assert_allclose
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdUtils
from recordings import FORMS, GRAINS, RADIUS, bands_of, make_frames, make_scene, moment, moments, record
from walled_scenes import BOXES, boxed

from warpgrains import Box, Disc, Scene, Segment, Simulation
from warpgrains.drawing.chains import CHAIN_COLOR, ChainScale, all_contacts, cut
from warpgrains.drawing.colorings import (
    COLORINGS,
    colorings_of,
    mobilized,
    pressure,
    pressure_scale,
    speed_scale,
    spin_scale,
)
from warpgrains.drawing.colors import LEVELS, PALETTE, GrainColors, colormap, encoded, linear, mark_color
from warpgrains.drawing.shapes import disc, drawn_walls, mark, moved_walls, sphere
from warpgrains.usd.recording import Recording, painter_of

FORCES = "/World/Forces"
HALF_STEP = 0.5 / (LEVELS - 1)  # of a scale
FLOAT32 = 1e-6  # of coordinates up to 2 m
ROTATION = {"primvars:spin", "primvars:angle", "orientations", "primvars:tangential_force"}


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


FALLS, AT_REST = {"gravity": (0, -10)}, {"gravity": (0, 0)}
THROWN = AT_REST | {"velocity": np.full((5, 2), 3.0)}
PISTON = Segment((-1.0, 1.6), (1.0, 1.6), velocity=(0.3, -0.4))
BLADE = Segment((-1.5, 0.0), (-0.7, 0.0), angular_velocity=-2.0)
ROLLER = Disc((0.0, 1.6), 0.1, angular_velocity=7.0)
LID = Segment((-1.0, 1.6), (1.0, 1.6), force=-60.0, mass=3.0, friction=0.0)
DRIVEN = AT_REST | {"friction": 0.3, "walls": [LID]}
BOX = {"x": (-2.0, 2.0), "y": (-1.5, 1.5)}
IN_BOX = FALLS | {"radius_out": None, "radius_in": 0.0, "domain": Box(**BOX)}
TOP = {"pressure": 30.0, "mass": 3.0, "velocity": (0.5, 0.0)}
PRESSED = IN_BOX | AT_REST | {"domain": Box(**BOX, top=TOP)}


def force_scale(scene):
    return ChainScale.of(scene).force


@pytest.mark.parametrize(
    ("scale", "fields", "expected"),
    [
        (speed_scale, FALLS, np.sqrt(2 * 10 * 2.0)),
        (speed_scale, FALLS | {"drag": 5.0}, 10 * 1.0 / 5.0),
        (speed_scale, THROWN, 3 * 2**0.5),
        (pressure_scale, FALLS, 5 * 10 / 1.0),
        (pressure_scale, THROWN, 3 * 2**0.5 / 0.01 / (2 * np.pi * RADIUS.mean())),
        (pressure_scale, AT_REST, 1 / 0.01**2 / (2 * np.pi)),
        (force_scale, FALLS, 50 * 2 * RADIUS.mean()),
        # what walls inside give to grains at rest: the ends of the blade, and a roller unless it is smooth
        (speed_scale, AT_REST | {"friction": 0.3, "walls": [PISTON, BLADE]}, 2.0 * 0.4),
        (spin_scale, AT_REST | {"friction": 0.3, "walls": [PISTON, BLADE]}, 0.5 * 0.8 / 0.1),
        (speed_scale, AT_REST | {"friction": 0.3, "walls": [PISTON, ROLLER]}, 7.0 * 0.1),
        (speed_scale, AT_REST | {"walls": [PISTON, ROLLER]}, 0.5),
        (speed_scale, DRIVEN, np.sqrt(2 * 60.0 * 4.0 / (3.0 + 5.0))),
        (pressure_scale, DRIVEN, 4 * 60.0 / 2.0),
        (force_scale, DRIVEN, 120 * 2 * RADIUS.mean()),
        (pressure_scale, DRIVEN | {"gravity": (0, -1000)}, 5 * 1000 / 1.0),
        # the longer side of a box
        (speed_scale, PRESSED, np.sqrt(2 * 30.0 * 4.0 * 4.0 / (3.0 + 5.0))),
        (pressure_scale, PRESSED, 4 * 30.0),
        (speed_scale, IN_BOX, np.sqrt(2 * 10 * 2.0)),
        (pressure_scale, IN_BOX, 5 * 10 / 1.0),
    ],
)
def test_scales_come_from_the_scene(scale, fields, expected):
    assert scale(make_scene(**fields)) == pytest.approx(expected)


@pytest.mark.parametrize("kind", BOXES)
def test_sides_and_walls_of_a_box_are_drawn_in_it_at_all_times(kind):
    """Without a circle; what crosses a periodic side reaches beyond by its width, and in between again."""
    scene, still = boxed(kind), drawn_walls(boxed(kind))
    period, high = scene.period, np.array([1.0, 0.7])
    assert {name.split("_")[0] for name in still} == {*scene.wall_names[2:]}
    for time in (0.0, 0.3, 2.0, 50.0):
        for name, band in (still | moved_walls(scene, scene, time)).items():
            wall = scene.walls[list(still).index(name)]
            points = np.concatenate([band.first, band.second])
            assert len(points) == len(still[name].first) * 2
            width = 2.0 * wall.circle[2] + 0.02 if np.isfinite(wall.circle[2]) else 0.03
            outside = ((points < -width) | (points > high + width)) & (period > 0.0)
            assert not outside.any(), (name, time)


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


def test_spin_is_colored_by_its_sign():
    scene = make_scene(friction=0.3, gravity=(0.0, -10.0))
    largest = 0.5 * np.sqrt(2.0 * 10.0 * 2.0) / 0.1  # half as fast as what falls across; the median radius
    assert spin_scale(scene) == pytest.approx(largest)
    assert spin_scale(scene.replace(spin=-1000.0)) == 1000.0
    assert spin_scale(scene.replace(angular_velocity_out=-1000.0)) == pytest.approx(0.5 * 1000.0 * 2.0 / 0.1)
    spin = largest * np.array([-7.0, -1.0, 1.0 / 63.0, 1.0 / 3.0, 1.0])
    now = moment(scene.position, scene.velocity, scene, spin=spin)
    assert GrainColors(scene, "spin").levels(now).tolist() == [0, 0, 32, 42, 63]


def test_mobilized_friction_is_the_largest_of_a_grain():
    scene = make_scene(friction=0.5, wall_friction=0.1)
    contacts = {
        "pair": np.array([[0, 1], [1, 2]], np.int32),
        "force": np.array([2.0, 4.0]),
        "tangential_force": np.array([-1.0, 0.5]),
        "wall": np.array([[2, 0], [3, 1]], np.int32),
        "wall_force": np.ones(2),
        "wall_tangential_force": np.array([0.04, -0.07]),
    }
    where = scene.position, scene.velocity
    assert_allclose(mobilized(moment(*where, scene, **contacts)), [1.0, 1.0, 0.4, 0.7, 0.0])
    smooth = scene.replace(wall_friction=0.0)
    assert_allclose(mobilized(moment(*where, smooth, **contacts)), [1.0, 1.0, 0.25, 0.0, 0.0])


@pytest.mark.parametrize("shape", [disc, sphere])
def test_a_mark_changes_no_shape(shape):
    plain, marked = shape(), shape(is_marked=True)
    assert plain.marked is None
    assert marked.marked is not None
    assert area(marked).sum(axis=0) == pytest.approx(area(plain).sum(axis=0), abs=1e-12)
    assert np.hypot(*area(marked).T[:2]).sum() == pytest.approx(np.hypot(*area(plain).T[:2]).sum())
    first = np.cumsum(marked.counts) - marked.counts
    middle = np.add.reduceat(marked.points[marked.corners], first) / marked.counts[:, np.newaxis]
    inside = np.abs(np.arctan2(middle[:, 1], middle[:, 0])) < np.pi / 8
    assert np.array_equal(marked.marked, inside)
    assert np.abs(np.arctan2(*mark()[1:].T[::-1])).max() == pytest.approx(np.pi / 8)


def area(shape):
    """Return the area vector of each polygon, shape (p, 3)."""
    found = []
    for corners in np.split(shape.corners, np.cumsum(shape.counts)[:-1]):
        points = shape.points[corners]
        found.append(0.5 * np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0))
        assert (np.cross(points[1] - points[0], points[2] - points[0]) @ found[-1]) > 0.0
    return np.array(found)


@pytest.mark.parametrize("draw_as", FORMS)
@pytest.mark.parametrize(
    ("color_by", "codes"),
    [("palette", 0), ("radius", 0), ("speed", 3), ("pressure", 3), ("spin", 3), ("mobilized", 3)],
)
def test_colors_and_numbers_are_those_of_the_snapshots(stage_of, tmp_path, color_by, codes, draw_as):
    """And only what changes is written each frame."""
    scene = make_scene(friction=0.3 if color_by in ("spin", "mobilized") else 0.0)
    has_forces = color_by in ("radius", "spin")
    stage = stage_of(3, scene, color_by=color_by, draw_as=draw_as, forces=has_forces)
    grains = stage.GetPrimAtPath(GRAINS)
    indices = ["primvars:displayColor:indices"] + ["protoIndices"] * (draw_as != "points")
    assert [grains.GetAttribute(name).GetNumTimeSamples() for name in indices] == [codes] * len(indices)
    assert grains.GetAttribute("primvars:displayColor").GetNumTimeSamples() == 0
    recording, colors = Recording(tmp_path / "run.usdc"), GrainColors(scene, color_by)
    assert recording.scale == colors.scale
    primvars, bands = UsdGeom.PrimvarsAPI(grains), UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(FORCES))
    for number, now in enumerate(moments(make_frames(3), scene)):
        shown = encoded(np.array(primvars.GetPrimvar("displayColor").ComputeFlattened(number)))
        assert_allclose(shown, colors.of(now), atol=1e-6)  # float32, linear and back
        frame = recording.frame(number, contacts=has_forces)
        assert np.array_equal(painter_of(recording).color(frame), colors.of(now))
        numbers = {"angle": now.angle} if scene.has_friction else {}
        found = colorings_of(scene, has_forces or colors.needs_contacts)
        for name, values in (numbers | {name: own.values(now) for name, own in found.items()}).items():
            assert np.array_equal(primvars.GetPrimvar(name).Get(number), values.astype(np.float32))
        if has_forces:
            for name, values in zip(("force", "tangential_force"), all_contacts(now)[1:], strict=True):
                if bands.HasPrimvar(name):
                    assert np.array_equal(bands.GetPrimvar(name).Get(number), values.astype(np.float32))


@pytest.mark.parametrize("draw_as", FORMS)
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_grains_turn_only_with_friction(stage_of, draw_as, friction):
    scene = make_scene(friction=friction)
    stage = stage_of(2, scene, forces=True, draw_as=draw_as)
    names = {name for prim in stage.TraverseAll() for name in prim.GetAuthoredPropertyNames()}
    lacking = {"orientations"} if draw_as == "points" else set()
    assert names & ROTATION == (ROTATION - lacking if friction else set())
    if friction and draw_as != "points":
        turned = UsdGeom.PointInstancer(stage.GetPrimAtPath(GRAINS)).ComputeInstanceTransformsAtTime(1, 1)
        right = np.array([matrix.TransformDir((1.0, 0.0, 0.0)) for matrix in turned])
        angle = [*moments(make_frames(2), scene)][1].angle
        expected = RADIUS * np.array([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
        assert_allclose(right, expected.T, rtol=0.0, atol=2e-3 * RADIUS.max())  # half precision


@pytest.mark.parametrize("draw_as", ["discs", "spheres"])
@pytest.mark.parametrize(
    ("color_by", "friction"), [("speed", 0.0), ("radius", 0.0), ("palette", 0.0), ("speed", 0.3)]
)
def test_prototypes_have_about_the_colors_of_their_grains_and_marks(stage_of, draw_as, color_by, friction):
    scene = make_scene(friction=friction)
    stage = stage_of(1, scene, color_by=color_by, draw_as=draw_as)
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath(GRAINS))
    shapes = [UsdGeom.Mesh.Get(stage, path) for path in instancer.GetPrototypesRel().GetTargets()]
    assert len(shapes) == (len(PALETTE) if color_by == "palette" else 16)
    primvars = [shape.GetDisplayColorPrimvar() for shape in shapes]
    color = encoded(np.array([primvar.Get()[0] for primvar in primvars], np.float64))
    exact = GrainColors(scene, color_by).of(next(moments(make_frames(1), scene)))
    shown = color[np.array(instancer.GetProtoIndicesAttr().Get(0))]
    assert_allclose(shown, exact, rtol=0.0, atol=1e-6 if color_by == "palette" else 0.06)
    for own, primvar, shape in zip(color, primvars, shapes, strict=True):
        assert primvar.GetInterpolation() == ("uniform" if friction else "constant")
        if friction:
            assert_allclose(mark_color(own), encoded(np.array(primvar.Get()[1], np.float64)), atol=1e-6)
            assert len(primvar.GetIndices()) == len(shape.GetFaceVertexCountsAttr().Get())


@pytest.mark.parametrize("draw_as", FORMS)
def test_few_prims_stand_for_any_number_of_grains(stage_of, draw_as):
    stage = stage_of(1, make_scene(np.full(300, 0.01)), draw_as=draw_as)
    prims = list(stage.Traverse())
    assert len(prims) == 12
    points = [str(prim.GetPath()) for prim in prims if prim.IsA(UsdGeom.Points)]
    assert points == ([GRAINS] if draw_as == "points" else [])
    kinds = {prim.GetName(): Usd.ModelAPI(prim).GetKind() for prim in prims}
    found = {name: kind for name, kind in kinds.items() if kind}
    assert found == {"World": "component", "Grains": "subcomponent", "Walls": "subcomponent"}


def test_the_file_says_what_its_colors_and_chains_mean(tmp_path):
    path = record(tmp_path / "run.usdc", make_frames(1), color_by="pressure", forces=True)
    told = Sdf.Layer.FindOrOpen(str(path)).customLayerData["warpgrains"]
    high = pressure_scale(make_scene())
    scale = {"quantity": "pressure", "unit": "N/m", "colormap": "cividis", "low": 0.0, "high": high}
    assert told["colors"] == scale
    assert told["forces"] == {"unit": "N", "force": ChainScale.of(make_scene()).force, "width": RADIUS.min()}


@pytest.mark.parametrize("draw_as", FORMS)
def test_everything_has_a_material_that_reads_its_color(stage_of, draw_as):
    stage = stage_of(forces=True, draw_as=draw_as)
    drawn = [prim for prim in stage.TraverseAll() if prim.IsA(UsdGeom.Gprim)]
    assert len(drawn) == 3 + (1 if draw_as == "points" else 16)
    for prim in drawn:
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        surface = material.ComputeSurfaceSource()[0]
        assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
        source = surface.GetInput("diffuseColor").GetConnectedSources()[0][0].source
        assert source.GetInput("varname").Get() == "displayColor"
    assert any(prim.IsA(UsdLux.DistantLight) for prim in stage.Traverse())


def test_viewers_find_the_camera(stage_of):
    stage = stage_of()
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
    assert camera.projection == Gf.Camera.Perspective
    assert distance * camera.verticalAperture / camera.focalLength / 2.0 == pytest.approx(half, rel=1e-5)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_force_chains_join_centers_and_walls_along_forces(tmp_path, friction):
    """They turn about the contact points, and are as wide as the forces, up to the smallest radius."""
    frames, scene = make_frames(3), make_scene(friction=friction)
    path = record(tmp_path / "run.usdc", frames, scene, forces=True)
    for code, now in enumerate(moments(frames, scene)):
        (ends, width), x = bands_of(path, code), now.position
        (pair, force, tangential), scale = all_contacts(now), ChainScale.of(scene)
        share = np.minimum(np.hypot(force, tangential) / scale.force, 1.0)
        assert_allclose(width, share * RADIUS.min(), rtol=0.0, atol=FLOAT32)
        (i, j), at_wall = pair.T, pair[:, 1] < 0
        side = np.where(j == -2, -1.0, 1.0)[:, np.newaxis]
        normal = np.where(at_wall[:, np.newaxis], side * x[i], x[np.maximum(j, 0)] - x[i])
        normal /= np.hypot(*normal.T)[:, np.newaxis]
        push = force[:, np.newaxis] * normal + tangential[:, np.newaxis] * normal[:, ::-1] * (-1.0, 1.0)
        direction = push / np.hypot(force, tangential)[:, np.newaxis]
        contact = x[i] + RADIUS[i, np.newaxis] * normal
        other = np.where(at_wall[:, np.newaxis], contact, x[np.maximum(j, 0)])
        beyond = ((other - contact) * normal).sum(axis=1, keepdims=True)
        expected = contact - RADIUS[i, np.newaxis] * direction, contact + beyond * direction
        assert_allclose(ends, np.stack(expected, axis=1), rtol=0.0, atol=FLOAT32)


def test_lines_are_cut_at_periodic_sides():
    """Pieces lie in the box, and join at its sides: end to start, a length apart."""
    box = Box((-0.4, 0.6), (0.1, 0.6), periodic="xy")
    rng = np.random.default_rng(1)
    start, way = rng.uniform(-2.0, 2.0, (200, 2)), rng.uniform(-0.2, 0.2, (200, 2))
    begin, end, line = cut(box.space, start, start + way)
    low, high = np.array([box.x, box.y]).T
    for points in (begin, end):
        assert ((points > low - 1e-12) & (points < high + 1e-12)).all()
    total = np.stack([np.bincount(line, along) for along in (end - begin).T], axis=1)
    assert_allclose(total, way, rtol=0.0, atol=1e-12)
    assert np.array_equal(line[:200], np.arange(200))
    for whole in np.flatnonzero(np.bincount(line) > 1):
        own = np.flatnonzero(line == whole)
        joins = (begin[own, np.newaxis] - end[own]) / box.lengths
        joins = np.abs(joins - np.rint(joins)).max(axis=2) < 1e-12
        assert np.count_nonzero(joins) == len(own) - 1
    assert np.bincount(np.bincount(line)).tolist()[1:] != [200]


@pytest.mark.parametrize(("draw_as", "height"), [("discs", 0.24), ("spheres", 1.0), ("points", 1.0)])
def test_force_chains_are_in_front_of_the_grains(stage_of, draw_as, height):
    stage = stage_of(forces=True, draw_as=draw_as)
    bands = UsdGeom.Mesh.Get(stage, FORCES)
    depth = np.array(bands.GetPointsAttr().Get(0))[:, 2]
    assert np.allclose(depth, 1.05 * height * RADIUS.max())
    assert np.allclose(bands.GetDisplayColorPrimvar().Get()[0], linear(np.array(CHAIN_COLOR)))


def test_there_may_be_no_force_chain(tmp_path):
    Simulation(Scene.load("annulus")).run(steps=1, record=tmp_path / "run.usdc", forces=True)
    assert bands_of(tmp_path / "run.usdc", 0)[0].shape == (0, 2, 2)
    assert Recording(tmp_path / "run.usdc").frame(0).force.shape == (0,)
