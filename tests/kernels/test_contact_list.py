"""A new list: each contact finds again what it carried in the old one, and those that carry stay listed."""

import numpy as np
import pytest
from stages import OneRecord

from warpgrains import Scene
from warpgrains.arrays import FloatArray
from warpgrains.kernels import contact_list, neighbors
from warpgrains.kernels.record import WITHOUT_ROOM
from warpgrains.kernels.stages import Serial
from warpgrains.kernels.step import NEW_LIST, SAVE, sweeping_order

N, WIDE, NARROW, NOTHING = 120, 0.35, 0.05, 0.0
EXPIRE = [*SAVE, Serial(contact_list.expire)]
LISTED = [*NEW_LIST, *sweeping_order(dealt=False)]
PAIR = {"now": "contacts.pair_dv", "start": "contacts.pair_dv_start", "last": "momentum.pair_last"}
WALL = {"now": "contacts.walls", "start": "contacts.wall_dv_start", "last": "momentum.wall_last"}


def cloud(order: str, method: str, equal: bool) -> Scene:
    """Grains of radius 0.1 anywhere, overlapping: a list cares for reach alone."""
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


class Listed:
    """A record with a list for a skin, and what its contacts carry."""

    def __init__(self, scene: Scene, skin: float):
        self.scene, self.record = scene, OneRecord(scene, pairs=N * N)
        self.names = ["now", "start"] + ["last"] * (scene.method == "accelerated")
        self.record["grains.position"][:], self.record["grains.radius"][:] = scene.position, scene.radius
        self.record["grains.mass"][:] = scene.mass
        self.record["verlet.reference_velocity"][:] = 0.0
        self.record.verlet_numbers["lifetime"] = scene.dt
        self.search(skin)

    def search(self, skin: float) -> None:
        self.record["verlet.skin"][:], self.record.verlet_numbers["frame_skin"] = skin, skin
        self.record.run(*LISTED)
        assert self.record.record["control"]["roomy"]

    @property
    def pairs(self) -> list[tuple[int, int]]:
        return list(map(tuple, self.record.memory.listed_pairs().tolist()))

    @property
    def walls(self) -> list[int]:
        return self.record["contacts.walls"]["i"][: self.record.memory.walls].tolist()

    def _values(self, name: str) -> FloatArray:
        array = self.record[name]
        return array["dv"] if name == "contacts.walls" else array

    def carry(self) -> None:
        """Let half of the contacts carry: now, at the step's start or a sweep back alone, or at all times."""
        rng, times = np.random.default_rng(1), len(self.names)
        for kinds, count in ((PAIR, len(self.pairs)), (WALL, len(self.walls))):
            which = rng.integers(0, 2 * (times + 1), count)
            for k, name in enumerate(self.names):
                carries = (which == k) | (which == times)
                self._values(kinds[name])[:count] = np.where(carries, rng.uniform(0.5, 1.0, count), 0.0)

    def carried(self) -> tuple[dict[tuple[int, int], list[float]], dict[int, list[float]]]:
        """Return what every listed contact carries, by its grains."""
        place = self.record["workspace.sweep_index"][: len(self.pairs)]
        swept = self.record["contacts.pairs"][place]
        assert list(zip(swept["i"].tolist(), swept["j"].tolist(), strict=True)) == self.pairs
        pair = np.stack([self._values(PAIR[name])[place] for name in self.names], axis=1)
        wall = np.stack([self._values(WALL[name])[: len(self.walls)] for name in self.names], axis=1)
        return (
            dict(zip(self.pairs, pair.tolist(), strict=True)),
            dict(zip(self.walls, wall.tolist(), strict=True)),
        )

    def expire(self) -> None:
        """Set the list aside, and spoil what is left of older ones, and what a new one has to write."""
        self.record["workspace.old_wall_dv"][:], self.record["workspace.was_at_wall"][:] = 9.0, 1
        self.record.run(*EXPIRE)
        for name in (*(PAIR[name] for name in self.names), "contacts.weights"):
            self.record[name][:] = np.nan
        self.record["contacts.walls"]["dv"], self.record["contacts.wall_dv_start"][:] = np.nan, np.nan
        self.record["contacts.pairs"]["i"], self.record["contacts.pairs"]["j"] = -7, -7
        self.record["workspace.sweep_index"][:] = -7


def within(scene: Scene, skin: float) -> tuple[set[tuple[int, int]], set[int]]:
    x, distance = scene.position, np.hypot(*scene.position.T)
    i, j = np.triu_indices(N, 1)
    near = np.hypot(*(x[j] - x[i]).T) <= 2.0 * (0.01 + skin)
    gap = np.minimum(scene.radius_out - distance, distance - scene.radius_in) - 0.01
    return set(zip(i[near].tolist(), j[near].tolist(), strict=True)), set(np.flatnonzero(gap <= 2.0 * skin))


@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated"])
@pytest.mark.parametrize("order", ["sequential", "color"])
@pytest.mark.parametrize("equal", [True, False], ids=["equal masses", "masses"])
def test_what_contacts_carry_is_found_again(order: str, method: str, equal: bool) -> None:
    scene = cloud(order, method, equal)
    listed = Listed(scene, NARROW)
    assert (set(listed.pairs), set(listed.walls)) == within(scene, NARROW)
    listed.carry()
    for skin in (WIDE, NARROW, NOTHING, NOTHING, NARROW):
        pair, wall = listed.carried()
        active = {key for key, dv in pair.items() if any(dv)}, {i for i, dv in wall.items() if any(dv)}
        assert min(map(len, active)) > 8
        listed.expire()
        assert listed.record["workspace.was_at_wall"].tolist() == [int(i in wall) for i in range(N)]
        listed.search(skin)
        near = within(scene, skin)
        assert set(listed.pairs) >= near[0] | active[0]  # and some that the wider skins of these reach
        assert set(listed.walls) >= near[1] | active[1]
        now = listed.carried()
        nothing = [0.0] * len(listed.names)
        assert now[0] == {key: pair.get(key, nothing) for key in listed.pairs}
        assert now[1] == {i: wall.get(i, nothing) for i in listed.walls}
    if skin == NARROW and equal:
        assert len(listed.record["contacts.weights"]) == 0


