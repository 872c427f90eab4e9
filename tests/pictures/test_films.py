"""Films and stills of runs and recordings, held against the state pixel by pixel."""

import signal
import subprocess
import sys
from contextlib import nullcontext
from functools import partial

import imageio_ffmpeg
import numpy as np
import pytest
from command import exit_code
from matplotlib.collections import PolyCollection
from matplotlib.image import imread
from matplotlib.patches import Rectangle
from moments import far_away
from PIL import Image, ImageSequence
from pxr import Usd
from recordings import make_scene, moment, record
from walled_scenes import boxed
from walls_seen import View

from warpgrains import InputError, Scene, Segment, Simulation
from warpgrains.analysis.plots import plot
from warpgrains.analysis.snapshot import snapshot
from warpgrains.drawing.chains import CHAIN_COLOR
from warpgrains.drawing.colorings import speed_scale
from warpgrains.drawing.colors import GrainColors, is_dark, mark_color
from warpgrains.drawing.frames import FrameTimes
from warpgrains.drawing.kinds import color_of
from warpgrains.drawing.looks import Look
from warpgrains.drawing.painter import Painter
from warpgrains.pictures.film import Film, FilmWriter, draw_film, encoding_of_frames
from warpgrains.pictures.still import FrameArtists, Picture
from warpgrains.scene.toml import toml_value
from warpgrains.simulation.options import RunOptions
from warpgrains.usd.recording import Recording, painter_of

STRIDE = 4
LOSS = 0.15  # of a color, by 8 bits of YUV at half resolution, 256 colors, or 80 % of quality


@pytest.fixture(scope="module")
def states():
    """Where the grains of the annulus are, and how fast, every fourth step; all of them move."""
    simulation = Simulation(Scene.load("annulus"))
    taken = [(simulation.position, simulation.velocity)]
    for _ in range(10):
        simulation.advance(STRIDE)
        taken.append((simulation.position, simulation.velocity))
    return taken


def film_frames(path):
    """Return the frames of a film, shape (f, height, width, 3), and how many it shows a second."""
    if "%" in path.name:
        pictures = sorted(path.parent.glob(f"*{path.suffix}"))
        assert [one.name for one in pictures] == [path.name % k for k in range(len(pictures))]
        return np.array([imread(one)[:, :, :3] for one in pictures]), 25.0
    if path.suffix in (".mp4", ".mov"):
        reader = imageio_ffmpeg.read_frames(str(path))
        meta = next(reader)
        shape = (meta["size"][1], meta["size"][0], 3)
        return np.array([np.frombuffer(one, np.uint8).reshape(shape) for one in reader]) / 255.0, meta["fps"]
    frames, milliseconds = [], 0.0
    with Image.open(path) as film:
        for frame in ImageSequence.Iterator(film):
            frames.append(np.array(frame.convert("RGB")) / 255.0)
            milliseconds += frame.info["duration"]
    return np.array(frames), 1000.0 * len(frames) / milliseconds


def picture_of(path):
    """Return the pixels of a still, or of the last frame of a film, shape (height, width, 3)."""
    return imread(path)[:, :, :3] if path.suffix == ".png" else film_frames(path)[0][-1]


