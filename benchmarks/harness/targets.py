"""A figure, what it should be, and whether it is."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

COMPARISONS = {"<=": operator.le, "<": operator.lt, ">=": operator.ge}


@dataclass(frozen=True)
class Unit:
    """How a figure is shown to a person.

    Attributes:
        name: the unit's; "" for a plain number.
        scale: what a value in SI units is multiplied by.
        show: format of the product.
    """

    name: str
    scale: float = 1.0
    show: str = "{:.2f}"

    def text(self, value: float) -> str:
        """Return a value, which is in SI units, for a person, without the unit's name."""
        return self.show.format(value * self.scale)

    def with_name(self, text: str) -> str:
        """Return a text followed by the unit's name, if it has one."""
        return f"{text} {self.name}".rstrip()


MILLIMETRES = Unit("mm", 1e3)
SECONDS = Unit("s")
MILLISECONDS = Unit("ms", 1e3)
ACCELERATION = Unit("m/s^2")
SAMPLES_PER_SECOND = Unit("samples/s", show="{:,.0f}")
MEGABYTES = Unit("MB", 1e-6, "{:.1f}")
PERCENT = Unit("%", 100.0, "{:.1f}")
TIMES = Unit("x")
COUNT = Unit("", show="{:,.0f}")


@dataclass(frozen=True)
class Target:
    """One figure of a section, and what it should be.

    Attributes:
        figure: where it stands in the section's figures, names joined by dots.
        what: what it is, in words.
        unit: in which it is shown.
        comparison: one of COMPARISONS: `value comparison limit` should hold; "" for a figure that is shown only.
        limit: in SI units, as the figures are; None for a figure that is shown only.
    """

    figure: str
    what: str
    unit: Unit
    comparison: str = ""
    limit: float | None = None

    def met(self, value: float) -> bool | None:
        """Return whether `value` is what it should be; None where nothing is set."""
        return None if self.limit is None else bool(COMPARISONS[self.comparison](value, self.limit))

    @property
    def text(self) -> str:
        """What the figure should be, for a person, without its unit; "" where nothing is set."""
        return "" if self.limit is None else f"{self.comparison} {self.unit.text(self.limit)}"


@dataclass(frozen=True)
class Verdict:
    """A target and what was measured; `met` is None where nothing is set."""

    target: Target
    value: float
    met: bool | None

    def __str__(self) -> str:
        """Return one line for a person."""
        target, unit = self.target, self.target.unit
        value = unit.text(self.value)
        should = f" (target {unit.with_name(target.text)})" if target.text else ""
        return f"{target.what} {value}{should}" if should else f"{target.what} {unit.with_name(value)}"

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document; the target and the value are in SI units."""
        target = self.target
        should = None if target.limit is None else f"{target.comparison} {target.limit:g}"
        return {"figure": target.figure, "value": self.value, "target": should, "met": self.met}


def judge(targets: Iterable[Target], figures: Mapping[str, Any]) -> list[Verdict]:
    """Compare every figure that was measured with its target.

    Args:
        targets: of a section.
        figures: the section's, as a JSON document; one that is absent or null was not measured.
    """
    verdicts = []
    for target in targets:
        value = _look_up(figures, target.figure)
        if value is not None:
            verdicts.append(Verdict(target, value, target.met(value)))
    return verdicts


def _look_up(figures: Mapping[str, Any], figure: str) -> float | None:
    """Return the value at a dotted path, None if there is none."""
    found: Any = figures
    for key in figure.split("."):
        if isinstance(found, (list, tuple)):
            found = found[int(key)] if int(key) < len(found) else None
        else:
            found = found.get(key) if isinstance(found, Mapping) else None
    return None if found is None else float(found)
