"""Scenes of many kinds for batches, and what each of them does alone."""

from typing import NamedTuple

from sample_scenes import SUDDEN, random_scene

from warpgrains import Scene, Simulation, State, StepReport
from warpgrains.scene.fields import METHODS, ORDERS
from warpgrains.solver.statistics import Summary

STEPS = 25


def mixed_scenes() -> list[Scene]:
    """Scenes of many kinds and sizes, in both orders, and some by the accelerated method."""
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


def of_step(report: StepReport) -> Summary:
    return Summary(
        steps=1,
        iterations=report.iterations,
        iterations_max=report.iterations,
        unconverged=int(not report.converged),
        residual=report.residual,
        gap_error=report.gap_error,
        overlap=report.overlap,
        rebuilds=report.rebuilds,
        restarts=report.restarts,
    )


def alone(scene: Scene) -> Alone:
    simulation, statistics = Simulation(scene, threads=1), Summary()
    for _ in range(STEPS):
        report = simulation.step()
        statistics.add(of_step(report))
    return Alone(simulation.state(), statistics, report)
