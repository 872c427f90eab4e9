"""A new list: each contact finds again what it carried in the old one, and those that carry stay listed."""

import numpy as np
import pytest
import warp as wp
from stages import OneRecord, listed, record_of_graph

from warpgrains import Scene
from warpgrains.base.arrays import IntArray
from warpgrains.kernels.access import put
from warpgrains.kernels.record import Outcome, Phase, grain_count
from warpgrains.kernels.record import Scene as SceneOnDevice
from warpgrains.kernels.search import contact_list, neighbors
from warpgrains.kernels.step import ORDER, SAVE, SEARCH, searching
from warpgrains.kernels.team.stages import Each, Serial, While

N, WIDE, NARROW, NOTHING = 120, 0.35, 0.05, 0.0
EXPIRE = [*SAVE, Serial(contact_list.expire)]
LISTED = [While(searching, SEARCH), *ORDER]
NOW, START, LAST, SKIN = "contacts.dv.now", "contacts.dv.start", "contacts.dv.last", "verlet.skin"
Bodies = tuple[int, int]  # a grain, and another one or the wall, which is body N


def cloud(order: str = "sequential", method: str = "gauss-seidel", equal: bool = True) -> Scene:
    """Grains anywhere, overlapping: a list cares for reach alone."""
    rng = np.random.default_rng(7)
    angle, distance = rng.uniform(0.0, 2.0 * np.pi, N), np.sqrt(rng.uniform(0.3, 0.9, N))
    return Scene(
        position=(distance * [np.cos(angle), np.sin(angle)]).T,
        radius=0.01,
        mass=1.0 if equal else rng.uniform(0.5, 4.0, N),
        radius_in=0.5,
        radius_out=1.0,
        order=order,
        method=method,
    )


class Listed(OneRecord):
    """A record with a list for a skin, and what its contacts carry."""

    def __init__(self, scene: Scene, skin: float):
        super().__init__(scene, contacts=N * N)
        self.scene, self.names = scene, [NOW, START] + [LAST] * (scene.method == "accelerated")
        self.write({"grains.position": scene.position, "grains.radius": scene.radius})
        self.write({"grains.contact_mass": scene.contact_mass, "verlet.reference_velocity": 0.0})
        self.write({"verlet.lifetime": scene.dt})
        self.search(skin)

    def search(self, skin: float) -> None:
        self.write({SKIN: skin, "verlet.frame_skin": skin, "control.phase": Phase.SEARCH})
        self.run(*LISTED)
        self.assert_holds({"control.phase": Phase.START})
        rows = self["neighbors.start"]
        first, second = np.repeat(np.arange(N), np.diff(rows)), self["neighbors.neighbor"][: rows[-1]]
        self.bodies: list[Bodies] = list(zip(first.tolist(), second.tolist(), strict=True))
        self.index: IntArray = self["neighbors.sweep_index"][: rows[-1]].copy()

    def carry(self) -> None:
        """Let half of the contacts carry: now, at the step's start or a sweep back alone, or at all times."""
        rng, times, count = np.random.default_rng(1), len(self.names), len(self.bodies)
        which = rng.integers(0, 2 * (times + 1), count)
        for k, name in enumerate(self.names):
            carries = (which == k) | (which == times)
            self[name][:count] = np.where(carries, rng.uniform(0.5, 1.0, count), 0.0)

    def carried(self) -> dict[Bodies, list[float]]:
        """Return what every listed contact carries, by its bodies, once those are found to be in order."""
        swept = self["contacts.contact"][self.index]
        found = np.stack([swept["i"], swept["j"]], axis=1) // 2
        assert [tuple(pair) for pair in found.tolist()] == self.bodies == sorted(self.bodies)
        dv = np.stack([self[name][self.index] for name in self.names], axis=1)
        return dict(zip(self.bodies, dv.tolist(), strict=True))

    def expire(self) -> None:
        """Set the list aside, and spoil what is left of older ones, and what a new one has to write."""
        self.write({"neighbors.old_start": -7, "neighbors.old_neighbor": -7, "contacts.dv.saved": 9.0})
        self.run(*EXPIRE)
        self.write(dict.fromkeys((*self.names, "contacts.weights"), np.nan) | {"neighbors.sweep_index": -7})
        self["contacts.contact"]["i"], self["contacts.contact"]["j"] = 7, 7


def within(scene: Scene, skin: float) -> set[Bodies]:
    """Return the bodies of the contacts that skins reach."""
    x, distance = scene.position, np.hypot(*scene.position.T)
    i, j = np.triu_indices(N, 1)
    near = np.hypot(*(x[j] - x[i]).T) <= 2.0 * (0.01 + skin)
    gap = np.minimum(scene.radius_out - distance, distance - scene.radius_in) - 0.01
    pairs = set(zip(i[near].tolist(), j[near].tolist(), strict=True))
    return pairs | {(i, N) for i in np.flatnonzero(gap <= 2.0 * skin).tolist()}


