"""Results for other programs: frames, datasets, recordings as arrays, files of VTK in pyvista."""

import sys
from dataclasses import asdict, fields
from math import ceil
from xml.etree import ElementTree

import numpy as np
import pytest
import pyvista
from command import exit_code, require_refusal
from walled_scenes import boxed

import warpgrains as wg
from warpgrains import InputError, Scene, Segment, Simulation, analysis
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.usd.check import inspect_recording

FLOAT32 = float(np.finfo(np.float32).eps)


RUNS = {
    "smooth": ("polydisperse", 60, {"drag": 0.03}),
    "rolling": ("annulus", 200, {"friction": 0.5, "angular_velocity_out": 3.0}),
}


@pytest.fixture(scope="module", params=RUNS)
def recorded(request, tmp_path_factory):
    path, (name, steps, changes) = tmp_path_factory.mktemp("recorded") / "run.usdc", RUNS[request.param]
    simulation = Simulation(Scene.load(name), **changes)
    simulation.run(steps=steps, record=path, fps=10, forces=True)
    return path, simulation


def single(array):
    return array.astype(np.float32)


def test_recording_as_arrays(recorded):
    path, simulation = recorded
    assert inspect_recording(path) == []
    found, scene = wg.Recording(path), simulation.scene
    frames, n = 1 + simulation.steps // 10, scene.n
    assert len(found) == frames
    assert found.time == pytest.approx(0.1 * np.arange(frames), rel=4 * np.finfo(float).eps)
    assert found.position.shape == found.velocity.shape == (frames, n, 2)
    assert np.array_equal(found.position[[0, -1]], single(np.array([scene.position, simulation.position])))
    assert np.array_equal(found.velocity[-1], single(simulation.velocity))
    told = f"run.usdc of {n} grains, frames {frames}, time {simulation.time:g} s, forces recorded"
    assert repr(found) == f"Recording({told})"
    for field in fields(Scene):
        ours, its = getattr(found.scene, field.name), getattr(scene, field.name)
        its = single(its) if field.name in ("position", "velocity") else its
        assert np.array_equal(ours, its), field.name


@pytest.mark.parametrize("suffix", RECORDINGS)
def test_a_file_that_is_replaced_is_read_anew(tmp_path, suffix):
    """Also while the recording of its former content is used. What it lacks is not made up."""
    path = tmp_path / f"run{suffix}"
    Simulation("annulus").run(steps=4, record=path)
    former, simulation = wg.Recording(path), Simulation("polydisperse")
    simulation.run(steps=8, record=path, fps=50)
    assert inspect_recording(path) == []
    assert len(former.position) == 1
    found = wg.Recording(path)
    assert found.scene.name == "polydisperse"
    assert np.array_equal(found.position[-1], single(simulation.position))
    with pytest.raises(InputError, match="holds no contacts"):
        found.frame(0)
    assert analysis.kinetic_energy(found.frame(0, contacts=False)) == 0.0
    with pytest.raises(InputError, match="frame 99 does not exist"):
        found.frame(99)
    assert dict(found.to_xarray().sizes) == {"time": len(found), "grain": found.scene.n}


def test_a_frame_within_a_step_has_its_time(tmp_path):
    """And so have its walls and its gravity."""
    paddle = Segment((-0.9, -0.4), (0.9, -0.4), angular_velocity=0.5)
    scene = Scene.load("annulus").replace(
        walls=[paddle], gravity={"vector": (0.0, -9.81), "angular_velocity": 1.0}
    )
    Simulation(scene).run(duration=2.0, record=tmp_path / "run.usdc", forces=True)
    recording = wg.Recording(tmp_path / "run.usdc")
    contacts = recording.to_pandas("wall_contacts")
    touched = [recording.frame(k) for k in sorted({*contacts.frame[contacts.wall == 0]})]
    within = [frame for frame in touched if frame.time < frame.steps * scene.dt]
    assert len(within) > 5
    for frame in within:
        k = round(24.0 * frame.time)
        assert (frame.time, frame.steps) == (pytest.approx(k / 24.0), ceil(k / 0.24))
        walls = frame.to_pandas("wall_contacts")
        assert walls.equals(contacts[contacts.frame == k][list(walls)].reset_index(drop=True))
        energy = -(scene.mass * (frame.position @ scene.gravity_at(k / 24.0))).sum()
        assert analysis.potential_energy(frame) == pytest.approx(energy, rel=1e-12)


