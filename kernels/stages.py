"""A step as data: stages, with loops and conditions.

Two makers turn it into what runs: `fuse` (fuse.py) makes one function of it for a team of CPU threads, and
`launch` (launch.py) the launches of a GPU's graph. Conditions are functions of conditions.py: the stages
write what they read.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import warp as wp

OPTIONS = {"enable_backward": False, "fuse_fp": False}


@dataclass(frozen=True)
class Serial:
    """A stage `(scene)` of one thread."""

    stage: wp.Function


@dataclass(frozen=True)
class Each:
    """A stage `(scene, element)` for each of so many elements, which the threads share out.

    Attributes
    ----------
    count, stage : wp.Function
    adds_up : bool
        Whether elements change the same places, by atomics: Warp's know of one thread on a CPU, which then
        does all elements.
    """

    count: wp.Function
    stage: wp.Function
    adds_up: bool = False


@dataclass(frozen=True)
class Shared:
    """A stage `(team, scene)` that shares out its work itself."""

    stage: wp.Function


@dataclass(frozen=True)
class Sets:
    """A stage `(team, scene, set)` for every independent set of pairs, in order."""

    stage: wp.Function


@dataclass(frozen=True)
class If:
    """Stages that are passed over unless a condition holds."""

    condition: wp.Function
    stages: Sequence["Stage"]


@dataclass(frozen=True)
class While:
    """Stages that are repeated as long as a condition holds."""

    condition: wp.Function
    stages: Sequence["Stage"]


Stage = Serial | Each | Shared | Sets | If | While
