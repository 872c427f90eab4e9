"""The result of a run, a row of a table.

================== ======= ============================================================================
column             unit    meaning
================== ======= ============================================================================
run                        number of the run
scene                      name of the base scene
section.key                what the run takes from the axes of the sweep, a column an axis
grains                     number of grains
steps                      time steps done
time               s       simulated time
iterations_mean            iterations a step
iterations_max             most iterations of a step
unconverged                steps that stopped short of the tolerance
worst_overlap      m       worst overlap after any step
..                         at the end of the run, see `quantities`:
kinetic_energy     J
potential_energy   J
outer_wall_force   N
inner_wall_force   N
pile_height        m
packing_fraction
error                      why the run failed, if it did
seconds            s       wall time; the table of all results leaves it out
================== ======= ============================================================================

All but the last are the same whenever, wherever and after however many interruptions the run is done.
"""

from warpgrains.analysis.quantities import quantities
from warpgrains.simulation.checkpoint import Checkpoint
from warpgrains.tables import Row

UNITS = {
    "grains": "",
    "steps": "",
    "time": "s",
    "iterations_mean": "",
    "iterations_max": "",
    "unconverged": "",
    "worst_overlap": "m",
    "kinetic_energy": "J",
    "potential_energy": "J",
    "outer_wall_force": "N",
    "inner_wall_force": "N",
    "pile_height": "m",
    "packing_fraction": "",
    "error": "",
}
"""Units of the columns that every sweep has, in their order."""
SECONDS = "seconds"


def result(labels: Row, reached: Checkpoint) -> Row:
    """Return the result of a run that has reached its end.

    Parameters
    ----------
    labels
        The first columns.
    reached : Checkpoint
        The end.
    """
    scene, summary = reached.scene, reached.statistics.summary(None)
    values = {
        "grains": scene.n,
        "steps": summary.steps,
        "time": summary.steps * scene.dt,
        "iterations_mean": summary.iterations_mean,
        "iterations_max": summary.iterations_max,
        "unconverged": summary.unconverged,
        "worst_overlap": summary.overlap,
        **quantities(scene, reached.state),
    }
    return _row(labels, {name: repr(value) for name, value in values.items()}, summary.seconds)


def failure(labels: Row, reason: str, seconds: float = 0.0) -> Row:
    """Return the result of a run that failed."""
    return _row(labels, {"error": reason}, seconds)


def _row(labels: Row, values: Row, seconds: float) -> Row:
    return labels | dict.fromkeys(UNITS, "") | values | {SECONDS: f"{seconds:.3f}"}
