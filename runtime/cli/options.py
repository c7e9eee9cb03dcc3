"""Options and lines that several programs have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

import typer

from runtime.cli.console import DONE_BUT_MISSED, MM, say
from runtime.friction import Friction
from runtime.plan import Plan, Status
from runtime.sizes import Sizes

Static = Annotated[float | None, typer.Option("--static", help="Static friction coefficient.", metavar="MU")]
Kinetic = Annotated[float | None, typer.Option("--kinetic", help="Kinetic friction coefficient.", metavar="MU")]


def chosen_friction(default: Friction, static: float | None, kinetic: float | None) -> Friction:
    """Return the default with what was given on the command line in its place."""
    return Friction(
        static=default.static if static is None else static,
        kinetic=default.kinetic if kinetic is None else kinetic,
    )


@dataclass(frozen=True)
class SizeOptions:
    """What was said of the sizes of pan and object."""

    pan_radius: float | None = field(default=None, metadata={"help": "Radius of the pan (m).", "metavar": "M"})
    object_radius: float | None = field(default=None, metadata={"help": "Radius of the object (m).", "metavar": "M"})

    def chosen(self, default: Sizes) -> Sizes:
        """Return the default with what was given on the command line in its place."""
        return Sizes(
            default.pan_radius if self.pan_radius is None else self.pan_radius,
            default.object_radius if self.object_radius is None else self.object_radius,
        )


def reach_of_limit(plan: Plan) -> str:
    limit = plan.quality.limits["pan_reach"]
    of = "" if limit is None else f" of {limit * MM:.0f} mm"
    return f"{plan.quality.pan_reach * MM:.1f} mm{of}"


def friction_off(plan: Plan) -> str:
    """Say how the plan tracks if the friction is another."""
    error = plan.quality.friction_off_rmse
    return "not known" if error is None else f"{error * MM:.2f} mm"


def conclude(name: str, plan: Plan, missed: Sequence[str] = (), said: Sequence[str] = ()) -> None:
    """Say the worst of the plan, and what was missed besides; a miss, or a plan that failed, exits with 1.

    Args:
        name: the program's.
        plan: what is judged.
        missed: further lines.
        said: notes of the plan that have been said already.
    """
    status, notes = plan.quality.status, plan.quality.notes
    lines = [*missed]
    if status.failed and notes[0] not in said:
        lines.append(f"{status.replace('_', ' ')}: {notes[0]}")
    if lines:
        say(name, "; ".join(lines))
    elif status in (Status.LIMITED, Status.BEYOND_TRAINING_RANGE):
        say(name, f"warning: {status.replace('_', ' ')}: {notes[0]}")
    if status.failed or missed:
        raise typer.Exit(DONE_BUT_MISSED)
