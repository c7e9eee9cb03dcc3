"""`python -m benchmarks.pictures.screenshots docs`: pictures of page and report for the documents."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmarks.pictures.browser import ARGUMENTS, PATIENCE, chromium
from benchmarks.serving.process import serving
from runtime.cli.console import run, say
from runtime.command import Command
from runtime.errors import InputError, extra
from runtime.friction import Friction
from runtime.planner import Planner
from runtime.report.report import write_report

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

NAME = "benchmarks.pictures.screenshots"
REPORTED = Path(__file__).resolve().parents[2] / "examples" / "figure_eight.csv"
MOMENT = 0.62
"""When the report's animation is looked at (s)."""


def screenshots(
    folder: Annotated[Path, typer.Argument(help="Where the pictures go.", show_default=False)],
) -> None:
    """Plan the example on the page, wide, narrow and dark, and in a report, and take pictures of them."""
    with extra("dev"):
        from playwright.sync_api import sync_playwright
    executable = chromium()
    if executable is None:
        raise InputError("no Chromium here: install it, or name it in SLIDE_CHROMIUM")
    with serving() as server, sync_playwright() as playwright, tempfile.TemporaryDirectory() as made:
        browser = playwright.chromium.launch(executable_path=executable, args=ARGUMENTS)
        _take_page(browser, server.port, folder / "page-wide.png", 1280, "light", "Signature")
        _take_page(browser, server.port, folder / "page-narrow.png", 360, "light", "Eight")
        _take_page(browser, server.port, folder / "page-dark.png", 1280, "dark", "Strokes")
        report = Path(made) / "report.html"
        write_report(report, Planner().plan(Command.load(REPORTED).position, friction=Friction(1.0, 0.5)))
        page = _open(browser, 1280, "light", report.as_uri())
        _seek(page, MOMENT)
        _take(page, folder / "report.png")
        browser.close()


def _take_page(browser: Browser, port: int, picture: Path, width: int, scheme: str, example: str) -> None:
    page = _open(browser, width, scheme, f"http://127.0.0.1:{port}")
    page.wait_for_selector("body[data-ready]")
    page.get_by_role("button", name=example, exact=True).click()
    page.wait_for_selector("#quality:not([hidden])")
    page.wait_for_selector("#plan:text('Plan again')")  # and no better plan is waited for
    _seek(page, MOMENT)
    _take(page, picture)


def _open(browser: Browser, width: int, scheme: str, url: str) -> Page:
    page = browser.new_page(viewport={"width": width, "height": 900}, reduced_motion="reduce", color_scheme=scheme)  # type: ignore[arg-type]
    page.set_default_timeout(PATIENCE)
    page.goto(url)
    return page


def _seek(page: Page, t: float) -> None:
    page.locator("#scrub").evaluate("(s, t) => { s.value = t; s.dispatchEvent(new Event('input')); }", t)


def _take(page: Page, picture: Path) -> None:
    page.screenshot(path=picture, full_page=True)
    say(NAME, f"wrote {picture}")


if __name__ == "__main__":
    run(NAME, screenshots)
