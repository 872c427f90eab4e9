"""States that take long to reach, kept in a folder for the next run."""

import os
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import Scene, Simulation, State
from warpgrains.scene.state import Corrections

CORRECTIONS = tuple(field.name for field in fields(Corrections))


def kept_state(file: Path, reach: Callable[[], State]) -> State:
    """Return the state in a file; where there is none, reach it and put it there."""
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        _save(reach(), file)
    with np.load(file) as kept:
        corrections = Corrections(**{name: kept[name] for name in CORRECTIONS if name in kept})
        return State(0, kept["position"], kept["velocity"], corrections)


def continued(scene: Scene, state: State, threads: int | None, **changes: Any) -> Simulation:
    """Continue from a state, with lists that are past their first steps."""
    simulation = Simulation(scene, threads=threads, **changes)
    simulation.restore(state)
    simulation.advance(3)
    return simulation


def _save(state: State, file: Path) -> None:
    """Write a state; the file appears only when it is whole."""
    unfinished = file.with_name(f"{file.stem}-{os.getpid()}.npz")
    arrays = {"position": state.position, "velocity": state.velocity, **vars(state.corrections)}
    np.savez(unfinished, **{name: array for name, array in arrays.items() if array is not None})
    unfinished.replace(file)
