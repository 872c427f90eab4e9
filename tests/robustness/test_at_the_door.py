"""What is no state, no option and no scene is refused where it comes in, by field, grain and value."""

import copy
import json
import pickle
from contextlib import suppress
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from command import exit_code, require_refusal

from warpgrains import Batch, InputError, Scene, Simulation
from warpgrains.scene.state import Corrections, State, VerletList
from warpgrains.simulation.checkpoint import read_checkpoint


@pytest.fixture(scope="module")
def simulation():
    simulation = Simulation(Scene.load("annulus", ["solver.order=color"]))
    simulation.run(steps=150)
    return simulation


def with_row(array, row, value):
    changed = array.copy()
    changed[row] = value
    return changed


CORRECTIONS = {
    "negative": (lambda c: replace(c, pair_correction=with_row(c.pair_correction, 0, -1.0)), "is -1.0"),
    "nan pair": (lambda c: replace(c, pair_correction=with_row(c.pair_correction, 0, np.nan)), "is nan"),
    "nan wall": (
        lambda c: replace(c, wall_correction=with_row(c.wall_correction, 0, np.nan)),
        "that of grain .* at wall . is nan",
    ),
    "list": (
        lambda c: replace(c, pair_correction=c.pair_correction.tolist()),
        "pair_correction .* is a list",
    ),
    "pairs as list": (lambda c: replace(c, pair=c.pair.tolist()), "pair of the state is a list"),
    "nothing": (lambda c: None, "corrections is a NoneType"),
}
STATES = {
    "nan": (lambda s: replace(s, position=with_row(s.position, 4, np.nan)), "position .* grain 4 is .nan"),
    "inf": (lambda s: replace(s, velocity=with_row(s.velocity, 5, np.inf)), "velocity .* grain 5 is .inf"),
    "same centre": (
        lambda s: replace(s, position=with_row(s.position, 9, s.position[2])),
        "position .* grain 9 is .* grain 2 has the same center",
    ),
    "lists": (lambda s: replace(s, position=s.position.tolist()), "position of the state is a list"),
    "None": (lambda s: replace(s, velocity=None), "velocity of the state is a NoneType"),
    "masked": (lambda s: replace(s, velocity=np.ma.masked_less(s.velocity, 0.0)), "is a MaskedArray"),
    "steps": (lambda s: replace(s, steps=1.5), "steps is 1.5"),
    "list of nan": (
        lambda s: replace(s, lists=replace(s.lists, skin=with_row(s.lists.skin, 1, np.nan))),
        "skin of the state holds NaN",
    ),
    "no listed wall": (lambda s: replace(s, lists=replace(s.lists, wall=None)), "listed wall .* NoneType"),
    "dict": (lambda s: vars(s), "state is a dict: it must be a State"),
    "listed dict": (lambda s: replace(s, lists=vars(s.lists)), "lists is a dict: it must be a VerletList"),
} | {
    name: (lambda s, change=change: replace(s, corrections=change(s.corrections)), complaint)
    for name, (change, complaint) in CORRECTIONS.items()
}


@pytest.mark.parametrize(("change", "complaint"), STATES.values(), ids=STATES.keys())
def test_restored_state_is_checked(simulation, change, complaint):
    good = simulation.state()
    assert isinstance(good.corrections, Corrections)
    assert isinstance(good.lists, VerletList)
    batch = Batch([simulation.scene])
    for restore in (simulation.restore, lambda state: batch.restore(0, state)):
        with pytest.raises(InputError, match=complaint):
            restore(change(good))
    assert isinstance(simulation.state(), State)
    assert np.array_equal(simulation.position, good.position)


