"""The page in a real browser: keys, buttons and sliders do what they say, and change no bit of a run.

These tests need Chromium and its driver, `apt-get install chromium chromium-driver`: `pytest -m browser`.
"""

import numpy as np
import pytest
from browser import browser, opened
from matplotlib.image import imread
from recordings import make_frames, make_scene, record
from same_bits import contents
from walls_seen import View

from warpgrains import InputError, Scene, Simulation
from warpgrains.analysis.snapshot import snapshot
from warpgrains.drawing.colors import GrainColors, mark_color
from warpgrains.usd.recording import Recording
from warpgrains.view.page import Page
from warpgrains.view.players import Replay

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def driver():
    with browser() as driver:
        yield driver


def test_keys_and_sliders_of_a_simulation(driver, tmp_path):
    simulation = Simulation(Scene.load("annulus"))
    page = simulation.view(port=8300)
    with opened(driver, page.url) as tab:
        assert (tab.told()["state"], tab.told()["steps"]) == ("stopped", "0")
        tab.press("s")
        for steps in ("1", "2"):
            tab.press("n")
            tab.wait_for(lambda steps=steps: tab.told()["steps"] == steps)
        tab.press("r")
        tab.wait_for(lambda: tab.told()["state"] == "running" and int(tab.told()["steps"]) > 10)
        tab.press("s")
        tab.wait_for(lambda: tab.told()["state"] == "stopped")
        steps = int(tab.told()["steps"])
        assert float(tab.told()["time"].split()[0]) == pytest.approx(0.01 * steps)
        tab.press("n")
        tab.wait_for(lambda: tab.told()["steps"] == str(steps + 1))

        plain = Simulation(Scene.load("annulus"))
        plain.run(steps=steps + 1)
        assert contents(simulation.state()) == contents(plain.state())
        require_colors(tab, tmp_path, plain)

        tab.fill("drag [kg/s]", "1.25")
        tab.wait_for(lambda: tab.told()["drag"] == "1.25 kg/s")
        assert simulation.scene.drag == 1.25
        tab.click("restart")
        tab.wait_for(lambda: tab.told()["steps"] == "0")
    page.close()


def test_marks_show_how_far_grains_have_turned(driver, tmp_path):
    simulation = Simulation(make_scene(np.full(5, 0.25), friction=0.3, spin=[-6.0, -1.0, 0.0, 2.0, 7.0]))
    simulation.run(steps=39)
    page = simulation.view(port=8330)
    with opened(driver, page.url) as tab:
        tab.press("n")
        tab.wait_for(lambda: tab.told()["steps"] == "40")
        for ahead, color_of in ((-0.6, lambda colors: colors), (0.6, mark_color)):
            require_colors(tab, tmp_path, simulation, ahead, color_of)
    page.close()


def test_friction_is_switched_on_and_off(driver):
    simulation = Simulation(Scene.load("annulus"))
    page = simulation.view(port=8340)
    with opened(driver, page.url) as tab:
        for label, value, row, shown in (
            ("friction", "0.5", "friction", "0.5"),
            ("outer wall [rad/s]", "2", "rotation of the walls", "2, 0 rad/s"),
            ("inner wall [rad/s]", "-1", "rotation of the walls", "2, -1 rad/s"),
            ("friction", "0", "rotation of the walls", "0, 0 rad/s"),
            ("friction", "0.25", "rotation of the walls", "2, -1 rad/s"),
        ):
            tab.fill(label, value)
            tab.wait_for(lambda row=row, shown=shown: tab.told()[row] == shown)
        assert simulation.scene.friction == 0.25
        tab.click("one step")
        tab.wait_for(lambda: tab.told()["steps"] == "1")
    page.close()


def test_a_change_that_is_refused_says_why(driver, monkeypatch):
    def refuse(self, **fields):
        raise InputError("friction of these walls is given")

    monkeypatch.setattr(Simulation, "change", refuse)
    page = Simulation(Scene.load("annulus")).view(port=8350)
    with opened(driver, page.url) as tab:
        tab.fill("friction", "0.5")
        tab.wait_for(lambda: "friction of these walls is given" in tab.text())
        assert tab.told()["friction"] == "0"
    page.close()


def test_labels_and_charts_appear_when_there_is_something(driver, tmp_path):
    """And nothing that appears moves the sliders."""
    scene = Scene.load("annulus").replace(max_iterations=5, on_unconverged="raise")  # fails at step 20
    page = Simulation(scene).view(port=8320)
    sliders = ("playback speed", "drag [kg/s]", "gravity [m/s2]", "gravity direction [degrees]")
    with opened(driver, page.url) as tab:
        assert tab.buttons()[:4] == ["run (R)", "stop (S)", "one step (N)", "restart (0)"]
        assert tab.charts() == []
        places = [tab.slider(label).location for label in sliders]
        tab.press("n")
        tab.wait_for(lambda: tab.told()["steps"] == "1")
        assert tab.buttons()[0] == "resume (R)"
        tab.press("n")
        tab.wait_for(lambda: tab.told()["steps"] == "2")
        tab.wait_for(
            lambda: len(tab.charts()) == 1
        )  # of the energy; a step without contacts has one iteration
        tab.press("r")
        tab.wait_for(lambda: "not converged" in tab.text() and tab.told()["state"] == "stopped")
        assert [tab.slider(label).location for label in sliders] == places
        tab.click("restart")
        tab.wait_for(lambda: tab.told()["steps"] == "0")
        tab.wait_for(lambda: tab.buttons()[0] == "run (R)" and tab.charts() == [])
    page.close()


def require_colors(tab, folder, simulation, ahead=0.0, color_of=lambda colors: colors):
    """Check in a picture of the page that grains are where they are, in their colors.

    Look `ahead` of their centers, in radii, in the direction into which they have turned.
    """
    tab.driver.save_screenshot(str(folder / "page.png"))
    pixels = imread(folder / "page.png")[:, :, :3]
    expected = color_of(GrainColors(simulation.scene, "speed").of(snapshot(simulation)))
    turned = np.stack([np.cos(simulation.angle), np.sin(simulation.angle)], axis=1)
    places = simulation.position + ahead * simulation.scene.radius[:, np.newaxis] * turned
    shown = View(pixels, 0.04).at(pixels, places)
    hues = [color - color.mean(axis=1, keepdims=True) for color in (shown, expected)]
    sizes = [np.linalg.norm(hue, axis=1) for hue in hues]
    likeness = (hues[0] * hues[1]).sum(axis=1) / np.prod(sizes, axis=0)
    assert (likeness > 0.95).all()  # the page maps tones


def test_keys_and_scrubber_of_a_recording(driver, tmp_path):
    path = record(tmp_path / "run.usdc", make_frames(9), make_scene(), forces=True, draw_as="discs")
    page = Page(Replay(Recording(path)), 8310).start()
    with opened(driver, page.url) as tab:

        def scrubbed():
            return tab.slider("frame").get_attribute("value")

        assert tab.told() == {"state": "stopped", "time": "0 s", "frame": "0 of 8", "contacts": "5"}
        tab.press("n")
        tab.wait_for(lambda: tab.told()["frame"] == "1 of 8" and scrubbed() == "1")
        tab.fill("frame", "6")
        tab.wait_for(lambda: tab.told()["frame"] == "6 of 8")
        tab.click("resume")
        tab.wait_for(lambda: (tab.told()["frame"], tab.told()["state"]) == ("8 of 8", "stopped"))
        tab.wait_for(lambda: scrubbed() == "8")
        tab.click("restart")
        tab.wait_for(lambda: tab.told()["frame"] == "0 of 8")
    page.close()
