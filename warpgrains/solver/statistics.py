"""Reports of steps, summaries of runs, and the sums and maxima that they are made of."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from operator import add, or_
from typing import Any, NamedTuple, Self

from warpgrains.arrays import FloatArray
from warpgrains.described import fields_in_help
from warpgrains.shown import Shown, number_of
from warpgrains.tables import Tabular

NAMED = 10


def named(grains: tuple[int, ...]) -> str:
    """Return the names of grains for messages, only the first few if there are many."""
    rest = len(grains) - NAMED
    return f"grains {', '.join(map(str, grains[:NAMED]))}{f' and {rest} more' if rest > 0 else ''}"


@fields_in_help
class StepHistory(NamedTuple):
    """History of the contact iteration of a step; entry k - 1 belongs to iteration k >= 1.

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
    """Residual eta after the iteration [m/s], shape (iterations,)."""


class FormerNames:
    """Former names of fields, kept for one release."""

    restarts: int

    @property
    def redos(self) -> int:
        """Former name of `restarts`."""
        return self.restarts


@dataclass(frozen=True)
class StepReport(Tabular, FormerNames):
    """Report of one step.

    Attributes
    ----------
    iterations : int
        Iterations k >= 1 of the contact loop.
    zeta : float
        Largest change of a correction in the last iteration [m/s]. If the accelerated method stops on zeta,
        it includes contacts that were not swept but would change.
    residual : float
        Error of the solve, eta [m/s]: the velocities solve exactly a step whose gaps differ by at most
        dt * residual, and whose free velocities differ by at most the residual per contact (MODEL.md,
        eq. 12).
    gap_error : float
        dt * residual in units of the smallest radius.
    converged : bool
        Whether the quantity that the scene stops on (`Scene.stop`) met the tolerance.
    contacts : int
        Contacts that carry a correction, between grains and with the walls.
    candidates : int
        Contacts in the list, which might carry a correction.
    overlap : float
        Worst overlap between grains or with a wall after the grains moved [m].
    rebuilds : int
        Number of rebuilds of the list of candidates.
    restarts : int
        Number of times that the step was solved again because a candidate might have been missing.
    factorizations : int
        Number of factorizations by the method "exact".
    history : StepHistory, optional
        Zeta and residual of every iteration, after ``step(history=True)``.

    Examples
    --------
    >>> report = wg.Simulation(wg.Scene.load("annulus")).step()
    >>> report.iterations, report.zeta, report.converged, report.contacts
    (1, 0.0, True, 0)
    """

    iterations: int
    zeta: float
    residual: float
    gap_error: float
    converged: bool
    contacts: int
    candidates: int
    overlap: float
    rebuilds: int
    restarts: int
    factorizations: int
    history: StepHistory | None = field(default=None, repr=False, compare=False, metadata={"tabular": False})


@dataclass(frozen=True, repr=False)
class Summary(Shown, Tabular, FormerNames):
    """Summary of a run.

    Attributes
    ----------
    steps : int
        Steps done.
    iterations_mean, iterations_max : float, int
        Iterations a step.
    unconverged : int
        Steps that reached `max_iterations` without meeting the tolerance.
    residual, gap_error : float
        Worst error of any step [m/s], and in smallest radii, see `StepReport`.
    overlap : float
        Worst overlap after any step [m].
    rebuilds, restarts : int
        Rebuilds of the list, and steps solved again because a candidate might have been missing.
    seconds : float
        Wall time [s].
    output : str or None
        The recording, if there is one.
    met : bool
        Whether the end criterion `until` ended the run.

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
    residual: float
    gap_error: float
    overlap: float
    rebuilds: int
    restarts: int
    seconds: float
    output: str | None
    met: bool = False

    def summary(self) -> dict[str, str]:
        """Return the fields of the one-line summary by name."""
        told = {
            "steps": f"{self.steps}",
            "iterations": f"{self.iterations_mean:.1f} a step, {self.iterations_max} at most",
            "not converged": number_of(self.unconverged, "step"),
            "residual": f"{self.residual:.2e} m/s",
            "overlap": f"{self.overlap:.2e} m",
            "time": f"{self.seconds:.2f} s",
        }
        return told if self.output is None else {**told, "output": self.output}


def _counted(reduce: Callable[[Any, Any], Any], default: Any = 0) -> Any:
    """Return a field with the function that combines its values, such as a sum or a maximum."""
    return field(default=default, metadata={"reduce": reduce})


def _first(one: tuple[int, ...], other: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(one or other)


@dataclass
class RunStatistics(FormerNames):
    """Sums and maxima over the steps of a run.

    Checkpoints store them, so that a resumed run counts all its steps.

    The device accumulates the steps of a launch in the same way (kernels/statistics.py).

    Attributes
    ----------
    steps, frames : int
        Steps done and frames recorded.
    iterations, iterations_max : int
        Sum and maximum over the steps.
    unconverged, residual, gap_error, overlap, rebuilds, restarts
        As in `Summary`.
    step_seconds : float
        Time in which a device or threads advanced the scene [s].
    other_seconds : float
        Time beside the steps [s]: all of it in a run by itself, such as that for outputs and checkpoints; in
        sweeps, that for completing the recording.
    held : int
        Number of steps for which the end criterion has held, plus 1; 0 if it does not hold.
    met : bool
        As in `Summary`.
    means : tuple of float
        Means of the quantities of a series over the steps since its last row.
    """

    steps: int = _counted(add)
    frames: int = _counted(add)
    iterations: int = _counted(add)
    iterations_max: int = _counted(max)
    unconverged: int = _counted(add)
    residual: float = _counted(max, 0.0)
    gap_error: float = _counted(max, 0.0)
    overlap: float = _counted(max, 0.0)
    rebuilds: int = _counted(add)
    restarts: int = _counted(add)
    step_seconds: float = _counted(add, 0.0)
    other_seconds: float = _counted(add, 0.0)
    held: int = _counted(add)
    met: bool = _counted(or_, False)
    means: tuple[float, ...] = _counted(_first, ())

    def __post_init__(self) -> None:
        self.means = tuple(self.means)

    @property
    def seconds(self) -> float:
        """Time of the run [s]; of a run by itself, it is the wall time."""
        return self.step_seconds + self.other_seconds

    def add(self, other: Self) -> None:
        """Add the statistics of other steps."""
        for counted in fields(self):
            name, reduce = counted.name, counted.metadata["reduce"]
            setattr(self, name, reduce(getattr(self, name), getattr(other, name)))

    def summary(self, output: str | None) -> Summary:
        """Return the summary of the steps counted."""
        alike = {own.name: getattr(self, own.name) for own in fields(Summary) if hasattr(self, own.name)}
        mean = self.iterations / max(1, self.steps)
        return Summary(iterations_mean=mean, output=output, **alike)
