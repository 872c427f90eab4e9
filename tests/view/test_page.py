"""The page in a real browser: keys, buttons and sliders do what they say, and change no bit of a run.

These tests need Chromium and its driver, `apt-get install chromium chromium-driver`: `pytest -m browser`.
"""

import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from recordings import make_frames, make_scene, record
from same_bits import contents
from scipy import ndimage
from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.common.by import By
from walls_seen import View

from warpgrains import InputError, Scene, Simulation
from warpgrains.analysis.snapshot import snapshot
from warpgrains.drawing.colors import GrainColors, mark_color
from warpgrains.drawing.shapes import WALL_COLOR
from warpgrains.grade.grader import Grader
from warpgrains.usd.recording import Recording
from warpgrains.view.homework import Homework
from warpgrains.view.page import Page
from warpgrains.view.players import Replay

pytestmark = pytest.mark.browser

ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",  # which needs no GPU
    "--enable-unsafe-swiftshader",
    "--window-size=1500,1000",
)
PATIENCE = 60.0  # s


class Tab:
    def __init__(self, driver, url):
        self.driver = driver
        driver.get(url)
        self.wait_for(lambda: "state" in self.told())

    def told(self):
        """Return the numbers of the page, by their names."""
        script = (
            "return Object.fromEntries([...document.querySelectorAll('td.value')]"
            ".map(cell => [cell.dataset.name, cell.textContent]))"
        )
        return self.driver.execute_script(script)

    def press(self, key):
        webdriver.ActionChains(self.driver).send_keys(key).perform()

    def click(self, label):
        self.driver.find_element(By.XPATH, f"//button[contains(., '{label}')]").click()

    def text(self):
        return self.driver.find_element(By.TAG_NAME, "body").text

    def buttons(self):
        found = self.driver.find_elements(By.XPATH, "//button[contains(., '(')]")
        return [button.text for button in found if button.is_displayed()]

    def charts(self):
        return [chart for chart in self.driver.find_elements(By.CLASS_NAME, "uplot") if chart.is_displayed()]

    def slider(self, label):
        """Return the field beside a slider."""
        path = f"//label[contains(., '{label}')]/following::input[@type='text'][1]"
        return self.driver.find_element(By.XPATH, path)

    def fill(self, label, value):
        field = self.slider(label)
        field.click()
        field.send_keys(f"\ue009a\ue000{value}\n")  # control-A

    def wait_for(self, is_so):
        end, holds = time.monotonic() + PATIENCE, False
        while not holds:
            assert time.monotonic() < end, self.told()
            time.sleep(0.05)
            with suppress(StaleElementReferenceException):  # of an element that the page has replaced
                holds = is_so()

    def wait_until_told(self, **numbers):
        self.wait_for(lambda: numbers.items() <= self.told().items())


@pytest.fixture(scope="module")
def driver():
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    for argument in ARGUMENTS:
        options.add_argument(argument)
    driver = webdriver.Chrome(options, webdriver.ChromeService("/usr/bin/chromedriver"))
    yield driver
    driver.quit()


@pytest.fixture
def opened(driver):
    """Open a page, and close it at the end of the test."""
    pages = []

    def open_page(page):
        pages.append(page)
        return Tab(driver, page.url)

    yield open_page
    driver.get("about:blank")
    for page in pages:
        page.close()


