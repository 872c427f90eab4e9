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
from .threads import TeamRecord

GPU_THREADS = 1 << 16
Launched = Serial | Each | Shared
"""Stages that are a launch each."""


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
def one_set(stage: wp.Function) -> wp.Function:
    """Return the stage that does what a stage of sets does for the next set that is left."""

    @named(f"one_set_of_{stage.func.__name__}")
    def of_next(team: wp.ref[TeamRecord], s: Scene):
        stage(team, s, set_count(s) - s.control.sets_left)

    return of_next


@cache
def stage_kernel(stage: Launched, module: wp.Module) -> wp.Kernel:
    """Return the kernel of one stage."""
    run = fuse([stage])

    def launched(records: wp.array(dtype=SceneRecord), k: int, team: TeamRecord):
        one = team
        one.rank = wp.tid()
        run(one, records[k])

    launched.__qualname__ = f"launch_{stage.stage.func.__name__}"  # a graph finds kernels by their names
    return wp.kernel(module=module)(launched)


def in_launches(
    stages: Sequence[Stage],
    launch: Callable[[Launched], None],
    node: Callable[[Callable[..., None], str, list[Stage]], None],
) -> None:
    """Call `launch` for each stage, and `node` for each loop and condition.

    `node` receives what adds it to a graph, the number of `Control` that the graph tests, and the stages
    within. Stages that add up run in parallel, because a GPU has atomics.
    """
    for stage in stages:
        match stage:
            case If(condition, inner):
                launch(Serial(test(condition)))
                node(wp.capture_if, "holds", list(inner))
            case While(condition, inner):
                tested = Serial(test(condition))
                launch(tested)
                node(wp.capture_while, "holds", [*inner, tested])
            case Sets(run):
                launch(Serial(begin_sets))
                node(wp.capture_while, "sets_left", [Shared(one_set(run)), Serial(next_set)])
            case Each():
                launch(replace(stage, atomic=False))
            case _:
                launch(stage)


def stage_kernels(stages: Sequence[Stage], module: wp.Module) -> list[wp.Kernel]:
    """Return the kernels of all stages, which are made before their module is loaded."""
    kernels: list[wp.Kernel] = []
    in_launches(
        stages,
        lambda stage: kernels.append(stage_kernel(stage, module)),
        lambda capture, word, inner: kernels.extend(stage_kernels(inner, module)),
    )
    return kernels


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
        self._team = TeamRecord()
        self._team.size = threads
        stage_kernels(stages, module)

    def __call__(self, stages: Sequence[Stage]) -> None:
        """Launch stages, or add them to the graph that is being captured."""
        in_launches(
            stages,
            self._launch,
            lambda capture, word, inner: capture(self._word(word), lambda: self(inner)),
        )

    def _launch(self, stage: Launched) -> None:
        dim = 1 if isinstance(stage, Serial) else self._team.size
        inputs = (self._records, self._k, self._team)
        wp.launch(stage_kernel(stage, self._module), dim=dim, inputs=inputs, device=self._records.device)

    def _word(self, name: str) -> wp.array:
        """Return a number of `Control`, where the record has it: a node of the graph reads it."""
        dtype = SceneRecord.numpy_dtype()
        control = dict(zip(dtype["names"], dtype["offsets"], strict=True))["control"]
        inner = dtype["formats"][dtype["names"].index("control")]
        offset = control + inner["offsets"][inner["names"].index(name)]
        pointer = self._records.ptr + self._k * dtype["itemsize"] + offset
        return wp.array(ptr=pointer, dtype=wp.int32, shape=(1,), device=self._records.device)
