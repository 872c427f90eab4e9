"""Fixed sequences of launches, captured once as a graph and replayed, by one OS thread or by several."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from threading import RLock

import numpy as np
import warp as wp

from warpgrains.kernels import crew as crew_kernels
from warpgrains.kernels.crew import Crew

GPU_WORKERS = 1 << 16
GPU_SLOTS = 64  # over which a GPU's workers spread their parts of a maximum
# Warp captures what any thread allocates, copies or launches: while one captures, others may replay, no more.
CAPTURING = RLock()
ALL_GROUPS = np.iinfo(np.int32).max


def reader(array: wp.array) -> Callable[[], np.ndarray]:
    """Return a function that reads a device array; on a CPU it is one view, made once."""
    if array.device.is_cpu:
        view = array.numpy()
        return lambda: view
    return array.numpy


class Replay:
    """Launches kernels on one device, captures sequences of launches and replays them.

    On a CPU every OS thread replays a graph of its own, as one worker of the crew, and the workers meet after
    every launch. On a GPU one launch holds all workers; where contacts must be swept group after group, every
    group is a launch of its own.

    Parameters
    ----------
    device : wp.Device
    threads : int
        OS threads on a CPU; without effect on a GPU.

    Attributes
    ----------
    slots : int
        Parts in which workers keep a maximum or a sum.
    """

    def __init__(self, device: wp.Device, threads: int = 1):
        self.device = device
        workers = threads if device.is_cpu else GPU_WORKERS
        self.slots = threads if device.is_cpu else GPU_SLOTS
        arrivals = wp.zeros(1, dtype=wp.int64, device=device)
        launchers = workers if device.is_cpu else 1
        ended = wp.zeros(8 * launchers, dtype=wp.int64, device=device)
        self._crews = [_crew(first, workers, arrivals, ended) for first in range(launchers)]
        self._alone = _crew(0, 1 if device.is_cpu else workers, arrivals, ended)
        self._crew = self._alone
        self._pool = ThreadPoolExecutor(launchers - 1) if launchers > 1 else None
        self._graphs: dict[str, list[wp.Graph]] = {}

    @property
    def by_group(self) -> bool:
        """Whether every group is a launch of its own."""
        return not self.device.is_cpu

    @property
    def launchers(self) -> int:
        """OS threads that launch kernels."""
        return len(self._crews)

    def __call__(self, launches: Callable[[], None]) -> None:
        """Replay the launches of a function with all workers; at first it is called, to be captured."""
        self._play(launches, self._crews)

    def alone(self, launches: Callable[[], None]) -> None:
        """Replay the launches of a function, on a CPU with one worker only."""
        self._play(launches, [self._alone])

    def _play(self, launches: Callable[[], None], crews: list[Crew]) -> None:
        graphs = self._graphs.get(launches.__qualname__)
        if graphs is None:
            graphs = self._graphs[launches.__qualname__] = [self._capture(launches, crew) for crew in crews]
        others = [self._pool.submit(wp.capture_launch, graph) for graph in graphs[1:]] if self._pool else []
        wp.capture_launch(graphs[0])
        for other in others:
            other.result()

    def _capture(self, launches: Callable[[], None], crew: Crew) -> wp.Graph:
        self._crew = crew
        with CAPTURING, wp.ScopedCapture(device=self.device) as capture:
            launches()
        return capture.graph

    def forget(self) -> None:
        """Capture anew: arrays that the graphs name have been replaced."""
        self._graphs.clear()

    def each(self, kernel: wp.Kernel, count: int, *inputs: object) -> None:
        """Launch a kernel with a thread for each of `count` elements; on a CPU the first worker does it."""
        if self._crew.first == 0:
            wp.launch(kernel, dim=count, inputs=inputs, device=self.device)
        self._meet()

    def share(self, kernel: wp.Kernel, *inputs: object) -> None:
        """Launch a kernel whose elements are shared out among the workers."""
        dim = 1 if self.device.is_cpu else self._crew.workers
        wp.launch(kernel, dim=dim, inputs=(self._crew, *inputs), device=self.device)
        self._meet()

    def copy(self, target: wp.array, source: wp.array) -> None:
        """Copy an array; on a CPU the first worker does it, before it meets the others at the next launch."""
        if self._crew.first == 0:
            wp.copy(target, source)

    def _meet(self) -> None:
        if self.device.is_cpu and self._crew.workers > 1:
            wp.launch(crew_kernels.meet_here, dim=1, inputs=(self._crew,), device=self.device)

    def group_ranges(self, groups: int) -> Iterator[tuple[int, int]]:
        """Yield first and last of the groups that one launch may sweep, in order."""
        if self.by_group:
            yield from ((group, group + 1) for group in range(groups))
        else:
            yield 0, ALL_GROUPS


def _crew(first: int, workers: int, arrivals: wp.array, ended: wp.array) -> Crew:
    crew = Crew()
    crew.first, crew.workers, crew.arrivals, crew.ended = first, workers, arrivals, ended
    return crew
