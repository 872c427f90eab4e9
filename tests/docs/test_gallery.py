"""What the gallery shows: the numbers of its scenes, and that each says what to look at."""

import itertools
from functools import cache
from itertools import takewhile

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


@pytest.fixture(scope="module")
def numbers(drawn):
    return lambda name: drawn(name)[0]


def test_a_column_carries_its_weight(numbers):
    found = numbers("column")
    assert found["contacts between grains"] == 49
    assert found["their weights above, at most [N]"] == pytest.approx(49 * 0.1 * 9.81)
    # a velocity is off by up to 49 tolerances where all contacts below are, and so is a force by 49 of these
    assert found["worst difference of a force [N]"] <= 49 * 49 * 1e-6 * 0.1 / 0.01


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
    "pressure [N/m]": (10.04423142, 10.10232852, 9.962875514, 10.04186376),
    "stress yy / xx": (1.033239912, 0.9875263929, 1.05107756, 1.040492265),
    "mean force [N]": (1.976757292, 1.961719569, 1.921807522, 1.987446897),
    "deviation / mean": (0.9717657227, 0.9449630201, 0.9973808841, 1.085158042),
}


def test_numbers_of_drums_are_those_of_before(numbers):
    found = numbers("drum")
    assert len(found) == len(drum.DRAGS) * len(DRUMS)
    for name, values in DRUMS.items():
        # a run has the same bits everywhere; ten digits are pinned, of which the last is rounded
        given = [found[f"drag {drag:g} kg/s: {name}"] for drag in drum.DRAGS]
        assert given == pytest.approx(values, rel=1e-9), name


def test_a_sliding_grain_is_of_second_order(numbers):
    found = numbers("bowl")
    assert 1.95 <= found["order, leapfrog, round wall"] <= 2.05
    assert 0.9 <= found["order, text, tangent"] <= 1.1


def test_a_crystal_takes_the_bullets_momentum(numbers):
    found = numbers("bullet")
    # 38 momenta of at most 10 kg m/s are changed some thousand times, in pairs that are rounded each
    assert abs(found["momentum in the end [kg m/s]"] - 10.0) <= 1000 * 38 * np.finfo(float).eps * 10.0
    assert found["worst overlap [smallest radii]"] <= 0.001 * 1e-6 / 0.05  # dt times the tolerance


def test_grains_of_two_sizes_have_as_many_contacts_as_forces_need(numbers):
    found = numbers("bidisperse")
    assert found["grains, of two sizes"] == found["grains, equal"] == 200
    assert found["contacts, of two sizes"] == 2 * 200 - 1
    assert found["contacts, equal"] > 2 * 200 - 1


def test_grains_on_slopes_follow_closed_forms(numbers):
    found = list(numbers("slope").values())
    assert found[0::2] == pytest.approx(found[1::2], rel=0.01)


@pytest.mark.slow
def test_balls_bounce_and_hand_on_their_speed(numbers):
    for e, top in zip((1.0, 0.8, 0.5), numbers("bouncing").values(), strict=True):
        assert top == pytest.approx(e**2, abs=0.01)  # a bounce is early by up to dt, 1 ms
    assert [*numbers("cradle").values()] == [24, 1.0, 1.0]
    energy, shape = numbers("gas").values()
    assert 0.99 < energy <= 1.0
    assert shape == pytest.approx(3.0, abs=0.3)


def test_a_hopper_flows_at_a_constant_rate(numbers):
    left = np.array([0, *numbers("hopper").values()])
    rate = np.diff(left)[1:4]  # each half second, once it flows
    assert rate.min() > 0.6 * rate.max() > 0


@pytest.mark.slow
def test_a_column_collapses(numbers):
    height, run_out, rest = numbers("collapse").values()
    assert 1.0 < 0.6 * height < run_out < 2.5 * height
    assert rest < 0.7 * height


def test_a_jam_names_its_grains(numbers):
    found = numbers("jam")
    assert found["grains that cannot fit"] == 5
    assert found["steps without a solution"] == 16
    assert found["force that a step adds [N]"] == pytest.approx(400.0, rel=1e-6)  # as that of the page


def test_a_batch_has_few_ways_to_rest(numbers):
    found = numbers("batch")
    assert found["scenes"] == 40
    assert 1.5 < found["mean of the largest forces [N]"] < 2.1


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
