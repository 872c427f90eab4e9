"""An interrupt reaches a long step, and leaves the last good state."""

import dataclasses
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from time import sleep

import numpy as np
import pytest
from same_bits import contents, run_of

from warpgrains import Batch, Scene, Simulation
from warpgrains.kernels.record import Phase
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.solver import engine, sizes
from warpgrains.solver.threads import run_threads

ENDLESS = {"tolerance": 0.0, "max_iterations": 2_000_000_000}


def interrupt_soon():
    threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()


@pytest.mark.parametrize(("method", "threads"), [("gauss-seidel", 1), ("accelerated", 2)])
def test_one_endless_step(method, threads):
    scene = Scene.load("polydisperse").replace(method=method)
    started = run_of(scene, 60, threads=threads)
    simulation = Simulation(scene.replace(**ENDLESS), threads=threads, state=started.state())
    interrupt_soon()
    with pytest.raises(KeyboardInterrupt):
        simulation.step()
    assert contents(simulation.state().corrections) == contents(started.state().corrections)
    assert np.array_equal(simulation.velocity, started.velocity)
    started.restore(simulation.state())
    started.step()
    assert np.array_equal(started.velocity, run_of(scene, 61).velocity)


def test_steps_that_the_host_solves_are_completed_by_a_cancel_between_steps(monkeypatch):
    """So no bits depend on when runs of a sweep are cut, also in color order, whose lists have a history."""
    scene = Scene.load("collapse").replace(method="exact", order="color", tolerance=1e-9)
    cut, whole = (Simulation(scene, threads=1) for _ in range(2))
    service, canceled_in = engine.Engine.service, set()

    def serve_and_cancel(self):
        going_on = service(self)
        if cut.steps in canceled_in:
            return going_on
        canceled_in.add(cut.steps)
        self.cancel(abandon=False)
        return False

    with monkeypatch.context() as serving:
        serving.setattr(engine.Engine, "service", serve_and_cancel)
        while cut.steps < 300:
            cut.advance(300 - cut.steps)
    whole.advance(300)
    assert contents(cut.state()) == contents(whole.state())


@pytest.mark.parametrize(
    ("scene", "method", "phase"),
    [
        ("polydisperse", "gauss-seidel", Phase.SEARCH),
        ("column", "exact", Phase.ANSWERED),
        ("collapse", "exact", Phase.ANSWERED),
    ],
)
def test_a_step_that_has_been_served_is_finished_or_undone(monkeypatch, scene, method, phase):
    """It has memory for its list, or is solved by the host, and then all steps are canceled."""
    monkeypatch.setattr(sizes, "first_pairs", np.ones_like)
    started = run_of(Scene.load(scene).replace(method=method, tolerance=1e-9), 60)
    state = dataclasses.replace(started.state(), lists=None)
    service = engine.Engine.service
    served = []

    def serve_and_cancel(self):
        going_on = service(self)
        if (self.records.host["control"]["phase"] == phase).any():
            served.append(1)
            self._cancel[0] = 1
            return False
        return going_on

    canceled, whole = (Simulation(started.scene, state=state) for _ in range(2))
    with monkeypatch.context() as serving:
        serving.setattr(engine.Engine, "service", serve_and_cancel)
        canceled.advance(10)
    assert served
    whole.advance(canceled.steps - whole.steps)
    left, expected = (dataclasses.replace(one.state(), lists=None) for one in (canceled, whole))
    assert contents(left) == contents(expected)
    for simulation in (canceled, whole):
        simulation.advance(20)
    assert np.array_equal(canceled.velocity, whole.velocity)


def test_a_gpu_returns_the_scene(monkeypatch):
    """Its memory holds the last good step also after an interrupt, and the host's does not."""
    worker = Simulation("annulus")._engine
    copied = []

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(engine.wp, "launch", interrupt)
    for name in ("push", "pull"):
        monkeypatch.setattr(worker.records, name, partial(copied.append, name))
    worker.submit([1])
    with pytest.raises(KeyboardInterrupt):
        worker._work_on_gpu()
    assert copied == ["push", "pull"]


