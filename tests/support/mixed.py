"""Scenes of many kinds for batches, and the result of each scene when it runs alone."""

from typing import NamedTuple

from sample_scenes import SUDDEN, random_scene

from warpgrains import Scene, Simulation, State, StepReport
from warpgrains.scene.fields import METHODS, ORDERS
from warpgrains.solver.statistics import Summary

STEPS = 25


def mixed_scenes() -> list[Scene]:
    """Return scenes of many kinds and sizes, with both orders of contacts, some by the accelerated method."""
    drawn = [random_scene(seed) for seed in range(12)] + [make() for make in SUDDEN]
    accelerated = {2, 7, 10, 12}
    return [
        scene.replace(order=ORDERS[k % 3 % 2], method=METHODS[k in accelerated])
        for k, scene in enumerate(drawn)
    ]


class Alone(NamedTuple):
    state: State
    statistics: Summary
    report: StepReport


def alone(scene: Scene) -> Alone:
    simulation, stepped = (Simulation(scene, threads=1) for _ in range(2))
    summary = simulation.advance(STEPS)
    stepped.advance(STEPS - 1)
    return Alone(simulation.state(), summary, stepped.step())
