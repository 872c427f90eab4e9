"""What the gallery shows: the numbers of its scenes, and that each says what to look at."""

from functools import cache
from itertools import takewhile

import numpy as np
import pytest
from pages import PAGES, ROOT

from warpgrains.scene.document import shipped_scenes
from warpgrains.scenes import gallery


@pytest.fixture(scope="module")
def numbers(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gallery")

    @cache
    def of(name):
        found = gallery.EXHIBITS[name](folder / f"{name}.png")
        assert (folder / f"{name}.png").stat().st_size > 10_000
        return found

    return of


def test_a_column_carries_its_weight(numbers):
    found = numbers("column")
    assert found["contacts between grains"] == 49
    assert found["their weights above, at most [N]"] == pytest.approx(49 * 0.1 * 9.81)
    # a velocity is off by up to 49 tolerances where all contacts below are, and so is a force by 49 of these
    assert found["worst difference of a force [N]"] <= 49 * 49 * 1e-6 * 0.1 / 0.01


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


def test_a_jam_names_its_grains(numbers):
    found = numbers("jam")
    assert found["grains that cannot fit"] == 5
    assert found["steps without a solution"] == 16
    assert found["force that a step adds [N]"] == pytest.approx(400.0, rel=1e-6)  # as that of the page


def test_a_batch_has_few_ways_to_rest(numbers, monkeypatch):
    monkeypatch.setattr(gallery, "COUNT", 40)
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
