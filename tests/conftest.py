"""Fixtures that several test files share."""

import ctypes
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from trimmed import trimmed
from warp._src import build as warp_build
from warp._src import context as warp_context

from warpgrains import Scene, Simulation
from warpgrains.base.warp_start import start_warp
from warpgrains.grade.compiler import Compiler
from warpgrains.reference.reference import Reference, build
from warpgrains.scene.fields import METHODS
from warpgrains.scene.state import State
from warpgrains.solver import tuning
from warpgrains.solver.statistics import Summary

HOLD = """
import sys
from pathlib import Path
from warpgrains.base.locks import Lock
lock = Lock(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


def pytest_configure() -> None:
    """Hear interrupts, also where a shell has started the tests in the background: it has them ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave WARPGRAINS_EXAMPLES cases of each long test, evenly spread, as in CI."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("slow"):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    left_out = set()
    for same in cases.values():
        count = trimmed(len(same))
        kept = {k * len(same) // count for k in range(count)}
        left_out.update(item for k, item in enumerate(same) if k not in kept)
    if left_out:
        config.hook.pytest_deselected(items=sorted(left_out, key=lambda item: item.nodeid))
        items[:] = [item for item in items if item not in left_out]


@pytest.fixture
def held_elsewhere() -> Iterator[Callable[[Path], subprocess.Popen[bytes]]]:
    """Have another process hold a lock, until the end of the test."""
    holders: list[subprocess.Popen[bytes]] = []

    def hold(path: Path) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-c", HOLD, str(path)]
        holder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        holders.append(holder)
        return holder

    yield hold
    for holder in holders:
        holder.kill()
        holder.wait(timeout=60)


@pytest.fixture
def stop_at(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Interrupt the next simulation after so many steps, once."""

    def stop(steps: int) -> None:
        advance = Simulation.advance

        def advance_or_stop(self: Simulation, count: int, *arguments: Any) -> Summary:
            if self.steps + count <= steps:
                return advance(self, count, *arguments)
            advance(self, steps - self.steps, *arguments)
            monkeypatch.setattr(Simulation, "advance", advance)
            raise KeyboardInterrupt

        monkeypatch.setattr(Simulation, "advance", advance_or_stop)

    return stop


@pytest.fixture(autouse=True)
def whole_teams(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let as many threads work as a test asks for, also where they do not pay and on a busy machine."""
    monkeypatch.setattr(tuning, "useful_threads", lambda scene, threads: threads)


@pytest.fixture(scope="session", autouse=True)
def headers_compiled_once() -> Iterator[None]:
    """Compile Warp's own headers, two seconds of each kernel's, once for all kernels of a process.

    By Warp's option for it, kernels would be others than those of commands in other processes.
    """
    start_warp()
    build = warp_build.build_cpu

    def build_with_headers(*paths: str, **options: Any) -> None:
        folder = warp_context.runtime.get_clang_pch_dir()
        build(*paths, **options | {"use_precompiled_headers": True, "pch_dir": folder})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(warp_build, "build_cpu", build_with_headers)
        yield


@pytest.fixture(scope="session", autouse=True)
def kernels_shared_out(request: pytest.FixtureRequest, headers_compiled_once: None) -> None:
    """In a run of all tests, let each worker compile its share of the kernels that several files need."""
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker is None or request.config.option.file_or_dir:
        return
    kinds = [*product(METHODS, ((0.0, 0.0), (0.3, 0.0), (0.0, 0.5))), ("gauss-seidel", (0.3, 0.5))]
    for method, (mu, e) in kinds[int(worker[2:]) :: int(os.environ["PYTEST_XDIST_WORKER_COUNT"])]:
        Simulation("annulus", method=method, friction=mu, restitution=e).compile()


@pytest.fixture(scope="session", autouse=True)
def own_c_compiled_once() -> Iterator[None]:
    """Compile what graders themselves consist of once for all graders of a process, with one `cc`."""
    compiled: dict[object, bytes] = {}
    run = Compiler._run

    def run_once(self: Compiler, command: Sequence[str], folder: Path, until: float = math.inf) -> str:
        if command[0] != "cc":  # a homework, behind the fence
            return run(self, command, folder, until)
        output = Path(command[command.index("-o") + 1])
        headers = [path.read_bytes() for path in sorted(folder.glob("*.h"))]
        options = [each.replace(str(folder), "") for each in command]
        key = (*options, *headers, os.environ.get("PATH"))
        if key in compiled:
            output.write_bytes(compiled[key])
            output.chmod(0o755)
            return ""
        printed = run(self, command, folder, until)
        compiled[key] = output.read_bytes()
        return printed

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Compiler, "_run", run_once)
        yield


@pytest.fixture(scope="session")
def c_library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The C reference, built once; without a compiler the tests fail."""
    try:
        return build(tmp_path_factory.mktemp("reference"))
    except RuntimeError as error:
        pytest.fail(str(error), pytrace=False)


@pytest.fixture
def reference(c_library: ctypes.CDLL) -> Callable[..., Reference]:
    def make(scene: Scene, state: State | None = None) -> Reference:
        return Reference(c_library, scene, state)

    return make
