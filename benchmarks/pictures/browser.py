"""The browser that pictures are taken with, and that the tests look at pages with."""

from __future__ import annotations

import os
import shutil

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
