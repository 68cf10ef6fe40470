"""The experiment in a real browser: pixel ratios, sizes, the keyboard alone, no console error."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from browsers import chromium, page_of
from command_line import done
from web_folders import Process, small_experiment

PIXEL_MM = 0.265  # of a CSS pixel, as the subject measures
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Process]:
    small_experiment(tmp_path / "experiment", 1080)
    running = Process("experiment", "serve", tmp_path / "experiment")
    yield running
    running.stop()


def press(page: Any, key: str, until: str) -> None:
    page.keyboard.press(key)
    page.wait_for_selector(until, timeout=20_000)


def measure(page: Any, width_mm: float) -> None:
    """Type the width of the rectangle and its unit."""
    page.wait_for_selector("#width")
    page.keyboard.type(f"{width_mm:.1f}")
    page.keyboard.press("Tab")
    page.keyboard.type("mm")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")


def calibrate(page: Any) -> None:
    for _ in range(2):
        measure(page, 500.0 * PIXEL_MM)
        page.wait_for_timeout(150)
    page.wait_for_selector("#card")
    page.keyboard.press("Tab")  # from the slider to 'Skip'
    page.keyboard.press("Enter")


def begin(page: Any, origin: str) -> None:
    """Come to the first picture by keys alone."""
    page.goto(f"{origin}/")
    page.wait_for_selector("text=I agree and take part")
    page.keyboard.press("Enter")
    calibrate(page)
    for label in ("#jspsych-fullscreen-btn", "text=What to do"):
        page.wait_for_selector(label)
        if label.startswith("#"):
            page.focus(label)
        page.keyboard.press("Enter")


def shot(page: Any, name: str) -> None:
    folder = os.environ.get("SIMRIG_SCREENSHOTS")
    if folder:
        page.screenshot(path=f"{folder}/{name}.png")


def shown(page: Any) -> dict[str, float]:
    page.wait_for_selector(".choices button:not([disabled])")
    return page.evaluate(
        "() => { const i = document.querySelector('.pictures img'), b = i.getBoundingClientRect();"
        " return { width: b.width, height: b.height, top: b.top, left: b.left, right: b.right,"
        " bottom: document.querySelector('.choices').getBoundingClientRect().bottom,"
        " all: window.innerWidth, tall: window.innerHeight }; }"
    )


@pytest.mark.parametrize(
    ("size", "ratio"), [((1366, 768), 1.0), ((1920, 1080), 1.5), ((2560, 1440), 2.0)]
)
def test_the_whole_experiment_by_keyboard(
    browser: Any, server: Process, tmp_path: Path, size: tuple[int, int], ratio: float
) -> None:
    with page_of(browser, size, ratio) as (page, faults):
        begin(page, server.origin)
        box = shown(page)
        shot(page, f"practice-{size[0]}-{ratio:g}")
        wanted = 290.0 / PIXEL_MM  # CSS pixels
        assert box["width"] <= wanted + 1.0 / ratio
        if size[1] >= 1200:  # room enough: the physical size, within a pixel of the screen
            assert abs(box["width"] - wanted) * ratio <= 1.0
        assert box["left"] >= 0 and box["right"] <= box["all"] and box["bottom"] <= box["tall"]
        page.keyboard.type("4")
        page.keyboard.press("Enter")
        page.wait_for_selector("text=Now it counts")
        page.keyboard.press("Enter")
        for number in range(6):
            page.wait_for_selector(f"text=({number + 1} of 6)")
            box = shown(page)
            page.keyboard.type("12" if number % 2 else "7")
            page.keyboard.press("Enter")
        page.wait_for_selector("code")
        shot(page, f"thanks-{size[0]}-{ratio:g}")
        code = page.inner_text("code")
        assert len(code) == 22
        assert faults == []
        assert page.context.cookies() == []
        assert page.evaluate("() => localStorage.length + sessionStorage.length") == 0
    done("experiment", "export", tmp_path / "experiment", "-o", tmp_path / "tables")
    rows = (tmp_path / "tables" / "answers.csv").read_text().splitlines()[1:]
    assert [row.split(",")[9] for row in rows] == ["7", "12"] * 3
    for row in rows:
        cells = row.split(",")
        assert float(cells[12]) == pytest.approx(box["width"] * PIXEL_MM, abs=PIXEL_MM)
        assert float(cells[13]) == pytest.approx(PIXEL_MM / ratio, rel=1e-3)


def test_wrong_measurements_are_asked_again_and_a_reload_goes_on(
    browser: Any, server: Process
) -> None:
    with page_of(browser, (1600, 1000)) as (page, faults):
        page.goto(f"{server.origin}/")
        page.click("text=I agree and take part")
        page.fill("#width", "13.2")  # in cm, said to be mm: two subjects of the thesis
        page.select_option("#unit", "mm")
        page.click("text=Continue")
        page.wait_for_selector("text=is the unit correct?")
        shot(page, "calibration")
        page.fill("#width", "-5")
        page.click("text=Continue")
        page.wait_for_selector("text=Enter the width as a number")
        for width in ("132.5", "100"):  # which contradict each other
            page.fill("#width", width)
            page.select_option("#unit", "mm")
            page.click("text=Continue")
            page.wait_for_timeout(150)
        page.wait_for_selector("#card")
        shot(page, "card")
        page.click("button:has-text('Skip')")
        page.wait_for_selector("text=The two measurements differ")
        calibrate(page)
        page.click("#jspsych-fullscreen-btn")
        page.click("text=Continue")
        shown(page)
        page.keyboard.type("3")
        page.keyboard.press("Enter")
        page.click("text=Begin")
        page.wait_for_selector("text=(1 of 6)")
        shown(page)
        page.keyboard.press("ArrowRight")
        page.keyboard.press("ArrowRight")
        page.keyboard.press("Enter")
        page.wait_for_selector("text=(2 of 6)")
        page.reload()
        calibrate(page)
        page.click("#jspsych-fullscreen-btn")
        page.click("text=Continue")
        page.wait_for_selector("text=(2 of 6)")
        assert faults == []


def test_the_code_deletes_everything(browser: Any, server: Process) -> None:
    with page_of(browser, (1280, 800)) as (page, _):
        page.goto(f"{server.origin}/#withdraw")
        page.wait_for_selector("#code")
        page.keyboard.type("nobody")
        page.keyboard.press("Enter")
        page.wait_for_selector("text=this code is unknown")
