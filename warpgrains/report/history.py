"""Steps of a scene's history at which its contacts are worth solving."""

from dataclasses import dataclass
from typing import NamedTuple

from warpgrains.errors import SceneError
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State
from warpgrains.simulation.simulation import Simulation


class Snapshot(NamedTuple):
    """A step of the history, from where it starts."""

    name: str
    state: State
    contacts: int
    """Contacts that carry a correction after it."""


@dataclass(frozen=True)
class History:
    """What a scene goes through, at its own tolerance."""

    first: State
    """Before the first step in which a contact acts."""
    hardest: State
    """Before the step of most iterations."""
    snapshots: list[Snapshot]
    """onset: the first step with half as many contacts as there will ever be; hardest; end: the last step.
    A step that is two of them is there once."""


def follow_history(scene: Scene, longest: int) -> History:
    """Follow a scene by the accelerated method, in color order, for `longest` steps at most.

    Raises
    ------
    SceneError
        No contact acts in it.
    """
    simulation = Simulation(scene, method="accelerated", order="color", stop="residual")
    records: list[Snapshot] = []  # steps with more contacts than any before
    hardest = end = Snapshot("", simulation.state(), 0)
    most_iterations = 0
    for _ in range(min(scene.steps, longest)):
        state = simulation.state()
        report = simulation.step()
        end = Snapshot("end", state, report.contacts)
        if report.contacts > (records[-1].contacts if records else 0):
            records.append(Snapshot("onset", state, report.contacts))
        if report.contacts and report.iterations > most_iterations:
            most_iterations = report.iterations
            hardest = Snapshot("hardest", state, report.contacts)
    if not records:
        raise SceneError(f"scene '{scene.name}' has no contacts in {end.state.steps + 1} steps")
    onset = next(record for record in records if 2 * record.contacts >= records[-1].contacts)
    by_step = {snapshot.state.steps: snapshot for snapshot in (end, hardest, onset) if snapshot.contacts}
    return History(records[0].state, hardest.state, [by_step[step] for step in sorted(by_step)])