def test_a_frame_is_analysed_as_the_simulation_was(recorded):
    path, simulation = recorded
    frame, moment = wg.Recording(path).frame(-1), analysis.snapshot(simulation)
    assert np.array_equal(frame.pair, moment.pair)
    assert analysis.coordination_number(frame) == analysis.coordination_number(moment)
    for name in ("force", "wall_force", "tangential_force", "wall_tangential_force", "spin", "angle"):
        assert getattr(frame, name) == pytest.approx(getattr(moment, name), rel=FLOAT32)
    if simulation.scene.has_friction:
        assert np.abs(moment.wall_tangential_force).max() > 0.1
        assert np.abs(moment.angle).max() > 1.0
    walls = [[own.normal for own in analysis.wall_forces(each).values()] for each in (frame, moment)]
    assert walls[0] == pytest.approx(walls[1], rel=FLOAT32)
    # centers within the domain of 1 m are rounded by FLOAT32 / 2, and normals by as much over a distance
    off = 4.0 * FLOAT32 / simulation.scene.radius.min()
    assert np.abs(frame.start - moment.start).max() <= FLOAT32
    assert np.abs(frame.loads.normal - moment.loads.normal).max() <= off
    expected = analysis.mean_stress(moment)
    assert analysis.mean_stress(frame) == pytest.approx(expected, abs=off * np.abs(expected).max())
    assert [wg.Recording(path).frame(k).steps for k in (0, 6)] == [0, 60]


def test_recording_as_dataset(recorded):
    found = wg.Recording(recorded[0])
    dataset = found.to_xarray()
    assert dict(dataset.sizes) == {"time": len(found), "grain": found.scene.n}
    assert np.array_equal(dataset.angle, found.angle)
    assert np.array_equal(np.stack([dataset.x, dataset.y], axis=-1), found.position)
    assert np.array_equal(dataset.mass[3], found.scene.mass)
    units = {"vx": "m/s", "time": "s", "spin": "rad/s"}
    assert {name: dataset[name].attrs["units"] for name in units} == units
    contacts = found.to_xarray("contacts")
    assert np.array_equal(contacts.force, found.to_pandas("contacts").force)
    assert contacts.force.attrs["units"] == "N"
    ours, last = found.frame(-1).to_xarray(), dataset.isel(time=-1)
    assert ours.data_vars.keys() == last.data_vars.keys()
    for name in ours.data_vars:
        assert np.array_equal(ours[name], last[name]), name
        assert ours[name].attrs == last[name].attrs


def test_tables_of_a_recording_are_those_of_its_frames(recorded):
    found = wg.Recording(recorded[0])
    for table in ("grains", "contacts", "wall_contacts"):
        rows = found.to_pandas(table)
        for k in range(len(found)):
            own, expected = rows[rows.frame == k], found.frame(k).to_pandas(table)
            assert (own.time == found.time[k]).all()
            assert expected.equals(own[list(expected)].reset_index(drop=True))
            assert len(expected) > 0 or k < len(found) - 1


def test_a_simulation_as_tables(recorded):
    """Those of a snapshot are those of the simulation's contacts that carry forces."""
    simulation = recorded[1]
    moment = analysis.snapshot(simulation)
    grains = moment.to_pandas("grains")
    assert np.array_equal(grains[["x", "y"]], simulation.position)
    assert np.array_equal(grains[["vx", "vy"]], simulation.velocity)
    assert np.array_equal(grains.mass, simulation.scene.mass)
    carried = ["normal_x", "normal_y", "gap", "correction", "force", "tangential_force", "slides"]
    each = {
        "contacts": (simulation.contacts(), "pair", ["i", "j"]),
        "wall_contacts": (simulation.wall_contacts(), "wall", ["grain", "wall"]),
    }
    for table, (contacts, name, columns) in each.items():
        expected, found = contacts.to_pandas(), moment.to_pandas(table)
        assert list(expected) == [*columns, *carried]
        assert np.array_equal(expected[columns], getattr(contacts, name))
        assert np.array_equal(expected[["normal_x", "normal_y"]], contacts.normal)
        assert np.array_equal(expected.force, contacts.force)
        assert np.array_equal(expected.tangential_force, contacts.tangential_force)
        assert found.equals(expected[list(found)][expected.force > 0.0].reset_index(drop=True))
        assert len(found) > 0
    other = Simulation("annulus")
    report = other.step()
    values = {name: value for name, value in asdict(report).items() if name != "history"}
    assert report.to_pandas().loc[0].to_dict() == values
    assert other.run(steps=3).to_pandas().steps.tolist() == [3]


