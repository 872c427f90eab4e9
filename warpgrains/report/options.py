"""How much a report measures."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """How much is measured; the default takes some minutes for the shipped scenes.

    Attributes
    ----------
    repeats : int
        Times a step is taken, of which the median counts.
    most_iterations : int
        Largest budget of iterations.
    longest : float
        Wall time of a step after which no larger budget is tried [s].
    course : int
        Steps after which the course of a scene is cut off.
    horizon : int
        Longest time over which trajectories are followed, in the scene's own steps; a multiple of 4.
    """

    repeats: int = 5
    most_iterations: int = 10_000
    longest: float = 0.2
    course: int = 1000
    horizon: int = 32

    @property
    def budgets(self) -> list[int]:
        """Iterations: 1, 3, 10, 30, ..."""
        steps = range(2 * len(str(self.most_iterations)))
        budgets = [(1, 3)[k % 2] * 10 ** (k // 2) for k in steps]
        return [budget for budget in budgets if budget <= self.most_iterations]