def test_keys_and_sliders_of_a_simulation(opened, tmp_path, monkeypatch):
    """And a change that is refused says why."""
    simulation = Simulation(Scene.load("annulus"))
    tab = opened(in_bands(simulation.view(port=8300)))
    assert (tab.told()["state"], tab.told()["steps"]) == ("stopped", "0")
    tab.press("s")
    for steps in ("1", "2"):
        tab.press("n")
        tab.wait_until_told(steps=steps)
    tab.press("r")
    tab.wait_for(lambda: tab.told()["state"] == "running" and int(tab.told()["steps"]) > 10)
    tab.press("s")
    tab.wait_until_told(state="stopped")
    steps = int(tab.told()["steps"])
    assert float(tab.told()["time"].split()[0]) == pytest.approx(0.01 * steps)
    tab.press("n")
    tab.wait_until_told(steps=str(steps + 1))

    plain = Simulation(Scene.load("annulus"))
    plain.run(steps=steps + 1)
    assert contents(simulation.state()) == contents(plain.state())
    require_colors(tab, tmp_path, plain)

    for label, value, row, shown in (
        ("drag [kg/s]", "1.25", "drag", "1.25 kg/s"),
        ("friction", "0.5", "friction", "0.5"),
        ("outer wall [rad/s]", "2", "rotation of the walls", "2, 0 rad/s"),
        ("inner wall [rad/s]", "-1", "rotation of the walls", "2, -1 rad/s"),
        ("friction", "0", "rotation of the walls", "0, 0 rad/s"),
        ("friction", "0.25", "rotation of the walls", "2, -1 rad/s"),
    ):
        tab.fill(label, value)
        tab.wait_until_told(**{row: shown})
    assert (simulation.scene.drag, simulation.scene.friction) == (1.25, 0.25)

    def refuse(self, **fields):
        raise InputError("friction of these walls is given")

    with monkeypatch.context() as patch:
        patch.setattr(Simulation, "change", refuse)
        tab.fill("friction", "0.5")
        tab.wait_for(lambda: "friction of these walls is given" in tab.text())
        assert tab.told()["friction"] == "0.25"
    tab.click("one step")
    tab.wait_until_told(steps=str(steps + 2))
    tab.click("restart")
    tab.wait_until_told(steps="0")


def test_marks_show_how_far_grains_have_turned(opened, tmp_path):
    simulation = Simulation(make_scene(np.full(5, 0.25), friction=0.3, spin=[-6.0, -1.0, 0.0, 2.0, 7.0]))
    simulation.run(steps=39)
    tab = opened(in_bands(simulation.view(port=8330)))
    tab.press("n")
    tab.wait_until_told(steps="40")
    for ahead, color_of in ((-0.6, lambda colors: colors), (0.6, mark_color)):
        require_colors(tab, tmp_path, simulation, ahead, color_of)


def chart_sizes(tab):
    """Return the sizes of both charts, which are as wide as their panel."""
    tab.wait_for(lambda: len(tab.charts()) == 2)
    sizes = [(chart.size["width"], chart.size["height"]) for chart in tab.charts()]
    assert min(width for width, _ in sizes) > 250
    return sizes


def test_charts_keep_their_size_from_step_to_step(opened):
    """Also where a step has one iteration, and the next one many."""
    tab = opened(Simulation(Scene.load("annulus")).view(port=8340))
    size, seen = chart_sizes(tab), set()
    for step in range(1, 24):
        tab.press("n")
        tab.wait_until_told(steps=str(step))
        seen.add(int(tab.told()["iterations"]) > 1)
        assert chart_sizes(tab) == size
    assert seen == {False, True}


def test_a_homework_has_its_curve_beside_that_of_the_reference(opened, tmp_path):
    grader, source = Grader(tmp_path), Path(__file__).parents[1] / "grade/right/plain.c"
    player = Homework(Scene.load("annulus"), lambda: grader.run(source), "homework")
    tab = opened(Page(player, 8350).start())
    while player.readout()["stage"] != "iteration 3":
        player.advance(1)
    tab.press("n")
    tab.wait_until_told(stage="iteration 4")
    tab.wait_for(lambda: len(tab.charts()) == 1)
    for words in ("zeta of the last step", "reference", "homework"):
        assert words in tab.charts()[0].text
    player.close()


