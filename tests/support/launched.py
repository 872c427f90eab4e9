"""A scene advanced as on a GPU: every stage and every independent set a launch, here by one CPU thread."""

import warp as wp

from warpgrains import Scene, State
from warpgrains.kernels.gpu import Launcher
from warpgrains.kernels.record import SLOW, SOLVED, UNPROVED, WITHOUT_ROOM
from warpgrains.kernels.step import step
from warpgrains.scene.state import first_state
from warpgrains.solver.engine import Engine


def launched_state(scene: Scene, steps: int) -> State:
    """Take so many steps by a captured graph of launches."""
    engine = Engine([scene], wp.get_device("cpu"))
    engine.load(0, first_state(scene))
    records = engine._records
    records.host["merge"] = 0
    module = wp.get_module(f"launched_{scene.method}")
    launcher = Launcher(module, records.device, 0, step(scene.method), threads=1)
    with wp.ScopedCapture(device="cpu") as capture:
        launcher(step(scene.method))
    while steps > 0:
        wp.capture_launch(capture.graph)
        outcome = records.host["step"]["outcome"][0]
        assert outcome in (SOLVED, UNPROVED, WITHOUT_ROOM, SLOW)
        if outcome == WITHOUT_ROOM:
            records.make_room(0, int(records.array(0, "neighbors.total")[0]))
        elif outcome == SLOW:
            engine._solve_exactly(0)
        else:
            steps -= 1
    return engine.state(0)
