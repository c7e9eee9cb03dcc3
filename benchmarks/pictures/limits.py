"""`python -m benchmarks.pictures.limits`: draws the tracking error over the pan's limit of acceleration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.harness.tables import print_tables, table
from benchmarks.suite.pans import Task, tracking
from runtime.cli.console import MM, AsJson, print_json, run, say
from runtime.documents.writing import check_writable
from runtime.errors import OutputError, extra
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.planner import Planner

NAME = "benchmarks.pictures.limits"

ACCELERATIONS = (4.0, 6.0, 9.0, 13.0, 20.0, 30.0, 40.0)
"""Limits of acceleration (m/s^2)."""

JERK_RATE, MOST_JERK = 500.0, 10_000.0
"""Limit of jerk over that of acceleration (1/s), as Franka publishes both for its arms, and the largest (m/s^3)."""

FRICTION = Friction(0.3, 0.2)
"""With more, an object could not slide on the weakest of these pans."""

COLOURS = {"network": "#0072b2", "optimizer": "#d55e00"}


@dataclass(frozen=True)
class Errors:
    """Mean tracking RMSE (m) under a limit of acceleration (m/s^2)."""

    acceleration: float
    network_level: float
    network_lifting: float
    optimizer_level: float
    optimizer_lifting: float


def main(
    model: Annotated[
        Path | None, typer.Option("--model", help="Bundle folder; the shipped one if not given.", metavar="DIR")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Picture to write; none if not given.", metavar="FILE")
    ] = None,
    commands: Annotated[int, typer.Option("--commands", help="Commands of `spline`.", metavar="N", min=1)] = 8,
    candidates: Annotated[
        int, typer.Option("--candidates", help="The optimizer's candidates.", metavar="N", min=8)
    ] = 512,
    iterations: Annotated[
        int, typer.Option("--iterations", help="The optimizer's iterations.", metavar="N", min=1)
    ] = 20,
    as_json: AsJson = False,
) -> None:
    """Draw the mean tracking RMSE of network and cross-entropy optimizer over the pan's limit of acceleration.

    Both plan with a level pan and with one that lifts, and are told the friction.
    """
    with extra("train"):
        from matplotlib.figure import Figure

    if output is not None:
        check_writable(output)
    found = measure(Planner(model), commands, candidates, iterations)
    if output is not None:
        try:
            draw(Figure, found, commands).savefig(output, dpi=100)
        except (OSError, ValueError) as error:
            raise OutputError(f"cannot write {output}: {error}") from error
    if as_json:
        print_json({"friction": FRICTION.to_dict(), "errors": [asdict(each) for each in found]})
        return
    rows = [
        (f"{acceleration:g}", *(f"{error * MM:.2f}" for error in errors))
        for acceleration, *errors in (vars(each).values() for each in found)
    ]
    header = ("m/s^2", "network", "network, lifting", "optimizer", "optimizer, lifting")
    title = f"Mean tracking RMSE (mm), friction {FRICTION.static:g}/{FRICTION.kinetic:g}"
    print_tables([table(title, header, rows)])


def measure(planner: Planner, commands: int, candidates: int, iterations: int) -> list[Errors]:
    """Plan so many commands of `spline` under each limit of acceleration.

    Raises:
        MissingExtraError: numba is not installed.
    """
    with extra("refine"):
        from benchmarks.peers.cross_entropy import CrossEntropy
    found = []
    for acceleration in ACCELERATIONS:
        say(NAME, f"{acceleration:g} m/s^2")
        limits = Limits(acceleration=acceleration, jerk=min(JERK_RATE * acceleration, MOST_JERK))
        level = Task(f"{acceleration:g}", "spline", limits, FRICTION)
        errors = []
        for way in (level, level.lifting()):
            positions = way.positions(commands)
            plans = planner.plan_batch(positions, FRICTION, limits=way.limits)
            optimizer = CrossEntropy(candidates, iterations, limits=way.limits)
            both = [plan.pan_acceleration for plan in plans], optimizer(positions, [FRICTION] * len(positions))
            errors.append([float(tracking(positions, each, FRICTION).mean()) for each in both])
        (network, sampled), (network_lifting, sampled_lifting) = errors
        found.append(Errors(acceleration, network, network_lifting, sampled, sampled_lifting))
    return found


def draw(figure_class: Any, found: Sequence[Errors], commands: int) -> Any:
    """Draw the errors, both axes logarithmic."""
    figure = figure_class(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.subplots()
    accelerations = [each.acceleration for each in found]
    for who, colour in COLOURS.items():
        for way, line, marker in (("level", "-", "o"), ("lifting", "--", "^")):
            errors = [MM * getattr(each, f"{who}_{way}") for each in found]
            axes.plot(accelerations, errors, line, color=colour, marker=marker, label=f"{who}, {way}")
    axes.set(xscale="log", yscale="log", xlabel="limit of acceleration (m/s²)", ylabel="mean tracking RMSE (mm)")
    axes.set_xticks(accelerations, [f"{each:g}" for each in accelerations])
    axes.set_xticks([], minor=True)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    axes.grid(visible=True, which="both", color="0.9")
    axes.set_title(f"{commands} random paths of 1.2 s, friction {FRICTION.static:g}/{FRICTION.kinetic:g}", fontsize=10)
    axes.legend(frameon=False)
    return figure


if __name__ == "__main__":
    run(NAME, main)
