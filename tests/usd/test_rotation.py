"""Recordings of scenes with friction: spin, angle, orientations and tangential forces."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pxr import Sdf, Usd, UsdGeom, UsdValidation, Vt
from recordings import GRAINS, bands_of, make_frames, make_scene, moment, recorder_of

import warpgrains as wg
from warpgrains import Scene, Simulation
from warpgrains.analysis.snapshot import snapshot
from warpgrains.arrays import FloatArray
from warpgrains.drawing.chains import ChainScale, all_contacts
from warpgrains.drawing.colorings import mobilized, spin_scale
from warpgrains.drawing.colors import GrainColors, encoded, mark_color
from warpgrains.drawing.shapes import Shape, disc, mark, sphere
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recorder import recover
from warpgrains.usd.recording import Recording, painter_of

FORMS = ("points", "discs", "spheres")
ROTATION = {"primvars:spin", "primvars:angle", "orientations", "primvars:tangential_force"}
FLOAT32 = 1e-6
STEPS = 200


def rolling() -> Scene:
    """Return grains that come to rest in a drum that rotates."""
    return Scene.load("annulus", ["contact.friction=0.5", "domain.angular_velocity_out=3.0"])


def record(path: Path, scene: Scene | None = None, **options: Any) -> Simulation:
    simulation = Simulation(rolling() if scene is None else scene)
    simulation.run(steps=STEPS, record=path, fps=50, **options)
    return simulation


@pytest.mark.parametrize("draw_as", FORMS)
def test_frames_have_spin_and_angle(tmp_path: Path, draw_as: str) -> None:
    path = tmp_path / "run.usdc"
    simulation = record(path, draw_as=draw_as, forces=True)
    assert inspect_recording(path) == []
    stage = Usd.Stage.Open(str(path))
    grains = stage.GetPrimAtPath(GRAINS)
    for name in ("spin", "angle"):
        values = grains.GetAttribute(f"primvars:{name}")
        assert values.GetNumTimeSamples() == STEPS // 2 + 1
        assert np.array_equal(values.Get(STEPS // 2), getattr(simulation, name).astype(np.float32))
    assert np.abs(simulation.angle).max() > 1.0
    if draw_as == "points":
        assert not grains.HasAttribute("orientations")
        return
    turned = UsdGeom.PointInstancer(grains).ComputeInstanceTransformsAtTime(STEPS // 2, STEPS // 2)
    right = np.array([matrix.TransformDir((1.0, 0.0, 0.0)) for matrix in turned])
    angle, radius = simulation.angle, simulation.scene.radius
    expected = radius * np.array([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    assert_allclose(right, expected.T, rtol=0.0, atol=2e-3 * radius.max())  # half precision


@pytest.mark.parametrize("shape", [disc, sphere])
def test_a_mark_changes_no_shape(shape: Callable[..., Shape]) -> None:
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


def area(shape: Shape) -> FloatArray:
    """Return the area vector of each polygon, shape (p, 3)."""
    found = []
    for corners in np.split(shape.corners, np.cumsum(shape.counts)[:-1]):
        points = shape.points[corners]
        found.append(0.5 * np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0))
        assert (np.cross(points[1] - points[0], points[2] - points[0]) @ found[-1]) > 0.0
    return np.array(found)


@pytest.mark.parametrize("draw_as", ["discs", "spheres"])
def test_instances_have_a_mark(tmp_path: Path, draw_as: str) -> None:
    record(tmp_path / "run.usdc", draw_as=draw_as)
    stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
    for prototype in stage.GetPrimAtPath("/World/Prototypes").GetChildren():
        primvar = UsdGeom.Mesh(prototype).GetDisplayColorPrimvar()
        assert primvar.GetInterpolation() == "uniform"
        color, other = encoded(np.array(primvar.Get(), np.float64))
        assert_allclose(mark_color(color), other, atol=1e-6)
        assert len(primvar.GetIndices()) == len(UsdGeom.Mesh(prototype).GetFaceVertexCountsAttr().Get())


def test_validators_find_nothing(tmp_path: Path) -> None:
    record(tmp_path / "run.usdc", draw_as="discs", forces=True)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetMessage() for error in errors] == []


@pytest.mark.parametrize("draw_as", FORMS)
def test_a_recording_without_friction_has_nothing_more(tmp_path: Path, draw_as: str) -> None:
    record(tmp_path / "run.usdc", Scene.load("annulus"), draw_as=draw_as, forces=True)
    stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
    names = {name for prim in stage.TraverseAll() for name in prim.GetAuthoredPropertyNames()}
    assert not names & ROTATION
    assert not wg.Recording(tmp_path / "run.usdc").angle.any()


def test_read_back_as_arrays(tmp_path: Path) -> None:
    simulation = record(tmp_path / "run.usdc", forces=True)
    recording = wg.Recording(tmp_path / "run.usdc")
    assert recording.spin.shape == recording.angle.shape == (STEPS // 2 + 1, recording.scene.n)
    assert recording.scene.friction == 0.5
    assert recording.scene.angular_velocity_out == 3.0
    assert_allclose(recording.angle[-1], simulation.angle, rtol=FLOAT32)
    frame, contacts, walls = recording.frame(-1), simulation.contacts(), simulation.wall_contacts()
    assert_allclose(frame.spin, simulation.spin, rtol=FLOAT32)
    assert_allclose(frame.force, contacts.force, rtol=FLOAT32)
    assert_allclose(frame.tangential_force, contacts.tangential_force, rtol=FLOAT32)
    assert_allclose(frame.wall_tangential_force, walls.tangential_force, rtol=FLOAT32)
    assert np.abs(walls.tangential_force).max() > 0.1
    dataset = recording.to_xarray()
    assert np.array_equal(dataset.angle, recording.angle)
    assert dataset.spin.attrs["units"] == "rad/s"
    for table, own in (("contacts", frame.tangential_force), ("wall_contacts", frame.wall_tangential_force)):
        rows = recording.to_xarray(table)
        assert np.array_equal(rows.tangential_force[rows.frame == STEPS // 2], own)
        assert rows.force.attrs["units"] == "N"


def test_vtk_has_them(tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    from warpgrains.analysis.vtk import export

    record(tmp_path / "run.usdc", forces=True)
    last = export(tmp_path / "run.usdc", tmp_path / "run.pvd") - 1
    reader, frame = pyvista.get_reader(tmp_path / "run.pvd"), wg.Recording(tmp_path / "run.usdc").frame(last)
    reader.set_active_time_point(last)
    blocks = reader.read()
    grains, contacts = blocks[0].point_data, blocks[1].cell_data
    for name in ("spin", "angle"):
        assert np.array_equal(grains[name], getattr(frame, name))
    stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
    found = stage.GetAttributeAtPath(f"{GRAINS}.primvars:mobilized").Get(last)
    assert np.array_equal(grains["mobilized"], found)
    assert grains["mobilized"].max() == 1.0
    tangential = np.concatenate([frame.tangential_force, frame.wall_tangential_force])
    assert np.array_equal(contacts["tangential_force"], tangential)


def test_spin_is_colored_by_its_sign() -> None:
    scene = make_scene(friction=0.3, gravity=(0.0, -10.0))
    largest = 0.5 * np.sqrt(2.0 * 10.0 * 2.0) / 0.1  # half as fast as what falls across; the median radius
    assert spin_scale(scene) == pytest.approx(largest)
    assert spin_scale(scene.replace(spin=-1000.0)) == 1000.0
    assert spin_scale(scene.replace(angular_velocity_out=-1000.0)) == pytest.approx(0.5 * 1000.0 * 2.0 / 0.1)
    spin = largest * np.array([-7.0, -1.0, 1.0 / 63.0, 1.0 / 3.0, 1.0])
    now = moment(scene.position, scene.velocity, scene, spin=spin)
    assert GrainColors(scene, "spin").levels(now).tolist() == [0, 0, 32, 42, 63]


def test_mobilized_friction_is_the_largest_of_a_grain() -> None:
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


@pytest.mark.parametrize("draw_as", FORMS)
@pytest.mark.parametrize("color_by", ["spin", "mobilized"])
def test_grains_have_their_colors(tmp_path: Path, color_by: str, draw_as: str) -> None:
    simulation = record(tmp_path / "run.usdc", color_by=color_by, draw_as=draw_as)
    now, colors = snapshot(simulation), GrainColors(simulation.scene, color_by)
    reader = Recording(tmp_path / "run.usdc")
    assert reader.scale == colors.scale
    stage, frame = Usd.Stage.Open(str(tmp_path / "run.usdc")), reader.frame(STEPS // 2, contacts=False)
    grains = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(GRAINS))
    color = grains.GetPrimvar("displayColor").ComputeFlattened(STEPS // 2)
    assert_allclose(encoded(np.array(color)), colors.of(now), atol=1e-6)
    assert np.array_equal(painter_of(reader).color(frame), colors.of(now))
    assert len(np.unique(colors.levels(now))) >= 3
    assert inspect_recording(tmp_path / "run.usdc") == []
    if color_by == "mobilized":
        expected = mobilized(now)
        assert expected.max() == pytest.approx(1.0)
        stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
        found = stage.GetPrimAtPath(GRAINS).GetAttribute("primvars:mobilized")
        assert np.array_equal(found.Get(STEPS // 2), expected.astype(np.float32))


def test_chains_are_the_total_forces(tmp_path: Path) -> None:
    """Bands go through the contact points, along the forces, and are as wide as they."""
    simulation = record(tmp_path / "run.usdc", forces=True)
    (ends, width), x = bands_of(tmp_path / "run.usdc", STEPS // 2), simulation.position
    (pair, force, tangential), radius = all_contacts(snapshot(simulation)), simulation.scene.radius
    at_wall, (i, j), scale = pair[:, 1] < 0, pair.T, ChainScale.of(simulation.scene)
    assert at_wall.any()
    share = np.minimum(np.hypot(force, tangential) / scale.force, 1.0)
    assert_allclose(width, share * scale.width, rtol=0.0, atol=FLOAT32)
    side = np.where(j == -2, -1.0, 1.0)[:, np.newaxis]
    normal = np.where(at_wall[:, np.newaxis], side * x[i], x[np.maximum(j, 0)] - x[i])
    normal /= np.hypot(*normal.T)[:, np.newaxis]
    along = ends[:, 1] - ends[:, 0]
    direction = along / np.hypot(*along.T)[:, np.newaxis]
    cross = normal[:, 0] * direction[:, 1] - normal[:, 1] * direction[:, 0]
    assert_allclose(cross / (normal * direction).sum(axis=1), tangential / force, atol=1e-4)
    contact = x[i] + radius[i, np.newaxis] * normal
    assert_allclose(ends[:, 0], contact - radius[i, np.newaxis] * direction, atol=1e-5)
    assert_allclose(ends[at_wall, 1], contact[at_wall], atol=1e-5)


@pytest.mark.parametrize("draw_as", FORMS)
def test_a_recording_can_be_continued_and_recovered(tmp_path: Path, draw_as: str) -> None:
    """Of its log, and of its file: the same bytes as of one run."""
    frames, still = make_frames(6), np.zeros(5)
    scene = make_scene(friction=0.3)
    paths = [tmp_path / name for name in ("whole.usdc", "again.usdc", "killed.usdc")]

    def write(path: Path, which: range, resume_at: int | None = None) -> None:
        with recorder_of(path, scene, draw_as=draw_as, resume_at=resume_at) as recorder:
            for k in which:
                recorder.record(moment(*frames[k], scene, spin=still + k, angle=still + 0.3 * k))

    write(paths[0], range(6))
    write(paths[1], range(4))
    write(paths[1], range(3, 6), resume_at=3)
    with pytest.raises(KeyboardInterrupt):
        interrupted(paths[2], scene, frames, draw_as)
    assert recover(f"{paths[2]}.frames") == (paths[2], 6)
    whole, again, killed = (Sdf.Layer.OpenAsAnonymous(str(path)).ExportToString() for path in paths)
    assert whole == again
    assert whole == killed
    assert inspect_recording(paths[1]) == []


def interrupted(path: Path, scene: Scene, frames: Any, draw_as: str) -> None:
    with recorder_of(path, scene, draw_as=draw_as) as recorder:
        for k, frame in enumerate(frames):
            recorder.record(moment(*frame, scene, spin=np.full(5, float(k)), angle=np.full(5, 0.3 * k)))
        raise KeyboardInterrupt


def shorten_angles(grains: Usd.Prim) -> None:
    grains.GetAttribute("primvars:angle").Set([0.1], 1)


def drop_an_orientation(grains: Usd.Prim) -> None:
    grains.GetAttribute("orientations").ClearAtTime(1)


def shorten_orientations(grains: Usd.Prim) -> None:
    grains.GetAttribute("orientations").Set(Vt.QuathArray(2), 1)


def turn_back(grains: Usd.Prim) -> None:
    grains.GetAttribute("orientations").Set(grains.GetAttribute("orientations").Get(100), 1)


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (shorten_angles, "primvars:angle hold 1 values, not 15 for 15 grains (frame 1)"),
        (drop_an_orientation, "Grains.orientations has other time codes than the grains' positions"),
        (shorten_orientations, "orientations hold 2 values, not 15 for 15 grains (frame 1)"),
        (turn_back, "orientations are not those of the angles (frame 1)"),
    ],
)
def test_check_names_what_is_wrong(tmp_path: Path, damage: Any, problem: str) -> None:
    record(tmp_path / "run.usdc", draw_as="discs")
    stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
    damage(stage.GetPrimAtPath(GRAINS))
    stage.Save()
    assert problem in inspect_recording(tmp_path / "run.usdc")
