"""What comes between two accelerated sweeps (momentum.py): restart, monotone safeguard, and on to the next y.

Momentum stops when it points up the gradient (O'Donoghue and Candes 2015), but t is only halved: the speed is
gone, the friction stays low, and the next run is soon as fast (Liang, Luo and Schoenlieb 2022). A sweep that
does not make good what going on to y has cost in phi is undone, which stops momentum as well; so phi falls
from sweep to sweep. Over-relaxation is what most often raises it, and is worn down each time.

Velocities that are corrected in place gather rounding errors, and momentum carries these on. Now and then
they are rebuilt from the corrections, and the last ones moved by as much: without that, the difference of
the two would hold a push that no correction has, and that every sweep repeats.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .access import set_velocity, velocity_of
from .crew import Crew, share
from .data import GROUPS, LOOK, PAIRS, WALLS, WATCHING, Contacts, Grains, Progress, Watch
from .momentum import BETA, CHUNK, RELAXED, TIME, Momentum, chunks_in
from .momentum import stages as momentum_stages
from .variant import Variant
from .watch import look_at, watch_grain

f64 = wp.float64
ROUNDING = wp.constant(f64(2.0e-15))
WEAR = wp.constant(f64(0.8))  # what an undone sweep leaves of that
STOP = wp.constant(f64(0.5))  # what a stop leaves of t


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the functions for one kind of scene."""
    mass_in_phi = momentum_stages(variant).mass_in_phi
    half = wp.constant(f64(0.5))

    @wp.func
    def judge_sweep(contacts: Contacts, momentum: Momentum, grains: int) -> f64:
        """Undo a sweep after which phi has risen; choose how far to go on after the others.

        Returns the largest change of a velocity [m/s] on the way to this sweep's y.
        """
        part = wp.vec2d(f64(0.0), f64(0.0))
        for k in range(chunks_in(contacts.count[PAIRS]) + contacts.count[GROUPS]):
            part = part + momentum.pair_part[k]
        for k in range(chunks_in(contacts.count[WALLS])):
            part = part + momentum.wall_part[k]
        energy = f64(0.0)
        size = f64(0.0)
        farthest = f64(0.0)
        for k in range(chunks_in(grains)):
            energy = energy + momentum.grain_part[k][0]
            size = size + momentum.grain_part[k][1]
            farthest = wp.max(farthest, momentum.grain_part[k][2])
        beta = momentum.scalar[BETA]
        momentum.undo[0] = 0
        if beta > f64(0.0) and part[0] + beta * (half * energy - ROUNDING * size) > f64(0.0):
            momentum.undo[0] = 1
            momentum.scalar[RELAXED] = WEAR * momentum.scalar[RELAXED]
        t = momentum.scalar[TIME]
        if momentum.undo[0] != 0 or part[1] > f64(0.0):
            momentum.scalar[TIME] = wp.max(f64(1.0), STOP * t)
            momentum.scalar[BETA] = f64(0.0)
        else:
            momentum.scalar[TIME] = half * (f64(1.0) + wp.sqrt(f64(1.0) + f64(4.0) * t * t))
            momentum.scalar[BETA] = (t - f64(1.0)) / momentum.scalar[TIME]
        return beta * wp.sqrt(farthest)

    @wp.func
    def take_back(crew: Crew, tid: int, contacts: Contacts, momentum: Momentum):
        """Undo this worker's share of a sweep."""
        begin, end = share(crew, tid, 0, contacts.count[PAIRS])
        for c in range(begin, end):
            contacts.pair_dv[c] = momentum.pair_last[c]
        begin, end = share(crew, tid, 0, contacts.count[WALLS])
        for c in range(begin, end):
            contacts.walls[c].dv = momentum.wall_last[c]

    @wp.func
    def attend(grains: Grains, watch: Watch, progress: Progress, momentum: Momentum, i: int):
        """Look at a grain, and give it its last velocity if the sweep is undone, or the one rebuilt."""
        v = velocity_of(grains.next_velocity, i)
        if watch.flag[LOOK] != 0:
            look_at(v, watch, i)
        if momentum.undo[0] != 0:
            set_velocity(grains.next_velocity, i, velocity_of(momentum.last_velocity, i))
        elif progress.checking[0] != 0:
            rebuilt = velocity_of(grains.rebuilt_velocity, i)
            set_velocity(grains.next_velocity, i, rebuilt)
            last = velocity_of(momentum.last_velocity, i)
            set_velocity(momentum.last_velocity, i, last + (rebuilt - v))

    @wp.func
    def advance(crew: Crew, tid: int, grains: Grains, momentum: Momentum, watch: Watch):
        """Take this worker's share of the velocities on to y."""
        n = grains.position.shape[0]
        beta = momentum.scalar[BETA]
        watching = watch.flag[WATCHING]
        begin, end = share(crew, tid, 0, chunks_in(n))
        for k in range(begin, end):
            energy = f64(0.0)
            size = f64(0.0)
            farthest = f64(0.0)
            i = k * CHUNK
            stop = wp.min(n, (k + 1) * CHUNK)
            while i < stop:
                v = velocity_of(grains.next_velocity, i)
                s = v - velocity_of(momentum.last_velocity, i)
                y = v + beta * s
                set_velocity(momentum.last_velocity, i, v)
                set_velocity(grains.next_velocity, i, y)
                m = mass_in_phi(grains, i)
                energy = energy + m * wp.dot(s, v + y)
                size = size + m * wp.dot(v, v)
                farthest = wp.max(farthest, wp.dot(s, s))
                if watching != 0:
                    watch_grain(y, watch, i)
                i += 1
            momentum.grain_part[k] = wp.vec3d(energy, size, farthest)

    @wp.func
    def go_on(
        crew: Crew,
        tid: int,
        grains: Grains,
        contacts: Contacts,
        watch: Watch,
        progress: Progress,
        momentum: Momentum,
    ):
        """Do this worker's share of what comes after a sweep."""
        if momentum.undo[0] != 0:
            take_back(crew, tid, contacts, momentum)
        if watch.flag[LOOK] != 0 or momentum.undo[0] != 0 or progress.checking[0] != 0:
            begin, end = share(crew, tid, 0, chunks_in(grains.position.shape[0]))
            for i in range(begin * CHUNK, wp.min(grains.position.shape[0], end * CHUNK)):
                attend(grains, watch, progress, momentum, i)
        if progress.iterating[0] != 0:
            advance(crew, tid, grains, momentum, watch)

    return SimpleNamespace(judge_sweep=judge_sweep, go_on=go_on)
