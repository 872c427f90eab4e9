"""Checkpoints: the state to the last bit, in a file that is whole or not there."""

import json
import re
import shutil
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from command import exit_code, require_refusal
from same_bits import contents

from warpgrains import InputError, Scene, Simulation
from warpgrains.scene.state import Corrections, State, VerletList, first_state
from warpgrains.simulation.checkpoint import VERSION, Checkpoint, read_checkpoint, write_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.solver.statistics import Summary

STORED = State, Corrections, VerletList, RunOptions, Summary
FIELDS = {
    name: names.split()
    for name, names in {
        "State": "steps position velocity corrections lists staggered spin angle driven"
        " last_staggered last_scene",
        "Corrections": "pair pair_correction wall wall_correction pair_friction wall_friction"
        " pair_rolling wall_rolling",
        "VerletList": "pair wall skin recent_deviation reference_position reference_velocity"
        " frame_shift base_skin frame_skin elapsed lifetime",
        "RunOptions": "steps record fps color_by forces draw_as size frame checkpoint every until"
        " measure series measure_every region mean",
        "Summary": "steps iterations iterations_max unconverged residual gap_error overlap rebuilds restarts"
        " seconds output met error frames held means",
    }.items()
}
"""Fields of version 16. Whoever changes them must increase `VERSION`."""


@pytest.fixture
def simulation():
    """The annulus when some grains touch each other and others a wall."""
    simulation = Simulation(Scene.load("annulus", ["solver.order=color"]))
    simulation.run(steps=150)
    return simulation


@pytest.fixture
def saved(simulation, tmp_path):
    simulation.save(tmp_path / "saved.npz")
    return tmp_path / "saved.npz"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder of a run of 150 steps with a checkpoint and a recording."""
    folder = tmp_path_factory.mktemp("run")
    scene = Scene.load("annulus", ["solver.order=color"])
    Simulation(scene).run(steps=150, record=folder / "run.usdc", checkpoint=folder / "run.npz")
    return folder


@pytest.fixture
def run(made, tmp_path):
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    return tmp_path / "run.npz"


def test_numbers_that_need_all_their_digits(tmp_path):
    third, tiny = 1.0 / 3.0, 5e-324
    scene = Scene(
        position=[[third, 0.7], [-0.7, np.nextafter(third, 1)]],
        radius=[third / 5, 0.1],
        mass=[1e-300, 1e300],
        radius_out=1.0 + 2**-52,
        gravity=(tiny, -third),
        dt=1e-3 / 3,
        tolerance=0.1 + 0.2,
        name='"quoted" \u00e9\u4e2d',
        text="line\nline\t\\ \x7f \U0001f40d",
    )
    kept = Checkpoint(scene, first_state(scene), None, Summary(overlap=third))
    write_checkpoint(tmp_path / "kept.npz", kept)
    assert contents(read_checkpoint(tmp_path / "kept.npz")) == contents(kept)


class TestFile:
    def test_layout_of_this_version(self, saved):
        """A file that another version could not read needs another number."""
        assert VERSION == 16
        assert {kind.__name__: [own.name for own in fields(kind)] for kind in STORED} == FIELDS
        with np.load(saved, allow_pickle=False) as archive:
            header = json.loads(archive["header"].tobytes())
            found = {name: archive[name].shape[1:] for name in archive.files}
        parts = ["scene", "state", "corrections", "lists"]
        assert list(header["lists"]) == ["base_skin", "frame_skin", "elapsed", "lifetime"]
        assert list(header) == ["format", "version", "warpgrains", "options", "statistics", *parts]
        vectors = "scene.position scene.velocity state.position state.velocity corrections.pair lists.pair"
        vectors += " corrections.wall lists.wall"
        vectors += " lists.reference_position lists.reference_velocity"
        numbers = "header scene.radius scene.mass scene.spin"
        numbers += " corrections.pair_correction corrections.wall_correction"
        numbers += " lists.skin lists.recent_deviation lists.frame_shift"
        assert found == dict.fromkeys(vectors.split(), (2,)) | dict.fromkeys(numbers.split(), ())

    @pytest.mark.parametrize("damage", ["write", "replace"])
    def test_failed_save_leaves_the_earlier_one(self, simulation, saved, monkeypatch, damage):
        def fail(*arguments):
            raise OSError("disk full")

        before = saved.read_bytes()
        simulation.step()
        with monkeypatch.context() as patch:
            if damage == "write":
                patch.setattr(Path, "write_bytes", fail)
            else:
                patch.setattr("os.replace", fail)
            with pytest.raises(OSError, match="disk full"):
                simulation.save(saved)
        assert saved.read_bytes() == before
        assert list(saved.parent.iterdir()) == [saved]

    @pytest.mark.parametrize("name", ["run", "run.npy", "no/such/run.npz", "folder.npz"])
    def test_bad_place(self, simulation, tmp_path, name):
        (tmp_path / "folder.npz").mkdir()
        for write in (simulation.save, lambda path: simulation.run(steps=1, checkpoint=path)):
            with pytest.raises(InputError, match=r"must end in \.npz|cannot be written|is a folder"):
                write(tmp_path / name)
        assert list(tmp_path.iterdir()) == [tmp_path / "folder.npz"]

    def test_file_of_something_else_is_not_replaced(self, simulation, tmp_path):
        """A scene's own grains are an .npz file too."""
        grains = tmp_path / "grains.npz"
        np.savez(grains, position=simulation.position)
        before = grains.read_bytes()
        for write in (simulation.save, lambda path: simulation.run(steps=1, checkpoint=path)):
            with pytest.raises(InputError, match=r"refusing to overwrite .*: not a checkpoint"):
                write(grains)
        assert grains.read_bytes() == before

    def test_checkpoint_is_replaced(self, simulation, saved):
        simulation.step()
        simulation.save(saved)
        assert contents(read_checkpoint(saved).state) == contents(simulation.state())


