"""What steps and runs did: reports, their sums, and grains named in words."""

from dataclasses import dataclass

NAMED = 10


def named(grains: tuple[int, ...]) -> str:
    """Name some grains, the first few if there are many."""
    rest = len(grains) - NAMED
    return f"grains {', '.join(map(str, grains[:NAMED]))}{f' and {rest} more' if rest > 0 else ''}"


@dataclass(frozen=True)
class StepReport:
    """What one step did.

    Attributes
    ----------
    iterations : int
        Iterations k >= 1 of the contact loop.
    zeta : float
        Largest change of a correction in the last of them [m/s].
    residual : float
        Error of the solve, eta [m/s]: the velocities are the exact ones of a step whose gaps are changed by
        at most dt * residual (kernels/residual.py).
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


@dataclass(frozen=True)
class Summary:
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


@dataclass
class RunStatistics:
    """Adds up what a run has done; a checkpoint keeps it, so that a resumed run tells of all its steps.

    Attributes
    ----------
    steps, frames : int
        Steps done and frames recorded.
    iterations, iterations_max : int
        Sum and maximum over the steps.
    unconverged, infeasible, infeasible_grains, residual, gap_error, overlap, rebuilds, redos, seconds
        As in `Summary`.
    """

    steps: int = 0
    frames: int = 0
    iterations: int = 0
    iterations_max: int = 0
    unconverged: int = 0
    infeasible: int = 0
    infeasible_grains: tuple[int, ...] = ()
    residual: float = 0.0
    gap_error: float = 0.0
    overlap: float = 0.0
    rebuilds: int = 0
    redos: int = 0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        self.infeasible_grains = tuple(self.infeasible_grains)

    def add(self, report: StepReport) -> None:
        """Count one step."""
        self.steps += 1
        self.iterations += report.iterations
        self.iterations_max = max(self.iterations_max, report.iterations)
        self.unconverged += not report.converged
        self.infeasible += bool(report.infeasible)
        self.infeasible_grains = self.infeasible_grains or report.infeasible
        self.residual = max(self.residual, report.residual)
        self.gap_error = max(self.gap_error, report.gap_error)
        self.overlap = max(self.overlap, report.overlap)
        self.rebuilds += report.rebuilds
        self.redos += report.redos

    def add_steps(self, summary: Summary) -> None:
        """Count the steps of a summary."""
        self.steps += summary.steps
        self.iterations += round(summary.iterations_mean * summary.steps)
        self.iterations_max = max(self.iterations_max, summary.iterations_max)
        self.unconverged += summary.unconverged
        self.infeasible += summary.infeasible
        self.infeasible_grains = self.infeasible_grains or summary.infeasible_grains
        self.residual = max(self.residual, summary.residual)
        self.gap_error = max(self.gap_error, summary.gap_error)
        self.overlap = max(self.overlap, summary.overlap)
        self.rebuilds += summary.rebuilds
        self.redos += summary.redos
        self.seconds += summary.seconds

    def summary(self, output: str | None) -> Summary:
        """Return the sums of what was counted."""
        return Summary(
            steps=self.steps,
            iterations_mean=self.iterations / max(1, self.steps),
            iterations_max=self.iterations_max,
            unconverged=self.unconverged,
            infeasible=self.infeasible,
            infeasible_grains=self.infeasible_grains,
            residual=self.residual,
            gap_error=self.gap_error,
            overlap=self.overlap,
            rebuilds=self.rebuilds,
            redos=self.redos,
            seconds=self.seconds,
            output=output,
        )
