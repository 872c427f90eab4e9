"""A scene advanced as on a GPU: every stage and every independent set a launch, here by one CPU thread."""

from functools import cache

import warp as wp
from stages import load

from warpgrains import Scene, State
from warpgrains.kernels.gpu import Launcher, stage_kernels
from warpgrains.kernels.record import SLOW, SOLVED, WITHOUT_ROOM
from warpgrains.kernels.stages import OPTIONS
from warpgrains.kernels.step import KINDS, step
from warpgrains.scene.state import first_state
from warpgrains.solver.engine import Engine
from warpgrains.solver.loading import load_state
from warpgrains.solver.sizes import Sizes, kind_of


def every_stage(name: str) -> tuple[wp.Module, list[wp.Kernel]]:
    """Put the stages of all methods into one module: what methods share is compiled once."""
    module = wp.get_module(name)
    wp.set_module_options(OPTIONS, module)
    kernels = dict.fromkeys(kernel for kind in KINDS for kernel in stage_kernels(step(kind), module))
    return module, list(kernels)


@cache
def launched_module() -> wp.Module:
    module, _ = every_stage("launched")
    load(module)
    return module


def launched_state(scene: Scene, steps: int) -> State:
    """Take so many steps by a captured graph of launches."""
    engine = Engine([scene], wp.get_device("cpu"), Sizes.first([scene], 1, wp.get_device("cpu")))
    records = engine.records
    load_state(records, 0, first_state(scene))
    records.host["merge"] = 0
    launcher = Launcher(launched_module(), records.device, 0, step(kind_of(scene)), threads=1)
    with wp.ScopedCapture(device="cpu") as capture:
        launcher(step(kind_of(scene)))
    while steps > 0:
        wp.capture_launch(capture.graph)
        outcome = records.host["step"]["outcome"][0]
        assert outcome in (SOLVED, WITHOUT_ROOM, SLOW)
        if outcome == WITHOUT_ROOM:
            records.reserve_contacts(0, int(records.array(0, "neighbors.total")[0]))
        elif outcome == SLOW:
            engine._exact[0].solve()
        else:
            steps -= 1
    return engine.scenes[0].state()
