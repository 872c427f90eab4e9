"""Pictures of recordings: radii, walls, colors and force chains, held against the state pixel by pixel."""

import numpy as np
import pytest
from command import exit_code
from matplotlib.image import imread
from recordings import RADIUS, bands_of, make_contacts, make_frames, make_scene, moment, record, recorder_of
from walls_seen import View

from warpgrains import InputError
from warpgrains.analysis.plots import measure, plot
from warpgrains.drawing.chains import CHAIN_COLOR
from warpgrains.usd.recording import Recording, painter_of

WHITE = np.ones(3)
WALL = np.full(3, 0.35)
CHAIN = np.array(CHAIN_COLOR)


class Picture:
    def __init__(self, path):
        self.pixels = imread(path)[:, :, :3]
        self._view = View(self.pixels)
        self.scale = self._view.scale

    def at(self, place):
        return self._view.at(self.pixels, np.array([place]))[0]

    def shows(self, color, place):
        return bool(np.abs(self.at(place) - color).max() < 0.02)


@pytest.fixture
def frames():
    """Five grains that touch nothing, in three frames."""
    angle = np.linspace(0.0, 6.0, 5)[:, np.newaxis] + np.arange(3)[:, np.newaxis, np.newaxis]
    position = 1.2 * np.concatenate([np.cos(angle), np.sin(angle)], axis=2)
    return np.stack([position, make_frames(3)[:, 1]], axis=1)


@pytest.fixture
def recording(tmp_path, frames):
    return record(tmp_path / "run.usdc", frames)


def draw(recording, frame, **options):
    path = recording.with_suffix(".png")
    plot(recording, path, [frame], **{"curves": False} | options)
    return Picture(path)


AROUND = np.stack([np.cos(np.arange(16) * np.pi / 8), np.sin(np.arange(16) * np.pi / 8)], axis=1)


class TestFrame:
    @pytest.mark.parametrize("options", [{"color_by": "palette"}, {"draw_as": "discs"}])
    def test_grains_have_their_places_radii_and_colors(self, tmp_path, frames, options):
        recording = record(tmp_path / "run.usdc", frames, **options)
        for number, (position, _) in enumerate(frames):
            picture = draw(recording, number)
            source = Recording(recording)
            colors = painter_of(source).color(source.frame(number, contacts=False))
            for place, radius, color in zip(position, RADIUS, colors, strict=True):
                edge = 2.0 / picture.scale  # half an outline, and a pixel that is partly covered
                for direction in AROUND:
                    assert picture.shows(color, place + (radius - edge) * direction)
                    assert picture.shows(WHITE, place + (radius + edge) * direction)

    @pytest.mark.parametrize("radius_in", [0.0, 0.5])
    def test_walls_stand_where_the_scene_says(self, tmp_path, frames, radius_in):
        picture = draw(record(tmp_path / "run.usdc", frames, make_scene(radius_in=radius_in)), 0)
        edge = 2.0 / picture.scale  # half an outline, and a pixel that is partly covered
        for direction in AROUND:
            for wall, inside in ((2.0, -1.0), (0.5, 1.0)):
                is_there = wall > 1.0 or radius_in > 0.0
                assert picture.shows(WALL, (wall - inside * edge) * direction) == is_there
                assert picture.shows(WHITE, (wall + inside * edge) * direction)
            assert picture.shows(WHITE, 0.3 * direction)

    def test_force_chains(self, tmp_path, frames):
        scene = make_scene(gravity=(0.0, -1.0))
        recording = record(tmp_path / "run.usdc", frames, scene, forces=True)
        without = record(tmp_path / "without.usdc", frames, scene)
        for number, (position, _) in enumerate(frames):
            with_chains, plain = draw(recording, number), draw(without, number)
            for i, j in [*make_contacts(number)["pair"].tolist(), (2, 3)]:
                middle = (position[i] + position[j]) / 2.0
                assert with_chains.shows(CHAIN, middle) == ((i, j) != (2, 3))
                assert not plain.shows(CHAIN, middle)

    def test_force_chains_are_as_wide_as_in_the_file(self, tmp_path, frames):
        recording = record(tmp_path / "run.usdc", frames, make_scene(gravity=(0.0, -1.0)), forces=True)
        picture = draw(recording, 1)
        for (start, end), width in zip(*bands_of(recording, 1), strict=True):
            along = (end - start) / np.linalg.norm(end - start)
            across = np.array([-along[1], along[0]])
            places = (start + end) / 2.0 + np.linspace(-0.1, 0.1, 4001)[:, np.newaxis] * across
            shown = np.mean([picture.shows(CHAIN, place) for place in places]) * 0.2
            assert shown == pytest.approx(width, abs=2.5 / picture.scale)


