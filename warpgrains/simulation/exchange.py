"""Exchange of grains with the sources and sinks of a scene, between two steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from warpgrains.base.errors import InputError
from warpgrains.scene.sources import Inflow, Outflow, Source
from warpgrains.simulation.population import Population


def exchanged(present: Population) -> Population:
    """Return the population after all exchanges that are due at its time.

    First sinks remove grains, then sources add grains.
    """
    scene, state, time = present.scene, present.state, present.time
    assert state.inflow is not None
    assert state.outflow is not None
    inflow = [Inflow(*row) for row in state.inflow.tolist()]
    outflow = [Outflow(int(grains), mass) for grains, mass in state.outflow.tolist()]
    number = {source.name: k for k, source in enumerate(scene.sources)}
    for k, sink in enumerate(scene.sinks):
        if state.steps % sink.steps(scene.dt) or not sink.is_open(time):
            continue
        gone = np.flatnonzero(sink.contains(scene.period.wrapped(present.state.position)))
        gone = gone[: present.scene.n - 1]
        mass = float(present.scene.mass[gone].sum())
        outflow[k] = Outflow(outflow[k].grains + len(gone), outflow[k].mass + mass)
        if sink.into is not None:
            fed = inflow[number[sink.into]]
            inflow[number[sink.into]] = fed._replace(waiting=fed.waiting + len(gone))
        present = present.without(present.id[gone])
    for k, source in enumerate(scene.sources):
        if state.steps % source.steps(scene.dt) or time < source.begin:
            continue
        due, entered, missed, waiting = inflow[k]
        new = source.due(time) - due
        n = present.scene.n
        present = _poured(present, source, new + waiting)
        found = present.scene.n - n
        left = new + waiting - found
        kept = min(waiting, left)
        inflow[k] = Inflow(due + new, entered + found, missed + left - kept, kept)
    after = replace(
        present.state,
        exchanged=state.steps,
        inflow=np.array(inflow, np.int64).reshape(-1, 4),
        outflow=np.array(outflow, np.float64).reshape(-1, 2),
    )
    return type(present)(present.scene, after)


def _poured(present: Population, source: Source, count: int) -> Population:
    """Return the population with `count` grains of a source added, or as many as find a place."""
    if count == 0:
        return present
    own = source.radius, source.density, source.region, source.velocity, source.seed
    try:
        return present.with_poured(count, *own)
    except InputError:  # walls cover so much of the region that no grain fits
        return present
