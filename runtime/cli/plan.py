"""The command line: `slide-plan`, `slide-run` and `slide-info`.

Exit codes: 0 done, 1 done but the plan is of a status from `poor` on (said in one line), 2 bad input or usage, 130
interrupted.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from runtime.assess.assess import cannot_slide
from runtime.cli.console import MM, AsJson, print_json, print_table, run, say
from runtime.cli.options import Kinetic, SizeOptions, Static, chosen_friction, conclude, reach_of_limit
from runtime.command import Command
from runtime.documents.files import check_writable
from runtime.plan import check_suffix
from runtime.planner import Planner

NO_SIZES = SizeOptions()

PAPER_SAMPLES_PER_SECOND = 622.0
"""Planning speed of the paper: 1200 samples in 1.93 s on an Intel Core i7-6700 (Section V-B)."""


def plan_main() -> None:
    """Entry point of `slide-plan`."""
    run("slide-plan", slide_plan)


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
    sizes: SizeOptions = NO_SIZES,
    as_json: AsJson = False,
) -> None:
    """Plan the motion of the pan that slides the object along a command."""
    check_suffix(output)
    check_writable(output)
    command = Command.load(command_file)
    planner = Planner(model)
    friction = chosen_friction(planner.bundle.manifest.friction, static, kinetic)
    given = {"pan_reach": reach, "acceleration": acceleration, "jerk": jerk}
    limits = replace(planner.bundle.manifest.limits, **{name: it for name, it in given.items() if it is not None})
    warned = cannot_slide(friction, limits)
    for line in warned:
        say("slide-plan", f"warning: {line}")
    begin = time.perf_counter()
    chosen = sizes.chosen(planner.bundle.manifest.sizes)
    plan = planner.plan(command, friction, limits=limits, sizes=chosen, tolerance=tolerance)
    duration = time.perf_counter() - begin
    plan.save(output)

    quality, speed = plan.quality, len(plan) / duration
    if as_json:
        print_json(
            {
                "plan": str(output),
                "model": {"name": plan.model_name, "sha256": plan.model_sha256},
                "friction": friction.to_dict(),
                "sizes": plan.sizes.to_dict(),
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
            ("pan reach", reach_of_limit(plan)),
            ("pan, object radius", f"{plan.sizes.pan_radius * MM:g} mm, {plan.sizes.object_radius * MM:g} mm"),
            ("share of time sliding", f"{quality.sliding_share:.1%}"),
            ("samples governed", f"{0 if quality.governed is None else quality.governed.samples}"),
            ("planning time", f"{duration * 1e3:.1f} ms for {len(plan)} samples"),
            ("samples per second", f"{speed:,.0f}, {speed / PAPER_SAMPLES_PER_SECOND:.0f} x the paper's 622"),
        ]
        print_table(f"{output}: {quality.status}", rows)
    conclude("slide-plan", plan, said=warned)
