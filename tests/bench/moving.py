"""Where grains move: what the steps of the common flowing scene cost, and what their lists have of it."""

from collections.abc import Iterator
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from warpgrains import Simulation
from warpgrains.arrays import FloatArray, IntArray

from ..support.same_bits import assert_same_bits
from .compiled import COMPILER, CellList, CReference
from .flow import SOLVED, flowing, splashed, splashing
from .inside import Sweeps, pair_count, seconds_of_a_list
from .kept import continued
from .options import Options
from .piles import settled_pile
from .rows import SPEEDUP, Subject, row
from .timing import in_turn, seconds

AIMS = {  # by grains: ms a step, worst overlap in radii
    100: ("<= 0.06", "<= 1e-3"),
    1_000: ("<= 0.9", "<= 2.5e-3"),
    5_000: ("<= 8", "<= 7e-3"),
    10_000: ("<= 20", "<= 1e-2"),
}
SWEEPS = 10  # after an impact
ITERATIONS = 60
LARGE = 100_000
PLAIN = {"order": "sequential", "tolerance": 1e-12, "max_iterations": ITERATIONS}


def moving(options: Options) -> Iterator[dict[str, str]]:
    """Whole steps, and their lists; one list, and monitored sweeps."""
    for n in options.sizes(AIMS):
        yield from _steps(n, options.repeats)
    for n in options.sizes((1_000, 10_000)):
        yield _one_list("flowing", _amid(n), options.repeats)
        yield _monitoring(n, options.repeats)
    yield from _large_lists(min(LARGE, options.largest), options)
    yield _against_all_pairs(min(1_000, options.largest), options.repeats)


def _steps(n: int, repeats: int) -> Iterator[dict[str, str]]:
    taken, reports, a_list = [], [], []
    for _ in range(repeats):
        simulation = Simulation(flowing(n, **SOLVED), threads=1)
        of_this_run = [simulation.step()]  # the first, so that kernels are loaded

        def work(simulation=simulation, of_this_run=of_this_run) -> None:
            of_this_run.extend(simulation.step() for _ in range(simulation.scene.steps))

        taken.append(seconds(work) / simulation.scene.steps * 1e3)
        reports += of_this_run[1:]
        a_list.append(seconds_of_a_list(simulation) * 1e3)
    lists, iterations = (
        sum(getattr(report, name) for report in reports) / len(reports) for name in ("rebuilds", "iterations")
    )
    ms_aim, overlap_aim = AIMS.get(n, ("", ""))
    subject = partial(Subject, n=n, order="color")
    yield row(subject("a flowing step, accelerated to 1e-2 m/s"), taken, "ms", target=ms_aim)
    overlap = max(report.overlap for report in reports) / simulation.scene.smallest_radius
    yield row(subject("worst overlap of it"), [overlap], "radii", target=overlap_aim)
    yield row(subject("iterations of it"), [iterations], "")
    yield row(subject("lists of it"), [lists], "")
    building = [lists * value for value in a_list]
    yield row(subject("building of them"), building, "ms", "the whole step", taken)


def _amid(n: int, **changes: object) -> Simulation:
    """Return the scene where all splash, as it is about to step on."""
    return splashed(flowing(n, **{**SOLVED, **changes}), threads=1)


def _large_lists(n: int, options: Options) -> Iterator[dict[str, str]]:
    """Lists of many grains, which splash, and which hardly move."""
    yield _one_list("flowing", continued(*splashing(n, options.cache), threads=1), options.repeats)
    settled = settled_pile(n, options.cache)
    yield _one_list(settled.kind, settled.simulation(**SOLVED), options.repeats)


def _one_list(kind: str, simulation: Simulation, repeats: int) -> dict[str, str]:
    scene, x = simulation.scene, simulation.position
    seconds_of_a_list(simulation)  # once, so that the kernels are loaded
    cells = CellList(x, _reach(x, pair_count(simulation)), scene.radius_out)
    ours, in_c = in_turn(
        max(repeats, 5) * (20 if scene.n < LARGE else 2),
        lambda: seconds_of_a_list(simulation) * 1e6,
        lambda: seconds(cells.build) * 1e6,
    )
    other = f"cell list and colors of as many pairs, {COMPILER}"
    return row(Subject(f"one list, {kind}", scene.n, "color"), ours, "us", other, in_c, target="<= 2")


def _reach(x: FloatArray, pairs: int) -> float:
    """The distance [m] within which there are so many pairs."""
    tree = cKDTree(x)
    near: IntArray = np.sort(tree.sparse_distance_matrix(tree, _far(x), output_type="ndarray")["v"])
    return float(near[near > 0.0][: 2 * pairs][-1])


def _far(x: FloatArray) -> float:
    """A distance [m] within which a grain has some 20 others."""
    return float(np.median(cKDTree(x).query(x, k=min(len(x), 20))[0][:, -1]))


def _monitoring(n: int, repeats: int) -> dict[str, str]:
    """Sweeps from free velocities, monitored as they have to be or not at all."""
    arrays = Sweeps(_amid(n, method="gauss-seidel", tolerance=1e-12, stop="zeta", max_iterations=SWEEPS))
    arrays.start_freely()

    def us_a_sweep(monitored: bool) -> float:
        arrays.reset(monitored)
        return seconds(arrays.run) / SWEEPS * 1e6

    us_a_sweep(False)  # once, so that the launches are captured
    rounds = max(repeats, 5) * 20
    ours, plain = in_turn(rounds, partial(us_a_sweep, True), partial(us_a_sweep, False))
    subject = Subject(f"one of {SWEEPS} sweeps after an impact, monitored", n, "color")
    return row(subject, ours, "us", "not monitored", plain, target="<= 1.3")


def _against_all_pairs(n: int, repeats: int) -> dict[str, str]:
    simulation = splashed(flowing(n, **PLAIN), threads=1)
    reference = CReference(simulation.scene, simulation.state())
    ours, in_c = in_turn(
        repeats,
        lambda: seconds(partial(simulation.advance, 5)) / 5 * 1e3,
        lambda: seconds(partial(reference.run, 5)) / 5 * 1e3,
    )
    assert_same_bits(simulation, reference)
    target = ">= 400" if n == 1_000 else ""
    subject = Subject(f"one step of {ITERATIONS} iterations, flowing", n)
    return row(subject, ours, "ms", f"all pairs, {COMPILER}", in_c, SPEEDUP, target)
