"""A real browser for tests: Debian's Chromium, driven by Playwright; skips where there is none."""

from __future__ import annotations

import gc
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest


@contextmanager
def chromium() -> Iterator[Any]:
    """Give a browser, or skip with what is missing."""
    place = (
        shutil.which("chromium")
        or shutil.which("chromium-browser")
        or shutil.which("google-chrome")
    )
    if place is None:
        pytest.skip("no browser here: apt-get install chromium")
    playwright = pytest.importorskip("playwright.sync_api", reason="needs simrig[dev]")
    gc.collect()  # nothing that other tests left is to be freed while the driver switches stacks
    with playwright.sync_playwright() as driver:
        options = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        browser = driver.chromium.launch(executable_path=place, args=options)
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def page_of(
    browser: Any, size: tuple[int, int], ratio: float = 1.0
) -> Iterator[tuple[Any, list[str]]]:
    """Give a page and the list of everything that its console complains about."""
    viewport = {"width": size[0], "height": size[1]}
    context = browser.new_context(viewport=viewport, device_scale_factor=ratio)
    page = context.new_page()
    faults: list[str] = []
    page.on("console", lambda m: faults.append(m.text) if m.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("requestfailed", lambda r: faults.append(f"{r.url}: {r.failure}"))
    try:
        yield page, faults
    finally:
        context.close()