@pytest.mark.parametrize(
    ("equal", "order", "method"),
    [
        (True, "sequential", "gauss-seidel"),
        (True, "color", "accelerated"),
        (False, "sequential", "accelerated"),
        (False, "color", "gauss-seidel"),
    ],
)
def test_what_contacts_carry_is_found_again(equal: bool, order: str, method: str) -> None:
    scene = cloud(order, method, equal)
    listed = Listed(scene, NARROW)
    assert set(listed.bodies) == within(scene, NARROW)
    listed.carry()
    for skin in (WIDE, NARROW, NOTHING, NOTHING, NARROW):
        before = listed.carried()
        active = {bodies for bodies, dv in before.items() if any(dv)}
        at_wall = sum(j == N for _, j in active)
        assert min(at_wall, len(active) - at_wall) > 8
        listed.expire()
        listed.search(skin)
        assert set(listed.bodies) >= within(scene, skin) | active  # and some that wider skins of these reach
        nothing = [0.0] * len(listed.names)
        assert listed.carried() == {bodies: before.get(bodies, nothing) for bodies in listed.bodies}
    if skin == NARROW and equal:
        assert len(listed["contacts.weights"]) == 0


@pytest.mark.parametrize("carrying", [None, NOW, START, LAST])
def test_skins_are_widened_for_pairs_that_carry_alone(carrying: str | None) -> None:
    """A grain that its wall holds, or held, stays listed there with any skin."""
    listed = Listed(cloud(method="accelerated"), WIDE)
    at_wall = {bodies: k for bodies, k in zip(listed.bodies, listed.index, strict=True) if bodies[1] == N}
    listed.write(dict.fromkeys(listed.names, 0.0))
    held = set(at_wall if carrying else ())
    if carrying:
        listed[carrying][list(at_wall.values())] = -1.0
    listed.expire()
    listed.search(NARROW)
    near = within(listed.scene, NARROW)
    assert set(listed.bodies) == near | held
    assert len(held - near) > 8 or not carrying
    listed.assert_holds({SKIN: NARROW})


def test_shares_and_their_sums() -> None:
    """A grain takes m_j / (m_i + m_j) of a pair, and all of its walls."""
    listed = Listed(cloud(equal=False), NARROW)
    m, row_sum = listed.scene.mass, np.zeros(N)
    weights = listed["contacts.weights"][listed.index].tolist()
    for (i, j), share in zip(listed.bodies, weights, strict=True):
        assert share == ([1.0, 0.0] if j == N else [m[j] / (m[i] + m[j]), m[i] / (m[i] + m[j])])
        np.add.at(row_sum, [i, j % N], share)
    assert listed["verlet.max_row_sum"] == pytest.approx(row_sum.max(), rel=1e-14)
    equal = Listed(cloud(), NARROW)
    halves = np.bincount(np.ravel([(i, i if j == N else j) for i, j in equal.bodies]), minlength=N)
    equal.assert_holds({"verlet.max_row_sum": halves.max() / 2.0})


@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated"])
@pytest.mark.parametrize("iterations", [0, 1, 7])
def test_list_that_expires(iterations: int, method: str) -> None:
    """Accelerated sweeps that were begun resume; plain ones begin again."""
    listed = Listed(cloud(method=method), NARROW)
    listed.write({"step.iterations": iterations, "step.rebuilds": 3, "step.restarts": 5})
    listed.write({"control.resuming": int(iterations == 0)})
    listed.run(Serial(contact_list.expire))
    begun, resumes = iterations > 0, method == "accelerated"
    listed.assert_holds({"control.resuming": begun and resumes})
    listed.assert_holds({"step.restarts": 5 + int(begun and not resumes), "step.rebuilds": 4})


@wp.func
def note_pair_end(s: SceneOnDevice, i: int):
    put(s.grid.bucket, i, contact_list.pair_end(s.neighbors.start, s.neighbors.neighbor, i))


@pytest.mark.parametrize("at_walls", [[0, 0, 0, 0], [2, 0, 1, 2], [0, 2, 0, 1], [1, 1, 1, 1]], ids=str)
def test_pairs_of_a_row_end_where_its_walls_begin(at_walls: list[int]) -> None:
    for pairs in (np.array([(0, 3), (2, 3)]), np.array([(1, 2), (1, 3)])):
        record = record_of_graph(pairs, np.array(at_walls))
        record.run(Each(grain_count, note_pair_end))
        bodies = listed(pairs, np.array(at_walls)).tolist()
        ends = [sum(k < i or (k == i and j < 4) for k, j in bodies) for i in range(4)]
        record.assert_holds({"grid.bucket": ends})


def test_step_waits_for_capacity() -> None:
    listed = Listed(cloud(), NARROW)
    capacity = len(listed["neighbors.neighbor"])
    for total, phase, outcome in (
        (capacity, Phase.START, 0),
        (capacity + 1, Phase.LIST_FULL, Outcome.WAITING),
    ):
        listed.write({"step.outcome": 0, "control.phase": Phase.SEARCH, "control.unordered": 1})
        listed["neighbors.slots"][0], listed["neighbors.empty"][0] = total + 3, 3
        listed.run(Serial(neighbors.check_capacity))
        listed.assert_holds({"control.phase": phase, "step.outcome": outcome})
        listed.assert_holds({"control.unordered": phase == Phase.START})
