"""`python -m benchmarks.pictures.moving docs/pictures/plan.webp`: a report's animation as a moving picture."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmarks.pictures.browser import PATIENCE, run_browser
from benchmarks.pictures.page import seek
from runtime import Command, Plan, Planner
from runtime.cli.console import run, say
from runtime.errors import extra
from runtime.report.report import write_report

if TYPE_CHECKING:
    from PIL.Image import Image

NAME = "benchmarks.pictures.moving"
COMMAND = Path(__file__).resolve().parents[2] / "examples" / "figure_eight.csv"

SLOWER = 4.0
"""How many times slower than in reality the plan plays."""

FRAME = 0.05
"""Time between two frames as played (s)."""

HOLD = 1.0
"""How long the last frame stays before the picture begins again (s)."""

WIDTH = 520
"""Of the report's window (px): narrow, so that pan and plots stand below each other."""

QUALITY = 60
"""Of the picture, of 100."""


def moving(
    picture: Annotated[Path, typer.Argument(help="Picture to write, .webp.", show_default=False)],
    command: Annotated[Path, typer.Option("--command", help="Command to plan.")] = COMMAND,
) -> None:
    """Plan a command and film the pan in its report."""
    first, *others = film(Planner().plan(Command.load(command)))
    durations = [round(FRAME * 1e3)] * len(others) + [round(HOLD * 1e3)]
    first.save(picture, save_all=True, append_images=others, duration=durations, loop=0, quality=QUALITY, method=6)
    say(NAME, f"wrote {picture}")


def film(plan: Plan) -> list[Image]:
    """Return what a plan's report shows of the pan, frame by frame.

    Raises:
        InputError: there is no Chromium.
    """
    with extra("dev"):
        from PIL import Image
    with run_browser() as browser, tempfile.TemporaryDirectory() as made:
        report = Path(made) / "report.html"
        write_report(report, plan)
        page = browser.new_page(viewport={"width": WIDTH, "height": 900}, reduced_motion="reduce", color_scheme="light")
        page.set_default_timeout(PATIENCE)
        page.goto(report.as_uri())
        page.wait_for_selector("body[data-ready]")
        stage = page.locator("#stage")
        step = round(FRAME / SLOWER / plan.dt)
        shots = []
        for k in range(0, len(plan), step):
            seek(page, k * plan.dt)
            shots.append(stage.screenshot())
    return [Image.open(io.BytesIO(shot)).convert("RGB") for shot in shots]


if __name__ == "__main__":
    run(NAME, moving)
