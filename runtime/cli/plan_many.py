"""`slide-plan-many`: the plans of any number of commands, in shards."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from runtime.assess.assess import cannot_slide
from runtime.cli.console import DONE_BUT_MISSED, MM, AsJson, print_json, print_table, run, say
from runtime.cli.options import FrictionOptions, LimitOptions, SizeOptions, chosen
from runtime.commands.reading import Reading
from runtime.errors import InputError, OutputError, SlideError
from runtime.many.folder import Outcome, begin, describe, done_shards, failures, held, outcomes
from runtime.many.lerobot import check_new, write_dataset
from runtime.many.records import SHARD_COMMANDS, Shard, Source, open_source
from runtime.many.shard import Done, Task, plan_shard
from runtime.many.workers import check_ray, work_through
from runtime.network.bundle import Bundle
from runtime.outputs.parquet_file import check_parquet
from runtime.physics.compiled import compiler
from runtime.planner import DEFAULT_BUNDLE

NAME = "slide-plan-many"

COMPILED_FROM = 2000
"""Commands from which on numba's law saves more time than it takes to compile; see `compile_law`."""

SAID_EVERY = 30.0
"""Time between two lines on the progress where there is no terminal (s)."""


def plan_many_main() -> None:
    """Entry point of `slide-plan-many`."""
    run(NAME, slide_plan_many)


def slide_plan_many(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="INPUT",
            help="A folder of command files, Parquet with a row for each command, or .ndjson.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder of the plans.", metavar="DIR", show_default=False)
    ],
    reading: Reading,
    workers: Annotated[
        int, typer.Option("--workers", min=0, help="Processes that plan; 0 for one a core.", metavar="N")
    ] = 1,
    ray: Annotated[
        str | None, typer.Option("--ray", help="Plan on a Ray cluster: its address, or local.", metavar="ADDRESS")
    ] = None,
    states: Annotated[
        bool, typer.Option("--states", help="Write the states of pan and object, too: ten times the size.")
    ] = False,
    lerobot: Annotated[
        Path | None,
        typer.Option("--lerobot", help="Write a LeRobotDataset v3 of the plans, too.", metavar="DIR"),
    ] = None,
    shard: Annotated[
        int, typer.Option("--shard", min=1, help="Commands whose plans are one file.", metavar="N")
    ] = SHARD_COMMANDS,
    model: Annotated[
        Path | None, typer.Option("--model", help="Bundle folder; the shipped one if not given.", metavar="DIR")
    ] = None,
    friction: FrictionOptions = FrictionOptions(),
    limits: LimitOptions = LimitOptions(),
    tolerance: Annotated[
        float | None, typer.Option("--tolerance", help="Tracking RMSE to hold the plans against (m).", metavar="M")
    ] = None,
    sizes: SizeOptions = SizeOptions(),
    as_json: AsJson = False,
) -> None:
    """Plan many commands, and write the plans as shards of Parquet.

    The same command given again goes on where it was stopped. The plans are the same, to the last bit, however many
    processes make them.
    """
    check_parquet()
    if lerobot is not None:
        check_new(lerobot)
    check_apart(source, output)
    if ray is not None:
        check_ray()
    found = open_source(source)
    bundle = Bundle.load(DEFAULT_BUNDLE if model is None else model)
    manifest = bundle.manifest
    task = Task(
        folder=output,
        bundle=None if model is None else bundle.path,
        sha256=bundle.sha256,
        reading=reading,
        friction=chosen(friction, manifest.friction),
        limits=limits.chosen(manifest.limits),
        sizes=chosen(sizes, manifest.sizes),
        tolerance=tolerance,
        states=states or lerobot is not None,
        compiled=found.count >= COMPILED_FROM and compiler() is not None,
    )
    if found.passed:
        say(NAME, f"note: passed {', '.join(found.passed)} by")
    for line in cannot_slide(task.friction, task.limits):
        say(NAME, f"warning: {line}")
    with held(output):
        going_on = begin(output, describe(found, task, shard))
        progress = Progress(found.count)
        try:
            done = done_shards(output)
            if going_on and done:
                say(NAME, f"going on: {len(done)} shards are written")
            missing = _missing(found.shards(shard), done, progress)
            planned = work_through(missing, partial(plan_shard, task), workers or os.cpu_count() or 1, ray)
            with_progress(planned, progress)
        except KeyboardInterrupt:
            say(NAME, f"interrupted: {progress.so_far()}; the same command goes on from here")
            raise
        except OutputError as error:
            raise OutputError(
                f"{error}; {progress.so_far()}, which are whole. Once it can be written, the same command goes on from "
                "here"
            ) from error
        if lerobot is not None:
            say(NAME, f"{lerobot}: {write_dataset(output, lerobot):,} episodes")
    _conclude(output, found, as_json)