def exported(path):
    """Export a recording, and yield for each frame its time and its blocks by name, as pyvista reads them."""
    output = path.with_suffix(".pvd")
    assert exit_code("export", path, "-o", output) == 0
    reader, listed = pyvista.get_reader(output), [*ElementTree.parse(output).iter("DataSet")]
    for time in reader.time_values:
        reader.set_active_time_value(time)
        names = [one.get("name") for one in listed if float(one.get("timestep")) == time]
        yield time, dict(zip(names, reader.read(), strict=True))


def test_vtk_reads_every_frame_back(recorded, capfd):
    """Also the first one, in which no contact carries a force."""
    source, found = wg.Recording(recorded[0]), [*exported(recorded[0])]
    assert capfd.readouterr().out == f"{recorded[0].with_suffix('.pvd')}: {len(source)} frames\n"
    assert [time for time, _ in found] == source.time.tolist()
    scene, walls, n = source.scene, found[0][1]["Walls"], source.scene.n
    rho, nearest = np.hypot(*walls.points[:, :2].T), 0.98 * scene.radius_in or scene.radius_out
    assert walls.n_cells > 100
    assert (rho.min(), rho.max()) == (
        pytest.approx(nearest, rel=0.1),
        pytest.approx((1.0 + 0.014 * 1.04) * scene.radius_out),
    )
    for k, (_, blocks) in enumerate(found):
        frame, grains, contacts = source.frame(k), blocks["Grains"], blocks["Contacts"]
        assert (grains.n_points, grains.n_verts, contacts.n_verts) == (n, n, 0)
        assert np.array_equal(grains.points[:, :2], frame.position)
        pressure = np.bincount(frame.loads.grain, frame.loads.force, n) / (2 * np.pi * scene.radius)
        values = {"grain": np.arange(n), "radius": scene.radius, "mass": scene.mass}
        values["velocity"] = np.insert(frame.velocity, 2, 0.0, axis=1)
        if scene.has_friction:
            values |= {"spin": frame.spin, "angle": frame.angle, "mobilized": frame.recorded["mobilized"]}
            tangential = np.concatenate([frame.tangential_force, frame.wall_tangential_force])
            assert np.array_equal(contacts.cell_data["tangential_force"], tangential)
        assert {*grains.point_data} == {*values, "speed", "pressure", "force"}
        for name, value in values.items():
            assert np.array_equal(grains.point_data[name], value)
        assert grains.point_data["speed"] == pytest.approx(np.hypot(*frame.velocity.T), rel=2 * FLOAT32)
        assert grains.point_data["pressure"] == pytest.approx(pressure, rel=8 * FLOAT32)  # up to 6 forces
        assert np.array_equal(contacts.cell_data["force"], np.concatenate([frame.force, frame.wall_force]))
        grain, other = (contacts.cell_data[name] for name in ("grain", "other"))
        assert np.array_equal(np.stack([grain, other], axis=1)[: len(frame.pair)], frame.pair)
        assert np.array_equal(np.stack([grain, -1 - other], axis=1)[len(frame.pair) :], frame.wall)
        ends = contacts.points[contacts.lines.reshape(-1, 3)[:, 1:], :2]
        assert np.array_equal(ends[:, 0], frame.position[grain])
        assert np.array_equal(ends[other >= 0, 1], frame.position[other[other >= 0]])
        # touched to what overlaps a converged step leaves, and rounding to float32
        radius = np.where(other[other < 0] == -2, scene.radius_in, scene.radius_out)
        assert np.hypot(*ends[other < 0, 1].T) == pytest.approx(radius, abs=1e-3)
    assert any(len(frame.wall) for frame in map(source.frame, range(len(source))))


