"""`slide-run`: replay a plan on the law of friction, or execute it on a simulated arm."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from runtime.arm.options import ArmOptions
from runtime.arm.simulated import Simulator
from runtime.arms.options import ArmChoice
from runtime.assess.assess import find_off_pan
from runtime.cli.console import MM, AsJson, print_json, print_table, run, say
from runtime.cli.options import FrictionOptions, chosen, conclude, reach_of_limit
from runtime.documents.writing import check_writable
from runtime.errors import InputError
from runtime.interrupt import INTERRUPTED
from runtime.physics.law import DT
from runtime.physics.positions import slide_to_rest
from runtime.plan import Plan, tracking_error
from runtime.report.report import Track, write_report


def run_main() -> None:
    """Entry point of `slide-run`."""
    run("slide-run", slide_run)


def slide_run(
    plan_file: Annotated[Path, typer.Argument(help="Plan: .json or .npz.", show_default=False)],
    replayed: FrictionOptions = FrictionOptions(),
    report: Annotated[
        Path | None, typer.Option("--report", help="Page to write, with the motion animated.", metavar="HTML")
    ] = None,
    pybullet: Annotated[bool, typer.Option("--pybullet", help="The same as --simulator pybullet.")] = False,
    options: ArmOptions = ArmOptions(),
    choice: ArmChoice = ArmChoice(),
    as_json: AsJson = False,
) -> None:
    """Replay a plan on the law of friction, maybe under another friction than it was made for, or execute it on a
    simulated arm.
    """
    if pybullet:
        if options.simulator not in (None, Simulator.PYBULLET):
            raise InputError(f"--pybullet and --simulator {options.simulator}: one of them")
        options = replace(options, simulator=Simulator.PYBULLET)
    if choice.arm is None and choice.given:
        raise InputError(f"{choice.given[0]} needs --arm")
    if choice.arm is not None and options.simulator is None:
        options = replace(options, simulator=Simulator.MUJOCO)
    if options.simulator is not None:
        if replayed != FrictionOptions():
            raise InputError("--static and --kinetic are of the replay: give --friction with --simulator")
        _run_on_arm(plan_file, options, choice, report, as_json)
    else:
        options.refuse_without_simulator()
        _replay(plan_file, replayed, report, as_json)


def _run_on_arm(plan_file: Path, options: ArmOptions, choice: ArmChoice, report: Path | None, as_json: bool) -> None:
    from runtime.arm.program import run_on_arm

    outcome = run_on_arm(plan_file, options, report, choice)
    for remark in outcome.remarks:
        say("slide-run", f"note: {remark}")
    if as_json:
        print_json(outcome.document)
    elif outcome.results is not None:
        document = outcome.document
        shares = [f"{name} {share:.0%}" for name, share in document["limits"].items()]
        more = [("friction in the simulator", f"{document['friction']:g}")]
        more += [("of the joints' limits", ", ".join(shares))] if shares else []
        more += outcome.rows
        written = (("video", options.video), ("report", report), ("log", options.log))
        more += [(name, str(path)) for name, path in written if path]
        title = f"{plan_file} on arm {document['arm']} in {document['simulator']}, {document['loop']}"
        print_table(title, [*outcome.results.rows, *more])
    if outcome.interrupted:
        say("slide-run", "interrupted; what was recorded until then is kept")
        raise typer.Exit(INTERRUPTED)
    conclude("slide-run", outcome.plan, outcome.notes)


def _replay(plan_file: Path, options: FrictionOptions, report: Path | None, as_json: bool) -> None:
    """Replay a plan on the law of friction, maybe under another friction than it was made for."""
    if report is not None:
        check_writable(report)
    plan = Plan.load(plan_file)
    friction = chosen(options, plan.friction)
    states = plan.replay(friction)
    position, velocity = states[:, :2], states[:, 2:]
    rmse, worst = tracking_error(position, plan.command_position)
    distance_at_end = float(np.hypot(*(position[-1] - plan.command_position[-1])))
    _, difference = tracking_error(position, plan.object_position)
    sliding_share = float(np.mean(velocity.any(axis=1)))
    rest = None
    if len(plan.stop_acceleration):
        leaving = plan.with_stop(friction).sliding[len(plan)]
        rest = math.dist(slide_to_rest(leaving, plan.stop_acceleration, friction), plan.command_position[-1])

    if report is not None:
        name = f"friction {friction.static:g}/{friction.kinetic:g}"
        tracks = [] if friction == plan.friction else [Track(name, position, velocity, plan.pan_position)]
        write_report(report, plan, tracks)
    if as_json:
        print_json(
            {
                "plan": str(plan_file),
                "friction": friction.to_dict(),
                "samples": len(plan),
                "tracking_rmse": rmse,
                "tracking_max": worst,
                "distance_at_end": distance_at_end,
                "rest_error": rest,
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
            *([] if rest is None else [("the same, at rest after the stop", f"{rest * MM:.2f} mm")]),
            ("largest difference to the plan", f"{difference * MM:.2f} mm"),
            ("pan reach", reach_of_limit(plan)),
            ("share of time sliding", f"{sliding_share:.1%}"),
        ]
        if report is not None:
            rows.append(("report", str(report)))
        print_table(f"{plan_file} on the law of friction", rows)
    off_pan = None if friction == plan.friction else find_off_pan(position, plan.sizes)
    left = [] if off_pan is None else [f"under this friction the object leaves the pan at {off_pan.first * DT:.3f} s"]
    conclude("slide-run", plan, left)