def test_skins_are_not_widened_for_contacts_that_carry_nothing() -> None:
    listed = Listed(cloud("sequential", "gauss-seidel", True), WIDE)
    for name in (PAIR["now"], PAIR["start"]):
        listed.record[name][:] = 0.0
    listed.expire()
    listed.search(NARROW)
    assert set(listed.pairs) == within(listed.scene, NARROW)[0]


def test_shares_and_their_sums() -> None:
    """A grain takes m_j / (m_i + m_j) of a pair, and all of its walls."""
    scene = cloud("sequential", "gauss-seidel", False)
    listed = Listed(scene, NARROW)
    place = listed.record["workspace.sweep_index"][: len(listed.pairs)]
    m, row_sum = scene.mass, np.zeros(N)
    for (i, j), share in zip(listed.pairs, listed.record["contacts.weights"][place].tolist(), strict=True):
        assert share == [m[j] / (m[i] + m[j]), m[i] / (m[i] + m[j])]
        row_sum[[i, j]] += share
    assert listed.record.verlet_numbers["max_row_sum"] == pytest.approx(row_sum.max() + 1.0, rel=1e-14)
    equal = Listed(cloud("sequential", "gauss-seidel", True), NARROW)
    halves = np.bincount(np.ravel(equal.pairs), minlength=N) / 2.0
    assert equal.record.verlet_numbers["max_row_sum"] == halves.max() + 1.0


@pytest.mark.parametrize("iterations", [0, 1, 7])
def test_list_that_expires(iterations: int) -> None:
    """Iterations that were begun go on; before them, the attempt starts anew."""
    listed = Listed(cloud("sequential", "gauss-seidel", True), NARROW)
    record = listed.record.record
    record["step"]["iterations"], record["step"]["rebuilds"] = iterations, 3
    record["verlet"]["flags"]["missed"] = 1
    record["control"]["resuming"] = int(iterations == 0)
    record["control"]["unlisted"] = 0
    listed.record.run(Serial(contact_list.expire))
    assert record["control"]["resuming"] == int(iterations > 0)
    assert (record["control"]["unlisted"], record["step"]["rebuilds"]) == (1, 4)
    assert record["verlet"]["flags"]["missed"] == 0


def test_new_colors_are_asked_for_once() -> None:
    """The list stays, and every contact carries what it did."""
    listed = Listed(cloud("color", "gauss-seidel", True), NARROW)
    listed.carry()
    carried, control = listed.carried(), listed.record.record["control"]
    control["recoloring"], control["unordered"] = 1, 0
    listed.record["workspace.old.start"][:], listed.record["workspace.old_place"][:] = -7, -7
    listed.record.run(*SAVE, Serial(contact_list.color_anew))
    assert (control["recoloring"], control["unordered"]) == (0, 1)
    assert np.array_equal(listed.record["workspace.old.start"], listed.record["neighbors.start"])
    listed.record["contacts.pair_dv"][:] = np.nan
    listed.record.run(*sweeping_order(dealt=False))
    assert listed.carried()[0] == carried[0]


def test_pairs_keep_their_colors_as_long_as_a_step_goes_on() -> None:
    listed = Listed(cloud("color", "gauss-seidel", True), WIDE)
    rng = np.random.default_rng(0)
    colors = rng.permutation(64)[: int(listed.record["workspace.color"][: len(listed.pairs)].max()) + 1]
    listed.record["workspace.color"][:] = colors[listed.record["workspace.color"] % len(colors)]
    for skin in (NARROW, WIDE):
        before = dict(zip(listed.pairs, listed.record["workspace.color"].tolist(), strict=False))
        listed.record.record["step"]["iterations"] = 1
        listed.expire()
        listed.search(skin)
        after = dict(zip(listed.pairs, listed.record["workspace.color"].tolist(), strict=False))
        both = before.keys() & after.keys()
        assert len(both) > 20
        assert {pair: before[pair] for pair in both} == {pair: after[pair] for pair in both}


def test_step_waits_for_capacity() -> None:
    listed = Listed(cloud("sequential", "gauss-seidel", True), NARROW)
    control, step = listed.record.record["control"], listed.record.record["step"]
    for roomy in (1, 0):
        step["outcome"], control["unsolved"], control["roomy"] = 0, 1, roomy
        listed.record.run(Serial(contact_list.end_list))
        assert (control["unlisted"], control["unordered"], control["unsolved"]) == (1 - roomy, roomy, roomy)
        assert step["outcome"] == (0 if roomy else WITHOUT_ROOM)


def test_search_begins() -> None:
    listed = Listed(cloud("sequential", "gauss-seidel", True), NARROW)
    listed.record.record["control"]["searching"] = 0
    listed.record.run(Serial(contact_list.begin_list))
    assert listed.record.record["control"]["searching"] == 1
    listed.record["neighbors.total"][0] = len(listed.record["neighbors.found"]) + 1
    listed.record.run(Serial(neighbors.see_whether_roomy))
    assert (listed.record.record["control"]["searching"], listed.record.record["control"]["roomy"]) == (0, 0)