@pytest.mark.parametrize("duration", [0, -1, -0.0, float("nan"), float("inf"), "1", None])
def test_duration(simulation, duration):
    if duration is None:
        with pytest.raises(InputError, match="give steps or duration, not both"):
            simulation.run(steps=1, duration=1.0)
        return
    steps = simulation.steps
    for run in (simulation.run, Batch([simulation.scene]).run):
        with pytest.raises(InputError, match="duration is"):
            run(duration=duration)
    assert simulation.steps == steps


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"fps": 30.0}, "fps has no effect without record"),
        ({"forces": True}, "forces has no effect without record"),
        ({"color_by": "radius"}, "color_by has no effect without record"),
        ({"draw_as": "spheres"}, "draw_as has no effect without record"),
        (
            {"record": "run.usdc", "draw_as": "cubes"},
            "unknown draw_as 'cubes': known: discs, points, spheres",
        ),
        ({"record": "run.usdc", "draw_as": 3}, "draw_as is 3"),
        ({"every": 10}, "every has no effect without checkpoint"),
        ({"record": "run.usdc", "fps": None}, "fps is None"),
        ({"record": "run.usdc", "forces": "no"}, "forces is 'no'"),
        ({"record": "run.usdc", "color_by": np.array(["a"])}, "color_by is array"),
        ({"record": ""}, "record is ''"),
        ({"record": "a\0.usdc"}, "record is 'a"),
        ({"checkpoint": ""}, "checkpoint is ''"),
    ],
)
def test_options_of_a_run(simulation, options, complaint):
    with pytest.raises(InputError, match=complaint):
        simulation.run(steps=1, **options)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--fps", "60"],
        ["--forces"],
        ["--color-by", "foo"],
        ["--as", "spheres"],
        ["--every", "3"],
        ["-o", ""],
    ],
)
def test_options_without_effect_on_the_command_line(arguments, capfd):
    assert exit_code("run", "annulus", "--steps", "1", *arguments) == 2
    refused = f"{arguments[0]} has no effect without --"
    require_refusal(capfd, "record is ''" if arguments[0] == "-o" else refused)


@pytest.mark.parametrize("threads", [0, 1025, 10**6, 10**400, 1.5, "2", True])
def test_threads(threads, capfd):
    scene = Scene.load("annulus")
    for kind in (Simulation, lambda scene, **options: Batch([scene], **options)):
        with pytest.raises(InputError, match="threads is"):
            kind(scene, threads=threads)
    if isinstance(threads, int) and not isinstance(threads, bool):
        assert exit_code("run", "annulus", "--steps", 1, "--threads", threads) == 2
        require_refusal(capfd)


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

    @pytest.mark.parametrize(
        ("fields", "complaint"),
        [
            ({"order": np.array(["color"])}, "unknown order"),
            ({"order": None}, "unknown order None"),
            ({"text": None}, "text is None"),
            ({"name": 3}, "name is 3"),
            ({"max_iterations": 10**5000}, "max_iterations is a number of more than 30 digits"),
            ({"mass": 10**5000}, "mass holds object values"),
        ],
    )
    def test_fields(self, fields, complaint):
        with pytest.raises(InputError, match=complaint):
            self.scene(**fields)

    @pytest.mark.parametrize("radius_out", [1e11, 1e13, 1e14, 1e300])
    def test_walls_out_of_all_proportion(self, radius_out):
        """Positions would have no digits for a gap, and a search for neighbours no end."""
        with pytest.raises(InputError, match=r"must be less than 1e\+12 radii of grain 1, 0\.1 m"):
            self.scene(radius=[0.2, 0.1], radius_out=radius_out)

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
    "seconds as text": ({"statistics": {"step_seconds": "1"}}, "step_seconds is '1'"),
    "truth": ({"statistics": {"restarts": True}}, "restarts is True"),
    "grains as number": ({"statistics": {"infeasible_grains": 3}}, "holds an invalid state"),
    "grain that is none": ({"statistics": {"infeasible_grains": [99]}}, "infeasible grain is 99"),
    "tally as text": ({"statistics": "none"}, "holds an invalid state"),
    "name as number": ({"scene": {"name": 3}}, "name is 3"),
    "text as list": ({"scene": {"text": []}}, "text is"),
    "state as list": ({"state": []}, "holds an invalid state"),
    "version as truth": ({"version": True}, "not a checkpoint"),
}


@pytest.mark.parametrize(("change", "complaint"), HEADERS.values(), ids=HEADERS.keys())
def test_header_of_a_checkpoint(tmp_path, change, complaint, capfd):
    kept = tmp_path / "run.npz"
    simulation = Simulation(Scene.load("annulus"))
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
    simulation = Simulation(Scene.load("annulus"))
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
    simulation = Simulation(Scene.load("annulus"))
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
