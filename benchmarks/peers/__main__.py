"""`python -m benchmarks.peers`: the network beside two optimizers, on the same commands in the same run."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.accuracy import PAN_REACH, Outcome, PlanFunction, measure
from benchmarks.suite import FAMILIES, Family, suite
from runtime.cli import MM, AsJson, extra, print_json, run
from runtime.friction import FloatArray, Friction
from runtime.planner import Planner

NAME = "benchmarks.peers"
MPPI_COMMANDS = 4
"""Commands of each family that the slowest planner is given, unless told otherwise; the table says how many."""

DEFAULT_FAMILIES = tuple(name for name in FAMILIES if name != "friction")


@dataclass(frozen=True)
class Row:
    """One planner on one family: lengths in metres, `cpu` in seconds of processor time a plan, `speed` in samples/s."""

    family: str
    planner: str
    commands: int
    tracking_mean: float
    tracking_max: float
    pan_reach_max: float
    within: float
    change_mean: float
    cpu: float
    speed: float


def main(
    model: Annotated[
        Path | None, typer.Option("--model", help="Bundle folder; the shipped one if not given.", metavar="DIR")
    ] = None,
    family: Annotated[list[str] | None, typer.Option(help="Family of the suite; may be repeated.")] = None,
    commands: Annotated[int | None, typer.Option(min=1, help="Only the first commands of each family.")] = None,
    candidates: Annotated[int, typer.Option(min=8, help="The optimizers' candidates in an iteration.")] = 512,
    iterations: Annotated[int, typer.Option(min=1, help="The optimizers' iterations in a planning.")] = 20,
    mppi: Annotated[
        int, typer.Option(min=0, help="Commands of each family that MPPI is given, its first ones; 0 leaves it out.")
    ] = MPPI_COMMANDS,
    as_json: AsJson = False,
) -> None:
    """Measure the network beside two sampling optimizers that are told the friction."""
    with extra("train"):
        from benchmarks.peers.cross_entropy import CrossEntropy  # needs numba
    planner, optimizer = Planner(model), CrossEntropy(candidates, iterations)
    contestants: dict[str, tuple[PlanFunction, int | None]] = {
        planner.bundle.manifest.name: (one_by_one(planner), None),
        optimizer.name: (optimizer, None),
    }
    if mppi:
        with extra("dev"):
            from benchmarks.peers.mppi import PathIntegral  # needs pytorch-mppi
        integral = PathIntegral(candidates, iterations)
        contestants[integral.name] = (integral, mppi)
    rows = []
    for chosen in suite(family or DEFAULT_FAMILIES).values():
        for name, (plan, most) in contestants.items():
            part = first(first(chosen, commands), most)
            plan(part.positions[:1], part.frictions[:1])  # warms up, compiles
            timed = Timed(plan)
            rows.append(summary(name, measure(timed, part), timed.cpu))
    if as_json:
        print_json({"rows": [vars(row) for row in rows]})
    else:
        _print(rows)


class Timed:
    """A planner whose processor time is counted, in `cpu` (s)."""

    def __init__(self, plan: PlanFunction) -> None:
        self._plan = plan
        self.cpu = 0.0

    def __call__(self, positions: Sequence[FloatArray], frictions: Sequence[Friction]) -> Sequence[FloatArray]:
        """Plan as the planner does."""
        begin = time.process_time()
        plans = self._plan(positions, frictions)
        self.cpu += time.process_time() - begin
        return plans


def one_by_one(planner: Planner) -> PlanFunction:
    """Plan each command alone, as a user with one command would."""

    def plan(positions: Sequence[FloatArray], frictions: Sequence[Friction]) -> list[FloatArray]:
        return [
            planner.plan(position, friction).pan_acceleration
            for position, friction in zip(positions, frictions, strict=True)
        ]

    return plan


def first(family: Family, commands: int | None) -> Family:
    """Return the family with its first commands only."""
    return replace(
        family,
        positions=family.positions[:commands],
        frictions=family.frictions[:commands],
        labels=family.labels[:commands],
    )


def summary(planner: str, outcome: Outcome, cpu: float) -> Row:
    """Sum up a planner's outcome on a family, for which it took `cpu` seconds of processor time."""
    count = len(outcome.tracking)
    return Row(
        family=outcome.family.name,
        planner=planner,
        commands=count,
        tracking_mean=float(outcome.tracking.mean()),
        tracking_max=float(outcome.tracking.max()),
        pan_reach_max=float(outcome.pan_reach.max()),
        within=float(np.mean(outcome.pan_reach <= PAN_REACH)),
        change_mean=float(outcome.change_mean.mean()),
        cpu=cpu / count,
        speed=sum(map(len, outcome.family.positions)) / cpu,
    )


def _print(rows: Sequence[Row]) -> None:
    from benchmarks.tables import print_tables, table

    header = ("family", "planner", "n", "RMSE", "worst", "reach", f"<= {PAN_REACH * MM:.0f}", "|du|", "ms", "samples/s")
    lines = [
        (
            row.family,
            row.planner,
            f"{row.commands}",
            f"{row.tracking_mean * MM:.2f}",
            f"{row.tracking_max * MM:.2f}",
            f"{row.pan_reach_max * MM:.0f}",
            f"{row.within:.0%}",
            f"{row.change_mean:.2f}",
            f"{row.cpu * 1e3:.0f}",
            f"{row.speed:,.0f}",
        )
        for row in rows
    ]
    print_tables(
        [table("RMSE, worst RMSE, worst pan reach (mm); processor time a plan, samples per s of it", header, lines)]
    )


if __name__ == "__main__":
    run(NAME, main)