def rewrite(path, header=None, **arrays):
    """Change entries of a checkpoint: values of tables of its header, and arrays; None takes an array out."""
    with np.load(path, allow_pickle=False) as archive:
        entries = {name: archive[name] for name in archive.files}
    text = json.loads(entries["header"].tobytes())
    for name, value in (header or {}).items():
        text[name] = text[name] | value if isinstance(value, dict) else value
    entries["header"] = np.frombuffer(json.dumps(text).encode(), np.uint8)
    entries |= {name.replace("__", "."): array for name, array in arrays.items()}
    np.savez(path, **{name: array for name, array in entries.items() if array is not None})


INVALID = [
    ({"state__position": np.zeros((14, 2))}, "position of the state is float64 (14, 2)"),
    ({"state__velocity": np.zeros((15, 2), np.float32)}, "velocity of the state is float32"),
    ({"scene__radius": np.full(15, -1.0)}, "radius of grain 0 is -1.0"),
    ({"scene__mass": None}, "mass"),
    ({"corrections__wall_correction": np.zeros(3)}, "wall_correction of the state"),
    ({"corrections__pair": np.array([[1, 15]], np.int32)}, "pair of corrections must name a grain"),
    ({"corrections__pair": np.array([[-1, 3]], np.int32)}, "pair of corrections must name a grain"),
    ({"corrections__pair": np.array([[3, 1]], np.int32)}, "pair of corrections must name a grain"),
    ({"corrections__wall": np.array([[0, 7]], np.int32)}, "wall of corrections must name a grain"),
    ({"lists__pair": np.array([[0, 2], [0, 1]], np.int32)}, "pair of lists must be in"),
    ({"lists__pair": np.zeros((0, 2), np.int32)}, "carries a correction but is not in its lists"),
    ({"lists__wall": np.array([15], np.int32)}, "wall of the state is int32 (1,)"),
    ({"lists__skin": np.zeros(14)}, "skin of the state"),
    ({"state__driven": np.ones((1, 2))}, "driven of the state is given: no force drives a wall"),
    *(
        ({"header": {table: change}}, complaint)
        for table, change, complaint in (
            ("lists", {"elapsed": -1.0}, "elapsed of the state is -1.0"),
            ("lists", {"lifetime": np.nan}, "lifetime of the state is nan"),
            ("lists", {"base_skin": "1"}, "base_skin of the state is '1'"),
            ("state", {"steps": -1}, "steps is -1"),
            ("state", {"staggered": 1}, "staggered is 1"),
            ("state", [], "holds an invalid state"),
            ("state", None, "holds an invalid state"),
            ("version", VERSION - 1, f"reads version {VERSION}"),
            ("version", VERSION + 1, f"reads version {VERSION}"),
            ("scene", {"name": 3}, "name is 3"),
            ("scene", {"text": []}, "text is"),
            ("scene", {"cohesion": 1.0}, "cohesion"),
            ("options", {"steps": "40"}, "steps is '40'"),
            ("options", {"steps": 40.0}, "steps is 40.0"),
            ("options", {"steps": 10}, "steps is 150"),
            ("options", {"record": 3}, "record is 3"),
            ("options", {"record": "/etc/motd.usdc"}, "record is '/etc/motd.usdc'"),
            ("options", {"forces": 1}, "forces is 1"),
            ("options", {"fps": "60"}, "fps is '60'"),
            ("options", {"fps": float("nan")}, "fps is nan"),
            ("options", {"color_by": []}, "color_by is"),
            ("options", {"shell": "rm"}, "shell"),
            ("options", [], "holds an invalid state"),
            ("statistics", {"frames": "1"}, "frames is '1'"),
            ("statistics", {"frames": 0}, "frames is 0"),
            ("statistics", {"frames": 1000}, "frames is 1000"),
            ("statistics", {"steps": 151}, "steps is 151"),
            ("statistics", {"iterations": -1}, "iterations is -1"),
            ("statistics", {"residual": float("nan")}, "residual is nan"),
            ("statistics", {"seconds": "1"}, "seconds is '1'"),
            ("statistics", {"restarts": True}, "restarts is True"),
            ("statistics", {"strides": 3}, "strides"),
            ("statistics", "none", "holds an invalid state"),
            ("version", True, "not a checkpoint"),
        )
    ),
]


