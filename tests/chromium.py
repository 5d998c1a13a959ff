"""Chromium, headless and without a graphics card, for the tests of pages."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",  # 3-D without a graphics card
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
PATIENCE = 120_000  # [ms] on a machine with much else to do


@contextmanager
def chromium() -> Iterator[Any]:
    """Browser of playwright; skips the test where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright to drive it")
    if CHROMIUM is None:
        pytest.skip("no chromium: `make browser` installs Debian's")
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(
            executable_path=CHROMIUM, args=ARGUMENTS, timeout=PATIENCE, env=dict(os.environ)
        )
        yield started
        started.close()
