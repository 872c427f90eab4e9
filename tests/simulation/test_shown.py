"""What a notebook shows: names, short texts with units, and nothing that nobody asked for."""

import inspect
import subprocess
import sys

import pytest

import warpgrains as wg
from warpgrains.cli.scenes import parameters_of
from warpgrains.simulation.options import Outputs


def test_completion_lists_the_public_names():
    assert {*wg.__all__} <= {*dir(wg)}
    for name in dir(wg):
        assert getattr(wg, name) is not None or name.startswith("__")
    assert [name for name in dir(wg) if not name.startswith("__")] == wg.__all__


def test_shown_in_a_line_with_units():
    start = wg.Scene.load("annulus")
    assert repr(start) == (
        "Scene(annulus of 15 grains, radius 0.1 m, mass 0.1 kg, walls 0.5 to 2 m,"
        " gravity (0, -9.81) m/s2, drag 0.5 kg/s, dt 0.01 s, duration 8 s)"
    )
    assert "radius 0.0213426 to 0.0991019 m" in repr(wg.Scene.load("polydisperse"))
    assert "walls 1 m" in repr(wg.Scene.load("no_inner_wall"))
    simulation = wg.Simulation(start)
    summary = simulation.run(steps=30)
    assert repr(simulation) == "Simulation(annulus of 15 grains, steps 30, time 0.3 s)"
    assert repr(summary).startswith(
        "Summary(steps 30, iterations 7.7 a step, 47 at most, not converged 0 steps, residual "
    )
    assert repr(summary).endswith(" s)")
    assert " m/s, overlap " in repr(summary)
    assert repr(wg.Batch([start, start])) == "Batch(2 scenes of annulus, grains 30 in all)"
    one = wg.Scene(position=[(0.0, 0.5)], radius=0.1, mass=1.0, radius_out=1.0)
    assert repr(one).startswith("Scene(scene of 1 grain, ")
    assert repr(wg.Batch([one])) == "Batch(1 scene of scene, grains 1 in all)"


def test_results_of_a_batch_are_shown_in_lines():
    """Ten at most, those of the first and of the last scenes."""
    batch = wg.Batch([wg.Scene.load("annulus").replace(drag=0.01 * k) for k in range(12)])
    results = batch.run(steps=1)
    lines = repr(results).split("\n")
    assert lines == [
        f"[{results[0]!r},",
        *(f" {results[k]!r}," for k in range(1, 5)),
        " ... 2 more ...,",
        *(f" {results[k]!r}," for k in range(7, 11)),
        f" {results[11]!r}]",
    ]
    assert repr(wg.Batch(["annulus"] * 2).run(steps=1)).count("\n") == 1


@pytest.mark.parametrize("name", ["annulus", "<b>&"])
def test_shown_as_a_table(name):
    shown = wg.Scene.load("annulus").replace(name=name)._repr_html_()
    assert shown.count("<tr>") == 8
    assert "<b>" not in shown
    assert "0.1 kg" in shown


@pytest.mark.parametrize("what", [wg.Scene, wg.Simulation.run])
def test_help_tells_of_every_parameter(what):
    told = parameters_of(what)
    taken = inspect.signature(what).parameters.keys() - {"self", "outputs"}
    if what is wg.Simulation.run:
        taken |= Outputs.__annotations__.keys()
    assert told.keys() == taken
    assert all(meaning.endswith((".", "; or", "...")) for meaning in told.values())


def test_a_library_user_sees_remarks_of_warp_only_if_asked_for():
    program = "import warpgrains as wg; print(wg.Simulation(wg.Scene.load('annulus')).run(steps=3).steps)"
    asking = "import warp; warp.config.log_level = warp.LOG_DEBUG\n"
    done, asked = (
        subprocess.run([sys.executable, "-c", before + program], capture_output=True, text=True, check=True)
        for before in ("", asking)
    )
    assert (done.stdout, done.stderr) == ("3\n", "")
    assert "initialized" in asked.stdout + asked.stderr
