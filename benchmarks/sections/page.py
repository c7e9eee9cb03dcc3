"""The page in a browser: from the pen that is lifted to the pan that moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject, at_least
from benchmarks.harness.tables import span, targets_table
from benchmarks.harness.targets import MILLISECONDS, Target, Verdict
from benchmarks.harness.timing import Spread
from benchmarks.pictures.browser import PATIENCE, run_browser
from benchmarks.pictures.page import draw, settle
from benchmarks.serving.process import serving
from runtime.documents.options import option

if TYPE_CHECKING:
    from playwright.sync_api import Page

WATCH = """
window.penUp = [];
addEventListener("pointerup", () => {
  const begun = performance.now(), still = document.getElementById("now").textContent;
  const look = () => {
    const played = document.getElementById("stage-card").dataset.mode === "play";
    const now = document.getElementById("now").textContent;
    if (played && now !== still && Number(now) > 0) window.penUp.push(performance.now() - begun);
    else requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
}, true);
"""
"""Notes the time (ms) from each pen that is lifted to the first frame in which the pan has moved."""


@dataclass(frozen=True)
class PageSettings:
    """How much is drawn.

    Attributes:
        drawings: loops drawn on the pan, after one that does not count.
    """

    drawings: int = option("Loops drawn on the page.", 25)

    def __post_init__(self) -> None:
        at_least(1, drawings=self.drawings)


@dataclass(frozen=True)
class PageFigures:
    """Everything this section measures.

    Attributes:
        pen_up: time from the pen that is lifted to the first frame in which the pan has moved (s).
    """

    pen_up: Spread


TARGETS = (Target("pen_up.median", "pen up to moving pan, median", MILLISECONDS, "<=", 0.15),)


def measure_page(subject: Subject, settings: PageSettings) -> Measured:
    """Draw on the page of a server that plans with the bundle.

    Raises:
        InputError: there is no browser.
        SlideError: the server ends.
        MissingExtraError: Playwright is not installed.
    """
    with serving(subject.folder) as server, run_browser() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 900}, reduced_motion="no-preference")
        page.set_default_timeout(PATIENCE)
        page.add_init_script(WATCH)
        page.goto(f"http://127.0.0.1:{server.port}")
        page.wait_for_selector("body[data-ready]")
        times = [_time_of(page, 0.6 + 0.4 * k / settings.drawings) for k in range(settings.drawings + 1)]
    return Measured(PageFigures(Spread.of(np.array(times[1:]))))


def _time_of(page: Page, turns: float) -> float:
    """Draw a loop, and return the time until the pan moves (s)."""
    before = page.evaluate("penUp.length")
    draw(page, turns)
    page.wait_for_function("(count) => penUp.length > count", arg=before)
    settle(page)  # the better plan, which is asked for afterwards
    time: float = page.evaluate("penUp.at(-1)")
    return time * 1e-3


def page_tables(figures: PageFigures, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the page's figures, beside their targets."""
    details = {"pen_up.median": [span(figures.pen_up, MILLISECONDS)]}
    return targets_table(f"The page, {figures.pen_up.count} drawings", verdicts, details)


SECTION = Section(
    "page",
    "the page in a browser: from the pen that is lifted to the pan that moves",
    PageSettings(),
    measure_page,
    TARGETS,
    page_tables,
    timed=True,
    usual=False,
)