def test_short_steps_are_ended(monkeypatch):
    """In color order, bits depend on the list: an interrupt must not change it."""
    monkeypatch.setattr(engine, "BRIEF", 0)
    monkeypatch.setattr("warpgrains.solver.threads.GLANCE", 1e-4)
    monkeypatch.setattr("warpgrains.solver.threads.GRACE", 60.0)
    interrupted, whole = (Simulation("annulus", threads=1, order="color", drag=0.1) for _ in range(2))

    def interrupt(steps):
        raise KeyboardInterrupt

    for _ in range(20):
        before = interrupted.steps
        with pytest.raises(KeyboardInterrupt):
            interrupted.advance(10**6, interrupt)
        whole.advance(interrupted.steps - before)
        assert contents(interrupted.state()) == contents(whole.state())


def test_an_endless_batch():
    Simulation(Scene.load("annulus")).step()  # so that nothing has to be compiled
    batch = Batch([Scene.load("polydisperse").replace(**ENDLESS), Scene.load("annulus")], threads=2)
    interrupt_soon()
    with pytest.raises(KeyboardInterrupt):
        batch.run(steps=100)
    assert batch.state(0).steps < 100
    assert batch.state(1).steps == 100


def test_a_command_amid_an_endless_step(tmp_path):
    kept = tmp_path / "run.npz"
    endless = [f"solver.{name}={value}" for name, value in ENDLESS.items()]
    options = ["--set", endless[0], "--set", endless[1], "--checkpoint", str(kept), "--every", "1"]
    command = subprocess.Popen(
        [sys.executable, "-m", "warpgrains", "run", "polydisperse", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    while not kept.exists() or time.time() - kept.stat().st_mtime < 1.0:  # no step has ended for a second
        time.sleep(0.1)
    command.send_signal(signal.SIGINT)
    out, complaint = command.communicate(timeout=60)
    assert out == b""
    assert complaint.startswith(b"warpgrains: error: interrupted; ")
    assert complaint.count(b"\n") == 1
    assert command.returncode == 130
    steps = read_checkpoint(kept).state.steps
    assert steps > 0
    undisturbed = run_of(Scene.load("polydisperse", endless), steps)
    assert contents(read_checkpoint(kept).state) == contents(undisturbed.state())


def test_interrupt_while_threads_start(monkeypatch):
    """All works have ended before it goes on, also where the executor does not know of a thread yet."""
    submit, ended, begun = ThreadPoolExecutor.submit, [], []

    def interrupted(self, *work):
        future = submit(self, *work)
        begun.append(work)
        if len(begun) == 1:
            self._threads.clear()
            raise KeyboardInterrupt
        return future

    monkeypatch.setattr(ThreadPoolExecutor, "submit", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_threads([lambda: (sleep(0.2), ended.append(0)), lambda: ended.append(1)], lambda: None)
    assert sorted(ended) == [0, 1]


INTERRUPTED = """
import random, signal, time
from warpgrains.solver import threads

def interrupt_soon():
    if signal.getitimer(signal.ITIMER_REAL)[0] == 0.0:
        signal.setitimer(signal.ITIMER_REAL, random.uniform(1e-5, 2e-3))

threads.GLANCE = 2e-5
signal.signal(signal.SIGALRM, signal.default_int_handler)
for _ in range(500):
    try:
        tasks = [lambda: time.sleep(random.uniform(2e-3, 3e-3))] * 3
        threads.run_threads(tasks, interrupt_soon, lambda _: None)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    except KeyboardInterrupt:
        pass
"""


def test_an_interrupt_while_threads_run_leaves_none_waiting():
    """An interrupt in a wait for Python's futures left a lock that no thread would release."""
    subprocess.run([sys.executable, "-c", INTERRUPTED], check=True, timeout=60)
