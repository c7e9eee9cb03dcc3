"""`slide-plan`: from one command or many to plans.

Exit codes: 0 done, 1 done but a plan is of a status from `poor` on (said in one line), 2 bad input or usage, 130
interrupted. Of many commands, those that cannot be planned are said one by one, the others are planned all the same,
and the program exits with 2.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from runtime.arms.fit import CANDIDATES, Fitted, fit, pan_limits
from runtime.arms.model import ArmModel
from runtime.arms.motion import passed
from runtime.arms.options import ArmChoice, choose
from runtime.arms.place import Place
from runtime.assess.assess import cannot_slide, left_behind
from runtime.cli.console import BAD_INPUT, DONE_BUT_MISSED, MM, AsJson, print_json, print_table, run, say
from runtime.cli.options import (
    FrictionOptions,
    LimitOptions,
    SearchOptions,
    SizeOptions,
    chosen,
    conclude,
    friction_off,
    reach_of_limit,
    speed_of_limit,
)
from runtime.command import Command
from runtime.commands.files import STANDARD_INPUT
from runtime.commands.reading import Reading
from runtime.documents.writing import check_writable, is_standard_output
from runtime.errors import InputError, OutputError, SlideError
from runtime.limits import Limits
from runtime.outputs.formats import FORMATS, format_of
from runtime.physics.law import DT
from runtime.plan import Plan
from runtime.planner import Planner
from runtime.refine.refine import kernels

PAPER_SAMPLES_PER_SECOND = 622.0
"""Planning speed of the paper: 1200 samples in 1.93 s on an Intel Core i7-6700 (Section V-B)."""


@dataclass(frozen=True)
class Made:
    """A plan that was made and written.

    Attributes:
        source: the command's file.
        target: the plan's file.
        command: the command.
        plan: the plan.
        duration: time that planning took (s).
        fitted: how it fits the arm that was chosen, None if none was.
    """

    source: Path
    target: Path
    command: Command
    plan: Plan
    duration: float
    fitted: Fitted | None = None

    @property
    def passed(self) -> list[str]:
        """What an arm passes or cannot do, a line each."""
        if self.fitted is None:
            return []
        exceeded = self.fitted.joints.exceeded
        return [*([passed(exceeded)] if exceeded else []), *self.fitted.notes]


def plan_main() -> None:
    """Entry point of `slide-plan`."""
    run("slide-plan", slide_plan)


def slide_plan(
    commands: Annotated[
        list[Path],
        typer.Argument(help="Commands: tables, JSON, npz, npy, Parquet, SVG; - is standard input.", show_default=False),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Plan to write: .json, .npz, .csv or .parquet, - is standard output; of many, their folder.",
            show_default=False,
        ),
    ],
    reading: Reading,
    model: Annotated[
        Path | None, typer.Option("--model", help="Bundle folder; the shipped one if not given.", metavar="DIR")
    ] = None,
    friction: FrictionOptions = FrictionOptions(),
    limits: LimitOptions = LimitOptions(),
    search: SearchOptions = SearchOptions(),
    tolerance: Annotated[
        float | None, typer.Option("--tolerance", help="Tracking RMSE to hold the plan against (m).", metavar="M")
    ] = None,
    sizes: SizeOptions = SizeOptions(),
    arm: ArmChoice = ArmChoice(),
    stretch: Annotated[
        bool, typer.Option("--stretch", help="With --arm: slow the command down until its joints hold.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Plan the motion of the pan that slides the object along a command, or along each of many.

    slide-info shows the model's friction, limits and radii, which count unless others are given. With --arm the pan is
    kept to what the arm's joints can do.
    """
    output = Path("/dev/stdout") if str(output) == "-" else output
    many = len(commands) > 1 or (output.is_dir() and not output.suffix)
    targets = _targets(commands, output) if many else [output]
    if not many:
        format_of(output)
        check_writable(output)
    if arm.arm is None and (arm.given or stretch):
        raise InputError(f"{[*arm.given, '--stretch'][0]} needs --arm")
    first = None if many else Command.load(commands[0], reading)
    planner = Planner(model)
    manifest = planner.bundle.manifest
    asked = {
        "friction": chosen(friction, manifest.friction),
        "limits": limits.chosen(manifest.limits),
        "sizes": chosen(sizes, manifest.sizes),
        "tolerance": tolerance,
        **vars(search),
    }
    held_by = None if arm.arm is None else choose(arm)
    if held_by is not None and search.candidates is None:
        asked["candidates"] = CANDIDATES
    if search.refine_ms:
        kernels()  # compiles, which is not planning
    maker = Maker(planner, asked, held_by, stretch)
    warned = cannot_slide(asked["friction"], maker.limits)
    for line in warned:
        say("slide-plan", f"warning: {line}")
    if first is not None:
        _plan_one(maker, commands[0], output, first, warned, as_json)
    else:
        _plan_each(maker, list(zip(commands, targets, strict=True)), reading, output, as_json)


