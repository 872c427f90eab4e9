"""What the user of the benchmark has chosen."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Options:
    """How much is measured."""

    repeats: int
    largest: int  # grains: larger piles are left to this size
    cache: Path  # where settled piles are kept

    def sizes(self, wanted: Iterable[int]) -> list[int]:
        """Sizes of piles, none above the largest."""
        return sorted({min(n, self.largest) for n in wanted})
