"""`python -m benchmarks.pictures.screenshots docs/pictures`: pictures of page and report for the documents."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmarks.pictures.browser import PATIENCE, run_browser
from benchmarks.pictures.page import seek, settle
from benchmarks.serving.process import serving
from runtime.cli.console import run, say
from runtime.command import Command
from runtime.friction import Friction
from runtime.planner import Planner
from runtime.report.report import write_report

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

NAME = "benchmarks.pictures.screenshots"
REPORTED = Path(__file__).resolve().parents[2] / "examples" / "figure_eight.csv"
MOMENT = 0.62
"""When the animation is looked at (s)."""

PUSHED = 1.2
"""When the object is pushed that is followed in closed loop (s)."""

OFF_THE_PAN = "t,x,y\n0,0,0\n0.5,0.06,0.02\n1,0.13,-0.02\n1.5,0.19,0\n"
"""A command that leaves the pan."""


def screenshots(
    folder: Annotated[Path, typer.Argument(help="Where the pictures go.", show_default=False)],
) -> None:
    """Plan on the page, wide, narrow, dark, off the pan, in closed loop and with an arm, and in a report."""
    with serving() as server, run_browser() as browser, tempfile.TemporaryDirectory() as made:
        address = f"http://127.0.0.1:{server.port}"
        _take(_example(browser, address, 1280, "light", "Signature"), folder / "page-wide.png")
        _take(_example(browser, address, 360, "light", "Eight"), folder / "page-narrow.png")
        _take(_example(browser, address, 1280, "dark", "Strokes"), folder / "page-dark.png")
        _take(_with_arm(browser, address), folder / "page-arm.png")
        _take(_in_closed_loop(browser, address), folder / "page-loop.png", whole=False)
        _take(_off_the_pan(browser, address, Path(made)), folder / "page-off-pan.png", whole=False)
        report = Path(made) / "report.html"
        write_report(report, Planner().plan(Command.load(REPORTED).position, friction=Friction(1.0, 0.5)))
        page = _open(browser, 1280, "light", report.as_uri())
        seek(page, MOMENT)
        _take(page, folder / "report.png")


def _example(browser: Browser, address: str, width: int, scheme: str, example: str) -> Page:
    page = _open(browser, width, scheme, address)
    page.get_by_role("button", name=example, exact=True).click()
    settle(page)
    seek(page, MOMENT)
    return page


def _with_arm(browser: Browser, address: str) -> Page:
    """Show an arm's limits and the arm that keeps them, beside the pan."""
    page = _open(browser, 1280, "light", address)
    page.locator("#limits-row summary").click()
    page.select_option("#arm", label="UR10e, level")
    page.select_option("#pan", index=3)  # of steel
    page.locator("#arm-card summary").click()
    page.get_by_role("button", name="Circle", exact=True).click()
    settle(page)
    page.wait_for_selector("#arm-card[data-shows=ur10e]")
    seek(page, MOMENT)
    return page


def _in_closed_loop(browser: Browser, address: str) -> Page:
    """Pull the object off its path, and stop the clock."""
    page = _open(browser, 1280, "light", address)
    page.get_by_role("button", name="Circle", exact=True).click()
    settle(page)
    page.locator(".toggle:has(#closed)").click()
    page.wait_for_function("t => Number(document.getElementById('now').textContent) > t", arg=PUSHED)
    page.click("#push")
    page.wait_for_function("() => parseFloat(document.getElementById('hint').textContent.split(': ')[1]) > 10")
    page.click("#play")
    return page


def _off_the_pan(browser: Browser, address: str, folder: Path) -> Page:
    command = folder / "far.csv"
    command.write_text(OFF_THE_PAN)
    page = _open(browser, 1280, "light", address)
    page.set_input_files("#file", command)
    settle(page)
    seek(page, 1.35)
    return page


def _open(browser: Browser, width: int, scheme: str, url: str, height: int = 900) -> Page:
    page = browser.new_page(
        viewport={"width": width, "height": height},
        reduced_motion="reduce",
        color_scheme=scheme,  # type: ignore[arg-type]
    )
    page.set_default_timeout(PATIENCE)
    page.goto(url)
    page.wait_for_selector("body[data-ready]")
    return page


def _take(page: Page, picture: Path, whole: bool = True) -> None:
    page.screenshot(path=picture, full_page=whole)
    page.close()
    say(NAME, f"wrote {picture}")


if __name__ == "__main__":
    run(NAME, screenshots)
