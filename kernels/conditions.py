"""What is to be done next: the conditions of step.py. Each reads the number in `Control` of its own name."""

import warp as wp

from .record import Scene


@wp.func
def starting(s: Scene) -> bool:
    """A step begins."""
    return s.control.starting != 0


@wp.func
def unsolved(s: Scene) -> bool:
    """The step goes on."""
    return s.control.unsolved != 0


@wp.func
def unlisted(s: Scene) -> bool:
    """A new list is needed."""
    return s.control.unlisted != 0


@wp.func
def searching(s: Scene) -> bool:
    """Pairs are to be searched, with the skins as they are now."""
    return s.control.searching != 0


@wp.func
def roomy(s: Scene) -> bool:
    """The pairs found have room."""
    return s.control.roomy != 0


@wp.func
def unordered(s: Scene) -> bool:
    """The list is not in sweeping order yet."""
    return s.control.unordered != 0


@wp.func
def tiled(s: Scene) -> bool:
    """The list is long enough to be swept tile after tile."""
    return s.control.tiled != 0


@wp.func
def attempting(s: Scene) -> bool:
    """There is a list to solve the step with."""
    return s.control.attempting != 0


@wp.func
def fresh(s: Scene) -> bool:
    """The step is solved from its warm start, or goes on with another list."""
    return s.control.fresh != 0


@wp.func
def corrected(s: Scene) -> bool:
    """The step is solved on from what the host has made of its corrections."""
    return s.control.corrected != 0


@wp.func
def iterating(s: Scene) -> bool:
    """The contact iteration goes on."""
    return s.control.iterating != 0


@wp.func
def looking(s: Scene) -> bool:
    """All contacts are looked at before the next sweep."""
    return s.control.looking != 0


@wp.func
def sampling(s: Scene) -> bool:
    """Velocities that were not monitored are to be looked at."""
    return s.control.sampling != 0


@wp.func
def rejected(s: Scene) -> bool:
    """The last sweep is taken back."""
    return s.control.rejected != 0


@wp.func
def measuring(s: Scene) -> bool:
    """The residual is asked for."""
    return s.control.measuring != 0


@wp.func
def rebuilding(s: Scene) -> bool:
    """The velocities are to be replaced by those that the residual was measured with."""
    return s.control.rebuilding != 0


@wp.func
def accepted(s: Scene) -> bool:
    """The step is taken."""
    return s.control.accepted != 0


@wp.func
def recoloring(s: Scene) -> bool:
    """Pairs have kept colors that the list alone does not tell."""
    return s.control.recoloring != 0


@wp.func
def sweeping(s: Scene) -> bool:
    """Sets are left, where every set is a launch of its own."""
    return s.control.sweeping != 0
