"""Options and lines that several programs have."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from runtime.cli.console import DONE_BUT_MISSED, MM, say
from runtime.friction import Friction
from runtime.plan import Plan, Status

Static = Annotated[float | None, typer.Option("--static", help="Static friction coefficient.", metavar="MU")]
Kinetic = Annotated[float | None, typer.Option("--kinetic", help="Kinetic friction coefficient.", metavar="MU")]


def chosen_friction(default: Friction, static: float | None, kinetic: float | None) -> Friction:
    """Return the default with what was given on the command line in its place."""
    return Friction(
        static=default.static if static is None else static,
        kinetic=default.kinetic if kinetic is None else kinetic,
    )


def reach_of_limit(plan: Plan) -> str:
    limit = plan.quality.limits["pan_reach"]
    of = "" if limit is None else f" of {limit * MM:.0f} mm"
    return f"{plan.quality.pan_reach * MM:.1f} mm{of}"


def conclude(name: str, plan: Plan, missed: Sequence[str] = ()) -> None:
    """Say what is to be said of the plan and of what was missed besides; a limit or a tolerance missed exits with 1."""
    status, notes = plan.quality.status, "; ".join(plan.quality.notes)
    over = status in (Status.LIMIT_EXCEEDED, Status.TOLERANCE_MISSED)
    if over or missed:
        say(name, "; ".join([*missed, *([f"{status.replace('_', ' ')}: {notes}"] if over else [])]))
        raise typer.Exit(DONE_BUT_MISSED)
    if status is Status.BEYOND_TRAINING_RANGE:
        say(name, f"warning: {notes}")
