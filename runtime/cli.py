"""The command line: `slide-plan`, `slide-run` and `slide-info`.

Exit codes: 0 done, 1 done but a limit was missed (said in one line), 2 bad input or usage, 130 interrupted.
"""

from __future__ import annotations

import functools
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from runtime.arm.options import ArmOptions
from runtime.bundle import BUNDLE_FORMAT, TRAINED_ON, Bundle
from runtime.command import Command
from runtime.documents import check_writable
from runtime.errors import InputError, MissingExtraError, SlideError
from runtime.friction import Friction
from runtime.limits import UNITS
from runtime.plan import Plan, Status, check_suffix, tracking_error
from runtime.planner import DEFAULT_BUNDLE, Planner
from runtime.report import Track, write_report

PAPER_SAMPLES_PER_SECOND = 622.0
"""Planning speed of the paper: 1200 samples in 1.93 s on an Intel Core i7-6700 (Section V-B)."""

MM = 1e3
"""Millimetres in a metre."""

DONE_BUT_MISSED = 1
BAD_INPUT = 2
INTERRUPTED = 130

Static = Annotated[float | None, typer.Option("--static", help="Static friction coefficient.", metavar="MU")]
Kinetic = Annotated[float | None, typer.Option("--kinetic", help="Kinetic friction coefficient.", metavar="MU")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of the table.")]


def run(name: str, command: Callable[..., None]) -> None:
    """Run a function as a program: typer reads its arguments, and an error is one line and an exit code.

    Args:
        name: the program's name, for its messages.
        command: what it does; its parameters are the program's.
    """

    @functools.wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
            sys.stdout.flush()  # a closed pipe shows here, and not in a traceback at the interpreter's end
        except SlideError as error:
            say(name, f"error: {error}")
            raise typer.Exit(BAD_INPUT) from None
        except BrokenPipeError:  # whoever read our output has seen enough; typer ends it quietly
            raise
        except OSError as error:
            say(name, f"error: {error}")
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            raise typer.Exit(INTERRUPTED) from None

    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    app.command(name)(guarded)
    app(prog_name=name)


def say(name: str, message: str) -> None:
    """Print one line on standard error, preceded by the program's name."""
    print(f"{name}: {' '.join(message.split())}", file=sys.stderr)


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Import inside this what an extra brings.

    Raises:
        MissingExtraError: a package is not installed; the message says what to install.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"{error.name} is not installed: pip install 'slide-planner[{name}]'") from error


def print_table(title: str, rows: Iterable[tuple[str, str]]) -> None:
    """Print names and values as a table on standard output."""
    from rich import box  # rich takes as long to import as all the rest of a short program
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for row in rows:
        table.add_row(*row)
    Console(markup=False, highlight=False).print(table)


def plan_main() -> None:
    """Entry point of `slide-plan`."""
    run("slide-plan", slide_plan)


def run_main() -> None:
    """Entry point of `slide-run`."""
    run("slide-run", slide_run)


def info_main() -> None:
    """Entry point of `slide-info`."""
    run("slide-info", slide_info)


