"""What a device tells of a step, read as the report that users get."""

from collections.abc import Sequence

from warpgrains.arrays import FloatArray
from warpgrains.kernels.data import CARRYING, ITERATIONS, OVERLAP, RESIDUAL, ZETA
from warpgrains.scene.scene import Scene
from warpgrains.solver.statistics import StepReport


def has_converged(scene: Scene, zeta: float, residual: float) -> bool:
    """Whether a step with this zeta and residual [m/s] has met the scene's tolerance."""
    return (residual if scene.stops_on_residual else zeta) <= scene.tolerance


def gap_error(scene: Scene, smallest: float, residual: float) -> float:
    """Return dt * residual in smallest radii, of `smallest` metres."""
    return scene.dt * residual / smallest


def read_step_report(
    scene: Scene, smallest: float, told: FloatArray, counts: Sequence[int], rebuilds: int, redos: int
) -> StepReport:
    """Read the report of a step; whether grains cannot fit is not asked.

    Parameters
    ----------
    scene : Scene
    smallest : float
        Radius of its smallest grain [m].
    told : FloatArray
        `Progress.report` of the device.
    counts : sequence of int
        `Contacts.count` of the device.
    rebuilds, redos : int
        How often a list was built, and the step solved again.
    """
    pairs, _, walls = counts
    zeta, residual = told[ZETA].item(), told[RESIDUAL].item()
    return StepReport(
        iterations=int(told[ITERATIONS]),
        zeta=zeta,
        residual=residual,
        gap_error=gap_error(scene, smallest, residual),
        converged=has_converged(scene, zeta, residual),
        infeasible=(),
        contacts=int(told[CARRYING]),
        candidates=pairs + walls,
        overlap=told[OVERLAP].item(),
        rebuilds=rebuilds,
        redos=redos,
    )
