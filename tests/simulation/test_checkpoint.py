"""Checkpoints: the state to the last bit, in a file that is whole or not there."""

import json
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from checkpoints import rewrite_checkpoint
from command import exit_code, require_refusal
from same_bits import contents, run_of

from warpgrains import InputError, Scene, Simulation
from warpgrains.scene.state import Corrections, State, VerletList
from warpgrains.simulation.checkpoint import VERSION, read_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.solver.statistics import Summary

STORED = State, Corrections, VerletList, RunOptions, Summary
FIELDS = {
    name: names.split()
    for name, names in {
        "State": "steps position velocity corrections lists staggered spin angle driven"
        " last_staggered id born inflow outflow exchanged last_scene",
        "Corrections": "pair pair_correction wall wall_correction pair_friction wall_friction"
        " pair_rolling wall_rolling",
        "VerletList": "pair wall skin recent_deviation reference_position reference_velocity"
        " frame_shift base_skin frame_skin elapsed lifetime",
        "RunOptions": "color_by colors range forces size frame background clean fps slow steps record draw_as"
        " checkpoint every until measure series measure_every region mean",
        "Summary": "steps iterations iterations_max unconverged residual gap_error overlap rebuilds restarts"
        " seconds output met error frames held means",
    }.items()
}
"""Fields of version 19. Whoever changes them must increase `VERSION`."""


ODD = {"dt": 1e-2 / 3.0, "name": '"quoted" \u00e9\u4e2d', "text": "line\nline\t\\ \x7f \U0001f40d"}


@pytest.fixture
def simulation():
    """The annulus when some grains touch each other and others a wall, with texts that are hard to keep."""
    return run_of(Scene.load("annulus").replace(order="color", **ODD), 450)


@pytest.fixture
def saved(simulation, tmp_path):
    simulation.save(tmp_path / "saved.npz")
    return tmp_path / "saved.npz"


def test_layout_of_this_version(saved):
    """A file that another version could not read needs another number."""
    assert VERSION == 19
    assert {kind.__name__: [own.name for own in fields(kind)] for kind in STORED} == FIELDS
    with np.load(saved, allow_pickle=False) as archive:
        header = json.loads(archive["header"].tobytes())
        found = {name: archive[name].shape[1:] for name in archive.files}
    parts = ["scene", "state", "corrections", "lists"]
    assert list(header["lists"]) == ["base_skin", "frame_skin", "elapsed", "lifetime"]
    assert list(header) == ["format", "version", "warpgrains", "options", "statistics", *parts]
    vectors = "scene.position scene.velocity state.position state.velocity corrections.pair lists.pair"
    vectors += " corrections.wall lists.wall lists.reference_position lists.reference_velocity"
    numbers = "header scene.radius scene.mass scene.spin"
    numbers += " corrections.pair_correction corrections.wall_correction"
    numbers += " lists.skin lists.recent_deviation lists.frame_shift"
    assert found == dict.fromkeys(vectors.split(), (2,)) | dict.fromkeys(numbers.split(), ())


@pytest.mark.parametrize("call", ["pathlib.Path.write_bytes", "os.replace"])
def test_a_failed_save_leaves_the_earlier_one_and_the_next_replaces_it(simulation, saved, monkeypatch, call):
    before = saved.read_bytes()
    simulation.step()
    with monkeypatch.context() as patch:
        patch.setattr(call, Mock(side_effect=OSError("disk full")))
        with pytest.raises(OSError, match="disk full"):
            simulation.save(saved)
    assert saved.read_bytes() == before
    assert list(saved.parent.iterdir()) == [saved]
    simulation.save(saved)
    kept = read_checkpoint(saved)
    assert contents(kept.scene) == contents(simulation.scene)
    assert contents(kept.state) == contents(simulation.state())


def test_a_file_of_something_else_is_not_replaced(simulation, tmp_path):
    """A scene's own grains are an .npz file too."""
    grains = tmp_path / "grains.npz"
    np.savez(grains, position=simulation.position)
    before = grains.read_bytes()
    for write in (simulation.save, lambda path: simulation.run(steps=1, checkpoint=path)):
        with pytest.raises(InputError, match=r"refusing to overwrite .*: not a checkpoint"):
            write(grains)
    assert grains.read_bytes() == before


def test_pickles_are_not_opened(saved, tmp_path):
    trap = tmp_path / "sprung"

    class Trap:
        def __reduce__(self):
            return Path.touch, (trap,)

    rewrite_checkpoint(saved, state__position=np.array([Trap()], dtype=object))
    with pytest.raises(InputError, match="not a checkpoint of warpgrains"):
        Simulation.load(saved)
    assert not trap.exists()


@pytest.mark.parametrize(
    ("options", "steps"),
    [
        *(({"record": f"../there/{name}"}, 20) for name in ("new.usdc", "other.usdc", "note.txt")),
        *(({"measure": "pile_height", "series": "../there/new.csv"}, steps) for steps in (0, 20)),
    ],
)
def test_what_it_says_of_files_elsewhere_is_not_believed(tmp_path, capfd, monkeypatch, options, steps):
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    record = here / "run.usdc" if "record" in options else None
    with monkeypatch.context() as killed, suppress(KeyboardInterrupt):
        if steps == 0:
            killed.setattr(Simulation, "advance", Mock(side_effect=KeyboardInterrupt))
        Simulation("annulus").run(steps=20, record=record, checkpoint=here / "run.npz")
    Simulation(Scene.load("column")).run(steps=2, record=there / "other.usdc")
    before = {path: path.read_bytes() for path in there.iterdir()}
    rewrite_checkpoint(here / "run.npz", {"options": options | {"steps": 30}})
    assert exit_code("run", "--resume", here / "run.npz") == 2
    require_refusal(capfd, *["lacks rows before"] * ("series" in options))
    assert {path: path.read_bytes() for path in there.iterdir()} == before
