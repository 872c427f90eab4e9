"""Arguments in Python: what is meant is accepted, anything else is one line with its name and value."""

import copy
import pickle

import numpy as np
import pytest
from command import exit_code, require_refusal
from same_bits import contents

from warpgrains import Batch, InputError, OutputError, Scene, Simulation, SimulationError, errors
from warpgrains.usd.recorder import recover

MATRIX = np.arange(400).reshape(20, 20)


@pytest.fixture(scope="module")
def simulation():
    simulation = Simulation("annulus", order="color")
    simulation.advance(150)
    return simulation


@pytest.fixture(scope="module")
def batch(simulation):
    batch = Batch([simulation.scene, simulation.scene.replace(drag=0.1)])
    batch.run(150)
    return batch


CALLS = {
    "scene None": (lambda s, b: Simulation(None), "scene is None: it must be a Scene, or the file or name"),
    "scene number": (lambda s, b: Simulation(3), "scene is 3"),
    "unknown scene": (lambda s, b: Simulation("anulus"), "did you mean 'annulus'"),
    "override": (
        lambda s, b: Simulation("annulus", drga=1.0),
        "unknown field of a scene 'drga': did you mean",
    ),
    "change": (lambda s, b: s.change(drga=1.0), "unknown field of a scene 'drga': did you mean 'drag'"),
    "scenes None": (lambda s, b: Batch(None), "scenes is None"),
    "scenes of None": (lambda s, b: Batch([s.scene, None]), r"scenes\[1\] is None"),
    "load None": (lambda s, b: Scene.load(None), "scene is None"),
    "overrides None": (lambda s, b: Scene.load("annulus", None), "overrides is None"),
    "overrides of numbers": (lambda s, b: Scene.load("annulus", [1]), r"overrides\[0\] is 1"),
    "overrides table": (
        lambda s, b: Scene.load("annulus", {"physics.drag": 1}),
        "overrides is {'physics.drag'",
    ),
    "advance None": (lambda s, b: s.advance(None), "steps is None: it must be a whole number"),
    "advance backwards": (lambda s, b: s.advance(-1), "steps is -1: it must be between 0 and"),
    "advance 1.5": (lambda s, b: s.advance(1.5), "steps is 1.5"),
    "advance text": (lambda s, b: s.advance("3"), "steps is '3'"),
    "advance progress": (lambda s, b: s.advance(1, 1), "on_progress is 1: it must be a function"),
    "run backwards": (lambda s, b: s.run(-1), "steps is -1"),
    "batch backwards": (lambda s, b: b.run(-1), "steps is -1"),
    "observer": (
        lambda s, b: s.run(1, observer=1),
        r"observer is 1: it must have every, observe\(\) and flush",
    ),
    "until": (lambda s, b: s.run(1, until=3), "until is 3: it must be 'rest', or a function"),
    "record": (lambda s, b: s.run(1, record=3), "record is 3: it must be the name of a file"),
    "record bytes": (lambda s, b: s.run(1, record=b"x.usdc"), "record is b'x.usdc'"),
    "checkpoint": (lambda s, b: s.run(1, checkpoint=3), "checkpoint is 3"),
    "save": (lambda s, b: s.save(None), "path is None"),
    "load": (lambda s, b: Simulation.load(3), "path is 3"),
    "recover": (lambda s, b: recover(None), "log is None"),
    "formats": (
        lambda s, b: s.run(1, record="x.obj"),
        r"output 'x.obj' must end in .usdc, .usda, .usdz, .mp4, .gif, .webp, .png, .pdf, .svg",
    ),
    "color": (lambda s, b: s.run(1, record="x.usdc", color_by="sped"), "did you mean 'speed'"),
    "color of a film": (lambda s, b: s.run(1, record="x.mp4", color_by="sped"), "did you mean 'speed'"),
    "color of a picture": (lambda s, b: s.plot(color_by="presure"), "did you mean 'pressure'"),
    "drawn as": (lambda s, b: s.run(1, record="x.usdc", draw_as="disc"), "did you mean 'discs'"),
    "scene k": (lambda s, b: b.state(2), "k is 2: it must be between 0 and 1"),
    "scene -1": (lambda s, b: b.position(-1), "k is -1"),
    "scene 1.0": (lambda s, b: b.velocity(1.0), "k is 1.0: it must be a whole number"),
    "restore scene k": (lambda s, b: b.restore(2, b.state(0)), "k is 2"),
    "drag": (lambda s, b: s.scene.replace(drag=MATRIX), r"drag is array\(.* \.\.\.: it must be a number"),
    "gravity": (lambda s, b: s.scene.replace(gravity=MATRIX), "gravity is array.*: it must be two numbers"),
    "name": (lambda s, b: s.scene.replace(name=MATRIX), "name is array.*: it must be a string"),
    "order": (lambda s, b: s.scene.replace(order=MATRIX), "unknown order array.* known: color, sequential"),
    "port": (lambda s, b: s.view(port=-1), "port is -1: it must be between 1 and 65535"),
    "steps": (lambda s, b: s.run(MATRIX), "steps is array.*: it must be a whole number"),
    "threads": (lambda s, b: Simulation("annulus", threads=MATRIX), "threads is array.*: it must be a whole"),
}


