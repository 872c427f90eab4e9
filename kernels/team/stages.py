"""A step as data: stages, loops and conditions, and `fuse`, which compiles them into one function.

Every thread of a team calls that function, `(team, scene)`, with a barrier after every stage. Conditions are
predicates of the record, such as those of step.py.

Each stage is compiled separately (`inline=False`) and called: that takes a third of the time that a step in
one function takes to compile, and costs a step nothing. Warp detects changed kernels by the functions that a
closure names, so sequences name theirs.
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
    """A stage `(scene)` of one thread."""

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
    count, stage : wp.Function
    atomic : bool
        Whether elements change the same places, by atomics. These are atomic on a GPU alone: of a CPU's
        team, one thread does all elements.
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
    """A stage `(team, scene, k)` for every set k of contacts, in order: pairs, then contacts with walls.

    A set of pairs is an independent set, which several threads share, or all pairs if one thread does plain
    sweeps (coloring.py).
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
    """Stages that run if a condition holds."""

    condition: wp.Function
    stages: Sequence["Stage"]

    def fused(self) -> wp.Function:
        condition, body = self.condition, fuse(self.stages)

        @wp.func
        def run_if(team: Team, s: Scene):
            holds = condition(s)
            barrier(team)  # before a stage of the body changes what others have still to read
            if holds:
                body(team, s)

        return run_if


@dataclass(frozen=True)
class While:
    """Stages that run while a condition holds."""

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
    """Return the function that runs stages in turn, with a barrier after each."""
    return _in_turn([stage.fused() for stage in stages])


def _in_turn(runs: list[wp.Function]) -> wp.Function:
    """Return the function that runs others in turn."""
    if len(runs) == 1:
        return runs[0]
    first, others = runs[0], _in_turn(runs[1:])

    @wp.func
    def in_turn(team: Team, s: Scene):
        first(team, s)
        others(team, s)

    return in_turn
