"""`python -m benchmarks.pictures.drawing docs/pictures/drawing.webp`: a path drawn on the page, and its plan."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmarks.pictures.browser import PATIENCE, run_browser
from benchmarks.pictures.moving import FRAME, HOLD, QUALITY, SLOWER
from benchmarks.pictures.page import loop_on, seek, settle
from benchmarks.serving.process import serving
from runtime.cli.console import run, say
from runtime.errors import extra

if TYPE_CHECKING:
    from PIL.Image import Image
    from playwright.sync_api import Page

NAME = "benchmarks.pictures.drawing"

WIDTH, HEIGHT = 1000, 760
"""Of the window (px)."""

SHRUNK = 0.6
"""Size of the picture over that of the window."""

TURNS = 1.0
"""Of the loop that is drawn."""


def drawing(
    picture: Annotated[Path, typer.Argument(help="Picture to write, .webp.", show_default=False)],
) -> None:
    """Draw a loop on the page of a server, and film how it is drawn, planned and played, four times slower."""
    with extra("dev"):
        from PIL import Image
    with serving() as server, run_browser() as browser:
        page = browser.new_page(
            viewport={"width": WIDTH, "height": HEIGHT}, reduced_motion="reduce", color_scheme="light"
        )
        page.set_default_timeout(PATIENCE)
        page.goto(f"http://127.0.0.1:{server.port}")
        page.wait_for_selector("body[data-ready]")
        size = round(WIDTH * SHRUNK), round(HEIGHT * SHRUNK)
        first, *others = [_small(Image.open(io.BytesIO(shot)), size) for shot in _shots(page)]
    durations = [round(FRAME * 1e3)] * len(others) + [round(HOLD * 1e3)]
    first.save(picture, save_all=True, append_images=others, duration=durations, loop=0, quality=QUALITY, method=6)
    say(NAME, f"wrote {picture}")


def _shots(page: Page) -> Iterator[bytes]:
    """Yield pictures of the window: the pen on its way, then the pan."""
    points = loop_on(page, TURNS)
    page.mouse.move(*points[0])
    page.mouse.down()
    for point in points[1:]:
        page.mouse.move(*point)
        yield page.screenshot()
    page.mouse.up()
    settle(page)
    page.evaluate("scrollTo(0, 0)")
    end = page.locator("#scrub").evaluate("(s) => Number(s.max)")
    step = FRAME / SLOWER
    for k in range(int(end / step) + 1):
        seek(page, k * step)
        yield page.screenshot()


def _small(shot: Image, size: tuple[int, int]) -> Image:
    return shot.convert("RGB").resize(size)


if __name__ == "__main__":
    run(NAME, drawing)