class TestBadFile:
    def require_refusal(self, path, match):
        with pytest.raises(InputError, match=match) as refusal:
            Simulation.load(path)
        assert "\n" not in str(refusal.value)
        assert str(path) in str(refusal.value)

    @pytest.mark.parametrize(
        "content",
        [
            *(b"", b"text", b"PK\x03\x04", b"\x80\x04}."),
            *({}, {"x": np.zeros(3)}, {"header": np.zeros(3, np.uint8)}, {"header": np.zeros((), "U9")}),
            np.zeros(3),
        ],
    )
    def test_something_else(self, tmp_path, content):
        path = tmp_path / "other.npz"
        if isinstance(content, dict):
            np.savez(path, **content)
        elif isinstance(content, bytes):
            path.write_bytes(content)
        else:
            with path.open("wb") as file:
                np.save(file, content)
        self.require_refusal(path, "not a checkpoint of warpgrains")

    def test_pickles_are_not_opened(self, saved, tmp_path):
        trap = tmp_path / "sprung"

        class Trap:
            def __reduce__(self):
                return Path.touch, (trap,)

        rewrite(saved, state__position=np.array([Trap()], dtype=object))
        self.require_refusal(saved, "not a checkpoint of warpgrains")
        assert not trap.exists()

    def test_missing(self, tmp_path):
        self.require_refusal(tmp_path / "missing.npz", "does not exist")
        self.require_refusal(tmp_path, "does not exist")

    def test_of_a_program_without_a_field(self, saved):
        with np.load(saved, allow_pickle=False) as archive:
            scene = json.loads(archive["header"].tobytes())["scene"]
        without = json.dumps({name: own for name, own in scene.items() if name != "spin_drag"})
        with np.load(saved, allow_pickle=False) as archive:
            entries = {name: archive[name] for name in archive.files}
        header = entries["header"].tobytes().decode().replace(json.dumps(scene), without)
        np.savez(saved, **entries | {"header": np.frombuffer(header.encode(), np.uint8)})
        assert Simulation.load(saved).scene.spin_drag == 0.0

    def test_array_said_to_be_shorter(self, tmp_path):
        """NumPy would read its first rows and not notice that they are not all."""
        scene, path = Scene.load("pile"), tmp_path / "saved.npz"
        write_checkpoint(path, Checkpoint(scene, first_state(scene), None, Summary()))
        path.write_bytes(path.read_bytes().replace(b"(1000,", b"( 500,", 1))
        self.require_refusal(path, "or it is damaged")

    @pytest.mark.parametrize(("change", "complaint"), INVALID)
    def test_what_no_run_can_be_in(self, run, change, complaint, capfd):
        rewrite(run, **change)
        self.require_refusal(run, re.escape(complaint))
        assert exit_code("run", "--resume", run) == 2
        require_refusal(capfd)

    def test_state_of_other_grains_is_not_restored(self, simulation):
        with pytest.raises(InputError, match="position of the state"):
            Simulation(Scene.load("column")).restore(simulation.state())

    @pytest.mark.parametrize(
        ("options", "steps"),
        [
            *(({"record": f"../there/{name}"}, 20) for name in ("new.usdc", "other.usdc", "note.txt")),
            *(({"measure": "pile_height", "series": "../there/new.csv"}, steps) for steps in (0, 20)),
        ],
    )
    def test_what_it_says_of_files_elsewhere_is_not_believed(
        self, tmp_path, capfd, monkeypatch, options, steps
    ):
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
        rewrite(here / "run.npz", {"options": options | {"steps": 30}})
        assert exit_code("run", "--resume", here / "run.npz") == 2
        require_refusal(capfd, *["lacks rows before"] * ("series" in options))
        assert {path: path.read_bytes() for path in there.iterdir()} == before
