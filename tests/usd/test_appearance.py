"""What a recording shows: colors and numbers of grains, force chains, material, light and camera."""

from itertools import cycle

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade, UsdUtils
from recordings import (
    FORMS,
    GRAINS,
    RADIUS,
    bands_of,
    make_frames,
    make_scene,
    moments,
    opened,
    record,
)
from walled_scenes import BOXES, boxed, stirred

from warpgrains import Scene, Simulation
from warpgrains.drawing.chains import CHAIN_COLOR, ChainScale, all_contacts
from warpgrains.drawing.colorings import (
    COLORINGS,
    colorings_of,
)
from warpgrains.drawing.colors import CATEGORIES, PALETTE, GrainColors, encoded, linear, mark_color
from warpgrains.usd.recording import Recording, painter_of

FORCES = "/World/Forces"
FLOAT32 = 1e-6  # of coordinates up to 2 m
TURNING = make_scene(friction=0.3)
ROTATION = {"primvars:spin", "primvars:angle", "orientations", "primvars:tangential_force"}


@pytest.fixture(scope="module", params=FORMS)
def in_form(request, tmp_path_factory):
    """Return a form, and a recording in it of grains that rotate, with their forces."""
    path = tmp_path_factory.mktemp(request.param) / "run.usdc"
    return request.param, opened(path, 2, TURNING, draw_as=request.param, forces=True)


@pytest.mark.parametrize(("color_by", "draw_as"), [*zip([*CATEGORIES, *COLORINGS], cycle(FORMS))])
def test_colors_and_numbers_are_those_of_the_snapshots(tmp_path, color_by, draw_as):
    """And only what changes is written each frame, and what turns only with friction."""
    scene = TURNING if color_by in ("spin", "mobilized") else make_scene()
    has_forces = color_by in ("radius", "spin")
    stage = opened(tmp_path / "run.usdc", 3, scene, color_by=color_by, draw_as=draw_as, forces=has_forces)
    written = {name for prim in stage.TraverseAll() for name in prim.GetAuthoredPropertyNames()}
    assert bool(written & ROTATION) == scene.has_friction
    codes = 3 if color_by in COLORINGS and COLORINGS[color_by].changes else 0
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
        assert np.array_equal(painter_of(recording).colors.of(frame), colors.of(now))
        numbers = {"angle": now.angle} if scene.has_friction else {}
        found = colorings_of(scene, has_forces or colors.needs_contacts).items()
        numbers |= {name: own.values(now) for name, own in found if own.changes}
        for name, values in numbers.items():
            assert np.array_equal(primvars.GetPrimvar(name).Get(number), values.astype(np.float32))
        if has_forces:
            for name, values in zip(("force", "tangential_force"), all_contacts(now)[1:], strict=True):
                if bands.HasPrimvar(name):
                    assert np.array_equal(bands.GetPrimvar(name).Get(number), values.astype(np.float32))


