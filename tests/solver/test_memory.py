"""What does not fit in memory is refused, with an estimate that covers what is allocated."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from same_bits import contents, run_of
from stages import grains_apart

from warpgrains import Scene, Simulation, SimulationError
from warpgrains.cli.main import main
from warpgrains.kernels.record import SceneRecord
from warpgrains.solver import buffers, memory, sizes
from warpgrains.solver.buffers import ALIGNMENT, BlockLayout, array_fields, bytes_needed
from warpgrains.solver.records import SceneRecords
from warpgrains.solver.sizes import Sizes


def test_a_scene_that_does_not_fit_is_refused_with_the_estimate(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda _: 50_000.0)
    scene = Scene.load("pile")
    expected = "1000 grains and their contacts need 0.00 GB, and cpu has 0.00 GB free"
    with pytest.raises(SimulationError, match=expected):
        Simulation(scene)


GB = 1024 * 10**6
V1 = {"memory.usage_in_bytes": 3 * GB, "memory.stat": f"cache {GB}\ntotal_inactive_file {GB}"}
V2 = {"memory.current": 3 * GB, "memory.stat": f"anon 5\ninactive_file {GB}"}
LIMITS = {
    "of the host": ({"proc/self/cgroup": "0::/"}, 24.0),
    "no proc": ({"proc/meminfo": ""}, np.inf),
    "of a group": ({"proc/self/cgroup": "0::/job", "job/memory.max": 8 * GB, "job": V2}, 6.0),
    "of a group around it": (
        {"proc/self/cgroup": "0::/job/step", "job/memory.max": 8 * GB, "job": V2, "job/step": V2}
        | {"job/step/memory.max": "max"},
        6.0,
    ),
    "of a group seen as root": ({"proc/self/cgroup": "0::/docker/7", "memory.max": 8 * GB, "": V2}, 6.0),
    "version 1": (
        {"proc/self/cgroup": "5:cpu,memory:/job\n3:cpuset:/", "memory/job/memory.limit_in_bytes": 8 * GB}
        | {"memory/job": V1},
        6.0,
    ),
    "exceeded": ({"proc/self/cgroup": "0::/", "memory.max": GB, "": V2}, 0.0),
    "ulimit -v": ({"proc/self/limits": f"Max address space         {6 * GB}  unlimited  bytes"}, 4.0),
    "ulimit -d": ({"proc/self/limits": f"Max data size             {6 * GB}  unlimited  bytes"}, 5.0),
}


@pytest.mark.parametrize(("files", "free"), LIMITS.values(), ids=LIMITS)
def test_limits_of_groups_and_processes_count(files, free, tmp_path, monkeypatch):
    """In GB; the host has 24."""
    host = {"proc/meminfo": f"MemTotal: 25000000 kB\nMemAvailable: {24 * GB // 1024} kB"}
    own = {"proc/self/status": f"Name:\tpython\nVmSize:\t {2 * GB // 1024} kB\nVmData:\t {GB // 1024} kB"}
    for name, content in (host | own | files).items():
        for file, text in (content if isinstance(content, dict) else {"": content}).items():
            path = tmp_path / ("" if name.startswith("proc") else "cgroup") / name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(str(text))
    monkeypatch.setattr(memory, "PROC", tmp_path / "proc")
    monkeypatch.setattr(memory, "CGROUPS", tmp_path / "cgroup")
    assert memory.free_memory(wp.get_device("cpu")) == free * GB


@pytest.mark.parametrize("why", ["Unable to allocate 11.0 GiB", ""])
def test_a_command_that_runs_out_of_memory_says_so_in_a_line(why, monkeypatch, capsys):
    def lacking(*_):
        raise MemoryError(*filter(None, [why]))

    monkeypatch.setattr(buffers.Block, "several", lacking)
    assert main(["run", "annulus", "--steps", "1"]) == 1
    assert capsys.readouterr().err == f"warpgrains: error: out of memory{why and ': '}{why}\n"


def test_a_list_that_grows_out_of_memory_leaves_the_last_state(monkeypatch):
    monkeypatch.setattr(sizes, "first_pairs", lambda n: n // 2)
    simulation = Simulation(Scene.load("polydisperse"), threads=1)
    monkeypatch.setattr(memory, "free_memory", lambda _: 1.0)
    with pytest.raises(SimulationError, match=r"step \d+, .*80 grains and their contacts need"):
        simulation.run(steps=100)
    monkeypatch.undo()
    assert simulation.steps > 10
    undisturbed = run_of(simulation.scene, simulation.steps)
    assert contents(simulation.state().corrections) == contents(undisturbed.state().corrections)
    for each in (simulation, undisturbed):
        each.run(steps=20)
    assert np.array_equal(simulation.position, undisturbed.position)
    assert np.array_equal(simulation.velocity, undisturbed.velocity)


def test_a_repeated_search_that_runs_out_of_memory_leaves_the_last_state(monkeypatch):
    """Rows of the first search are written already, and are not joined with the contacts of the last list."""
    simulation = run_of(Scene.load("annulus"), 300, threads=1)
    state = simulation.state()
    apart = np.linalg.norm(state.position[:, np.newaxis] - state.position, axis=2)
    pairs = np.unique(np.sort(np.stack([np.arange(15), apart.argmax(axis=1)], axis=1)), axis=0)
    corrections = replace(
        state.corrections,
        pair=pairs.astype(np.int32),
        pair_correction=np.full(len(pairs), 1e-3),
        wall=np.zeros((0, 2), np.int32),
        wall_correction=np.zeros(0),
    )
    changed = replace(state, lists=None, corrections=corrections)
    simulation.restore(changed)
    reserve = SceneRecords.reserve_contacts

    def refuse(records, k, count):
        if count > len(records.array(k, "neighbors.neighbor")):
            raise SimulationError(f"no memory for {count}")
        reserve(records, k, count)

    with monkeypatch.context() as patch:
        patch.setattr(SceneRecords, "reserve_contacts", refuse)
        with pytest.raises(SimulationError, match="no memory"):
            simulation.step()
    undisturbed = Simulation(simulation.scene, threads=1, state=changed)
    assert contents(simulation.state().corrections) == contents(undisturbed.state().corrections)
    assert contents(simulation.step()) == contents(undisturbed.step())
    assert np.array_equal(simulation.position, undisturbed.position)


@pytest.mark.parametrize(
    ("accelerated", "friction", "team"), [(0, 0, 1), (1, 0, 1), (0, 0, 3), (1, 0, 3), (0, 1, 3)]
)
def test_arrays_do_not_overlap(accelerated, friction, team):
    grains = np.array([1, 2, 7, 60])
    kinds = [(1, 3, 2, 1), (0, 2, 0, 0), (0, 0, 1, 0), (0, 1, 0, 1)]
    kinds += [(0, 0, 1, 0), (1, 0, 0, 1), (0, 1, 0, 1), (0, 5, 0, 0)]
    counts = (grains, np.full_like(grains, 11), *map(np.array, kinds))
    wanted = Sizes(*counts, accelerated, *[friction] * 3, team, team)
    layout = BlockLayout.of(wanted)
    item = np.array([field.bytes for field in array_fields()])[:, None]
    end = layout.offset + item * layout.length
    assert (layout.offset % ALIGNMENT == 0).all()
    assert (end[:-1] <= layout.offset[1:]).all()
    assert (end[-1] <= layout.size).all()
    assert (bytes_needed(wanted) == layout.size + SceneRecord.numpy_dtype()["itemsize"]).all()


def test_every_scene_has_a_history_of_its_own():
    scenes, device = [grains_apart(3)] * 2, wp.get_device("cpu")
    records = SceneRecords(scenes, Sizes.first(scenes, 1, device), device)
    records.keep_history(1, 7)
    assert [len(records.array(k, "zeta_history")) for k in (0, 1)] == [0, 7]
    records.keep_history(0, 7)
    assert [len(records.array(k, "zeta_history")) for k in (0, 1)] == [7, 7]