@pytest.mark.parametrize("kind", ["shear", "walls"])
def test_a_picture_of_a_periodic_box_is_the_same_on_both_sides(kind):
    """Wherever its grains and walls have gone: columns at its sides differ by up to four rows."""
    simulation = Simulation(boxed(kind, 100))
    simulation.run(duration=0.2)
    pictures = []
    for shown in (snapshot(simulation), far_away(snapshot(simulation))):
        figure = Picture(Painter(shown.scene, Look(color_by="speed")), shown).figure
        figure.canvas.draw()
        pictures.append(np.asarray(figure.canvas.buffer_rgba())[..., :3] / 255.0)
    assert np.array_equal(*pictures)
    window = figure.axes[0].get_window_extent()
    left, right = (np.ceil(window.x0).astype(int) + 1, np.floor(window.x1).astype(int) - 2)
    top = pictures[0].shape[0] - int(window.y1)
    rows = slice(top + 20, top + int(window.height) - 20)
    first, last, middle = (pictures[0][rows, column] for column in (left, right, (left + right) // 2))
    shares = []
    for other in (last, middle):
        moved = [np.abs(first - np.roll(other, row, axis=0)).max(axis=1) for row in range(-4, 5)]
        shares.append((np.min(moved, axis=0) > 0.2).mean())
    assert shares[0] < 0.15 < 0.3 < shares[1]


@pytest.mark.parametrize(
    ("recorded", "drawn"),
    [
        ("run.mp4", None),
        ("run.mov", None),
        ("run.webp", None),
        ("%02d.PNG", None),
        ("run.usdc", "run.gif"),
        ("run.usdc", "run.mov"),
        ("run.usdc", "run_%04d.png"),
    ],
)
def test_frames_show_the_states(tmp_path, states, capsys, recorded, drawn):
    """Of a run, and of its recording."""
    path, scene = tmp_path / recorded, Scene.load("annulus")
    if drawn is None and "%" not in recorded:
        path.write_bytes(b"earlier")
    summary = Simulation(scene).run(steps=STRIDE * (len(states) - 1), record=path, fps=25, color_by="speed")
    assert summary.output == str(path)
    if drawn:
        recording, path = path, tmp_path / drawn
        assert exit_code("plot", recording, "-o", path) == 0
        assert capsys.readouterr().out == f"{path}: {len(states)} frames\n"
        recording.unlink()
    frames, rate = film_frames(path)
    assert len(list(tmp_path.iterdir())) == (len(states) if "%" in path.name else 1)
    assert (len(frames), rate) == (len(states), pytest.approx(25.0))
    view, colors = View(frames[0], 0.08), GrainColors(scene, "speed")
    for pixels, (position, velocity) in zip(frames, states, strict=True):
        assert np.allclose(view.at(pixels, position), colors.of(moment(position, velocity)), atol=LOSS)
        assert np.allclose(view.at(pixels, -position), 1.0, atol=0.05)


def test_numbered_pictures_replace_no_others(tmp_path, states):
    """Because those of an earlier, longer film would remain; and an interrupted film leaves none or all."""
    path, scene = tmp_path / "a_%02d.png", Scene.load("annulus")
    recording = record(tmp_path / "run.usdc", states[:3], scene)
    (tmp_path / "a_b7.png").touch()
    for number in (11, 5):  # the first is named
        earlier = tmp_path / f"a_{number}.png"
        earlier.touch()
        for draw in (partial(draw_film, recording), lambda path: Simulation(scene).run(2, record=path)):
            with pytest.raises(InputError, match=rf"refusing to overwrite '{earlier}': remove"):
                draw(path)
        earlier.unlink()
    with (
        pytest.raises(KeyboardInterrupt),
        Film(scene, RunOptions(steps=1, record=path), FrameTimes(0.01, 50)),
    ):
        raise KeyboardInterrupt
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a_b7.png", "run.usdc"]


@pytest.mark.parametrize(("suffix", "options"), [(".mp4", {"fps": 25}), (".png", {})])
def test_marks_show_how_far_grains_have_turned(tmp_path, suffix, options):
    path = tmp_path / f"run{suffix}"
    simulation = Simulation(make_scene(np.full(5, 0.25), friction=0.3, spin=[-6.0, -1.0, 0.0, 2.0, 7.0]))
    path.write_bytes(b"earlier")
    simulation.run(steps=40, record=path, **options)
    assert list(tmp_path.iterdir()) == [path]
    pixels, now = picture_of(path), snapshot(simulation)
    view, colors = View(pixels, 0.08), Painter(simulation.scene, Look()).color(now)
    turned = np.stack([np.cos(now.angle), np.sin(now.angle)], axis=1)
    ahead = 0.6 * now.scene.radius[:, np.newaxis] * turned
    for shift, expected in ((-ahead, colors), (ahead, mark_color(colors))):
        assert np.allclose(view.at(pixels, simulation.position + shift), expected, atol=LOSS)


def test_browsers_play_gifs_of_fifty_frames_a_second_at_most(tmp_path):
    scene = Scene.load("annulus").replace(dt=0.001)
    assert Simulation(scene).run(steps=40, record=tmp_path / "run.gif", fps=200).steps == 40
    frames, rate = film_frames(tmp_path / "run.gif")
    assert (len(frames), rate) == (3, pytest.approx(50.0))


WITHIN_STEPS = ["t = 0.50 s", "t = 0.53 s", "t = 0.55 s", "t = 0.57 s"]  # every 0.025 s


@pytest.mark.parametrize(
    ("suffix", "expected"), [(".gif", WITHIN_STEPS), (".usdc", 2 * WITHIN_STEPS), (".png", ["t = 0.58 s"])]
)
def test_a_second_run_shows_the_simulated_time(tmp_path, monkeypatch, suffix, expected):
    drawn, show = [], FrameArtists.show

    def noted(artists, now):
        show(artists, now)
        drawn.append(artists.changing[-1].get_text())

    monkeypatch.setattr(FrameArtists, "show", noted)
    simulation, path = Simulation(Scene.load("annulus")), tmp_path / f"run{suffix}"
    simulation.run(steps=50)
    summary = simulation.run(steps=8, record=path, **({} if suffix == ".png" else {"fps": 40}))
    if suffix == ".usdc":
        plot(path, tmp_path / "frames.pdf", frames=range(4))
        draw_film(path, tmp_path / "run.mp4", size="320x240")
    assert summary.steps == 8
    assert drawn == expected


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_film_that_is_not_finished_leaves_what_was_there(tmp_path, suffix):
    path, scene = tmp_path / f"run{suffix}", make_scene()
    path.write_bytes(b"earlier")
    run = scene, RunOptions(steps=1, record=path), FrameTimes(scene.dt, 50)

    def interrupted():
        with Film(*run) as film:
            film.record(moment(scene.position, scene.velocity))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with pytest.raises(ValueError, match="no frame was drawn"), Film(*run):
        pass
    assert path.read_bytes() == b"earlier"
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_killed_film_left_is_removed(tmp_path):
    """SIGKILL, while its frames are encoded; the next film of the name removes it."""
    script = (
        "import os, signal, sys\nfrom warpgrains import Simulation\n"
        "from warpgrains.pictures.film import FilmWriter\n"
        "FilmWriter._finish = lambda self: os.kill(os.getpid(), signal.SIGKILL)\n"
        "Simulation('annulus').run(steps=2, record=sys.argv[1])"
    )
    path = tmp_path / "run.gif"
    killed = subprocess.run([sys.executable, "-c", script, path], timeout=200)
    assert killed.returncode == -signal.SIGKILL
    assert list(tmp_path.glob(".*/film.mkv"))
    Simulation(Scene.load("annulus")).run(steps=2, record=path)
    assert list(tmp_path.iterdir()) == [path]


def test_ffmpeg_ends_with_a_run_that_is_interrupted_at_the_end(tmp_path, monkeypatch):
    """It is in a process group of its own, which Ctrl-C does not reach."""
    encoding = encoding_of_frames(tmp_path / "film.mkv", (2, 2, 3), 24.0)
    wait = encoding._wait

    def interrupt_once():
        monkeypatch.setattr(encoding, "_wait", wait)
        raise KeyboardInterrupt

    monkeypatch.setattr(encoding, "_wait", interrupt_once)
    with pytest.raises(KeyboardInterrupt):
        encoding.finish()
    assert encoding._process.poll() is not None


FRAME = "-0.5,-0.25,1.5,0.75"  # begins with a minus


@pytest.mark.parametrize(("suffix", "draw"), [(".webp", draw_film), (".png", plot)])
def test_size_and_frame_of_a_run_and_of_its_recording(tmp_path, states, capfd, suffix, draw):
    run, again = tmp_path / f"run{suffix}", tmp_path / f"again{suffix}"
    looks = ("--color-by", "radius", "--frame", FRAME, "--size", "900x400")
    assert exit_code("run", "annulus", "--steps", 10, "-o", run, *looks) == 0
    assert f"\noutput            {run}" in capfd.readouterr().out
    recording = record(tmp_path / "run.usdc", states[:2], Scene.load("annulus"))
    draw(recording, again, size="900x400", frame=FRAME)
    for path in (run, again):
        assert picture_of(path).shape == (400, 900, 3)
    with pytest.raises(InputError, match="size is '900'"):
        draw(recording, again, size="900")


def test_a_still_contains_all_grains_unless_it_has_a_frame():
    cup = [((-0.3, -0.4), (0.3, -0.4)), ((-0.3, -0.4), (-0.3, 0.6)), ((0.3, -0.4), (0.3, 0.6))]
    walls = [Segment(*ends) for ends in cup]
    scene = Scene(position=[(0.0, 0.1)], radius=0.05, mass=0.1, radius_out=2.0, walls=walls)
    for y, top in ((0.1, 0.62), (1.0, 1.05)):
        now = moment(np.array([(0.0, y)]), np.zeros((1, 2)), scene)
        for frame, limits in ((None, [-0.32, 0.32, -0.42, top]), (FRAME, [-0.5, 1.5, -0.25, 0.75])):
            (axes,) = Picture(Painter(scene, Look(frame=frame)), now).figure.axes
            assert [*axes.get_xlim(), *axes.get_ylim()] == pytest.approx(limits)


def test_a_still_shows_the_state(tmp_path):
    simulation = Simulation(Scene.load("annulus"))
    simulation.run(steps=600, record=tmp_path / "run.png", forces=True)
    simulation.plot(forces=True).save(tmp_path / "now.png")
    assert (tmp_path / "run.png").read_bytes() == (tmp_path / "now.png").read_bytes()
    assert simulation.plot()._repr_png_().startswith(b"\x89PNG")  # in notebooks
    pixels, contacts = picture_of(tmp_path / "now.png"), simulation.contacts()
    widest = contacts.pair[np.argmax(contacts.force)]
    middle = simulation.position[widest].mean(axis=0, keepdims=True)
    assert np.allclose(View(pixels).at(pixels, middle), CHAIN_COLOR, atol=0.02)


LOOKS = [
    {"color_by": "bands"},
    {"color_by": "height", "colors": "#f4e9cd,#31572c"},
    {"color_by": "speed", "colors": "viridis_r", "range": "0,0.5"},
    {"color_by": "force", "forces": True, "clean": True},
    {"color_by": "id", "background": "#202428", "frame": FRAME, "size": "640x400"},
    {"color_by": "palette", "background": "black", "colors": "tan,#ffffff", "forces": True},
]


class TestLooks:
    """They may be chosen when one runs a scene, and when one looks at its recording."""

    @pytest.fixture(scope="class")
    def recorded(self, tmp_path_factory):
        """Return the path of a recording of the annulus with its forces, and the simulation at its end."""
        path, simulation = tmp_path_factory.mktemp("looks") / "run.usdc", Simulation(Scene.load("annulus"))
        simulation.run(steps=100, record=path, fps=50, forces=True, color_by="radius")
        return path, simulation

    @pytest.mark.parametrize("looks", LOOKS)
    def test_of_a_recording_are_those_of_the_run(self, recorded, tmp_path, looks):
        """And in Python, on the command line and in a style alike."""
        path, simulation = recorded
        colors = painter_of(Recording(path), **looks).color(Recording(path).frame(-1))
        assert (
            np.abs(colors - Painter(simulation.scene, Look(**looks)).color(snapshot(simulation))).max() < 0.02
        )
        flags = [
            f"--{name.replace('_', '-')}" + ("" if one is True else f"={one}") for name, one in looks.items()
        ]
        style = tmp_path / "style.toml"
        style.write_text("\n".join(f"{name} = {toml_value(one)}" for name, one in looks.items()))
        chosen = {"a": flags, "b": ["--style", style], "c": ["--style", style, "--no-clean"]}
        for name, words in chosen.items():
            words = [*words, "--no-curves", "--frames=-1"]
            assert exit_code("plot", path, "-o", tmp_path / f"{name}.png", *words) == 0
        plot(path, tmp_path / "d.png", [-1], False, **looks)
        one, same, bare, again = ((tmp_path / f"{name}.png").read_bytes() for name in "abcd")
        assert one == same == again
        assert (one == bare) == ("clean" not in looks)
        assert picture_of(tmp_path / "a.png")[0, 0] == pytest.approx(
            color_of("", looks.get("background", "white"))
        )

    def test_of_a_run_have_a_style_too(self, tmp_path):
        style = tmp_path / "style.toml"
        style.write_text("color_by = 'height'\nclean = true\nsize = '200x200'\n")
        assert exit_code("run", "annulus", "--steps", 3, "-o", tmp_path / "a.png", "--style", style) == 0
        looks = {"color_by": "height", "clean": True, "size": "200x200"}
        Simulation("annulus").run(steps=3, record=tmp_path / "b.png", **looks)
        simulation = Simulation("annulus")
        simulation.run(steps=3)
        simulation.plot(style=style).save(tmp_path / "c.png")
        one, *others = ((tmp_path / f"{name}.png").read_bytes() for name in "abc")
        assert others == [one, one]

    def test_that_a_recording_cannot_have_are_refused(self, tmp_path, states):
        path = record(tmp_path / "run.usdc", states[:2], Scene.load("annulus"))
        style = tmp_path / "style.toml"
        style.write_text("colour = 'red'")
        for looks, complaint in (
            ({"color_by": "force"}, "color_by 'force' needs contacts: record them with --forces"),
            ({"forces": True}, "holds no contacts"),
            ({"color_by": "spin"}, "needs a scene with friction"),
            ({"range": "1,1"}, "LOW must be less than HIGH"),
            ({"color_by": "bands", "range": "0,1"}, "range has no effect on color_by 'bands'"),
            ({"colors": "virdis"}, "a colormap of Matplotlib, such as viridis"),
            ({"colors": "#fff,red"}, None),
            ({"colors": "#ff,red"}, "colors is '#ff': it must be a color"),
        ):
            with pytest.raises(InputError, match=complaint) if complaint else nullcontext():
                plot(path, tmp_path / "run.png", **looks)
        with pytest.raises(InputError, match=r"key of style .*'colour': did you mean"):
            Simulation("annulus").plot(style=style)

    def test_have_more_than_a_few_light_colors(self):
        """The colors of most frames are light: those of grains at rest, and the palette."""
        scene = Scene.load("rotating_drum")
        slow = moment(scene.position, np.full((scene.n, 2), 0.02), scene)
        for color_by in ("palette", "speed", "spin"):
            assert not is_dark(GrainColors(scene, color_by).of(slow)).any()

    def test_slow_grains_use_the_scale_too(self):
        """A hundredth of the largest speed has a tenth of the colors."""
        scene = Scene.load("annulus")
        velocity = np.outer(np.geomspace(0.01, 1.0, 3), (speed_scale(scene), 0.0)).repeat(5, axis=0)
        levels = GrainColors(scene, "speed").levels(moment(scene.position, velocity, scene))
        assert levels[::5].tolist() == [round(0.1 * 63), round(0.1**0.5 * 63), 63]

    def test_turn_orange_with_speed(self):
        """Grains of the palette: at rest they have its colors, and the fastest one is far from sand."""
        scene = Scene.load("annulus")
        velocity = np.outer(np.linspace(0.0, 1.0, 15), (speed_scale(scene), 0.0))
        now, rest = moment(scene.position, velocity, scene), GrainColors(scene, "palette").of
        color = Painter(scene, Look()).color(now)
        assert np.array_equal(color[0], rest(now)[0])
        assert np.abs(color[-1] - rest(now)[-1]).max() > 0.3
        for look in (Look(color_by="bands"), Look(colors="tan,#ffffff")):
            painter = Painter(scene, look)
            assert np.array_equal(painter.color(now), painter.colors.of(now))

    @pytest.mark.parametrize("look", [Look(), Look(forces=True), Look(color_by="radius"), Look(clean=True)])
    def test_legends(self, look):
        """A length is as long as its text says, and nothing is written in a clean picture."""
        scene = Scene.load("annulus")
        axes = Picture(Painter(scene, look), snapshot(Simulation(scene))).figure.axes[0]
        texts = {text.get_text() for text in axes.texts if text.get_visible()}
        speed, force = (
            {"speed 0 to 2 m/s"} if look.color_by == "palette" else set(),
            {"2.9 N"} if look.forces else set(),
        )
        assert texts == (set() if look.clean else {"t = 0.00 s", "0.5 m"} | speed | force)
        lengths = [own.get_width() for own in axes.patches if isinstance(own, Rectangle)]
        assert (0.5 in lengths) == (not look.clean)

    @pytest.mark.parametrize(("pixels", "is_marked"), [(64, False), (800, True)])
    def test_marks_are_off_where_grains_are_small(self, pixels, is_marked):
        scene = make_scene(np.full(5, 0.1), friction=0.3)
        look = Look(size=f"{pixels}x{pixels}", clean=True)
        artists = Picture(Painter(scene, look), moment(scene.position, scene.velocity, scene)).figure.axes[0]
        marks = [own for own in artists.collections if isinstance(own, PolyCollection) and own.get_paths()]
        assert len(marks) == is_marked


class TestSlowMotion:
    def test_a_film_of_a_bullet_shows_it(self, tmp_path, capfd):
        """Of 0.13 s, without an option."""
        path = tmp_path / "bullet.mp4"
        assert exit_code("run", "bullet", "-o", path) == 0
        assert "frames, 24 a second, 20 times slower" in capfd.readouterr().out
        frames, rate = film_frames(path)
        assert (len(frames) > 40, rate) == (True, 24.0)

    def test_films_of_runs_and_recordings_play_it(self, tmp_path):
        scene = Scene.load("bullet")
        for suffix in (".webp", ".usdc"):
            Simulation(scene).run(steps=40, record=tmp_path / f"run{suffix}", fps=25, slow=10.0)
        draw_film(tmp_path / "run.usdc", tmp_path / "again.webp")
        draw_film(tmp_path / "run.usdc", tmp_path / "fast.webp", slow=5.0, fps=25)
        draw_film(tmp_path / "run.usdc", tmp_path / "real.webp", slow=1.0, fps=50)
        for name, count, rate in (
            ("run", 11, 25.0),
            ("again", 11, 25.0),
            ("fast", 6, 25.0),
            ("real", 3, 50.0),
        ):
            frames, shown = film_frames(tmp_path / f"{name}.webp")
            assert (len(frames), shown) == (count, pytest.approx(rate))
        with pytest.raises(InputError, match="fps 20 cannot be met"):
            draw_film(tmp_path / "run.usdc", tmp_path / "odd.webp", fps=20)

    def test_velocities_of_a_recording_are_those_that_it_shows(self, tmp_path):
        """A grain that flies freely moves by its velocity over the time codes a second, for motion blur."""
        flight = {"velocity": [(3.0, -2.0)], "gravity": (0.0, 0.0), "dt": 1e-3}
        scene = Scene(position=[(0.0, 0.3)], radius=0.1, mass=1.0, radius_out=2.0, **flight)
        Simulation(scene).run(steps=100, record=tmp_path / "run.usdc", slow=20.0)
        stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
        assert stage.GetTimeCodesPerSecond() == 24.0
        points, velocities = (
            [np.array(stage.GetAttributeAtPath(f"/World/Grains.{name}").Get(k))[0] for k in range(48)]
            for name in ("points", "velocities")
        )
        assert np.diff(points, axis=0) == pytest.approx(np.array(velocities[1:]) / 24.0, abs=1e-6)
        recording = Recording(tmp_path / "run.usdc")
        assert recording.times.rate == 480.0
        assert recording.time[-1] == pytest.approx(48 / 480.0, abs=1 / 480.0)
        assert recording.velocity[0] == pytest.approx(np.array([[3.0, -2.0]]))


def test_ctrl_c_leaves_the_film_so_far(tmp_path, monkeypatch, capfd):
    """And the line says how a run is continued."""
    path, add = tmp_path / "run.mp4", FilmWriter.add

    def interrupted(writer, now):
        if writer.frames == 5:
            raise KeyboardInterrupt
        add(writer, now)

    monkeypatch.setattr(FilmWriter, "add", interrupted)
    assert exit_code("run", "annulus", "--duration", 2, "-o", path) == 130
    assert "interrupted; '" in (said := capfd.readouterr().err)
    assert f"'{path}' shows the 5 frames so far; a run with -o FILE.usdc --checkpoint" in said
    assert len(film_frames(path)[0]) == 5
    assert list(tmp_path.iterdir()) == [path]