def test_vtk_has_the_walls_where_they_are(tmp_path):
    wall = Segment((-0.9, -0.4), (0.5, -0.4), velocity=(0.1, 0.0))
    scene = Scene.load("annulus").replace(walls=[wall], friction=0.5)
    Simulation(scene).run(duration=1.0, record=tmp_path / "run.usdc")
    found = [blocks for _, blocks in exported(tmp_path / "run.usdc")]
    moved = found[-1]["Walls"].points - found[0]["Walls"].points
    assert len(found) == 25
    assert np.abs(moved).max() == pytest.approx(0.1, abs=1e-12)
    assert moved[:64, 0] == pytest.approx(0.1, abs=1e-12)  # the segment, the first wall
    assert not moved[64:].any()
    names = {"grain", "radius", "mass", "velocity", "speed", "spin", "angle"}
    assert all({*blocks["Grains"].point_data} == names for blocks in found)
    assert {*found[0]} == {"Grains", "Walls"}


@pytest.mark.parametrize("kind", ["shear", "walls"])
def test_vtk_has_grains_and_contacts_of_a_periodic_box_inside(tmp_path, kind):
    """Of a contact that leaves it, the pieces have the length and the numbers of the contact."""
    scene, path = boxed(kind, 80), tmp_path / "run.usdc"
    Simulation(scene).run(steps=40, record=path, forces=True)
    frame, (*_, (_, last)) = wg.Recording(path).frame(-1), exported(path)
    grains, contacts, number = last["Grains"], last["Contacts"], last["Grains"].point_data["grain"]
    away = (grains.points[:, :2] - frame.position[number]) / np.where(
        scene.period.repeats, scene.period.lengths, 1.0
    )
    assert away == pytest.approx(np.rint(away), abs=1e-12)
    assert np.array_equal(number[: scene.n], np.arange(scene.n))
    assert len(number) > scene.n
    assert np.array_equal(grains.point_data["radius"], scene.radius[number])
    ends = contacts.points[contacts.lines.reshape(-1, 3)[:, 1:], :2]
    inside = ends[..., scene.period.repeats], scene.period.lengths[scene.period.repeats]
    assert ((inside[0] >= -1e-12) & (inside[0] <= inside[1] + 1e-12)).all()
    pairs = np.stack([contacts.cell_data[name] for name in ("grain", "other")], axis=1)
    for (i, j), force in zip(frame.pair.tolist(), frame.force.tolist(), strict=True):
        pieces = (pairs == (i, j)).all(axis=1)
        length = np.hypot(*(ends[pieces, 1] - ends[pieces, 0]).T).sum()
        assert length == pytest.approx(scene.radius[[i, j]].sum(), abs=0.02)  # which few iterations leave
        assert (contacts.cell_data["force"][pieces] == force).all()
    assert len(frame.pair) > 10


def test_an_export_replaces_frames_only(tmp_path, capfd):
    path, folder = tmp_path / "run.usdc", tmp_path / "run"
    folder.mkdir()
    for name in ("0099.vtp", "contacts-0003.vtp", ".draft.grains-0000.vtp"):
        (folder / name).write_text("of an earlier export")
    Simulation(Scene.load("annulus")).run(steps=5, record=path)
    assert exit_code("export", path) == 0
    assert {one.stem for one in folder.iterdir()} == {"grains-0000", "grains-0001", "walls-0000"}
    (folder / "notes.txt").write_text("mine")
    capfd.readouterr()
    assert exit_code("export", path) == 2
    require_refusal(capfd, "holds other files than frames")


def test_series_as_frame_and_dataset():
    series = analysis.Series("speed,pressure", every=5)
    Simulation(Scene.load("annulus")).run(steps=20, observer=series)
    frame, dataset = series.to_pandas(), series.to_xarray()
    assert list(frame.index) == [0, 5, 10, 15, 20]
    assert list(frame) == ["time", "mean_speed", "largest_speed", "granular_temperature", "pressure"]
    assert frame.mean_speed.tolist() == [row["mean_speed"] for row in series.rows]
    assert dataset.pressure.attrs["units"] == "N/m"
    assert dataset.time.values.tolist() == frame.time.tolist()
    assert len(analysis.Series("speed").to_pandas()) == 0


@pytest.mark.parametrize("name", ["pandas", "xarray"])
def test_without_the_extra_a_line_names_it(name, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(InputError, match=rf"to_{name} needs {name}: pip install 'pandas>="):
        getattr(analysis.Series("speed"), f"to_{name}")()
