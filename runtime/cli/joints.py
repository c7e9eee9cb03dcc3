"""`slide-joints`: how an arm's joints move along a plan, beside their limits, and as files that robots take.

Exit codes: 0 done, 1 a limit of a joint or of the hand is passed (said in one line), 2 bad input or usage.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import typer

from runtime.arms.files import format_of
from runtime.arms.motion import JointMotion, follow_plan, passed
from runtime.arms.options import ArmChoice, choose
from runtime.cli.console import DONE_BUT_MISSED, MM, AsJson, print_json, print_table, run, say
from runtime.documents.files import reading
from runtime.documents.writing import check_writable, is_standard_output, write_whole
from runtime.plan import Plan


def joints_main() -> None:
    """Entry point of `slide-joints`."""
    run("slide-joints", slide_joints)


def slide_joints(
    plan_file: Annotated[Path, typer.Argument(help="Plan: .json or .npz.", show_default=False)],
    arm: ArmChoice = ArmChoice(),
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Joints to write: .csv, .json (JointTrajectory) or .mcap.", metavar="FILE"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Follow a plan and its stop with an arm's joints, show what each comes to beside its limits, and write them."""
    write = None
    if output is not None:
        write = format_of(output)
        check_writable(output)
    plan = Plan.load(plan_file)
    model, place = choose(arm)
    with reading(str(plan_file)):
        motion = follow_plan(model, place, plan)
    if output is not None and write is not None:
        sliding = plan.with_stop().sliding[:, :2]
        write_whole(output, write(motion, sliding))
    taken = output is not None and is_standard_output(output)
    if as_json:
        print_json(_document(plan_file, output, motion), stderr=taken)
    else:
        _show(plan_file, output, motion, taken)
    if unknown := motion.arm.unknown:
        say("slide-joints", f"note: limits on {', '.join(unknown)} are not known for {motion.arm.name}: not checked")
    if exceeded := motion.exceeded:
        say("slide-joints", passed(exceeded))
        raise typer.Exit(DONE_BUT_MISSED)


def _document(plan_file: Path, output: Path | None, motion: JointMotion) -> dict[str, Any]:
    nearest = int(motion.singular.argmin())
    return {
        "plan": str(plan_file),
        "arm": motion.arm.name,
        "place": {"position": motion.place.position.tolist(), "heading": motion.place.heading},
        "home": motion.place.home.tolist(),
        "samples": len(motion),
        "peaks": [{**vars(peak), "exceeded": peak.exceeded} for peak in motion.peaks],
        "unknown": list(motion.arm.unknown),
        "singularity": {
            "smallest_singular_value": float(motion.singular[nearest]),
            "time": float(motion.time[nearest]),
            "hardest": motion.hardest,
        },
        "position_error": motion.position_error,
        "tilt_error": motion.tilt_error,
        "holds": not motion.exceeded,
        "output": None if output is None else str(output),
    }


def _show(plan_file: Path, output: Path | None, motion: JointMotion, taken: bool) -> None:
    """Print what each joint comes to, of which limit, and when; then where the arm holds the pan, and how well."""
    parts = list(dict.fromkeys(peak.part for peak in motion.peaks))
    peaks = sorted(motion.peaks, key=lambda peak: parts.index(peak.part))
    rows = [
        (
            peak.part if before is None or before.part != peak.part else "",
            f"{peak.quantity} ({peak.unit})",
            f"{peak.value:.4g}",
            "unknown" if peak.limit is None else f"{peak.limit:.4g}",
            "" if peak.share is None else f"{peak.share:.0%}{' !' if peak.exceeded else ''}",
            f"{peak.time:.3f}",
        )
        for before, peak in pairwise([None, *peaks])
        if peak is not None
    ]
    header = ("joint", "peak of", "value", "limit", "share", "time (s)")
    print_table(f"{plan_file} on {motion.arm.title}", rows, header, stderr=taken)
    x, y, z = motion.place.position
    nearest = int(motion.singular.argmin())
    worst = motion.worst
    print_table(
        "",
        [
            ("pan begins at", f"({x:.3f}, {y:.3f}, {z:.3f}) m, heading {math.degrees(motion.place.heading):.0f} deg"),
            (
                "nearest singularity",
                f"singular value {motion.singular[nearest]:.3f} at {motion.time[nearest]:.3f} s, hardest is "
                f"{motion.hardest}",
            ),
            ("pan off its path", f"{motion.position_error * MM:.2g} mm, {math.degrees(motion.tilt_error):.2g} deg"),
            *(
                []
                if worst is None
                else [("worst", f"{worst.quantity} of {worst.part}, {worst.share:.0%} of its limit")]
            ),
            *([] if output is None else [("written", str(output))]),
        ],
        stderr=taken,
    )
