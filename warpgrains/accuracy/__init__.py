"""Measurement of the true error of a step, by an exact solution that is computed without the kernels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.base.described import fields_in_help
from warpgrains.base.errors import InputError, requiring

if TYPE_CHECKING:
    from warpgrains.simulation.simulation import Simulation

__all__ = ["ErrorBound", "certify"]


@fields_in_help
@dataclass(frozen=True)
class ErrorBound:
    """Error of the velocities of a step: measured, and as a proven bound.

    Examples
    --------
    >>> bound = certify(simulation)
    >>> bound.error <= bound.at_most
    True
    """

    error: float | None
    """Largest difference of a velocity component from the reference velocities [m/s].

    None if it is not above `solver_error`, because it then says nothing about the step.
    """
    solver_error: float
    """Proven bound of the error of the reference velocities [m/s], from their duality gap.

    It holds for the gaps of the step as rounded to double precision.
    """
    at_most: float
    """Proven upper bound of the true error of the step [m/s]."""


def certify(simulation: Simulation) -> ErrorBound:
    """Measure the true error of a simulation's last step.

    The step's convex problem (kernels/MODEL.md, eq. 10) is set up from the positions and velocities at its
    start, with all pairs of grains that could touch within it and with all walls. It is solved by clarabel,
    an interior point method, in about 0.2 s for a pile of 1,000 grains.

    With friction a step may have several solutions. The slip of the contacts is then frozen at the velocities
    that the simulation found, which makes the problem convex. The error is the distance from the exact
    solution of this problem, including rim speeds. It is 0 only for a solution of Coulomb's law (De Saxce and
    Feng 1998).

    Parameters
    ----------
    simulation : Simulation
        A simulation that has done a step; it is not changed.

    Raises
    ------
    InputError
        clarabel, qdldl or scipy is not installed; the extra ``[report]`` installs them. Or a force or a
        pressure drives a wall, or there is rolling friction.
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
    if not hasattr(simulation, "last_start"):
        raise InputError(
            f"certify takes a Simulation that has done a step, not a {type(simulation).__name__}"
        )
    if simulation.scene.has_driven_walls:
        raise InputError("certify: steps in which a force drives a wall cannot be certified")
    if simulation.scene.has_rolling_friction:
        raise InputError("certify: steps with rolling_friction cannot be certified")
    with requiring("certify"):
        from warpgrains.accuracy.exact_step import StepProblem, solve_exactly
    velocity = simulation.velocity
    if simulation.scene.has_friction:
        velocity = np.column_stack([velocity, simulation.scene.radius * simulation.spin])
    start = simulation.scene.time_after(simulation.steps - 1)
    problem = StepProblem(simulation.scene, *simulation.last_start(), time=start)
    exact = solve_exactly(problem, velocity)
    difference = float(np.abs(velocity - exact.velocity).max())
    return ErrorBound(
        error=difference if difference > exact.error else None,
        solver_error=exact.error,
        at_most=difference + exact.error,
    )
