"""The true error of a step, on request: against the exact velocities, found without the kernels."""

from dataclasses import dataclass

import numpy as np

from warpgrains.errors import missing_extra
from warpgrains.simulation.simulation import Simulation


@dataclass(frozen=True)
class ErrorBound:
    """Distance of a step's velocities from the exact ones.

    Examples
    --------
    >>> bound = certify(simulation)
    >>> bound.error <= bound.at_most, bound.witnesses < 1e-9
    (True, True)
    """

    error: float | None
    """Largest difference of a component [m/s]; None where it is not above `solver_error`, so that it says
    nothing of the step."""
    solver_error: float
    """What the velocities that it is measured against may be wrong by themselves [m/s], proven by their
    duality gap, for the step's gaps as they are rounded to double precision."""
    at_most: float
    """What the true error is proven not to exceed [m/s]."""
    witnesses: float
    """Largest difference of a component between the exact velocities of clarabel and those of the package's
    own interior point method [m/s], far below what can be proven, unless a step is hardly determined."""


def certify(simulation: Simulation) -> ErrorBound:
    """Measure the true error of a simulation's last step.

    The step's convex problem (kernels/MODEL.md, eq. 10) is set up from the positions and velocities at its
    start, over all pairs of grains that could meet in it and both walls, and solved by clarabel, an interior
    point method, and again by that of the package. About 0.4 s for a pile of 1,000 grains.

    Parameters
    ----------
    simulation : Simulation
        It is not changed.

    Raises
    ------
    InputError
        clarabel or qdldl is not installed; they come with the extra ``[report]``.
    SimulationError
        No step has been taken, or no velocities satisfy every gap of the step.

    Examples
    --------
    >>> bound = certify(simulation)
    >>> f"{bound.error:.1e} m/s"
    '8.2e-07 m/s'
    >>> bound.solver_error < 0.1 * bound.error
    True
    """
    try:
        from warpgrains.analysis.exact_step import StepProblem, own_witness, solve_exactly
    except ModuleNotFoundError as error:
        raise missing_extra("certify", error) from error
    velocity = simulation.velocity
    problem = StepProblem(simulation.scene, *simulation.last_start())
    exact = solve_exactly(problem, velocity)
    other = solve_exactly(problem, velocity, own_witness)
    difference = float(np.abs(velocity - exact.velocity).max())
    return ErrorBound(
        error=difference if difference > exact.error else None,
        solver_error=exact.error,
        at_most=difference + exact.error,
        witnesses=float(np.abs(other.velocity - exact.velocity).max()),
    )
