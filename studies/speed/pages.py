"""Time from a slider of the explorer to the new curve, and size and opening of a report, in a real browser.

    python -m studies.speed.pages [--quick] [-o DIR]

Chromium without a window moves the slider of the damping fifty times, each time after the page has come to rest, and
the clock of the page runs from the move until the curve is drawn and the next frame is due. The report of the
double-helical pair is opened ten times with the network switched off, until its last figure is drawn.
"""

from __future__ import annotations

import shutil
import threading
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from threadpoolctl import threadpool_limits

import hbgear as hb
from hbgear.web.editable_model import EditableInstance
from hbgear.web.explorer import Explorer
from hbgear.web.server import Server
from studies import study

ALONE = True

MODELS = {"spur-pair": hb.SpurPair(), "double-helical": hb.gears.DoubleHelicalPair(zeta=0.05)}

MOVES = """
const done = arguments[1], out = [], slider = document.querySelector("[aria-label='zeta as a slider']");
const low = Number(slider.min), high = Number(slider.max), pause = (ms) => new Promise((go) => setTimeout(go, ms));
(async () => {
  for (let k = 0; k <= arguments[0]; k++) {
    const before = explorer.timings.length, from = performance.now();
    slider.value = low + (high - low) * (0.3 + 0.4 * ((7 * k) % 50) / 50);
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    while (explorer.timings.length === before) await pause(1);
    await new Promise((go) => requestAnimationFrame(go));
    if (k) out.push(performance.now() - from);
    await pause(400);
  }
  done(out);
})();
"""


def browser() -> Any:
    """Chromium by Selenium."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for flag in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1280,1000"):
        options.add_argument(flag)
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    driver.set_script_timeout(300)
    driver.execute_cdp_cmd("Network.enable", {})
    return driver


def moved(driver: Any, name: str, count: int) -> dict[str, Any]:
    """Milliseconds from slider to curve."""
    model = MODELS[name]
    server = Server(Explorer(EditableInstance(model, name), model.default_span), name)
    threading.Thread(target=server.run, daemon=True).start()
    driver.get(server.address)
    driver.execute_async_script("hbgear.ready.then(() => setTimeout(arguments[0], 1000))")
    times = sorted(driver.execute_async_script(MOVES, count))
    driver.get("about:blank")
    return {"what": f"{name}: slider to new curve", "median": median(times), "worst": times[-1], "size": None}


def reported(driver: Any, count: int) -> dict[str, Any]:
    """Milliseconds until a report is drawn, without a network; its size in bytes."""
    model = MODELS["double-helical"]
    made = hb.report(hb.trace(hb.HarmonicBalance(model, 16), "Omega", model.default_span))
    off = {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "report.html"
        made.save(path)
        driver.execute_cdp_cmd("Network.emulateNetworkConditions", off)
        times = []
        for _ in range(count):
            driver.get("about:blank")
            start = time.perf_counter()
            driver.get(path.as_uri())
            driver.execute_async_script("hbgear.ready.then(() => requestAnimationFrame(arguments[0]))")
            times.append(1e3 * (time.perf_counter() - start))
        size = path.stat().st_size
    return {"what": "double-helical: report opened", "median": median(times), "worst": max(times), "size": size}


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row for each of the pages."""
    driver = browser()
    try:
        with threadpool_limits(1):
            rows = [moved(driver, name, 5 if quick else 50) for name in MODELS]
            return [*rows, reported(driver, 2 if quick else 10)]
    finally:
        driver.quit()


def report(rows: list[dict[str, Any]]) -> str:
    """Table in Markdown."""
    lines = ["| page | median [ms] | worst [ms] | size [MB] |", "| --- | --- | --- | --- |"]
    for row in rows:
        size = "-" if row["size"] is None else f"{row['size'] / 1e6:.2f}"
        lines.append(f"| {row['what']} | {row['median']:.0f} | {row['worst']:.0f} | {size} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
