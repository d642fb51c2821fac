"""A real browser without a window, for tests of pages, which are skipped with a reason without one."""

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
        float(x),
        float(y),
    )
    mouse = ActionChains(driver)
    mouse.w3c_actions.pointer_action.move_to_location(round(at[0]), round(at[1]))
    mouse.pause(0.2).click().perform()


BUTTONS = {"Download plot", "Zoom", "Pan", "Zoom in", "Zoom out", "Autoscale", "Reset axes"}
"""All that the toolbars of a page may have: no button sends the data away."""


def check_toolbars(driver: Any) -> None:
    """The toolbar of every figure has buttons of the list only, and no server to send data to."""
    toolbars = driver.execute_script(
        "return [...document.querySelectorAll('.js-plotly-plot')].map(div => ({id: div.id, context: div._context,"
        "buttons: [...div.querySelectorAll('.modebar-btn')].map(b => b.getAttribute('data-title')"
        " || b.getAttribute('aria-label'))}))"
    )
    assert {"response", "time"} <= {each["id"] for each in toolbars}
    assert {button for each in toolbars for button in each["buttons"]} == BUTTONS
    for each in toolbars:
        context = each["context"]
        assert context["plotlyServerURL"] == ""
        links = ("sendData", "showSendToCloud", "showEditInChartStudio", "showLink")  # some of them by version
        assert not any(context.get(name, False) for name in links)
        assert context["displaylogo"] is False


def check_only_own_scripts_run(driver: Any) -> None:
    """A script, a handler in an attribute, an image from elsewhere and a request put into the page do nothing."""
    found = driver.execute_async_script(
        "const done = arguments[0], seen = []; window.foreign = 0;"
        "document.addEventListener('securitypolicyviolation', (e) => seen.push(e.effectiveDirective));"
        "const script = document.createElement('script'); script.textContent = 'window.foreign += 1';"
        "document.body.append(script); const div = document.createElement('div');"
        'div.innerHTML = \'<img src="http://127.0.0.1:9/x.png" onerror="window.foreign += 1">\';'
        "document.body.append(div); fetch('http://127.0.0.1:9/').catch(() => {});"
        "setTimeout(() => done([window.foreign, seen]), 500)"
    )
    assert found[0] == 0
    assert {"script-src-elem", "script-src-attr", "img-src", "connect-src"} <= set(found[1])


def complaints(driver: Any) -> list[str]:
    """What the browser's console has of errors."""
    return [entry["message"] for entry in driver.get_log("browser") if entry["level"] == "SEVERE"]
