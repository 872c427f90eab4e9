"""A step as data: stages, loops and conditions, and `fuse`, which combines them into one function.

Every thread of a team calls this function `(team, scene)`, in which a barrier follows every stage. Conditions
are functions `(scene)` that return a bool, such as those of step.py.

Each stage is compiled as a separate function (`inline=False`). This takes a third of the time to compile a
step as one function, and does not slow a step down. Warp detects changed kernels by the functions to which a
closure refers by name, so `_in_turn` refers to its functions by names.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import warp as wp

from ..contacts import set_count
from ..record import Scene
from .threads import Team, is_on_gpu, thread_range
from .waiting import barrier

OPTIONS = {"enable_backward": False, "fuse_fp": False}


@dataclass(frozen=True)
class Serial:
    """A stage `(scene)` that one thread runs."""

    stage: wp.Function

    def fused(self) -> wp.Function:
        stage = self.stage

        @wp.func(inline=False)
        def serial(team: Team, s: Scene):
            if team.rank == 0:
                stage(s)
            barrier(team)

        return serial


@dataclass(frozen=True)
class Each:
    """A stage `(scene, element)` for each of `count` elements, which are divided among the threads.

    Attributes
    ----------
    count : wp.Function
        Function `(scene)` that returns the number of elements.
    stage : wp.Function
        Function `(scene, element)`, element from 0 to count - 1.
    atomic : bool
        Whether several elements change the same number. On a GPU they do so by atomics. On a CPU, one thread
        runs the stage for all elements, without atomics.
    """

    count: wp.Function
    stage: wp.Function
    atomic: bool = False

    def fused(self) -> wp.Function:
        count, stage, atomic = self.count, self.stage, self.atomic

        @wp.func(inline=False)
        def each(team: Team, s: Scene):
            begin = int(0)
            end = count(s)
            if wp.static(not atomic) or is_on_gpu(team):
                begin, end = thread_range(team, 0, end)
            elif team.rank > 0:
                end = 0
            k = int(begin)
            while k < end:
                stage(s, k)
                k += 1
            barrier(team)

        return each


@dataclass(frozen=True)
class Shared:
    """A stage `(team, scene)` that divides its work among the threads itself."""

    stage: wp.Function

    def fused(self) -> wp.Function:
        stage = self.stage

        @wp.func(inline=False)
        def shared(team: Team, s: Scene):
            stage(team, s)
            barrier(team)

        return shared


@dataclass(frozen=True)
class Sets:
    """A stage `(team, scene, k)` for every set k of contacts, in order: sets of pairs, then one with walls.

    Several threads share the pairs of a set, which must be independent. If one thread does plain sweeps, all
    pairs are one set instead (coloring.py).
    """

    stage: wp.Function

    def fused(self) -> wp.Function:
        stage = self.stage

        @wp.func(inline=False)
        def sets(team: Team, s: Scene):
            k = int(0)
            while k < set_count(s):
                stage(team, s, k)
                barrier(team)
                k += 1

        return sets


@dataclass(frozen=True)
class If:
    """Stages that run if a condition `(scene)` holds."""

    condition: wp.Function
    stages: Sequence["Stage"]

    def fused(self) -> wp.Function:
        condition, body = self.condition, fuse(self.stages)

        @wp.func
        def run_if(team: Team, s: Scene):
            holds = condition(s)
            barrier(team)  # all threads have read the condition before a stage of the body changes it
            if holds:
                body(team, s)

        return run_if


@dataclass(frozen=True)
class While:
    """Stages that run again and again while a condition `(scene)` holds."""

    condition: wp.Function
    stages: Sequence["Stage"]

    def fused(self) -> wp.Function:
        condition, body = self.condition, fuse(self.stages)

        @wp.func
        def run_while(team: Team, s: Scene):
            holds = condition(s)
            barrier(team)
            while holds:
                body(team, s)
                holds = condition(s)
                barrier(team)

        return run_while


Stage = Serial | Each | Shared | Sets | If | While


def fuse(stages: Sequence[Stage]) -> wp.Function:
    """Return the function `(team, scene)` that runs stages in order, with a barrier after each."""
    return _in_turn([stage.fused() for stage in stages])


def _in_turn(runs: list[wp.Function]) -> wp.Function:
    """Return the function `(team, scene)` that calls the functions `runs` in order."""
    if len(runs) == 1:
        return runs[0]
    first, others = runs[0], _in_turn(runs[1:])

    @wp.func
    def in_turn(team: Team, s: Scene):
        first(team, s)
        others(team, s)

    return in_turn
