"""What steps and runs did: reports, their sums, and grains named in words."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from operator import add, or_
from typing import Any, NamedTuple, Self

from warpgrains.arrays import FloatArray
from warpgrains.shown import Shown
from warpgrains.tables import Tabular

NAMED = 10


def named(grains: tuple[int, ...]) -> str:
    """Name some grains, the first few if there are many."""
    rest = len(grains) - NAMED
    return f"grains {', '.join(map(str, grains[:NAMED]))}{f' and {rest} more' if rest > 0 else ''}"


class StepHistory(NamedTuple):
    """How the contact iteration of a step went on; entry k - 1 is of iteration k >= 1.

    Examples
    --------
    >>> simulation = wg.Simulation(wg.Scene.load("annulus"))
    >>> statistics = simulation.advance(60)
    >>> history = simulation.step(history=True).history
    >>> history.zeta.shape, f"{history.zeta[-1]:.1e} m/s"
    ((13,), '8.6e-07 m/s')
    """

    zeta: FloatArray
    """Largest change of a correction in the iteration [m/s], shape (iterations,)."""
    residual: FloatArray
    """Error that it leaves, eta [m/s], shape (iterations,)."""


@dataclass(frozen=True)
class StepReport(Tabular):
    """What one step did.

    Attributes
    ----------
    iterations : int
        Iterations k >= 1 of the contact loop.
    zeta : float
        Largest change of a correction in the last of them; where the accelerated method stops on it, also of
        one that it has not swept and would have to [m/s].
    residual : float
        Error of the solve, eta [m/s]: the velocities are the exact ones of a step whose gaps are changed by
        at most dt * residual, and free velocities by at most the residual a contact (MODEL.md, eq. 12).
    gap_error : float
        dt * residual in units of the smallest radius.
    converged : bool
        Whether zeta, or the residual if that is what the scene stops on, met the tolerance.
    infeasible : tuple of int
        Grains that cannot fit, where it is proved that no velocities solve the step
        (solver/infeasible.py). Proofs are looked for after steps that did not converge, as long as they
        are found, and otherwise so seldom that it costs at most a twentieth of the time: none found, an empty
        tuple, proves nothing.
    contacts : int
        Contacts that carry a correction, between grains and with the walls.
    candidates : int
        Contacts that were swept because they might have.
    overlap : float
        Worst overlap after the move, of grains with each other or with a wall [m].
    rebuilds : int
        How often the candidates were searched anew.
    redos : int
        How often the step was solved again because a candidate might have been missing.
    factorizations : int
        How often the method "exact" factored a matrix.
    history : StepHistory, optional
        Zeta and residual of every iteration, of ``step(history=True)``.

    Examples
    --------
    >>> report = wg.Simulation(wg.Scene.load("annulus")).step()
    >>> report.iterations, report.zeta, report.converged, report.contacts, report.infeasible
    (1, 0.0, True, 0, ())
    """

    iterations: int
    zeta: float
    residual: float
    gap_error: float
    converged: bool
    infeasible: tuple[int, ...]
    contacts: int
    candidates: int
    overlap: float
    rebuilds: int
    redos: int
    factorizations: int
    history: StepHistory | None = field(default=None, repr=False, compare=False, metadata={"tabular": False})


@dataclass(frozen=True, repr=False)
class Summary(Shown, Tabular):
    """What a run did.

    Attributes
    ----------
    steps : int
        Steps done.
    iterations_mean, iterations_max : float, int
        Iterations a step.
    unconverged : int
        Steps that stopped at `max_iterations` and had not met the tolerance.
    infeasible : int
        Steps among them of which it is proved that no velocities solve them, see `StepReport`.
    infeasible_grains : tuple of int
        The grains that could not fit in the first of these.
    residual, gap_error : float
        Worst error of any step [m/s], and in smallest radii, see `StepReport`.
    overlap : float
        Worst overlap after any step [m].
    rebuilds, redos : int
        Searches for candidates, and steps solved again because one might have been missing.
    seconds : float
        Wall time [s].
    output : str or None
        The recording, if there is one.
    met : bool
        Whether the run has ended at what it was to run until.

    Examples
    --------
    >>> summary.steps, summary.iterations_max, summary.unconverged, summary.output
    (400, 129, 0, 'annulus.usdc')
    >>> f"{summary.overlap:.1e} m, {summary.residual:.1e} m/s"
    '5.3e-05 m, 9.3e-07 m/s'
    """

    steps: int
    iterations_mean: float
    iterations_max: int
    unconverged: int
    infeasible: int
    infeasible_grains: tuple[int, ...]
    residual: float
    gap_error: float
    overlap: float
    rebuilds: int
    redos: int
    seconds: float
    output: str | None
    met: bool = False

    def facts(self) -> dict[str, str]:
        """Return what there is to tell of it in a line."""
        told = {
            "steps": f"{self.steps}",
            "iterations": f"{self.iterations_mean:.1f} a step, {self.iterations_max} at most",
            "not converged": f"{self.unconverged} steps",
            "residual": f"{self.residual:.2e} m/s",
            "overlap": f"{self.overlap:.2e} m",
            "time": f"{self.seconds:.2f} s",
        }
        return told if self.output is None else {**told, "output": self.output}


def _counted(reduce: Callable[[Any, Any], Any], default: Any = 0) -> Any:
    """Return a field, and how it is added up."""
    return field(default=default, metadata={"reduce": reduce})


def _first(one: tuple[int, ...], other: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(one or other)


@dataclass
class RunStatistics:
    """Adds up what a run has done; a checkpoint keeps it, so that a resumed run tells of all its steps.

    The device adds up the steps of a launch the same way (kernels/statistics.py).

    Attributes
    ----------
    steps, frames : int
        Steps done and frames recorded.
    iterations, iterations_max : int
        Sum and maximum over the steps.
    unconverged, infeasible, infeasible_grains, residual, gap_error, overlap, rebuilds, redos, seconds
        As in `Summary`.
    held : int
        Steps for which what is to end the run has held, and 1; 0 while it does not.
    met : bool
        As in `Summary`.
    """

    steps: int = _counted(add)
    frames: int = _counted(add)
    iterations: int = _counted(add)
    iterations_max: int = _counted(max)
    unconverged: int = _counted(add)
    infeasible: int = _counted(add)
    infeasible_grains: tuple[int, ...] = _counted(_first, ())
    residual: float = _counted(max, 0.0)
    gap_error: float = _counted(max, 0.0)
    overlap: float = _counted(max, 0.0)
    rebuilds: int = _counted(add)
    redos: int = _counted(add)
    seconds: float = _counted(add, 0.0)
    held: int = _counted(add)
    met: bool = _counted(or_, False)

    def __post_init__(self) -> None:
        self.infeasible_grains = tuple(self.infeasible_grains)

    @classmethod
    def of_summary(cls, summary: Summary) -> Self:
        """Return the statistics that a summary was made of."""
        alike = [field.name for field in fields(cls) if hasattr(summary, field.name)]
        return cls(iterations=round(summary.iterations_mean * summary.steps), **_alike(summary, *alike))

    def add(self, other: Self) -> None:
        """Count what another run, or a part of this one, has done."""
        for counted in fields(self):
            name, reduce = counted.name, counted.metadata["reduce"]
            setattr(self, name, reduce(getattr(self, name), getattr(other, name)))

    def summary(self, output: str | None) -> Summary:
        """Return the sums of what was counted."""
        alike = [field.name for field in fields(Summary) if hasattr(self, field.name)]
        mean = self.iterations / max(1, self.steps)
        return Summary(iterations_mean=mean, output=output, **_alike(self, *alike))


def _alike(record: Any, *names: str) -> dict[str, Any]:
    """Return some of the fields of a record."""
    return {name: getattr(record, name) for name in names}