def slide_plan(
    command_file: Annotated[Path, typer.Argument(help="Command: .csv, .json or .npz.", show_default=False)],
    output: Annotated[Path, typer.Option("--output", "-o", help="Plan to write: .json or .npz.", show_default=False)],
    model: Annotated[
        Path | None, typer.Option("--model", help="Bundle folder, or a shipped one: default, fp32.", metavar="DIR")
    ] = None,
    static: Static = None,
    kinetic: Kinetic = None,
    reach: Annotated[float | None, typer.Option("--reach", help="Limit on the pan's reach (m).", metavar="M")] = None,
    acceleration: Annotated[
        float | None, typer.Option("--acceleration", help="Limit on its acceleration (m/s^2).", metavar="A")
    ] = None,
    jerk: Annotated[float | None, typer.Option("--jerk", help="Limit on its jerk (m/s^3).", metavar="J")] = None,
    tolerance: Annotated[
        float | None, typer.Option("--tolerance", help="Tracking RMSE to hold the plan against (m).", metavar="M")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Plan the motion of the pan that slides the object along a command."""
    check_suffix(output)
    check_writable(output)
    command = Command.load(command_file)
    planner = Planner(model)
    friction = _friction(planner.bundle.manifest.friction, static, kinetic)
    given = {"pan_reach": reach, "acceleration": acceleration, "jerk": jerk}
    limits = replace(planner.bundle.manifest.limits, **{name: it for name, it in given.items() if it is not None})
    begin = time.perf_counter()
    plan = planner.plan(command, friction, limits=limits, tolerance=tolerance)
    duration = time.perf_counter() - begin
    plan.save(output)

    quality, speed = plan.quality, len(plan) / duration
    if as_json:
        print_json(
            {
                "plan": str(output),
                "model": {"name": plan.model_name, "sha256": plan.model_sha256},
                "friction": {"static": friction.static, "kinetic": friction.kinetic},
                "samples": len(plan),
                "quality": quality.to_dict(),
                "planning_time": duration,
                "samples_per_second": speed,
                "ratio_to_paper": speed / PAPER_SAMPLES_PER_SECOND,
            }
        )
    else:
        rows = [
            ("tracking RMSE", f"{quality.tracking_rmse * MM:.2f} mm"),
            ("tracking maximum", f"{quality.tracking_max * MM:.2f} mm"),
            ("pan reach", _reach(plan)),
            ("share of time sliding", f"{quality.sliding_share:.1%}"),
            ("samples governed", f"{0 if quality.governed is None else quality.governed.samples}"),
            ("planning time", f"{duration * 1e3:.1f} ms for {len(plan)} samples"),
            ("samples per second", f"{speed:,.0f}, {speed / PAPER_SAMPLES_PER_SECOND:.0f} x the paper's 622"),
        ]
        print_table(f"{output}: {quality.status}", rows)
    _conclude("slide-plan", plan)


def slide_run(
    plan_file: Annotated[Path, typer.Argument(help="Plan: .json or .npz.", show_default=False)],
    static: Static = None,
    kinetic: Kinetic = None,
    report: Annotated[
        Path | None, typer.Option("--report", help="Page to write, with the motion animated.", metavar="HTML")
    ] = None,
    pybullet: Annotated[
        bool, typer.Option("--pybullet", help="Execute on a simulated arm; what follows is for it.")
    ] = False,
    closed_loop: Annotated[bool, typer.Option("--closed-loop", help="Decode again with what is measured.")] = False,
    model: Annotated[
        Path | None, typer.Option("--model", help="Bundle for it: a folder, or a shipped one.", metavar="DIR")
    ] = None,
    server: Annotated[
        str | None, typer.Option("--server", help="Closed loop through this server instead.", metavar="URL")
    ] = None,
    paper_control: Annotated[
        bool, typer.Option("--paper-control", help="Control without feed-forward and gravity terms.")
    ] = False,
    gui: Annotated[bool, typer.Option("--gui", help="Open the simulator's window.")] = False,
    video: Annotated[Path | None, typer.Option("--video", help="Film to write.", metavar="MP4")] = None,
    friction: Annotated[
        float | None, typer.Option("--friction", help="Friction in the simulator; 0.5 if not given.", metavar="MU")
    ] = None,
    object_mass: Annotated[
        float | None, typer.Option("--object-mass", help="Mass of the object; 0.1 kg if not given.", metavar="KG")
    ] = None,
    noise: Annotated[
        float | None, typer.Option("--noise", help="Spread of the measured object position (m).", metavar="M")
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Seed of the noise.")] = None,
    disturb: Annotated[
        list[str] | None,
        typer.Option("--disturb", help="push@T=FX,FY (N) or friction@T=MU; may be repeated.", metavar="WHAT"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Replay a plan on the law of friction, maybe under another friction, or execute it on a simulated arm."""
    arm = ArmOptions(
        closed_loop, model, server, paper_control, gui, video, friction, object_mass, noise, seed, tuple(disturb or ())
    )
    if pybullet:
        if static is not None or kinetic is not None:
            raise InputError("--static and --kinetic are of the replay: give --friction with --pybullet")
        _run_on_arm(plan_file, arm, report, as_json)
    else:
        arm.refuse_without_pybullet()
        _replay(plan_file, static, kinetic, report, as_json)


def _run_on_arm(plan_file: Path, options: ArmOptions, report: Path | None, as_json: bool) -> None:
    from runtime.arm.program import run_on_arm  # needs the extra [pybullet]

    outcome = run_on_arm(plan_file, options, report)
    for remark in outcome.remarks:
        say("slide-run", f"note: {remark}")
    if as_json:
        print_json(outcome.document)
    elif outcome.results is not None:
        written = [(name, str(path)) for name, path in (("video", options.video), ("report", report)) if path]
        print_table(f"{plan_file} on the simulated arm, {outcome.document['loop']}", [*outcome.results.rows, *written])
    if outcome.interrupted:
        say("slide-run", "interrupted; what was recorded until then is kept")
        raise typer.Exit(INTERRUPTED)
    _conclude("slide-run", outcome.plan, outcome.notes)


def _replay(plan_file: Path, static: float | None, kinetic: float | None, report: Path | None, as_json: bool) -> None:
    """Replay a plan on the law of friction, maybe under another friction than it was made for."""
    if report is not None:
        check_writable(report)
    plan = Plan.load(plan_file)
    friction = _friction(plan.friction, static, kinetic)
    states = plan.replay(friction)
    position, velocity = states[:, :2], states[:, 2:]
    rmse, worst = tracking_error(position, plan.command_position)
    distance_at_end = float(np.hypot(*(position[-1] - plan.command_position[-1])))
    _, difference = tracking_error(position, plan.object_position)
    sliding_share = float(np.mean(velocity.any(axis=1)))

    if report is not None:
        name = f"friction {friction.static:g}/{friction.kinetic:g}"
        tracks = [] if friction == plan.friction else [Track(name, position, velocity, plan.pan_position)]
        write_report(report, plan, tracks)
    if as_json:
        print_json(
            {
                "plan": str(plan_file),
                "friction": {"static": friction.static, "kinetic": friction.kinetic},
                "samples": len(plan),
                "tracking_rmse": rmse,
                "tracking_max": worst,
                "distance_at_end": distance_at_end,
                "difference_to_plan": difference,
                "pan_reach": plan.quality.pan_reach,
                "sliding_share": sliding_share,
                "status": plan.quality.status.value,
                "report": None if report is None else str(report),
            }
        )
    else:
        rows = [
            ("friction, static/kinetic", f"{friction.static:g}/{friction.kinetic:g}"),
            ("tracking RMSE", f"{rmse * MM:.2f} mm"),
            ("tracking maximum", f"{worst * MM:.2f} mm"),
            ("object to command at the end", f"{distance_at_end * MM:.2f} mm"),
            ("largest difference to the plan", f"{difference * MM:.2f} mm"),
            ("pan reach", _reach(plan)),
            ("share of time sliding", f"{sliding_share:.1%}"),
        ]
        if report is not None:
            rows.append(("report", str(report)))
        print_table(f"{plan_file} on the law of friction", rows)
    _conclude("slide-run", plan)


def slide_info(
    bundle: Annotated[Path | None, typer.Argument(help="Bundle folder, or a shipped one: default, fp32.")] = None,
    as_json: AsJson = False,
) -> None:
    """Say what a bundle is: its network, what it was trained for and how it did."""
    path = DEFAULT_BUNDLE if bundle is None else bundle
    loaded = Bundle.load(path)
    manifest = loaded.manifest
    if as_json:
        print_json({"path": str(path), "sha256": loaded.sha256, "sizes": loaded.sizes, **manifest.to_dict()})
        return
    bound = manifest.acceleration_bound
    rows = [
        ("name", manifest.name),
        ("format", BUNDLE_FORMAT),
        ("network", f"{manifest.layers} x {manifest.units} LSTM units, {manifest.precision}, opset {manifest.opset}"),
        ("chunk", f"{manifest.chunk} samples of {manifest.dt * 1e3:g} ms"),
        ("command ahead", f"{manifest.command_ahead} chunks"),
        ("friction, static/kinetic", f"{manifest.friction.static:g}/{manifest.friction.kinetic:g}"),
        ("pan limit", f"{manifest.pan_limit:g} m"),
        ("acceleration bound", "none" if bound is None else f"{bound:g} m/s^2"),
        *(
            (f"limit on {name.replace('_', ' ')}", f"{getattr(manifest.limits, name):g} {UNITS[name]}")
            for name in UNITS
        ),
    ]
    for name, unit in TRAINED_ON.items():
        low, high = manifest.trained_on[name]
        rows.append((f"trained on {name}", f"{low:g} to {high:g} {unit}".rstrip()))
    rows += [(f"{name} size", f"{size / 1e6:.2f} MB") for name, size in loaded.sizes.items()]
    rows.append(("sha256", loaded.sha256))
    rows += [(name.replace("_", " "), _brief(value)) for name, value in manifest.evaluation.items()]
    print_table(str(path), rows)


def _friction(default: Friction, static: float | None, kinetic: float | None) -> Friction:
    """Return the default with what was given on the command line in its place."""
    return Friction(
        static=default.static if static is None else static,
        kinetic=default.kinetic if kinetic is None else kinetic,
    )


def _reach(plan: Plan) -> str:
    limit = plan.quality.limits["pan_reach"]
    of = "" if limit is None else f" of {limit * MM:.0f} mm"
    return f"{plan.quality.pan_reach * MM:.1f} mm{of}"


def _brief(value: object) -> str:
    """Lay out one free-form evaluation figure on few lines."""
    if isinstance(value, dict):
        return "\n".join(f"{name.replace('_', ' ')} {_brief(part)}" for name, part in value.items())
    if isinstance(value, float):
        return f"{value:.4g}"
    return value if isinstance(value, str) else json.dumps(value)


def print_json(document: dict[str, Any]) -> None:
    print(json.dumps(document, allow_nan=False))


def _conclude(name: str, plan: Plan, missed: Sequence[str] = ()) -> None:
    """Say what is to be said of the plan and of what was missed besides; a limit or a tolerance missed exits with 1."""
    status, notes = plan.quality.status, "; ".join(plan.quality.notes)
    over = status in (Status.LIMIT_EXCEEDED, Status.TOLERANCE_MISSED)
    if over or missed:
        say(name, "; ".join([*missed, *([f"{status.replace('_', ' ')}: {notes}"] if over else [])]))
        raise typer.Exit(DONE_BUT_MISSED)
    if status is Status.BEYOND_TRAINING_RANGE:
        say(name, f"warning: {notes}")