class TestForms:
    def test_grains_turn(self, in_form):
        draw_as, stage = in_form
        names = {name for prim in stage.TraverseAll() for name in prim.GetAuthoredPropertyNames()}
        if draw_as == "points":
            assert names & ROTATION == ROTATION - {"orientations"}
            return
        assert names >= ROTATION
        turned = UsdGeom.PointInstancer(stage.GetPrimAtPath(GRAINS)).ComputeInstanceTransformsAtTime(1, 1)
        right = np.array([matrix.TransformDir((1.0, 0.0, 0.0)) for matrix in turned])
        angle = [*moments(make_frames(2), TURNING)][1].angle
        expected = RADIUS * np.array([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
        assert_allclose(right, expected.T, rtol=0.0, atol=2e-3 * RADIUS.max())  # half precision

    def test_few_prims_stand_for_all_grains(self, in_form):
        draw_as, stage = in_form
        prims = list(stage.Traverse())
        assert len(prims) == 13
        points = [str(prim.GetPath()) for prim in prims if prim.IsA(UsdGeom.Points)]
        assert points == ([GRAINS] if draw_as == "points" else [])
        kinds = {prim.GetName(): kind for prim in prims if (kind := Usd.ModelAPI(prim).GetKind())}
        parts = dict.fromkeys(("Grains", "Walls", "Forces"), "subcomponent")
        assert kinds == {"World": "component", **parts}

    def test_viewers_find_light_and_camera(self, in_form):
        _, stage = in_form
        assert any(prim.IsA(UsdLux.DistantLight) for prim in stage.Traverse())
        camera = stage.GetPrimAtPath(f"/World/{UsdUtils.GetPrimaryCameraName()}")
        assert camera.IsA(UsdGeom.Camera)
        settings = stage.GetRootLayer().customLayerData["cameraSettings"]
        assert settings == {"boundCamera": str(camera.GetPath())}

    def test_everything_has_a_material_that_reads_its_color(self, in_form):
        draw_as, stage = in_form
        drawn = [prim for prim in stage.TraverseAll() if prim.IsA(UsdGeom.Gprim)]
        assert len(drawn) == 3 + (1 if draw_as == "points" else 16)
        for prim in drawn:
            material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
            surface = material.ComputeSurfaceSource()[0]
            assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
            source = surface.GetInput("diffuseColor").GetConnectedSources()[0][0].source
            assert source.GetInput("varname").Get() == "displayColor"

    def test_force_chains_are_in_front_of_the_grains(self, in_form):
        draw_as, stage = in_form
        bands = UsdGeom.Mesh.Get(stage, FORCES)
        depth = np.array(bands.GetPointsAttr().Get(0))[:, 2]
        assert np.allclose(depth, 1.05 * (0.24 if draw_as == "discs" else 1.0) * RADIUS.max())
        assert np.allclose(bands.GetDisplayColorPrimvar().Get()[0], linear(np.array(CHAIN_COLOR)))


@pytest.mark.parametrize(("color_by", "friction"), [("speed", 0.3), ("radius", 0.0), ("palette", 0.3)])
@pytest.mark.parametrize("draw_as", ["discs", "spheres"])
def test_prototypes_have_about_the_colors_of_their_grains_and_marks(tmp_path, draw_as, color_by, friction):
    scene = make_scene(friction=friction)
    stage = opened(tmp_path / "run.usdc", 1, scene, color_by=color_by, draw_as=draw_as)
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


def test_there_may_be_no_force_chain(tmp_path):
    Simulation(Scene.load("annulus")).run(steps=1, record=tmp_path / "run.usdc", forces=True)
    assert bands_of(tmp_path / "run.usdc", 0)[0].shape == (0, 2, 2)
    assert Recording(tmp_path / "run.usdc").frame(0).force.shape == (0,)


@pytest.mark.parametrize("kind", ["turning", *BOXES])
def test_walls_are_bodies_about_the_bands_of_pictures(tmp_path, kind):
    """Also where they move: their volume, by their faces, is that of the bands times their depth."""
    scene, path = stirred(20) if kind == "turning" else boxed(kind, 30), tmp_path / "run.usdc"
    Simulation(scene).run(duration=0.3, record=path)
    stage, height = Usd.Stage.Open(str(path)), float(scene.radius.mean())
    painter = painter_of(recording := Recording(path))
    last = len(recording) - 1
    bands = painter.walls | painter.moved_walls(scene.placed(recording.places(last)), recording.time[last])
    for name, band in bands.items():
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/Walls/{name}"))
        get = (mesh.GetPointsAttr(), mesh.GetFaceVertexIndicesAttr(), mesh.GetNormalsAttr())
        points, faces, normals = (np.array(own.Get(last)) for own in get)
        corner = points[faces.reshape(-1, 4)].astype(np.float64)
        area = 0.5 * np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])
        size = np.linalg.norm(area, axis=1)
        assert_allclose((area * normals).sum(axis=1), size, rtol=0.0, atol=1e-5 * size.max())
        flat = sum(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)) for x, y in band.outlines().swapaxes(1, 2))
        volume = (area * corner.mean(axis=1)).sum() / 3.0
        assert volume == pytest.approx(2.0 * height * abs(flat), rel=1e-4)  # float32
