"""A team of CPU threads: its shared memory, and the number of its threads in a launch."""

from typing import Any

import warp as wp

from warpgrains.kernels.threads import Pace, TeamRecord
from warpgrains.kernels.waiting import WORDS
from warpgrains.solver import tuning


class Crew:
    """A team of CPU threads.

    Each launch uses the number of threads that paid off in earlier launches (pace.py).

    Parameters
    ----------
    first, most : int
        Threads of the first launch, and the most of any launch.

    Attributes
    ----------
    members : list of TeamRecord
        The team's record for each thread.
    """

    def __init__(self, first: int = 1, most: int = 1):
        self._words = wp.zeros(WORDS, dtype=wp.int64, device="cpu")
        self._pace = wp.zeros(1, dtype=Pace, device="cpu")
        pace = self._pace.numpy()
        pace["size"], pace["most"] = first, most
        pace["share"] = tuning.WAITING
        pace["shortest"] = pace["rest"] = pace["pause"] = tuning.PAUSE
        shared: dict[str, Any] = {
            "scene": wp.zeros(1, dtype=wp.int32, device="cpu"),
            "going_on": wp.zeros(1, dtype=wp.int32, device="cpu"),
        }
        if most > 1:
            shared |= {"words": self._words, "pace": self._pace}
        self.members: list[TeamRecord] = []
        for rank in range(most):
            record = TeamRecord()
            record.rank, record.size = rank, most
            for name, array in shared.items():
                setattr(record, name, array)
            self.members.append(record)

    @property
    def size(self) -> int:
        """Number of threads that take part now."""
        return int(self._pace.numpy()["size"][0])

    def threads_of_next_launch(self) -> int:
        """Begin a launch and return its number of threads, the first ones of `members`."""
        self._words.numpy()[:] = 0
        pace = self._pace.numpy()[0]
        if pace["size"] < pace["most"] and pace["rest"] <= 0.0:
            pace["size"] = min(2 * pace["size"], pace["most"])
            pace["rest"] = pace["pause"]
        return int(pace["size"])
