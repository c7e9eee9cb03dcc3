"""`python -m benchmarks.sections.peers`: the network beside two optimizers, on the same commands in the same run."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.sections.accuracy import PAN_REACH, Outcome, PlanFunction, measure
from benchmarks.suite.families import Family
from benchmarks.suite.suite import FAMILIES, suite
from runtime.cli.console import MM, AsJson, print_json, run, say
from runtime.documents.checks import FloatArray
from runtime.errors import extra
from runtime.friction import Friction
from runtime.planner import Planner

NAME = "benchmarks.sections.peers"
PROBE = 400
"""Samples of the command by which a planner's speed is estimated; the first ones, nearly at rest, cost less."""

DEFAULT_FAMILIES = tuple(name for name in FAMILIES if name != "friction")


@dataclass(frozen=True)
class Row:
    """One planner on one family.

    Lengths are in metres, `cpu` in seconds of processor time per plan, `times` that over the network's on the same
    commands, `speed` in samples per second of processor time.
    """

    family: str
    planner: str
    commands: int
    tracking_mean: float
    tracking_max: float
    pan_reach_max: float
    within: float
    change_mean: float
    cpu: float
    times: float
    speed: float


def main(
    model: Annotated[
        Path | None, typer.Option("--model", help="Bundle folder; the shipped one if not given.", metavar="DIR")
    ] = None,
    family: Annotated[list[str] | None, typer.Option(help="Family of the suite; may be repeated.")] = None,
    commands: Annotated[int | None, typer.Option(min=1, help="Only the first commands of each family.")] = None,
    candidates: Annotated[int, typer.Option(min=8, help="The optimizers' candidates in an iteration.")] = 512,
    iterations: Annotated[int, typer.Option(min=1, help="The optimizers' iterations in a planning.")] = 20,
    mppi: Annotated[bool, typer.Option(help="Measure path integral control too, by pytorch-mppi.")] = True,
    as_json: AsJson = False,
) -> None:
    """Measure the network beside two sampling optimizers that are told the friction; the whole takes some minutes."""
    families = [first(each, commands) for each in suite(family or DEFAULT_FAMILIES).values()]
    planner = Planner(model)
    contestants: dict[str, PlanFunction] = {planner.bundle.manifest.name: one_by_one(planner)}
    with extra("train"):
        from benchmarks.peers.cross_entropy import CrossEntropy
    optimizer = CrossEntropy(candidates, iterations)
    contestants[optimizer.name] = optimizer
    if mppi:
        with extra("dev"):
            import torch

            from benchmarks.peers.mppi import PathIntegral
        torch.set_num_threads(1)  # more would wait for each other at its small tensors, and count as time
        integral = PathIntegral(candidates, iterations)
        contestants[integral.name] = integral
    samples = sum(len(position) for each in families for position in each.positions)
    cost = {name: samples * seconds_per_sample(plan) for name, plan in contestants.items()}
    say(NAME, f"about {sum(cost.values()) / 60.0:.1f} minutes of one core: {_shares(cost)}")
    rows: list[Row] = []
    for each in families:
        network = 0.0
        for name, plan in contestants.items():
            say(NAME, f"{each.name}, {len(each)} commands: {name}")
            timed = Timed(plan)
            outcome = measure(timed, each)
            network = network or timed.cpu  # the network is the first
            rows.append(summary(name, outcome, timed.cpu, network))
    if as_json:
        print_json({"rows": [vars(row) for row in rows]})
    else:
        _print(rows)


def seconds_per_sample(plan: PlanFunction) -> float:
    """Let a planner compile and warm up, and return what planning a sample takes then (s of processor time)."""
    position = next(iter(suite(["spline"]).values())).positions[0][:PROBE]
    plan([position], [Friction()])
    timed = Timed(plan)
    timed([position], [Friction()])
    return timed.cpu / PROBE


def _shares(cost: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {seconds:.0f} s" for name, seconds in cost.items())


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


def summary(planner: str, outcome: Outcome, cpu: float, network: float) -> Row:
    """Sum up a planner's outcome on a family; it took `cpu` (s of processor time), the network `network`."""
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
        times=cpu / network,
        speed=sum(map(len, outcome.family.positions)) / cpu,
    )


def _print(rows: Sequence[Row]) -> None:
    from benchmarks.harness.tables import print_tables, table

    header = ("family", "planner", "n", "RMSE", "worst", "reach", "|du|", "ms", "times", "samples/s")
    lines = [
        (
            row.family,
            row.planner.split()[0],
            f"{row.commands}",
            f"{row.tracking_mean * MM:.2f}",
            f"{row.tracking_max * MM:.2f}",
            f"{row.pan_reach_max * MM:.0f}",
            f"{row.change_mean:.2f}",
            f"{row.cpu * 1e3:.0f}",
            f"{row.times:.0f}",
            f"{row.speed:,.0f}",
        )
        for row in rows
    ]
    # The optimizers' settings, part of their names, would make the table too wide; the command was told them.
    title = "RMSE, worst RMSE, worst pan reach (mm); processor time a plan, times the network's, samples per s of it"
    print_tables([table(title, header, lines)])


if __name__ == "__main__":
    run(NAME, main)
