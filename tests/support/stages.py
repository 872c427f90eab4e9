"""Single stages of a step (device functions), run on a scene's record, whose arrays a test has set.

A record is the struct of all arrays and numbers of a scene. Arrays that a stage must write can be filled with
invalid numbers before.
"""

from functools import partial, reduce
from operator import getitem
from typing import Any

import numpy as np
import warp as wp

from warpgrains import Scene
from warpgrains.base.arrays import IntArray
from warpgrains.kernels.record import SceneRecord
from warpgrains.kernels.team.stages import OPTIONS, Stage, fuse
from warpgrains.kernels.team.threads import TeamRecord, team_records
from warpgrains.solver.engine import CPU_BLOCK
from warpgrains.solver.records import SceneRecords
from warpgrains.solver.sizes import Sizes
from warpgrains.solver.threads import run_threads

Values = dict[str, Any]
"""Values of arrays and numbers of a record, by name, such as "contacts.dv.now" or "step.zeta"."""
KERNELS: dict[str, wp.Kernel] = {}


def kernel_of(*stages: Stage) -> wp.Kernel:
    """Return a kernel that runs stages one after the other, for the first record that it is given."""
    name = repr(stages)
    if name not in KERNELS:
        run = fuse(stages)

        @wp.kernel(module="unique", module_options=OPTIONS)
        def run_stages(records: wp.array(dtype=SceneRecord), team: TeamRecord):
            run(team, records[0])

        run_stages.module.load(wp.get_device("cpu"), CPU_BLOCK)
        KERNELS[name] = run_stages
    return KERNELS[name]


class OneRecord:
    """The record of one scene, with a capacity of `contacts` contacts, and threads that run its stages."""

    def __init__(self, scene: Scene, contacts: int, threads: int = 1):
        device = wp.get_device("cpu")
        self.records = SceneRecords([scene], Sizes.first([scene], threads, device), device)
        self.records.reserve_contacts(0, contacts)
        self.team = team_records(threads)

    def __getitem__(self, name: str) -> np.ndarray[Any, Any]:
        """Return an array of the record by name. A number, such as "step.zeta", has shape (1,)."""
        try:
            return self.records.array(0, name)
        except KeyError:
            return reduce(getitem, name.split("."), self.records.host)

    def write(self, values: Values) -> None:
        for name, value in values.items():
            self[name][:] = value

    def assert_holds(self, values: Values) -> None:
        for name, value in values.items():
            assert np.array_equal(self[name], np.broadcast_to(value, self[name].shape)), name

    def run(self, *stages: Stage) -> None:
        kernel, records = kernel_of(*stages), self.records.device
        launch = partial(wp.launch, kernel, 1, device="cpu", record_cmd=True)
        run_threads([launch(inputs=(records, thread)).launch for thread in self.team])


def grains_apart(n: int) -> Scene:
    """Return n grains that do not touch, for tests in which a graph sets the contacts."""
    x, y = np.divmod(np.arange(n), 100)
    return Scene(position=np.stack([x, y], axis=1) + 0.5, radius=0.1, mass=1.0, radius_out=200.0 + n)


def path(n: int) -> IntArray:
    """Return the pairs (0, 1), (1, 2), ... of n grains, shape (n - 1, 2)."""
    return np.arange(n - 1)[:, np.newaxis] + np.arange(2)


def random_graph(n: int, pairs: int, seed: int) -> IntArray:
    """Return random distinct pairs of n grains in lexicographic order, shape (pairs, 2)."""
    everything = np.stack(np.triu_indices(n, 1), axis=1)
    chosen = np.random.default_rng(seed).choice(len(everything), pairs, replace=False)
    return everything[np.sort(chosen)]


def grain_total(pairs: IntArray) -> int:
    """Return the number of grains of a graph."""
    return int(pairs.max(initial=0)) + 1


def listed(pairs: IntArray, at_walls: IntArray) -> IntArray:
    """Return contacts in the order of the list, shape (m, 2): the given pairs, and contacts with walls.

    Grain i touches the first `at_walls[i]` walls. Wall k has the number n + k, with n grains.
    """
    n = len(at_walls)
    body = n + np.arange(at_walls.max(initial=0))
    at = np.nonzero(np.arange(len(body)) < at_walls[:, np.newaxis])
    contacts = np.concatenate([pairs, np.stack([at[0], body[at[1]]], axis=1)])
    return contacts[np.lexsort(contacts.T[::-1])]


def record_of_graph(pairs: IntArray, at_walls: IntArray) -> OneRecord:
    """Return a record whose list of contacts is `listed(pairs, at_walls)`.

    Arrays that stages must write hold invalid numbers.
    """
    contacts, scene = listed(pairs, at_walls), grains_apart(len(at_walls))
    record = OneRecord(scene.replace(wall="round"), len(contacts) + 1)  # round walls have limits
    record["neighbors.start"][:] = np.searchsorted(contacts[:, 0], np.arange(scene.n + 1))
    record["neighbors.neighbor"][: len(contacts)] = contacts[:, 1]
    record.write({"neighbors.set_of": -7, "neighbors.sweep_index": -7, "neighbors.taken": 2**64 - 1})
    record.write({"contacts.set_start": -7, "contacts.count": (-7, -7, -7)})
    return record
