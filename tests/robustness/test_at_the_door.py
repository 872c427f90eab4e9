"""Scenes hold what they say, also copies of them; checkpoints of others are refused where they come in."""

import copy
import json
import pickle
from contextlib import suppress
from unittest.mock import Mock

import numpy as np
import pytest
from command import exit_code, require_refusal

from warpgrains import InputError, Scene, Simulation
from warpgrains.simulation.checkpoint import read_checkpoint

GRAINS = {"position": [[0.5, 0.0], [0.0, 0.5]], "radius": 0.1, "mass": 1.0, "radius_out": 1.0}


class TestScene:
    def scene(self, **fields):
        return Scene(**{**GRAINS, **fields})

    @pytest.mark.parametrize("field", ["position", "velocity", "radius", "mass"])
    def test_masked_values_are_refused(self, field):
        array = getattr(self.scene(), field)
        masked = np.ma.array(array, mask=np.zeros(array.shape, bool))
        assert np.array_equal(getattr(self.scene(**{field: masked}), field), array)
        masked[0] = np.ma.masked
        with pytest.raises(InputError, match=f"{field} holds masked values"):
            self.scene(**{field: masked})

    @pytest.mark.parametrize(
        "remake", [copy.copy, copy.deepcopy, lambda scene: pickle.loads(pickle.dumps(scene))]
    )
    def test_copies_cannot_be_written_to(self, remake):
        scene = self.scene(name="mine", drag=0.1)
        again = remake(scene)
        assert type(again) is Scene
        for name, value in vars(scene).items():
            assert np.array_equal(getattr(again, name), value)
        for name in ("position", "velocity", "radius", "mass"):
            with pytest.raises(ValueError, match="read-only"):
                getattr(again, name)[0] = 1.0

    def test_walls_far_away(self):
        assert Simulation(self.scene(radius_out=9.9e10)).step().converged


def test_velocity_of_minus_zero_becomes_zero(reference):
    """As in the text's loop: -0.0 + dt (0 - 0 * -0.0) is +0.0."""
    fields = GRAINS | {"gravity": (0.0, 0.0), "velocity": np.full((2, 2), -0.0)}
    simulation = Simulation(Scene(**fields))
    expected = reference(simulation.scene)
    simulation.step()
    expected.step()
    assert not np.signbit(simulation.velocity).any()
    assert np.array_equal(np.signbit(simulation.velocity), np.signbit(expected.velocity))


HEADERS = {
    "steps as text": ({"options": {"steps": "40"}}, "steps is '40'"),
    "steps as number": ({"options": {"steps": 40.0}}, "steps is 40.0"),
    "record as number": ({"options": {"record": 3}}, "record is 3"),
    "record anywhere": ({"options": {"record": "/etc/motd.usdc"}}, "record is '/etc/motd.usdc'"),
    "forces as number": ({"options": {"forces": 1}}, "forces is 1"),
    "fps as text": ({"options": {"fps": "60"}}, "fps is '60'"),
    "fps of nothing": ({"options": {"fps": float("nan")}}, "fps is nan"),
    "color as list": ({"options": {"color_by": []}}, "color_by is"),
    "less than was done": ({"options": {"steps": 10}}, "steps is 20"),
    "plan as list": ({"options": []}, "holds an invalid state"),
    "unknown plan": ({"options": {"shell": "rm"}}, "shell"),
    "frames as text": ({"statistics": {"frames": "1"}}, "frames is '1'"),
    "no frames": ({"statistics": {"frames": 0}}, "frames is 0"),
    "many frames": ({"statistics": {"frames": 1000}}, "frames is 1000"),
    "more steps than the state": ({"statistics": {"steps": 21}}, "steps is 21"),
    "negative": ({"statistics": {"iterations": -1}}, "iterations is -1"),
    "nan": ({"statistics": {"residual": float("nan")}}, "residual is nan"),
    "seconds as text": ({"statistics": {"seconds": "1"}}, "seconds is '1'"),
    "truth": ({"statistics": {"restarts": True}}, "restarts is True"),
    "tally as text": ({"statistics": "none"}, "holds an invalid state"),
    "name as number": ({"scene": {"name": 3}}, "name is 3"),
    "text as list": ({"scene": {"text": []}}, "text is"),
    "state as list": ({"state": []}, "holds an invalid state"),
    "version as truth": ({"version": True}, "not a checkpoint"),
}


@pytest.mark.parametrize(("change", "complaint"), HEADERS.values(), ids=HEADERS.keys())
def test_header_of_a_checkpoint(tmp_path, change, complaint, capfd):
    kept = tmp_path / "run.npz"
    simulation = Simulation("annulus")
    simulation.run(steps=20, record=tmp_path / "run.usdc", checkpoint=kept)
    rewrite(kept, change)
    with pytest.raises(InputError, match=complaint) as refusal:
        read_checkpoint(kept)
    assert "\n" not in str(refusal.value)
    assert exit_code("run", "--resume", kept) == 2
    require_refusal(capfd)


def rewrite(path, change):
    """Change entries of a header, and values of those that are tables."""
    with np.load(path, allow_pickle=False) as archive:
        entries = {name: archive[name] for name in archive.files}
    header = json.loads(entries["header"].tobytes())
    for name, value in change.items():
        header[name] = header[name] | value if isinstance(value, dict) else value
    entries["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez(path, **entries)


def test_checkpoint_of_foreign_hands_makes_no_file_elsewhere(tmp_path, capfd):
    """What it says of a recording is believed only where that is one, of the same scene."""
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    simulation = Simulation("annulus")
    simulation.run(steps=20, record=here / "run.usdc", checkpoint=here / "run.npz")
    Simulation(Scene.load("column")).run(steps=2, record=there / "other.usdc")
    before = {path: path.read_bytes() for path in there.iterdir()}
    for record in ("../there/new.usdc", "../there/other.usdc", "../there/note.txt"):
        rewrite(here / "run.npz", {"options": {"record": record, "steps": 30}})
        assert exit_code("run", "--resume", here / "run.npz") == 2
        require_refusal(capfd)
        assert {path: path.read_bytes() for path in there.iterdir()} == before


@pytest.mark.parametrize("steps", [0, 20])
def test_checkpoint_of_foreign_hands_makes_no_series_elsewhere(tmp_path, capfd, monkeypatch, steps):
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    simulation = Simulation("annulus")
    with monkeypatch.context() as killed, suppress(KeyboardInterrupt):
        if steps == 0:
            killed.setattr(Simulation, "advance", Mock(side_effect=KeyboardInterrupt))
        simulation.run(steps=20, checkpoint=here / "run.npz")
    rewrite(
        here / "run.npz", {"options": {"measure": "pile_height", "series": "../there/new.csv", "steps": 30}}
    )
    assert exit_code("run", "--resume", here / "run.npz") == 2
    require_refusal(capfd, "lacks rows before")
    assert not list(there.iterdir())
