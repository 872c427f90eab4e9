"""How far velocities are likely to change in a step, foreseen from those before its first iteration.

A skin that does not suffice makes an attempt at a step void (verlet.py), so lists are made for, and held
against, what is to come. A pair that approaches faster than its gap allows changes its grains' velocities by
up to that excess, and a grain that is pushed passes it on to those that it comes to touch. This proves
nothing: too little foreseen costs an attempt, too much a fatter list.
"""

import warp as wp

from .record import Scene

f64 = wp.float64
PASSED_ON = wp.constant(f64(0.8))  # of a grain's impact, to the next
PASSES = 2  # from neighbor to neighbor


@wp.func
def forget_impact(s: Scene, i: int):
    """Begin with none."""
    s.workspace.impact[i] = f64(0.0)
    s.workspace.passed_impact[i] = f64(0.0)


@wp.func
def excess(s: Scene, c: int) -> f64:
    """How much faster a pair approaches than its gap allows [m/s]; negative where it does not."""
    pair = s.contacts.pairs[c]
    v = s.grains.next_velocity
    return wp.dot(v[pair.i] - v[pair.j], pair.n) - pair.gap_rate


@wp.func
def find_impact(s: Scene, c: int):
    """A grain's impact is the largest excess of its pairs."""
    change = excess(s, c)
    if change > f64(0.0):
        wp.atomic_max(s.workspace.impact, s.contacts.pairs[c].i, change)
        wp.atomic_max(s.workspace.impact, s.contacts.pairs[c].j, change)


@wp.func
def pass_on(s: Scene, c: int):
    """A pair passes on what is left when its gap is closed."""
    i = s.contacts.pairs[c].i
    j = s.contacts.pairs[c].j
    impact_i = s.workspace.impact[i]
    impact_j = s.workspace.impact[j]
    if impact_i != impact_j:
        left = PASSED_ON * wp.max(impact_i, impact_j) + wp.min(f64(0.0), excess(s, c))
        if left > wp.min(impact_i, impact_j):
            wp.atomic_max(s.workspace.passed_impact, wp.where(impact_i < impact_j, i, j), left)


@wp.func
def take_over(s: Scene, i: int):
    """Go on from what was passed on."""
    s.workspace.impact[i] = wp.max(s.workspace.impact[i], s.workspace.passed_impact[i])