@pytest.mark.parametrize(("call", "complaint"), CALLS.values(), ids=CALLS.keys())
def test_is_refused_in_one_line(simulation, batch, tmp_path, monkeypatch, call, complaint):
    monkeypatch.chdir(tmp_path)
    before = simulation.state()
    with pytest.raises(InputError, match=complaint) as refusal:
        call(simulation, batch)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 400
    assert contents(simulation.state()) == contents(before)
    assert not list(tmp_path.iterdir())


def test_scenes_may_be_named(tmp_path):
    scene = Scene.load("annulus", "physics.drag=0.1")
    assert scene.drag == Scene.load("annulus", ["physics.drag=0.1"]).drag == 0.1
    path = tmp_path / "mine.toml"
    path.write_text(scene.text.replace("[physics]", "[physics]\ndrag = 0.1", 1).replace("drag = 0.5", ""))
    for given in (path, str(path)):
        assert Simulation(given).scene.drag == 0.1
        assert [one.drag for one in Batch(given).scenes] == [0.1]
    assert Simulation("annulus", drag=0.1).scene.drag == 0.1
    assert [one.name for one in Batch(scene).scenes] == ["annulus"]
    assert [one.drag for one in Batch([scene, "annulus"]).scenes] == [0.1, 0.5]


COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda one: pickle.loads(pickle.dumps(one)),
}


class TestCopies:
    @pytest.mark.parametrize("remake", COPIES.values(), ids=COPIES.keys())
    def test_of_a_simulation_share_nothing_and_go_on_with_the_same_bits(self, simulation, remake):
        simulation = remake(simulation)
        before, again = simulation.state(), remake(simulation)
        assert type(again) is Simulation
        assert again.scene.text == simulation.scene.text
        assert contents(again.state()) == contents(before)
        again.advance(50)
        assert contents(simulation.state()) == contents(before)
        simulation.advance(50)
        assert contents(again.state()) == contents(simulation.state())

    def test_of_a_simulation_have_taken_no_step(self, simulation):
        with pytest.raises(SimulationError, match="no step has been taken"):
            copy.copy(simulation).last_start()

    @pytest.mark.parametrize("remake", COPIES.values(), ids=COPIES.keys())
    def test_of_a_batch(self, batch, remake):
        batch = remake(batch)
        again = remake(batch)
        again.run(50)
        assert [batch.state(k).steps for k in range(2)] == [150, 150]
        assert [again.state(k).steps for k in range(2)] == [200, 200]
        assert [report.iterations for report in again.reports] != []
        batch.run(50)
        for k in range(2):
            assert contents(again.state(k)) == contents(batch.state(k))
        assert again.reports == batch.reports

    def test_of_a_batch_that_has_not_begun(self):
        again = copy.deepcopy(Batch("annulus"))
        assert again.state(0).steps == 0
        assert again.reports == [None]

    def test_keep_threads_and_a_class_of_the_users(self):
        class Mine(Simulation):
            pass

        again = copy.copy(Mine("annulus", threads=2))
        assert type(again) is Mine
        assert again._threads_wanted == 2


