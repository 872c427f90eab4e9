"""Stages launched on a GPU: each is a separate launch, and loops and conditions are nodes of the graph.

The stages are those of the CPU's kernel, wrapped the same way; the end of a launch is the barrier.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import warp as wp

from .access import named
from .contacts import set_count
from .record import Scene, SceneRecord
from .stages import Each, If, Serial, Sets, Shared, Stage, While, fuse
from .threads import TeamRecord, member

GPU_THREADS = 1 << 16


@wp.func
def begin_sets(s: Scene):
    """Begin with the first set."""
    s.control.sets_left = set_count(s)


@wp.func
def next_set(s: Scene):
    """Go on with the next set."""
    s.control.sets_left = s.control.sets_left - 1


@cache
def test(condition: wp.Function) -> wp.Function:
    """Return the stage that writes whether a condition holds where a node of the graph reads it."""

    @named(f"test_{condition.func.__name__}")
    def tested(s: Scene):
        s.control.holds = 1 if condition(s) else 0

    return tested


@cache
def stage_kernel(stage: Serial | Each | Shared | Sets, module: wp.Module) -> wp.Kernel:
    """Return the kernel of one stage; of a set, it is the next one that is left."""
    run = _one_set(stage.stage) if isinstance(stage, Sets) else fuse([stage])

    def launched(records: wp.array(dtype=SceneRecord), k: int, team: TeamRecord):
        one = member(team, wp.tid())
        run(one, records[k])

    launched.__qualname__ = f"launch_{stage.stage.func.__name__}"  # a graph finds kernels by their names
    return wp.kernel(module=module)(launched)


def _one_set(stage: wp.Function) -> wp.Function:
    @wp.func
    def one_set(team: wp.ref[TeamRecord], s: Scene):
        stage(team, s, set_count(s) - s.control.sets_left)

    return one_set


def leaves(stages: Sequence[Stage]) -> list[Serial | Each | Shared | Sets]:
    """Return all stages to launch. Stages that add up run in parallel, because a GPU has atomics."""
    found: list[Serial | Each | Shared | Sets] = []
    for stage in stages:
        match stage:
            case If(condition, inner) | While(condition, inner):
                found += [Serial(test(condition)), *leaves(inner)]
            case Each():
                found.append(replace(stage, atomic=False))
            case Sets():
                found += [Serial(begin_sets), stage, Serial(next_set)]
            case _:
                found.append(stage)
    return found


class Launcher:
    """Launches stages for one scene on one device.

    Parameters
    ----------
    module : wp.Module
        Where the kernels of the stages are compiled, with the options of stages.py.
    records : array of SceneRecord
    k : int
        The scene.
    stages : sequence of Stage
    threads : int
        Of a launch.
    """

    def __init__(
        self,
        module: wp.Module,
        records: wp.array,
        k: int,
        stages: Sequence[Stage],
        threads: int = GPU_THREADS,
    ):
        self._module, self._records, self._k = module, records, k
        for leaf in leaves(stages):
            stage_kernel(leaf, module)
        self._team = TeamRecord()
        self._team.size = threads

    def __call__(self, stages: Sequence[Stage]) -> None:
        """Launch stages, or add them to the graph that is being captured."""
        for stage in stages:
            match stage:
                case If(condition, inner):
                    self._launch(Serial(test(condition)), 1)
                    wp.capture_if(self._word("holds"), self._later(inner))
                case While(condition, inner):
                    tested = Serial(test(condition))
                    self._launch(tested, 1)
                    wp.capture_while(self._word("holds"), self._later([*inner, tested]))
                case Each():
                    self._launch(replace(stage, atomic=False), self._team.size)
                case Serial():
                    self._launch(stage, 1)
                case Shared():
                    self._launch(stage, self._team.size)
                case Sets():
                    self._launch(Serial(begin_sets), 1)
                    wp.capture_while(self._word("sets_left"), lambda stage=stage: self._next_set(stage))

    def _later(self, stages: Sequence[Stage]) -> Callable[[], None]:
        return lambda: self(stages)

    def _next_set(self, stage: Sets) -> None:
        self._launch(stage, self._team.size)
        self._launch(Serial(next_set), 1)

    def _launch(self, stage: Serial | Each | Shared | Sets, threads: int) -> None:
        kernel = stage_kernel(stage, self._module)
        inputs = (self._records, self._k, self._team)
        wp.launch(kernel, dim=threads, inputs=inputs, device=self._records.device)

    def _word(self, name: str) -> wp.array:
        """Return a number of `Control`, where the record has it: a node of the graph reads it."""
        dtype = SceneRecord.numpy_dtype()
        control = dict(zip(dtype["names"], dtype["offsets"], strict=True))["control"]
        inner = dtype["formats"][dtype["names"].index("control")]
        offset = control + inner["offsets"][inner["names"].index(name)]
        pointer = self._records.ptr + self._k * dtype["itemsize"] + offset
        return wp.array(ptr=pointer, dtype=wp.int32, shape=(1,), device=self._records.device)
