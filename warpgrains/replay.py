"""Fixed sequences of launches, captured once as a graph and replayed."""

from collections.abc import Callable, Iterator

import numpy as np
import warp as wp

from warpgrains.kernels.crew import Crew

GPU_WORKERS = 1 << 16
GPU_SLOTS = 64  # over which a GPU's workers spread their parts of a maximum


def reader(array: wp.array) -> Callable[[], np.ndarray]:
    """Return a function that reads a device array; on a CPU it is one view, made once."""
    if array.device.is_cpu:
        view = array.numpy()
        return lambda: view
    return array.numpy


class Replay:
    """Launches kernels on one device, captures sequences of launches and replays them.

    On a CPU one worker does all of a launch. On a GPU a launch has many, and where contacts must be swept
    group after group, every group is a launch of its own.
    """

    def __init__(self, device: wp.Device):
        self.device = device
        self.in_line = device.is_cpu
        self._crew = Crew()
        self._crew.first = 0
        self._crew.arrivals = wp.zeros(1, dtype=wp.int64, device=device)
        self._crew.workers = 1 if device.is_cpu else GPU_WORKERS
        self.slots = 1 if device.is_cpu else GPU_SLOTS
        self._graphs: dict[str, wp.Graph] = {}

    def __call__(self, launches: Callable[[], None]) -> None:
        """Replay the launches of a function, which is called once only, to be captured."""
        graph = self._graphs.get(launches.__qualname__)
        if graph is None:
            with wp.ScopedCapture(device=self.device) as capture:
                launches()
            graph = self._graphs[launches.__qualname__] = capture.graph
        wp.capture_launch(graph)

    def forget(self) -> None:
        """Capture anew: arrays that the graphs name have been replaced."""
        self._graphs.clear()

    def each(self, kernel: wp.Kernel, count: int, *inputs: object) -> None:
        """Launch a kernel that has a thread for each of `count` elements."""
        wp.launch(kernel, dim=count, inputs=inputs, device=self.device)

    def share(self, kernel: wp.Kernel, *inputs: object) -> None:
        """Launch a kernel whose elements are shared out among the workers."""
        wp.launch(kernel, dim=self._crew.workers, inputs=(self._crew, *inputs), device=self.device)

    def group_ranges(self, groups: int) -> Iterator[tuple[int, int]]:
        """Yield first and last of the groups that one launch may sweep, in order."""
        if self.in_line:
            yield 0, groups
        else:
            yield from ((group, group + 1) for group in range(groups))
