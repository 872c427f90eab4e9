"""What the gallery shows: the numbers of its scenes, and that each says what to look at."""

import itertools
from functools import cache
from itertools import takewhile
from math import sqrt

import drum
import gallery
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pages import PAGES, ROOT

from warpgrains.drawing.colorings import COLORINGS
from warpgrains.drawing.colors import colormap
from warpgrains.pictures.still import FrameArtists
from warpgrains.scene.toml import shipped_scenes

approx = pytest.approx


def listening(patch, kind, name):
    """Return the list of arguments and results of all calls of a method."""
    calls, method = [], getattr(kind, name)

    def call(*given, **how):
        calls.append((*given, method(*given, **how)))
        return calls[-1][-1]

    patch.setattr(kind, name, call)
    return calls


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Return what a section finds, and the calls that draw color bars, curves and frames."""
    folder = tmp_path_factory.mktemp("gallery")

    @cache
    def of(name):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(gallery, "COUNT", 40)
            methods = (Figure, "colorbar"), (Axes, "plot"), (FrameArtists, "show")
            calls = [listening(patch, *method) for method in methods]
            figure, found = gallery.SECTIONS[name]()
        figure.savefig(folder / f"{name}.png")
        assert (folder / f"{name}.png").stat().st_size > 10_000
        return found, *calls

    return of


def test_no_curve_of_the_column_hides_another(drawn):
    curves = [y for _, _, y, *_ in drawn("column")[2]]
    assert len(curves) == 5
    for one, other in itertools.combinations(curves, 2):
        shared = min(len(one), len(other))
        # of the height of the axes, 62 N in 200 pixels: ten pixels
        assert np.abs(one[:shared] - other[:shared]).max() > 3.0 or abs(len(one) - len(other)) > 5


def test_scales_of_the_jam_reach_to_its_forces(drawn):
    frames = [(artists._painter, now) for artists, now, _ in drawn("jam")[3]]
    chains = [painter.chains(now) for painter, now in frames]
    first, last = (max(now.force.max(), now.wall_force.max()) for _, now in frames)
    assert last == pytest.approx(16.0 * first, rel=0.02)  # 400 N a step, and the first somewhat more
    for painter, _ in frames:
        assert painter.chain_scale.force == pytest.approx(last, rel=0.01)  # that of a wall is a little larger
        assert painter.colors.scale.high >= 2.0 * last / (2.0 * np.pi * painter.scene.radius.max())
    assert chains[0].width.max() < 0.1 * chains[1].width.max()


@pytest.mark.parametrize("name", ["drum", "batch", "jam", "bidisperse", "bullet"])
def test_a_quantity_has_one_colormap(drawn, name):
    """That of a quantity that grains are colored by, and no other quantity has it."""
    bars = drawn(name)[1]
    assert bars
    for _, mapped, bar in bars:
        quantity = bar.ax.get_ylabel().partition(" [")[0]
        shown = mapped.cmap(np.linspace(0.0, 1.0, 5))[:, :3]
        for other, of in COLORINGS.items():
            is_its = np.abs(shown - colormap(of.colormap, np.linspace(0.0, 1.0, 5))).max() < 0.03
            assert is_its == (other == quantity), (quantity, other)


DRUMS = {
    "time to rest [s]": (5.8, 2.75, 2.5, 3.05),
    "packing fraction": (0.831962211, 0.8321976732, 0.8323835531, 0.8275640305),
    "coordination": (3.835, 3.84, 3.84, 3.84),
    "pressure [N/m]": (10.04423199, 10.10232864, 9.962875552, 10.04186457),
    "stress yy / xx": (1.033239988, 0.9875264073, 1.051077561, 1.040492368),
    "mean force [N]": (1.976757292, 1.961719569, 1.921807522, 1.987446897),
    "deviation / mean": (0.9717657227, 0.9449630201, 0.9973808841, 1.085158042),
}

EXPECTED = {
    "column": {
        "contacts between grains": 49,
        "their weights above, at most [N]": approx(49 * 0.1 * 9.81),
        # a velocity is off by up to 49 tolerances where all contacts below are, and a force by 49 of these
        "worst difference of a force [N]": approx(0.0, abs=49 * 49 * 1e-6 * 0.1 / 0.01),
    },
    # a run has the same bits everywhere; ten digits are pinned, of which the last is rounded
    "drum": {
        f"drag {drag:g} kg/s: {name}": approx(value, rel=1e-9)
        for name, values in DRUMS.items()
        for drag, value in zip(drum.DRAGS, values, strict=True)
    },
    "bowl": {
        "order, leapfrog, round wall": approx(2.0, abs=0.05),
        "order, euler, tangent": approx(1.0, abs=0.1),
    },
    "bullet": {
        "momentum of the bullet [kg m/s]": 10.0,
        # 38 momenta of at most 10 kg m/s are changed some thousand times, in pairs that are rounded each
        "momentum in the end [kg m/s]": approx(10.0, abs=1000 * 38 * np.finfo(float).eps * 10.0),
        "worst overlap [smallest radii]": approx(0.0, abs=0.001 * 1e-6 / 0.05),  # dt times the tolerance
    },
    "bidisperse": {  # forces need two contacts a grain but one; equal grains have more
        "grains, of two sizes": 200,
        "contacts, of two sizes": 2 * 200 - 1,
        "grains, equal": 200,
        "contacts, equal": 405,
    },
    "heap": {
        "friction that the heap needs": approx(0.186527, abs=1e-6),
        "fallen at 0.3000 [m]": approx(0.0, abs=1e-9),
        "fallen at 0.1884 [m]": approx(0.0, abs=1e-9),
        "fallen at 0.1847 [m]": approx(0.088, abs=0.001),  # the upper disc lies between the lower ones
    },
    "slope": {
        "way of the upper grain [m]": approx(2 / 3 * 9.81 * 0.5 * 0.6**2 / 2, rel=0.01),
        "2/3 g sin(30) t^2 / 2 [m]": approx(2 / 3 * 9.81 * 0.5 * 0.6**2 / 2),
        "way of the lower grain [m]": approx(9.81 * (0.5 - 0.1 * sqrt(0.75)) * 0.6**2 / 2, rel=0.01),
        "g (sin(30) - 0.1 cos(30)) t^2 / 2 [m]": approx(9.81 * (0.5 - 0.1 * sqrt(0.75)) * 0.6**2 / 2),
    },
    "jam": {
        "steps without a solution": 16,
        "grains that cannot fit": 5,
        "force that a step adds [N]": approx(400.0, rel=1e-6),  # as that of the page
    },
    "batch": {
        "scenes": 40,
        "mean of the largest forces [N]": approx(1.8, abs=0.3),
        "deviation [N]": approx(0.1, abs=0.05),
        "mean height of the centres [m]": approx(-1.759, abs=0.001),
    },
    "bouncing": {f"e {e:g}: first bounce / fall": approx(e**2, abs=0.01) for e in (1.0, 0.8, 0.5)},
    "cradle": {
        "times that a speed is handed on": 24,
        "speed of the last one [m/s]": 1.0,
        "energy / that of the start": 1.0,
    },
    "gas": {
        "energy / that of the start": approx(0.995, abs=0.005),
        "mean of v^4 / square of that of v^2": approx(3.0, abs=0.3),
    },
}
SLOW = "bouncing", "cradle", "gas"


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in EXPECTED]
)
def test_numbers(drawn, name):
    """A bounce is early by up to dt, 1 ms."""
    assert drawn(name)[0] == EXPECTED[name]


def test_a_hopper_flows_at_a_constant_rate(drawn):
    left = np.array([0, *drawn("hopper")[0].values()])
    rate = np.diff(left)[1:4]  # each half second, once it flows
    assert rate.min() > 0.6 * rate.max() > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["silo", "hourglass"])
def test_what_is_refilled_flows_at_a_constant_rate(drawn, name):
    start, *left, end = drawn(name)[0].values()
    rate = np.diff(left)  # between equal times, once it flows
    assert rate.min() > 0.6 * rate.max() > 0
    assert end == start


@pytest.mark.slow
def test_a_column_collapses(drawn):
    height, run_out, rest = drawn("collapse")[0].values()
    assert 1.0 < 0.6 * height < run_out < 2.5 * height
    assert rest < 0.7 * height


@pytest.mark.parametrize("name", shipped_scenes())
def test_every_scene_says_what_to_look_at(name):
    text = (ROOT / f"scenes/{name}.toml").read_text()
    said = [
        line.removeprefix("# ") for line in takewhile(lambda line: line.startswith("# "), text.splitlines())
    ]
    assert said[0].endswith(".")
    assert said[1].startswith("Look at: ")
    page = PAGES["gallery"].read_text()
    assert f"(gallery/{name}.png)" in page
    assert f"{' '.join(said)} ([{name}.toml](../{name}.toml))" in page.replace("\n", " ")
