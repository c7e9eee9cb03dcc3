"""What all tests share: a browser for report and page, and patience with a busy machine."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

from benchmarks.pictures.browser import ARGUMENTS, PATIENCE, chromium

# An example of hypothesis may take as long as it needs: on a busy machine a deadline fails what is right.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, Page


Program = Callable[..., tuple[int, str, str]]


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., Program]:
    """Make a function of a program's entry point and name, and the terminal's width if it counts.

    The function takes the program's arguments, runs it in this process, and gives its exit code, standard output and
    standard error.
    """

    def of(main: Callable[[], None], name: str, columns: int | None = None) -> Program:
        def call(*arguments: object) -> tuple[int, str, str]:
            monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
            if columns is not None:
                monkeypatch.setenv("COLUMNS", str(columns))
            capfd.readouterr()
            with pytest.raises(SystemExit) as ended:
                main()
            code = ended.value.code
            return (code if isinstance(code, int) else 0, *capfd.readouterr())

        return call

    return of


@pytest.fixture(scope="module")  # no longer: while Playwright runs, asyncio.run does not
def browser() -> Iterator[Browser]:
    executable = chromium()
    if executable is None and not os.environ.get("CI"):
        pytest.skip("no Chromium here: install it, or name it in SLIDE_CHROMIUM")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=executable, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Open a page; at the end, nothing may have been asked of anybody but its origin, and nothing complained."""
    contexts: list[BrowserContext] = []
    asked: list[str] = []
    complaints: list[str] = []
    origins: set[str] = set()

    def open_it(
        url: str, width: int = 1280, height: int = 900, complains: bool = False, calm: bool = True, **options: Any
    ) -> Page:
        motion: Any = "reduce" if calm else "no-preference"
        context = browser.new_context(viewport={"width": width, "height": height}, reduced_motion=motion, **options)
        context.set_default_timeout(PATIENCE)
        contexts.append(context)
        origins.add(url.partition("#")[0])
        page = context.new_page()
        page.on("request", lambda request: asked.append(request.url))
        if not complains:
            page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(url)
        page.wait_for_selector("body[data-ready]")
        return page

    yield open_it
    for context in contexts:
        context.close()
    elsewhere = [url for url in asked if not url.startswith((*origins, "blob:"))]
    assert elsewhere == []
    assert complaints == []
