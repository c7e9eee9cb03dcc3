"""The figures asked for, in one table; what is measured is held against it."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

COMPARISONS = {"<=": operator.le, "<": operator.lt, ">=": operator.ge}


@dataclass(frozen=True)
class Target:
    """One figure asked for.

    Attributes:
        figure: where it stands in the results, keys joined by dots.
        what: what it is, in words.
        unit: in which a value is shown; "" for a plain number.
        comparison: one of COMPARISONS: `value comparison limit` is to hold.
        limit: in SI units, as the results are.
        show: format of a value for a person.
        scale: of `unit` in SI units: multiplies a value before it is shown.
    """

    figure: str
    what: str
    unit: str
    comparison: str
    limit: float
    show: str
    scale: float = 1.0

    def met(self, value: float) -> bool:
        """Return whether `value` is what was asked for."""
        return bool(COMPARISONS[self.comparison](value, self.limit))

    def text(self, value: float) -> str:
        """Return `value` for a person, without its unit."""
        return self.show.format(value * self.scale)

    @property
    def asked(self) -> str:
        """What is asked for, for a person, without its unit."""
        return f"{self.comparison} {self.text(self.limit)}"


TARGETS = (
    Target("accuracy.families.spline.tracking_mean", "spline, mean RMSE", "mm", "<=", 1.3e-3, "{:.2f}", 1e3),
    Target("accuracy.families.spline.tracking_max", "spline, worst RMSE", "mm", "<=", 6.0e-3, "{:.2f}", 1e3),
    Target("accuracy.families.shapes.tracking_mean", "shapes, mean RMSE", "mm", "<=", 4.5e-3, "{:.2f}", 1e3),
    Target("accuracy.families.shapes.tracking_max", "shapes, worst RMSE", "mm", "<=", 20e-3, "{:.2f}", 1e3),
    Target("accuracy.friction_worst", "friction, worst cell", "mm", "<=", 2.5e-3, "{:.2f}", 1e3),
    Target("accuracy.friction_ratio", "friction, worst cell over nominal", "x", "<=", 1.4, "{:.2f}"),
    Target("accuracy.total.pan_reach_share", "pan reach up to 0.21 m", "%", ">=", 0.99, "{:.1f}", 100.0),
    Target("accuracy.total.change_mean", "mean |du|", "m/s^2", "<=", 1.0, "{:.2f}"),
    Target(
        "accuracy.families.spline.no_better_than_unmoved", "spline, no better than a still pan", "", "<=", 0, "{:.0f}"
    ),
    Target("speed.single.samples_per_second.median", "single plan", "samples/s", ">=", 150e3, "{:,.0f}"),
    Target("speed.compiled.samples_per_second.median", "single plan, numba's law", "samples/s", ">=", 150e3, "{:,.0f}"),
    Target("speed.compiled.ratio_to_torch", "numba's law, over torch eager", "x", ">=", 5.0, "{:.2f}"),
    Target("speed.batch.samples_per_second.median", "batch of 64", "samples/s", ">=", 500e3, "{:,.0f}"),
    Target("speed.single.ratio_to_torch", "single plan over torch eager", "x", ">=", 5.0, "{:.2f}"),
    Target(
        "speed.large.samples_per_second.median", "single plan, 2 x 1024 units int8", "samples/s", ">=", 57e3, "{:,.0f}"
    ),
    Target("speed.large.ratio_to_torch", "2 x 1024 units over torch eager", "x", ">=", 5.5, "{:.2f}"),
    Target("speed.slide_plan.median", "slide-plan, start to file", "s", "<=", 1.5, "{:.2f}"),
    Target("control.step.p50", "stream step, median", "ms", "<=", 0.35e-3, "{:.2f}", 1e3),
    Target("control.step.p99", "stream step, 99 %", "ms", "<=", 1e-3, "{:.2f}", 1e3),
    Target("control.governor_share", "governor's share of planning", "%", "<=", 0.15, "{:.1f}", 100.0),
    Target("control.first_plan.median", "process start to first plan", "s", "<=", 0.5, "{:.2f}"),
    Target("control.memory", "memory of it", "MB", "<=", 110e6, "{:.0f}", 1e-6),
    Target("refine.reduction", "refinement, error down by", "%", ">=", 0.25, "{:.1f}", 100.0),
    Target("refine.worse", "refinement, commands made worse", "", "<=", 0, "{:.0f}"),
    Target("refine.over_optimizer", "refined over optimizer, worst family", "x", "<=", 1.0, "{:.2f}"),
    Target("long.windows.0.ratio", "60 s over short commands, worst", "x", "<=", 1.0, "{:.2f}"),
    Target("long.recovery.ratio", "error after a push over nominal", "x", "<=", 2.0, "{:.2f}"),
    Target("training.step.median", "forward + backward", "s", "<=", 0.4, "{:.3f}"),
    Target("training.friction_share", "friction's share of it", "%", "<", 0.1, "{:.1f}", 100.0),
)


@dataclass(frozen=True)
class Verdict:
    """A target and what was measured."""

    target: Target
    value: float
    met: bool

    def __str__(self) -> str:
        """Return one line for a person."""
        unit = f" {self.target.unit}" if self.target.unit else ""
        return f"{self.target.what} {self.target.text(self.value)} (asked {self.target.asked}{unit})"

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document."""
        return {
            "figure": self.target.figure,
            "value": self.value,
            "asked": f"{self.target.comparison} {self.target.limit:g}",
            "met": self.met,
        }


def judge(results: Mapping[str, Any]) -> list[Verdict]:
    """Hold every figure that was measured against what is asked of it.

    Args:
        results: the results as a JSON document; a section that is absent or null was not measured.
    """
    verdicts = []
    for target in TARGETS:
        value = _look_up(results, target.figure)
        if value is not None:
            verdicts.append(Verdict(target, value, target.met(value)))
    return verdicts


def _look_up(results: Mapping[str, Any], figure: str) -> float | None:
    """Return the value at a dotted path, None if there is none."""
    found: Any = results
    for key in figure.split("."):
        if isinstance(found, (list, tuple)):
            found = found[int(key)]
        else:
            found = found.get(key) if isinstance(found, Mapping) else None
    return None if found is None else float(found)
