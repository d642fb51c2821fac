"""A real browser without a window, for tests of pages; they are skipped, and say so, where there is none."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")


@contextmanager
def browser(width: int = 1280, height: int = 1000) -> Iterator[Any]:
    """Chromium by Selenium, with the console in ``get_log("browser")``."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="Selenium is not installed")
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("no browser: apt-get install chromium chromium-driver")
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", f"--window-size={width},{height}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    try:
        driver.set_script_timeout(60)
        driver.execute_cdp_cmd("Network.enable", {})
        yield driver
    finally:
        driver.quit()


def opened(driver: Any, address: str) -> None:
    """Open a page and wait until it is drawn."""
    driver.get(address)
    driver.execute_async_script("hbgear.ready.then(() => requestAnimationFrame(arguments[0]))")


def resized(driver: Any, width: int, height: int) -> None:
    """A screen of another size."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def clicked(driver: Any, x: float, y: float) -> None:
    """Click a place of the response, in its own units."""
    from selenium.webdriver import ActionChains

    at = driver.execute_script(
        "const d = document.getElementById('response'), l = d._fullLayout; d.scrollIntoView();"
        "const r = d.getBoundingClientRect(), [x, y] = arguments;"
        "return [r.left + l.xaxis._offset + l.xaxis.d2p(x), r.top + l.yaxis._offset + l.yaxis.d2p(y)]",
        float(x), float(y),
    )  # fmt: skip
    mouse = ActionChains(driver)
    mouse.w3c_actions.pointer_action.move_to_location(round(at[0]), round(at[1]))
    mouse.pause(0.2).click().perform()


def complaints(driver: Any) -> list[str]:
    """What the browser's console has of errors."""
    return [entry["message"] for entry in driver.get_log("browser") if entry["level"] == "SEVERE"]