def test_sliders_reset_and_say_what_is_out_of_range(opened):
    simulation = Simulation(Scene.load("annulus"))
    tab = opened(simulation.view(port=8360))
    tab.fill("friction", "7")
    tab.wait_for(lambda: "friction is 7: it must be 0 to 1" in tab.text())
    tab.fill("friction", "0.5")
    tab.wait_until_told(friction="0.5")
    tab.wait_for(lambda: "friction is 7" not in tab.text())
    tab.fill("drag [kg/s]", "1.25")
    tab.wait_until_told(drag="1.25 kg/s")
    tab.click("reset the sliders")
    tab.wait_until_told(friction="0", drag="0.5 kg/s")
    tab.wait_for(lambda: tab.slider("friction").get_attribute("value") == "0")


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (800, 1200), (390, 844)])
def test_windows_of_any_size_show_the_whole_circle(opened, tmp_path, width, height):
    """Its leftmost, rightmost, highest and lowest points are not beyond the window or below the panel."""
    tab = opened(Simulation(Scene.load("annulus")).view(port=8370))
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    tab.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    tab.driver.refresh()
    tab.wait_for(lambda: tab.told().get("steps") == "0")
    for button in tab.driver.find_elements(By.CSS_SELECTOR, "[class*=Notification] button"):
        button.click()

    def is_whole():
        tab.driver.save_screenshot(str(tmp_path / "page.png"))
        pixels = imread(tmp_path / "page.png")[:, :, :3]
        shape, count = ndimage.label(np.abs(pixels - WALL_COLOR).max(axis=2) < 0.04, np.ones((3, 3)))
        sizes = [
            (np.ptp(np.nonzero(shape == k)[0]), np.ptp(np.nonzero(shape == k)[1]))
            for k in range(1, count + 1)
        ]
        tall, wide = max(sizes, default=(0, 0))
        return tall > 200 and abs(tall - wide) < 0.02 * tall

    try:
        tab.wait_for(is_whole)
    finally:
        tab.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_labels_appear_when_there_is_something(opened):
    """And nothing that appears moves the sliders."""
    scene = Scene.load("annulus").replace(max_iterations=5, on_unconverged="raise")  # fails at step 20
    tab = opened(Simulation(scene).view(port=8320))
    sliders = ("playback speed", "drag [kg/s]", "gravity [m/s2]", "gravity direction [degrees]")
    assert tab.buttons()[:4] == ["run (R)", "stop (S)", "one step (N)", "restart (0)"]
    size = chart_sizes(tab)
    places = [tab.slider(label).location for label in sliders]
    tab.press("n")
    tab.wait_until_told(steps="1")
    assert tab.buttons()[0] == "resume (R)"
    tab.press("n")
    tab.wait_until_told(steps="2")
    tab.press("r")
    tab.wait_for(lambda: "not converged" in tab.text() and tab.told()["state"] == "stopped")
    assert [tab.slider(label).location for label in sliders] == places
    tab.click("restart")
    tab.wait_until_told(steps="0")
    tab.wait_for(lambda: tab.buttons()[0] == "run (R)")
    assert chart_sizes(tab) == size


def in_bands(page):
    """Return a page with colors whose hues differ."""
    page._asked.put(lambda: page._set_style(color_by="bands"))
    return page


def require_colors(tab, folder, simulation, ahead=0.0, color_of=lambda colors: colors):
    """Check in a picture of the page that grains are where they are, in their colors.

    Look `ahead` of their centers, in radii, in the direction into which they have turned.
    """
    tab.driver.save_screenshot(str(folder / "page.png"))
    pixels = imread(folder / "page.png")[:, :, :3]
    expected = color_of(GrainColors(simulation.scene, "bands").of(snapshot(simulation)))
    turned = np.stack([np.cos(simulation.angle), np.sin(simulation.angle)], axis=1)
    places = simulation.position + ahead * simulation.scene.radius[:, np.newaxis] * turned
    shown = View(pixels, 0.04).at(pixels, places)
    hues = [color - color.mean(axis=1, keepdims=True) for color in (shown, expected)]
    sizes = [np.linalg.norm(hue, axis=1) for hue in hues]
    likeness = (hues[0] * hues[1]).sum(axis=1) / np.prod(sizes, axis=0)
    assert (likeness > 0.95).all()  # the page maps tones


def test_keys_and_scrubber_of_a_recording(opened, tmp_path):
    path = record(tmp_path / "run.usdc", make_frames(9), make_scene(), forces=True, draw_as="discs")
    tab = opened(Page(Replay(Recording(path)), 8310).start())

    def scrubbed():
        return tab.slider("frame").get_attribute("value")

    assert tab.told() == {"state": "stopped", "time": "0 s", "frame": "0 of 8", "contacts": "5"}
    tab.press("n")
    tab.wait_for(lambda: tab.told()["frame"] == "1 of 8" and scrubbed() == "1")
    tab.fill("frame", "6")
    tab.wait_until_told(frame="6 of 8")
    tab.click("resume")
    tab.wait_until_told(frame="8 of 8", state="stopped")
    tab.wait_for(lambda: scrubbed() == "8")
    tab.click("restart")
    tab.wait_until_told(frame="0 of 8")
