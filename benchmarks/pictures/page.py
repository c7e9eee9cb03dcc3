"""What one does on the page: draw, plan, wait until a plan is played, go to a moment of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from playwright.sync_api import Page

POINTS = 41
"""Of a loop that is drawn."""


def loop_on(page: Page, turns: float = 1.0) -> list[tuple[float, float]]:
    """Return the points of a loop on the pan, in pixels of the window."""
    box = page.locator("#stage").bounding_box()
    assert box is not None
    x, y, r = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, min(box["width"], box["height"]) * 0.14
    angles = [2 * math.pi * turns * k / (POINTS - 1) for k in range(POINTS)]
    return [(x + r * math.sin(angle), y - r * math.cos(angle)) for angle in angles]


def draw(page: Page, turns: float = 1.0) -> None:
    """Draw a loop on the pan with the mouse."""
    points = loop_on(page, turns)
    page.mouse.move(*points[0])
    page.mouse.down()
    for point in points[1:]:
        page.mouse.move(*point)
    page.mouse.up()


def plan(page: Page) -> dict[str, Any]:
    """Press Plan, wait until a plan is shown, and return what the server was asked."""
    with page.expect_request("**/plan") as request:
        page.click("#plan")
    settle(page)
    return dict(request.value.post_data_json or {})


def settle(page: Page) -> None:
    """Wait until a plan is shown with its plots, and no better one is asked for."""
    page.wait_for_selector("#quality:not([hidden])")
    page.wait_for_selector("#plan:text-is('Plan again')")
    page.wait_for_selector("#plots figure:nth-of-type(6) svg", state="attached")


def seek(page: Page, t: float) -> None:
    """Show the moment t (s) of what is played."""
    page.locator("#scrub").evaluate("(s, t) => { s.value = t; s.dispatchEvent(new Event('input')); }", t)