@dataclass(frozen=True)
class Maker:
    """Makes plans, and writes them.

    Attributes:
        planner: plans.
        asked: what it is asked, besides the command.
        held_by: the arm that holds the pan, and where; None for none.
        stretch: whether a command is slowed down until the arm's joints hold.
    """

    planner: Planner
    asked: dict[str, Any]
    held_by: tuple[ArmModel, Place] | None
    stretch: bool

    @property
    def limits(self) -> Limits:
        """What the pan is kept to, the arm's limits included."""
        limits: Limits = self.asked["limits"]
        return limits if self.held_by is None else pan_limits(*self.held_by, limits)

    def make(self, source: Path, target: Path, command: Command) -> Made:
        """Plan a command, and write the plan.

        Raises:
            SlideError: it cannot be planned, or not be written.
        """
        begin, fitted = time.perf_counter(), None
        if self.held_by is None:
            plan = self.planner.plan(command, **self.asked)
        else:
            fitted = fit(
                self._within, command, *self.held_by, self.asked["limits"], self.stretch, self.asked["tolerance"]
            )
            command, plan = fitted.command, fitted.plan
        duration = time.perf_counter() - begin
        plan.save(target)
        return Made(source, target, command, plan, duration, fitted)

    def _within(self, command: Command, limits: Limits) -> Plan:
        return self.planner.plan(command, **{**self.asked, "limits": limits})


def _plan_one(maker: Maker, source: Path, target: Path, command: Command, warned: Sequence[str], as_json: bool) -> None:
    """Plan one command; exit with 1 if something must be looked at that was not said in a warning."""
    _show(made := maker.make(source, target, command), as_json)
    if not made.plan.quality.status.failed:
        for line in left_behind(made.plan.quality.rest_error):
            say("slide-plan", f"note: {line}")
    conclude("slide-plan", made.plan, made.passed, said=warned)


def _plan_each(maker: Maker, jobs: Sequence[tuple[Path, Path]], reading: Reading, folder: Path, as_json: bool) -> None:
    """Plan commands, each to its target; exit with 2 if some cannot be planned, with 1 if some must be looked at."""
    documents: list[dict[str, Any]] = []
    missed, failed = [], {}
    for source, target in _with_progress(jobs):
        try:
            one = maker.make(source, target, Command.load(source, reading))
        except SlideError as error:
            failed[str(source)] = str(error)
        else:
            documents.append(_document(one))  # and not its plan, of which there may be thousands
            if one.plan.quality.status.failed:
                missed.append(f"{source}: {one.plan.quality.status.replace('_', ' ')}: {one.plan.quality.notes[0]}")
            missed += [f"{source}: {line}" for line in one.passed]
    _show_many(folder, documents, failed, as_json)
    for line in missed:
        say("slide-plan", line)
    if missed or failed:
        raise typer.Exit(BAD_INPUT if failed else DONE_BUT_MISSED)


def _targets(commands: Sequence[Path], folder: Path) -> list[Path]:
    """Return where each plan is written; makes the folder.

    Raises:
        InputError: two plans would have the same name.
        OutputError: the folder is a file, or cannot be made.
    """
    targets: dict[Path, Path] = {}
    for command in commands:
        stem = "stdin" if str(command) == STANDARD_INPUT else command.stem
        target = folder / f"{stem}.json"
        if target in targets:
            raise InputError(f"{targets[target]} and {command} would both be written to {target}")
        targets[target] = command
    if not folder.is_dir() and (folder.exists() or folder.suffix in FORMATS):
        raise OutputError(f"{folder}: cannot be written: {len(commands)} plans need a folder")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror}") from error
    for target in targets:
        check_writable(target)
    return list(targets)