class TestStrip:
    @pytest.mark.parametrize(
        ("count", "frames", "expected"),
        [
            (41, None, [0, 10, 20, 30, 40]),
            (1, None, [0]),
            (3, [-1, 0, 1, -3, 2, 2, 0], [2, 0, 1, 0, 2, 2, 0]),
        ],
    )
    def test_frames(self, tmp_path, count, frames, expected):
        recording = record(tmp_path / "run.usdc", make_frames(count))
        assert plot(recording, tmp_path / "run.png", frames) == expected

    @pytest.mark.parametrize(
        ("numbers", "message"),
        [
            ([], "frames is empty: name one frame or more"),
            ([1.5], r"frame is 1\.5: it must be a whole number"),
            (["1"], "frame is '1': it must be a whole number"),
        ],
    )
    def test_frames_that_are_no_numbers(self, recording, tmp_path, numbers, message):
        with pytest.raises(InputError, match=message):
            plot(recording, tmp_path / "run.png", numbers)


class TestCurves:
    def test_energy_height_and_contacts(self, tmp_path, frames):
        """Of grains of several masses that rotate, with gravity aslant."""
        mass = np.array([1.0, 0.2, 3.0, 0.5, 2.0])
        scene = make_scene(mass=mass, gravity=(3.0, -4.0), friction=0.5)
        spin, path = np.arange(5.0) - 9.0, tmp_path / "run.usdc"
        with recorder_of(path, scene, forces=True) as recorder:
            for seed, frame in enumerate(frames):
                recorder.record(moment(*frame, scene, **make_contacts(seed), spin=spin, angle=spin))
        source = Recording(path)
        energy, height, contacts = measure(source).values()
        position, velocity = frames[:, 0], frames[:, 1]
        energies = 0.5 * mass * (velocity**2).sum(axis=2) + 0.25 * mass * (RADIUS * spin) ** 2
        # recorded as float32, each with a relative error of 6e-8
        assert energy == pytest.approx(energies.sum(axis=1) / mass.sum(), rel=1e-6)
        assert height == pytest.approx((position @ [-0.6, 0.8]).mean(axis=1), rel=1e-6)
        assert contacts.tolist() == [5, 5, 5]
        assert [source.times.time(k) for k in range(len(source))] == pytest.approx([0.0, 0.02, 0.04])

    def test_contacts_only_where_forces_were_recorded(self, recording):
        assert len(measure(Recording(recording))) == 2

    def test_are_drawn_below_the_frames(self, recording):
        picture = recording.with_suffix(".svg")
        for curves in (True, False):
            plot(recording, picture, curves=curves)
            for title in ("kinetic energy per mass [J/kg]", "mean height [m]"):
                assert (title in picture.read_text()) == curves


class TestCommand:
    def test_draws_beside_the_recording(self, recording, capsys):
        assert exit_code("plot", recording, "--frames", "0,-1") == 0
        assert capsys.readouterr().out == f"{recording.with_suffix('.png')}: frames 0, 2\n"
        assert recording.with_suffix(".png").exists()

    def test_options(self, recording, tmp_path, capsys):
        options = ["-o", tmp_path / "a.svg", "--frames", 1, "--no-curves"]
        assert exit_code("plot", recording, *options) == 0
        assert capsys.readouterr().out == f"{tmp_path / 'a.svg'}: frame 1\n"
        assert "mean height" not in (tmp_path / "a.svg").read_text()
