"""Options and lines that several programs have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import typer

from runtime.cli.console import DONE_BUT_MISSED, MM, say
from runtime.documents.options import option
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.limits import NAMED, Limits
from runtime.plan import Plan, Status
from runtime.sizes import Sizes


@dataclass(frozen=True)
class FrictionOptions:
    """What was said of the friction."""

    static: float | None = option("Static friction coefficient.", metavar="MU")
    kinetic: float | None = option("Kinetic friction coefficient.", metavar="MU")


@dataclass(frozen=True)
class LimitOptions:
    """What was said of the limits: those of a name, or the model's, with single ones in their place."""

    limits_of: str | None = option(f"Limits by name: {', '.join(NAMED)}.", metavar="NAME", flag="--limits")
    pan_reach: float | None = option("Limit on the pan's reach (m).", metavar="M", flag="--reach")
    height: float | None = option("How far it may rise and sink (m); 0: level.", metavar="M")
    level: bool = option("Keep the pan level: --height 0.", False)
    speed_limit: float | None = option("Limit on its speed (m/s).", metavar="V")
    acceleration: float | None = option("Limit on its acceleration (m/s^2).", metavar="A")
    jerk: float | None = option("Limit on its jerk (m/s^3).", metavar="J")

    def chosen(self, default: Limits) -> Limits:
        """Return these limits, with a model's where nothing was said.

        Raises:
            InputError: a name is not known, options or limits contradict each other.
        """
        if self.level and self.height:
            raise InputError(f"--level and --height {self.height:g} contradict each other")
        named = default if self.limits_of is None else Limits.named(self.limits_of)
        given: dict[str, Any] = {
            "pan_reach": self.pan_reach,
            "height": 0.0 if self.level else self.height,
            "speed": self.speed_limit,
            "acceleration": self.acceleration,
            "jerk": self.jerk,
        }
        return replace(named, **{name: value for name, value in given.items() if value is not None})


@dataclass(frozen=True)
class SizeOptions:
    """What was said of the sizes of pan and object."""

    pan_radius: float | None = option("Radius of the pan (m).", metavar="M")
    object_radius: float | None = option("Radius of the object (m).", metavar="M")


@dataclass(frozen=True)
class SearchOptions:
    """How much to try for a better plan; as `Planner.plan` takes them."""

    candidates: int | None = option(
        "Plan so many turned and mirrored ways, keep the best; 1, and 8 where that is bad, if not given.", metavar="N"
    )
    robust: float | None = option("Judge by friction off by this share, too: 0.1; 0 for not.", metavar="SHARE")
    refine_ms: float | None = option("Make the plan better for so many milliseconds.", metavar="MS")


Settings = TypeVar("Settings", Friction, Sizes)


def chosen(options: FrictionOptions | SizeOptions, default: Settings) -> Settings:
    """Return the default with what was given on the command line in its place."""
    return replace(default, **{name: value for name, value in vars(options).items() if value is not None})


def reach_of_limit(plan: Plan) -> str:
    """Say how far the pan goes, of how far it may; and how high, if it lifts."""
    quality = plan.quality
    reach = f"{quality.pan_reach * MM:.1f} mm{_of(quality.limits['pan_reach'], MM, 'mm')}"
    if not quality.height_max and not quality.limits["height"]:
        return reach
    return f"{reach}; height {quality.height_max * MM:.1f} mm{_of(quality.limits['height'], MM, 'mm')}"


def speed_of_limit(plan: Plan) -> str:
    """Say how fast the pan goes, of how fast it may."""
    return f"{plan.quality.speed_max:.2f} m/s{_of(plan.quality.limits['speed'], 1.0, 'm/s')}"


def _of(limit: float | None, scale: float, unit: str) -> str:
    return "" if limit is None else f" of {limit * scale:g} {unit}"


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