def check_apart(source: Path, output: Path) -> None:
    """Check that the plans are not written into the folder of the commands: the next run would take them for some.

    Raises:
        InputError: they are.
    """
    if source.is_dir() and output.resolve().is_relative_to(source.resolve()):
        raise InputError(f"{output}: is in the folder of the commands, {source}: give another folder for the plans")


def _missing(shards: Iterable[Shard], done: set[int], progress: Progress) -> Iterator[Shard]:
    """Yield the shards that are not written yet."""
    for shard in shards:
        if shard.number in done:
            progress.before += len(shard.records)
        else:
            yield shard


class Progress:
    """How far a run is.

    Attributes:
        total: commands of the input.
        before: those that were done before this run.
        now: those that this run has done.
    """

    def __init__(self, total: int) -> None:
        self.total, self.before, self.now = total, 0, 0
        self._begin = time.monotonic()

    def so_far(self) -> str:
        """Say how many commands are done."""
        return f"{self.before + self.now:,} of {self.total:,} commands are done"

    def line(self) -> str:
        """Say how many are done, how fast, and how long it will take."""
        rate = self.now / max(time.monotonic() - self._begin, 1e-9)
        left = (self.total - self.before - self.now) / rate if rate else 0.0
        return f"{self.so_far()}, {rate:,.0f} a second, {duration(left)} left"


def duration(seconds: float) -> str:
    """Return a time in words: 40 s, 12 min, 3.5 h."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 100.0 * 60.0 else f"{seconds / 3600.0:.1f} h"


def with_progress(shards: Iterable[Done], progress: Progress) -> None:
    """Go through the shards as they are done, and say how far it is: in a bar on a terminal, otherwise now and then."""
    from rich.console import Console  # rich takes as long to import as all the rest of a short program
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    said = time.monotonic()
    columns = BarColumn(), TextColumn("{task.description}")
    hidden = not sys.stderr.isatty()
    with Bar(*columns, console=Console(stderr=True), transient=True, disable=hidden) as bar:
        shown = bar.add_task("planning", total=progress.total)
        for done in shards:
            progress.now += done.plans + done.failures
            bar.update(shown, completed=progress.before + progress.now, description=progress.line())
            if hidden and time.monotonic() - said > SAID_EVERY:
                said = time.monotonic()
                say(NAME, progress.line())


def _conclude(folder: Path, source: Source, as_json: bool) -> None:
    """Print what came of all commands; exit with 1 if something must be looked at."""
    found, (failed, first) = outcomes(folder), failures(folder)
    plans = sum(each.plans for each in found)
    if plans + failed != source.count:
        raise SlideError(f"{folder}: {plans + failed} of {source.count} commands are done: the input changed meanwhile")
    if as_json:
        print_json(
            {
                "plans": plans,
                "failures": failed,
                "statuses": {each.status.value: each.plans for each in found},
                "tracking_rmse_median": {each.status.value: each.tracking_rmse for each in found},
            }
        )
    else:
        rows = [
            (each.status.value, f"{each.plans:,}", f"{each.plans / plans:.1%}", f"{each.tracking_rmse * MM:.2f}")
            for each in found
        ]
        print_table(f"{folder}: {plans:,} plans", rows, ("status", "plans", "share", "median RMSE (mm)"))
    for line in first:
        say(NAME, f"error: {line}")
    lines = []
    if failed:
        are = "is no command" if failed == 1 else "are no commands"
        lines.append(f"{failed:,} of {source.count:,} {are}: see {folder / 'failures-*.parquet'}")
    poor = [each for each in found if each.status.failed]
    if poor:
        lines.append(", ".join(_poor(each) for each in poor))
    if lines:
        say(NAME, "; ".join(lines))
        raise typer.Exit(DONE_BUT_MISSED)


def _poor(outcome: Outcome) -> str:
    are = "1 plan is" if outcome.plans == 1 else f"{outcome.plans:,} plans are"
    return f"{are} {outcome.status.value.replace('_', ' ')}"
