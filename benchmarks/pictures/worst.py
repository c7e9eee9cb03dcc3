"""`python -m benchmarks.pictures.worst`: draws the ten commands of the suite that are tracked worst."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.harness.tables import print_tables, table
from benchmarks.suite.families import lengths
from benchmarks.suite.outcome import PlanFunction, measured_states, one_by_one
from benchmarks.suite.suite import FAMILIES, suite
from runtime.cli.console import MM, AsJson, print_json, run, say
from runtime.documents.checks import FloatArray
from runtime.documents.writing import check_writable
from runtime.errors import OutputError, extra
from runtime.physics.law import DT
from runtime.planner import Planner

NAME = "benchmarks.pictures.worst"
WORST = 10
COLUMNS = 5


@dataclass(frozen=True, eq=False)
class Tracked:
    """One command and what became of it.

    Attributes:
        label: the command's.
        position: (K, 2) the command (m).
        object_position: (K, 2) where the object went, relative to the pan (m).
        pan_reach: largest distance of the pan from where it began (m).
    """

    label: str
    position: FloatArray
    object_position: FloatArray
    pan_reach: float

    @property
    def error(self) -> FloatArray:
        """Distance between object and command, (K,) (m)."""
        return lengths(self.object_position - self.position)

    @property
    def rmse(self) -> float:
        """Tracking RMSE (m)."""
        return float(np.sqrt(np.mean(self.error**2)))


TRAITS: dict[str, tuple[Callable[[Tracked], float], str, float]] = {
    "mean speed": (lambda each: float(_speed(each).mean()), "m/s", 1.0),
    "top speed": (lambda each: float(_speed(each).max()), "m/s", 1.0),
    "top acceleration": (lambda each: float(lengths(np.diff(each.position, 2, axis=0)).max() / DT**2), "m/s²", 1.0),
    "reach": (lambda each: float(lengths(each.position).max()), "mm", MM),
    "duration": (lambda each: len(each.position) * DT, "s", 1.0),
    "pan reach": (lambda each: each.pan_reach, "mm", MM),
}
"""What may make a command hard: how it is computed, its unit, and the unit's scale."""


@dataclass(frozen=True)
class Trait:
    """A trait of the worst commands beside that of all, in SI units, and its correlation with the RMSE over all."""

    trait: str
    worst: float
    all: float
    correlation: float


def main(
    model: Annotated[
        Path | None, typer.Option("--model", help="Bundle folder; the shipped one if not given.", metavar="DIR")
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Picture to write.", metavar="PNG")] = None,
    as_json: AsJson = False,
) -> None:
    """Plan the suite under nominal friction, draw the worst commands, and say what they have in common."""
    if output is not None:
        check_writable(output)
    tracked = track(one_by_one(Planner(model)), [name for name in FAMILIES if name != "friction"])
    worst, traits = tracked[:WORST], compare(tracked)
    if output is not None:
        with extra("report"):
            from matplotlib.figure import Figure
        try:
            draw(Figure, worst).savefig(output, dpi=100)
        except OSError as error:
            raise OutputError(f"cannot write {output}: {error.strerror}") from error
        say(NAME, f"wrote {output}")
    if as_json:
        commands = [{"label": each.label, "rmse": each.rmse, "pan_reach": each.pan_reach} for each in worst]
        print_json({"worst": commands, "traits": [vars(trait) for trait in traits]})
    else:
        _print(worst, traits, len(tracked))


def track(plan: PlanFunction, families: Iterable[str]) -> list[Tracked]:
    """Plan all commands of the families; the worst come first."""
    tracked = []
    for family in suite(families).values():
        states = measured_states(plan(family.positions, family.frictions), family)
        tracked += [
            Tracked(label, position, each[:, 4:6], float(lengths(each[:, :2]).max()))
            for label, position, each in zip(family.labels, family.positions, states, strict=True)
        ]
    return sorted(tracked, key=lambda each: -each.rmse)


def compare(tracked: Sequence[Tracked]) -> list[Trait]:
    """Return the traits of the worst commands beside those of all, the most telling first."""
    errors = np.array([each.rmse for each in tracked])
    traits = []
    for name, (compute, _, _) in TRAITS.items():
        values = np.array([compute(each) for each in tracked])
        correlation = float(np.corrcoef(values, errors)[0, 1]) if values.std() > 0.0 else 0.0
        traits.append(Trait(name, float(values[:WORST].mean()), float(values.mean()), correlation))
    return sorted(traits, key=lambda trait: -abs(trait.correlation))


def _speed(tracked: Tracked) -> FloatArray:
    return lengths(np.diff(tracked.position, axis=0)) / DT


def draw(figure_class: Any, worst: Sequence[Tracked]) -> Any:
    """Draw each command from above with the object's path, and its error over time below."""
    rows = -(-len(worst) // COLUMNS)
    figure = figure_class(figsize=(3.0 * COLUMNS, 4.4 * rows), layout="constrained")
    grid = figure.subplots(2 * rows, COLUMNS, height_ratios=(2.0, 1.0) * rows, squeeze=False)
    highest = MM * max(each.error.max() for each in worst)
    for index, each in enumerate(worst):
        row, column = divmod(index, COLUMNS)
        above, below = grid[2 * row, column], grid[2 * row + 1, column]
        above.plot(*(MM * each.position.T), color="black", linestyle="--", linewidth=1.0, label="command")
        above.plot(*(MM * each.object_position.T), color="#0072b2", linewidth=1.3, label="object")
        above.plot(*(MM * each.position[0]), "o", color="black", markersize=4)
        above.set_title(f"{index + 1}. {each.label}: {MM * each.rmse:.1f} mm", fontsize=10)
        above.set_aspect("equal", adjustable="datalim")
        below.plot(np.arange(len(each.position)) * DT, MM * each.error, color="#d55e00", linewidth=1.0)
        below.set(ylim=(0.0, 1.05 * highest), xlabel="time (s)")
    grid[0, 0].legend(fontsize=8, loc="best")
    for row in range(rows):
        grid[2 * row, 0].set_ylabel("y (mm), over x (mm)")
        grid[2 * row + 1, 0].set_ylabel("error (mm)")
    return figure


def _print(worst: Sequence[Tracked], traits: Sequence[Trait], count: int) -> None:
    lines = [(each.label, f"{MM * each.rmse:.2f}", f"{MM * each.pan_reach:.0f}") for each in worst]
    shared = []
    for trait in traits:
        _, unit, scale = TRAITS[trait.trait]
        figures = (f"{scale * trait.worst:.3g}", f"{scale * trait.all:.3g}", f"{trait.correlation:+.2f}")
        shared.append((f"{trait.trait} ({unit})", *figures))
    print_tables(
        [
            table(f"The {len(worst)} worst of {count} commands", ("command", "RMSE (mm)", "pan reach (mm)"), lines),
            table("What they share, on average", ("", "worst", "all", "correlation with the RMSE"), shared),
        ]
    )


if __name__ == "__main__":
    run(NAME, main)
