"""How much a report measures."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Budget:
    """How much is measured; the default takes some minutes for the shipped scenes.

    Attributes
    ----------
    repeats : int
        Times a step is taken, of which the median counts.
    most_iterations : int
        Of one step.
    longest : float
        Wall time of a step after which no more iterations are tried [s].
    history : int
        Steps after which the history of a scene is cut off.
    horizon : int
        Longest time over which trajectories are followed, in the scene's own steps; a multiple of 4.
    """

    repeats: int = 5
    most_iterations: int = 10_000
    longest: float = 0.2
    history: int = 1000
    horizon: int = 32

    @property
    def iterations(self) -> list[int]:
        """Limits on the iterations of a step: 1, 3, 10, 30, ..."""
        steps = range(2 * len(str(self.most_iterations)))
        limits = [(1, 3)[k % 2] * 10 ** (k // 2) for k in steps]
        return [limit for limit in limits if limit <= self.most_iterations]
