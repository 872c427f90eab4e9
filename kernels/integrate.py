"""Newton's law without contacts, and the move (MODEL.md, "One step"), with what a step reports."""

import warp as wp

from . import law
from .record import Scene, pair_count, wall_count
from .threads import Team, partial_index, thread_range
from .walls import wall_overlap

f64 = wp.float64


@wp.func
def begin_step(s: Scene):
    """Count lists and attempts anew."""
    s.step.rebuilds = 0
    s.step.redos = 0


@wp.func
def free_velocity(s: Scene, i: int):
    """v* (eq. 2)."""
    v = s.grains.velocity[i]
    s.grains.free_velocity[i] = law.free_velocity(v, s.gravity, s.drag, s.grains.mass[i], s.dt)


@wp.func
def move(s: Scene, i: int):
    """X += dt v, with the velocities that the contacts have corrected (eq. 3)."""
    x = s.grains.position[i]
    v = s.grains.next_velocity[i]
    s.grains.last_position[i] = x
    s.grains.last_velocity[i] = s.grains.velocity[i]
    s.grains.position[i] = x + s.dt * v
    s.grains.velocity[i] = v


@wp.func
def overlaps(team: Team, s: Scene):
    """Worst overlap [m] of the listed contacts, and how many are active; all others have stayed silent."""
    worst = f64(0.0)
    active = int(0)
    begin, end = thread_range(team, 0, pair_count(s))
    for c in range(begin, end):
        pair = s.contacts.pairs[c]
        _n, distance = law.normal(s.grains.position[pair.i], s.grains.position[pair.j])
        gap = law.pair_gap(distance, s.grains.radius[pair.i], s.grains.radius[pair.j])
        worst = wp.max(worst, -gap)
        active += 1 if s.contacts.pair_dv[c] != f64(0.0) else 0
    begin, end = thread_range(team, 0, wall_count(s))
    for c in range(begin, end):
        wall = s.contacts.walls[c]
        worst = wp.max(worst, wall_overlap(s.grains.position[wall.i], s.grains.radius[wall.i], s.walls))
        active += 1 if wall.dv != f64(0.0) else 0
    k = partial_index(team, s.partial.overlap.shape[0])
    wp.atomic_max(s.partial.overlap, k, worst)
    wp.atomic_add(s.partial.active, k, active)


@wp.func
def report(s: Scene):
    """Gather what the threads have measured."""
    worst = f64(0.0)
    active = int(0)
    for k in range(s.partial.overlap.shape[0]):
        worst = wp.max(worst, s.partial.overlap[k])
        active += s.partial.active[k]
        s.partial.overlap[k] = f64(0.0)
        s.partial.active[k] = 0
    s.step.overlap = worst
    s.step.active = active
