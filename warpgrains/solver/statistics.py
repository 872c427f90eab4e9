"""Reports of steps, and their summaries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from operator import add
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import fields_in_help
from warpgrains.base.shown import Shown, number_of
from warpgrains.base.tables import Tabular, library

if TYPE_CHECKING:
    import pandas


NAMED = 10


def named(grains: tuple[int, ...]) -> str:
    """Return text for messages, such as "grains 1, 2", with only the first few if there are many."""
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


@dataclass(frozen=True)
class StepReport(Tabular):
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


def _added(reduce: Callable[[Any, Any], Any], default: float = 0, shown: bool = True) -> Any:
    """Return a field of `Summary` that `Summary.add` combines by `reduce`, such as a sum or a maximum.

    Without `shown`, `Summary.results` omits the field.
    """
    return field(default=default, metadata={"reduce": reduce, "shown": shown})


@dataclass(repr=False)
class Summary(Shown):
    """Summary of steps, such as those of a run.

    Attributes
    ----------
    steps : int
        Steps done.
    iterations_mean, iterations_max : float, int
        Iterations a step.
    iterations : int
        Iterations of all steps.
    unconverged : int
        Steps that reached `max_iterations` without meeting the tolerance.
    residual, gap_error : float
        Worst error of any step [m/s], and in smallest radii, see `StepReport`.
    overlap : float
        Worst overlap after any step [m].
    rebuilds, restarts : int
        Rebuilds of the list, and steps solved again because a candidate might have been missing.
    seconds : float
        Wall time [s]; of a scene of a `Batch`, its share of one core's time.
    output : str or None
        The recording, if there is one.
    met : bool
        Whether the end criterion `until` ended the run.
    error : str or None
        Reason why a scene of a `Batch` stopped early, at its last good state.
    frames : int
        Frames recorded.
    held : int
        Steps for which the end criterion has held, plus 1; 0 if it does not hold.
    means : tuple of float
        Means of the quantities of a series over the steps since its last row.

    Examples
    --------
    >>> summary.steps, summary.iterations_max, summary.unconverged, summary.output
    (400, 129, 0, 'annulus.usdc')
    >>> f"{summary.overlap:.1e} m, {summary.residual:.1e} m/s"
    '5.3e-05 m, 9.3e-07 m/s'
    >>> scene = wg.Scene.load("annulus", ["solver.max_iterations=3"]).replace(on_unconverged="raise")
    >>> (failed,) = wg.Batch([scene]).run()
    >>> failed.steps, failed.error
    (19, 'step 20, from t = 0.19 s: not converged after 3 iterations: ...')
    """

    steps: int = _added(add)
    iterations: int = _added(add, shown=False)
    iterations_max: int = _added(max)
    unconverged: int = _added(add)
    residual: float = _added(max, 0.0)
    gap_error: float = _added(max, 0.0)
    overlap: float = _added(max, 0.0)
    rebuilds: int = _added(add)
    restarts: int = _added(add)
    seconds: float = _added(add, 0.0)
    output: str | None = None
    met: bool = False
    error: str | None = None
    frames: int = field(default=0, metadata={"shown": False})
    held: int = field(default=0, metadata={"shown": False})
    means: tuple[float, ...] = field(default=(), metadata={"shown": False})

    def __post_init__(self) -> None:
        self.means = tuple(self.means)

    @property
    def iterations_mean(self) -> float:
        """Iterations a step, on average."""
        return self.iterations / max(1, self.steps)

    def add(self, other: Self) -> None:
        """Add the summary of the next steps of the same run."""
        for name, reduce in _REDUCED.items():
            setattr(self, name, reduce(getattr(self, name), getattr(other, name)))

    def results(self) -> dict[str, Any]:
        """Return the numbers by name, as ``warpgrains run --json`` prints them."""
        shown = {own.name: getattr(self, own.name) for own in fields(self) if own.metadata.get("shown", True)}
        if self.error is None:
            del shown["error"]
        return {"steps": self.steps, "iterations_mean": self.iterations_mean, **shown}

    def to_pandas(self) -> pandas.DataFrame:
        """Return the numbers as a DataFrame of one row.

        Raises
        ------
        InputError
            pandas is not installed; the extra ``[data]`` installs it.
        """
        return library("pandas", "to_pandas").DataFrame([self.results()])

    def summary(self) -> dict[str, str]:
        """Return the fields of the one-line summary by name."""
        optional = {"output": self.output, "error": self.error}
        return {
            "steps": f"{self.steps}",
            "iterations": f"{self.iterations_mean:.1f} a step, {self.iterations_max} at most",
            "not converged": number_of(self.unconverged, "step"),
            "residual": f"{self.residual:.2e} m/s",
            "overlap": f"{self.overlap:.2e} m",
            "time": f"{self.seconds:.2f} s",
            **{name: text for name, text in optional.items() if text is not None},
        }


_REDUCED = {own.name: own.metadata["reduce"] for own in fields(Summary) if "reduce" in own.metadata}
