"""The recording of a run with friction: spin, angle and tangential forces are read back everywhere."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import warpgrains as wg
from warpgrains import Scene, Simulation, analysis
from warpgrains.usd.check import inspect_recording

FLOAT32 = 1e-6
LAST = 100


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("rolling") / "run.usdc"


@pytest.fixture(scope="module")
def simulation(path):
    """Grains that come to rest in a drum that rotates."""
    scene = Scene.load("annulus", ["contact.friction=0.5", "domain.angular_velocity_out=3.0"])
    simulation = Simulation(scene)
    simulation.run(steps=2 * LAST, record=path, fps=50, forces=True, draw_as="discs")
    return simulation


@pytest.fixture(scope="module")
def recording(simulation, path):
    assert inspect_recording(path) == []
    return wg.Recording(path)


def test_frames_are_snapshots_of_the_run(simulation, recording):
    assert (recording.scene.friction, recording.scene.angular_velocity_out) == (0.5, 3.0)
    assert recording.spin.shape == recording.angle.shape == (LAST + 1, recording.scene.n)
    frame, now = recording.frame(-1), analysis.snapshot(simulation)
    for name in ("position", "spin", "angle", "force", "wall_force", "tangential_force"):
        assert_allclose(getattr(frame, name), getattr(now, name), rtol=FLOAT32)
    assert_allclose(frame.wall_tangential_force, now.wall_tangential_force, rtol=FLOAT32)
    assert np.abs(now.wall_tangential_force).max() > 0.1
    assert np.abs(now.angle).max() > 1.0


def test_datasets_have_them(recording):
    frame, dataset = recording.frame(-1), recording.to_xarray()
    assert np.array_equal(dataset.angle, recording.angle)
    assert dataset.spin.attrs["units"] == "rad/s"
    for table, own in (("contacts", frame.tangential_force), ("wall_contacts", frame.wall_tangential_force)):
        rows = recording.to_xarray(table)
        assert np.array_equal(rows.tangential_force[rows.frame == LAST], own)
        assert rows.force.attrs["units"] == "N"


def test_vtk_has_them(recording, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    from warpgrains.analysis.vtk import export

    assert export(recording.path, tmp_path / "run.pvd") == LAST + 1
    reader, frame = pyvista.get_reader(tmp_path / "run.pvd"), recording.frame(LAST)
    reader.set_active_time_point(LAST)
    blocks = reader.read()
    grains, contacts = blocks[0].point_data, blocks[1].cell_data
    numbers = {**frame.recorded, "angle": frame.angle, "radius": frame.scene.radius}
    assert {"mobilized", "pressure", "speed", "spin"} < numbers.keys()
    for name, values in numbers.items():
        assert np.array_equal(grains[name], values)
    assert grains["mobilized"].max() == 1.0
    tangential = np.concatenate([frame.tangential_force, frame.wall_tangential_force])
    assert np.array_equal(contacts["tangential_force"], tangential)
