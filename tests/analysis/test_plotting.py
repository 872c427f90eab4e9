"""Pictures of recordings: radii, walls, colors and force chains, held against the state pixel by pixel."""

import numpy as np
import pytest
from command import exit_code
from matplotlib.image import imread
from recordings import RADIUS, bands_of, make_contacts, make_frames, make_scene, moment, record, recorder_of
from walled_scenes import on_circle
from walls_seen import View

from warpgrains import InputError
from warpgrains.analysis.plots import measure, plot
from warpgrains.drawing.chains import CHAIN_COLOR
from warpgrains.usd.recording import Recording, painter_of

WHITE = np.ones(3)
WALL = np.full(3, 0.35)
AROUND = on_circle(np.arange(16) * np.pi / 8)


@pytest.fixture(scope="module")
def frames():
    """Five grains that touch nothing, in three frames."""
    position = 1.2 * on_circle(np.linspace(0.0, 6.0, 5) + np.arange(3)[:, np.newaxis])
    return np.stack([position, make_frames(3)[:, 1]], axis=1)


@pytest.fixture(scope="module")
def recording(tmp_path_factory, frames):
    return record(tmp_path_factory.mktemp("recorded") / "run.usdc", frames)


class Picture:
    """A frame of a recording."""

    def __init__(self, recording, frame):
        path = recording.with_suffix(".png")
        plot(recording, path, [frame], curves=False)
        self.pixels = imread(path)[:, :, :3]
        self.view = View(self.pixels)
        self.edge = 2.0 / self.view.scale
        """Half an outline, and a pixel that is partly covered [m]."""

    def shows(self, color, places):
        """Return which of the places have a color."""
        found = self.view.at(self.pixels, np.reshape(places, (-1, 2)))
        return np.abs(found - color).max(axis=1) < 0.02


@pytest.mark.parametrize(
    ("number", "radius_in", "options"), [(0, 0.5, {"color_by": "palette"}), (2, 0.0, {"draw_as": "discs"})]
)
def test_grains_and_walls_have_their_places_and_colors(tmp_path, frames, number, radius_in, options):
    path = record(tmp_path / "run.usdc", frames, make_scene(radius_in=radius_in), **options)
    picture, source = Picture(path, number), Recording(path)
    edge, position = picture.edge, frames[number, 0]
    colors = painter_of(source).color(source.frame(number, contacts=False))
    for place, radius, color in zip(position, RADIUS, colors, strict=True):
        assert picture.shows(color, place + (radius - edge) * AROUND).all()
        assert picture.shows(WHITE, place + (radius + edge) * AROUND).all()
    for wall, inside in ((2.0, -1.0), (0.5, 1.0)):
        is_there = wall > 1.0 or radius_in > 0.0
        assert (picture.shows(WALL, (wall - inside * edge) * AROUND) == is_there).all()
        assert picture.shows(WHITE, (wall + inside * edge) * AROUND).all()
    assert picture.shows(WHITE, 0.3 * AROUND).all()
    assert not picture.shows(CHAIN_COLOR, position[make_contacts(number)["pair"]].mean(axis=1)).any()


def test_force_chains_are_as_wide_as_in_the_file(tmp_path, frames):
    scene = make_scene(gravity=(0.0, -1.0))
    path = record(tmp_path / "run.usdc", frames, scene, forces=True)
    picture, position = Picture(path, 1), frames[1, 0]
    assert picture.shows(CHAIN_COLOR, position[make_contacts(1)["pair"]].mean(axis=1)).all()
    assert not picture.shows(CHAIN_COLOR, position[[2, 3]].mean(axis=0)).any()
    for (start, end), width in zip(*bands_of(path, 1), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        across = np.array([-along[1], along[0]])
        places = (start + end) / 2.0 + np.linspace(-0.1, 0.1, 4001)[:, np.newaxis] * across
        shown = picture.shows(CHAIN_COLOR, places).mean() * 0.2
        # both sides may cut a pixel along its diagonal, and half of the white border lies on the band
        lost = 2.0 * np.sqrt(2.0) / picture.view.scale + 0.15 * width
        assert shown == pytest.approx(width, abs=lost)


def test_frames_of_a_strip_are_spread_evenly(tmp_path):
    for count, expected in ((21, [0, 5, 10, 15, 20]), (1, [0])):
        path = record(tmp_path / "run.usdc", make_frames(count))
        assert plot(path, tmp_path / "run.png", size="900x500") == expected


def test_frames_of_a_strip_are_those_that_are_asked_for(recording, capsys):
    """And the curves are drawn below them."""
    picture = recording.with_suffix(".svg")
    assert plot(recording, picture, [-1, 0, 1, -3, 2, 2, 0]) == [2, 0, 1, 0, 2, 2, 0]
    titles = ("kinetic energy per mass [J/kg]", "mean height [m]")
    assert all(title in picture.read_text() for title in titles)
    assert exit_code("plot", recording, "-o", picture, "--frames", 1, "--no-curves") == 0
    assert not any(title in picture.read_text() for title in titles)
    assert exit_code("plot", recording, "--frames", "0,-1") == 0
    for wrong, message in (([], "frames is empty"), ([1.5], r"frames is 1\.5"), (["1"], "frames is '1'")):
        with pytest.raises(InputError, match=message):
            plot(recording, picture, wrong)
    beside = recording.with_suffix(".png")
    assert capsys.readouterr().out == f"{picture}: frame 1\n{beside}: frames 0, 2\n"
    assert beside.exists()


def test_curves_of_energy_height_and_contacts(tmp_path, frames, recording):
    """Of grains of several masses that rotate, with gravity aslant."""
    mass = np.array([1.0, 0.2, 3.0, 0.5, 2.0])
    scene = make_scene(mass=mass, gravity=(3.0, -4.0), friction=0.5)
    spin, path = np.arange(5.0) - 9.0, tmp_path / "run.usdc"
    with recorder_of(path, scene, forces=True) as recorder:
        for seed, frame in enumerate(frames):
            recorder.record(moment(*frame, scene, **make_contacts(seed), spin=spin, angle=spin))
    energy, height, contacts = measure(Recording(path)).values()
    position, velocity = frames[:, 0], frames[:, 1]
    energies = 0.5 * mass * (velocity**2).sum(axis=2) + 0.25 * mass * (RADIUS * spin) ** 2
    # recorded as float32, each with a relative error of 6e-8
    assert energy == pytest.approx(energies.sum(axis=1) / mass.sum(), rel=1e-6)
    assert height == pytest.approx((position @ [-0.6, 0.8]).mean(axis=1), rel=1e-6)
    assert contacts.tolist() == [5, 5, 5]
    assert len(measure(Recording(recording))) == 2  # of no contacts, as no forces were recorded