def test_temporary_copies_cannot_be_written_to(simulation, batch):
    simulation.step()
    start = simulation.last_start()
    arrays = (simulation.position, simulation.velocity, start.position, start.velocity)
    for array in (*arrays, batch.position(0), batch.velocity(1), Batch("annulus").position(0)):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_states_of_a_batch_are_copies(simulation):
    """Neither what is restored nor what is returned is the batch's own memory."""
    batch, state = Batch(simulation.scene), simulation.state()
    batch.restore(0, state)
    expected = state.position.copy()
    state.position[0] = 0.0
    batch.state(0).position[1] = 0.0
    assert np.array_equal(batch.position(0), expected)


def test_errors_are_exported():
    assert OutputError is errors.OutputError


class TestNames:
    @pytest.mark.parametrize("log", [".", "..", "/", "", "run.usdc", ".frames", "\udcff.usdc.frames"])
    def test_logs_to_recover(self, log, capfd):
        assert exit_code("recover", log) == 2
        require_refusal(capfd, "is not the log of a recording, such as run.usdc.frames")

    @pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usdz"])
    def test_recordings_that_usd_cannot_name(self, tmp_path, monkeypatch, suffix, capfd):
        monkeypatch.chdir(tmp_path)
        assert exit_code("run", "annulus", "--steps", 2, "-o", f"\udcff{suffix}") == 2
        require_refusal(capfd, f"output '\\udcff{suffix}' is not UTF-8")
        assert not list(tmp_path.iterdir())

    @pytest.mark.parametrize("name", ["\udcff.mp4", "\udcff.png", "a:b.mp4", "-x.gif", "%d.webp"])
    def test_films_and_pictures_of_any_name(self, tmp_path, name):
        assert exit_code("run", "annulus", "--steps", 2, "-o", tmp_path / name) == 0
        assert [path.name for path in tmp_path.iterdir()] == [name]


class TestOverflow:
    def test_domain_whose_squares_are_not_finite(self):
        for size, radius in ((1e156, 1e150), (1e-165, 1e-167)):
            with pytest.raises(
                InputError, match=r"radius_out is 1e.* m: it must be between 1e-140 and 1e.150 m"
            ):
                Scene(position=[[0.2 * size, 0.0]], radius=radius, mass=1.0, radius_out=size)

    @pytest.mark.parametrize("layout", ["random", "grid"])
    def test_domain_of_a_file(self, tmp_path, layout):
        """It is refused before grains are placed in it."""
        path = tmp_path / "large.toml"
        grains = f'layout = "{layout}"\ncount = 5\nradius = 1e154\nmass = 1.0'
        path.write_text(f"[domain]\nradius_out = 1e156\n[grains]\n{grains}\n")
        with pytest.raises(InputError, match=r"radius_out is 1e\+156 m: it must be between"):
            Scene.load(path)

    @pytest.mark.parametrize("size", [1e-140, 1e150])
    def test_largest_and_smallest_domain(self, size):
        scene = Scene(
            position=[[0.2 * size, 0.0], [0.0, 0.3 * size]],
            radius=0.1 * size,
            mass=1.0,
            radius_out=size,
            gravity=(0.0, -size),
            tolerance=1e-6 * size,
        )
        summary = Simulation(scene).run(duration=3.0)
        assert summary.unconverged == 0
        assert summary.overlap < 1e-4 * size

    @pytest.mark.parametrize("speed", [1e200, 1e300])
    def test_velocity_whose_square_is_not_finite(self, speed):
        velocity = [[0.0, 0.0], [speed, 0.0]]
        scene = Scene(
            position=[[0.5, 0.0], [0.0, 0.5]], velocity=velocity, radius=0.1, mass=1.0, radius_out=1.0
        )
        path = f"{0.01 * speed:.3g}".replace("+", r"\+")
        reason = rf"grain 1 reached .*: in a step of 0.01 s it would move by {path} m, out of the domain"
        with pytest.raises(SimulationError, match=reason):
            Simulation(scene).step()