def _with_progress(jobs: Sequence[tuple[Path, Path]]) -> Iterator[tuple[Path, Path]]:
    """Yield the jobs, with a bar on standard error if that is a terminal."""
    from rich.console import Console  # rich takes as long to import as all the rest of a short program
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        yield from progress.track(jobs, description="planning")


def _document(made: Made) -> dict[str, Any]:
    plan, speed = made.plan, len(made.plan) / made.duration
    return {
        "command": str(made.source),
        "reading": list(made.command.notes),
        "plan": str(made.target),
        "model": {"name": plan.model_name, "sha256": plan.model_sha256},
        "friction": plan.friction.to_dict(),
        "sizes": plan.sizes.to_dict(),
        "samples": len(plan),
        "quality": plan.quality.to_dict(),
        "planning_time": made.duration,
        "samples_per_second": speed,
        "ratio_to_paper": speed / PAPER_SAMPLES_PER_SECOND,
        **({} if made.fitted is None else {"arm": made.fitted.to_dict()}),
    }


def _show(made: Made, as_json: bool) -> None:
    """Print one plan, on standard error if the plan itself is on standard output."""
    taken = is_standard_output(made.target)
    if made.command.notes:
        say("slide-plan", f"note: {'; '.join(made.command.notes)}")
    if as_json:
        print_json(_document(made), stderr=taken)
    else:
        plan, quality, speed = made.plan, made.plan.quality, len(made.plan) / made.duration
        rest = quality.rest_error
        rows = [
            ("tracking RMSE", f"{quality.tracking_rmse * MM:.2f} mm"),
            ("tracking maximum", f"{quality.tracking_max * MM:.2f} mm"),
            ("RMSE if friction is 10 % off", friction_off(plan)),
            ("stop after the end", f"{len(plan.stop_acceleration)} ms"),
            ("object to command after it", "not known" if rest is None else f"{rest * MM:.2f} mm"),
            ("pan reach", reach_of_limit(plan)),
            ("pan speed", speed_of_limit(plan)),
            ("pan, object radius", f"{plan.sizes.pan_radius * MM:g} mm, {plan.sizes.object_radius * MM:g} mm"),
            ("share of time sliding", f"{quality.sliding_share:.1%}"),
            *_arm_rows(made.fitted),
            ("samples governed", f"{0 if quality.governed is None else quality.governed.samples}"),
            *([("off its waypoints' lines", f"{made.command.deviation * MM:.1f} mm")] if made.command.remarks else []),
            ("planning time", f"{made.duration * 1e3:.1f} ms for {len(plan)} samples"),
            ("samples per second", f"{speed:,.0f}, {speed / PAPER_SAMPLES_PER_SECOND:.0f} x the paper's 622"),
        ]
        print_table(f"{'standard output' if taken else made.target}: {quality.status}", rows, stderr=taken)


def _arm_rows(fitted: Fitted | None) -> list[tuple[str, str]]:
    if fitted is None:
        return []
    limits, worst = fitted.limits, fitted.joints.worst
    return [
        ("arm", f"{fitted.joints.arm.title}, its joints {'hold' if fitted.holds else 'do not hold'}"),
        ("command slowed down", f"{fitted.stretch:.2f} times"),
        ("pan's limits", f"{limits.speed:.2f} m/s, {limits.acceleration:.1f} m/s^2, {limits.jerk:,.0f} m/s^3"),
        *([] if worst is None else [("nearest its limit", f"{worst.quantity} of {worst.part}, {worst.share:.0%}")]),
    ]


def _show_many(folder: Path, made: Sequence[dict[str, Any]], failed: dict[str, str], as_json: bool) -> None:
    """Print a table of the plans, and a line for each command that has none."""
    for each in made:
        if each["reading"]:
            say("slide-plan", f"note: {each['command']}: {'; '.join(each['reading'])}")
    if as_json:
        print_json({"plans": made, "failed": [{"command": name, "error": error} for name, error in failed.items()]})
    elif made:
        figures = ("tracking_rmse", "tracking_max")
        rows = [
            (
                Path(each["command"]).name,
                each["quality"]["status"],
                *(f"{each['quality'][name] * MM:.2f}" for name in figures),
                f"{each['samples'] * DT:.2f}",
            )
            for each in made
        ]
        header = ("command", "status", "RMSE (mm)", "maximum (mm)", "time (s)")
        print_table(f"{folder}: {len(made)} plans", rows, header)
    for name, error in failed.items():
        say("slide-plan", f"error: {error if error.startswith(name) else f'{name}: {error}'}")
