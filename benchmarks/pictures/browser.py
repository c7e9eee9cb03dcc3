"""The browser that pictures are taken with, and that the tests look at pages with."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from runtime.errors import InputError, extra

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PATIENCE = 60_000.0
"""How long a page may take (ms), in a browser without a graphics card on a busy machine."""

ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
"""Of a browser that asks nothing of anybody else."""


def chromium() -> str | None:
    """Return the browser to use: that of `SLIDE_CHROMIUM`, or the system's; None if there is none."""
    return os.environ.get("SLIDE_CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")


@contextmanager
def run_browser() -> Iterator[Browser]:
    """Run the browser until the block is left.

    Raises:
        InputError: there is none.
        MissingExtraError: Playwright is not installed.
    """
    with extra("dev"):
        from playwright.sync_api import sync_playwright
    executable = chromium()
    if executable is None:
        raise InputError("no Chromium here: install it, or name it in SLIDE_CHROMIUM")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=ARGUMENTS)
        yield browser
        browser.close()
