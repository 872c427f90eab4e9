"""Conditions of the stages of a step (step.py): the phase that it is in, or a flag."""

import warp as wp

from .access import named
from .record import Phase, Scene


def in_phase(*phases: Phase) -> wp.Function:
    """Return the condition that a step is in one of these phases."""
    bits = sum(1 << phase for phase in phases)

    @named("_or_".join(phase.name.lower() for phase in phases))
    def holds(s: Scene) -> bool:
        return (wp.static(bits) >> s.control.phase) & 1 != 0

    return holds


unsolved = in_phase(*set(Phase) - {Phase.ENDED, Phase.ACCEPTED, Phase.FULL})
beginning = in_phase(Phase.BEGIN)
searching = in_phase(Phase.SEARCH)
listed = in_phase(Phase.LISTED)
starting = in_phase(Phase.START)
answered = in_phase(Phase.CORRECTED, Phase.DECLINED)
attempting = in_phase(Phase.START, Phase.CORRECTED, Phase.DECLINED)
sweeping = in_phase(Phase.SWEEP)
checking_list = in_phase(Phase.CHECK_LIST)
measuring = in_phase(Phase.MEASURE, Phase.RECOMPUTE, Phase.RECORD)
recomputing = in_phase(Phase.RECOMPUTE)
scanning = in_phase(Phase.SCAN)
iterating = in_phase(Phase.SWEEP, Phase.CHECK_LIST, Phase.MEASURE, Phase.RECOMPUTE, Phase.RECORD, Phase.SCAN)
accepted = in_phase(Phase.ACCEPTED)
expired = in_phase(Phase.EXPIRE)


@wp.func
def unordered(s: Scene) -> bool:
    """Return whether the list is still to be put in sweeping order."""
    return s.control.unordered != 0


@wp.func
def fresh(s: Scene) -> bool:
    """Return whether sweeps start anew, and do not continue from velocities and momentum that they have."""
    return s.control.resuming == 0


@wp.func
def rejected(s: Scene) -> bool:
    """Return whether the last sweep is to be rolled back."""
    return s.control.rejected != 0
