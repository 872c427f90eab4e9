"""A headless Chromium of the system, which draws without a GPU."""

import time
from contextlib import contextmanager

from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.common.by import By

ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--window-size=1500,1000",
)
PATIENCE = 120.0  # s


class Tab:
    def __init__(self, driver, url):
        self.driver = driver
        driver.get(url)
        self.wait_for(lambda: "steps" in self.told() or "frame" in self.told())

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

    def fill(self, label, value):
        """Type a value into the field beside a slider."""
        field = self.slider(label)
        field.click()
        field.send_keys(f"\ue009a\ue000{value}\n")  # control-A

    def slider(self, label):
        return self.driver.find_element(
            By.XPATH, f"//label[contains(., '{label}')]/following::input[@type='text'][1]"
        )

    def _holds(self, is_so):
        """Return whether it is so now; an element that the page replaces meanwhile says no."""
        try:
            return is_so()
        except StaleElementReferenceException:
            return False

    def wait_for(self, is_so):
        end = time.monotonic() + PATIENCE
        while not self._holds(is_so):
            assert time.monotonic() < end, self.told()
            time.sleep(0.05)


@contextmanager
def browser():
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    for argument in ARGUMENTS:
        options.add_argument(argument)
    driver = webdriver.Chrome(options, webdriver.ChromeService("/usr/bin/chromedriver"))
    try:
        yield driver
    finally:
        driver.quit()


@contextmanager
def opened(driver, url):
    yield Tab(driver, url)
    driver.get("about:blank")
