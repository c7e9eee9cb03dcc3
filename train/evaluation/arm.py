"""The paper's evaluation with the arm in pybullet: Fig. 9 (trajectories), Fig. 10 (snapshots), and a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime import Friction
from runtime.arm.controller import FULL_CONTROL, PAPER_CONTROL, ControlSettings
from runtime.arm.interface import ObjectStatus
from runtime.arm.results import Results
from runtime.arm.run import closed_loop, execute, open_loop
from runtime.arm.simulated import Simulated
from runtime.arm.simulation import SimulatedArm
from runtime.plan import Plan
from train.commands.families import FloatArray
from train.evaluation.evaluate import NOMINAL, Subject

COMMANDS = 20

IN_PYBULLET = Friction(0.5, 0.5)
"""The friction of the paper's pybullet (Section V-A); the networks plan for another and are not told."""

WAYS = {
    "open loop": (FULL_CONTROL, False),
    "closed loop": (FULL_CONTROL, True),
    "open loop, paper control": (PAPER_CONTROL, False),
}
"""The ways a command is executed: which parts of the controller act, and whether the network sees what is measured."""

LAW = "law of friction, no arm"

SNAPSHOTS = (0.0, 0.4, 0.8, 1.2)
"""Times of the snapshots (s)."""

PICTURE = (480, 360)
"""Size of a snapshot (pixels)."""


class ArmRow(NamedTuple):
    """Figures over some commands: distance from object to command and from pan to its command, RMS, in metres."""

    rmse_mean: float
    rmse_median: float
    rmse_worst: float
    pan_worst: float
    lost: int
    held_back: int


def evaluate_on_arm(subject: Subject, position: FloatArray) -> dict[str, ArmRow]:
    """Execute (B, K, 2) commands in every way of WAYS; the law of friction under the same friction stands beside.

    Returns:
        The rows by their names: LAW, then those of WAYS.
    """
    plans = subject.plan(position, NOMINAL)
    error = np.array([plan.quality.tracking_rmse for plan in subject.plan(position, IN_PYBULLET)])
    rows = {LAW: ArmRow(float(error.mean()), float(np.median(error)), float(error.max()), 0.0, 0, 0)}
    for name, (control, closed) in WAYS.items():
        results = [_execute(subject, plan, control, closed) for plan in plans]
        rmse = [result.object_rms for result in results]
        rows[name] = ArmRow(
            float(np.mean(rmse)),
            float(np.median(rmse)),
            max(rmse),
            max(result.pan_rms for result in results),
            sum(result.lost is not None for result in results),
            sum(bool(result.limits) for result in results),
        )
    return rows


class Photographed(NamedTuple):
    """A command executed for the figures: positions (K, 2) (m; not a number once the object is lost), snapshots."""

    name: str
    object_position: FloatArray
    pan_position: FloatArray
    snapshots: list[NDArray[np.uint8]]


def photograph(subject: Subject, position: FloatArray) -> Photographed:
    """Execute one (K, 2) command open loop, as the paper does, and take its pictures."""
    (plan,) = subject.plan(position[None], NOMINAL)
    arm = SimulatedArm(Simulated(friction=IN_PYBULLET.kinetic))
    camera = arm.camera(plan.command_position, PICTURE)
    pictures: list[NDArray[np.uint8]] = []
    moments = {round(time / plan.dt) for time in SNAPSHOTS}

    def snap(k: int, measured: object) -> None:
        if k in moments:
            pictures.append(camera.picture(k))

    recording = execute(plan, arm, open_loop(plan), [snap])
    samples = len(plan)
    sliding = recording.sliding[:samples, :2]
    gone = [each.status is not ObjectStatus.ON_PAN for each in recording.measured[:samples]]
    sliding[np.maximum.accumulate(gone)] = np.nan
    return Photographed(subject.name, sliding, recording.pan[:samples, :2], pictures)


def draw_snapshots(figure_class: Any, runs: Sequence[Photographed]) -> Any:
    """Fig. 10: a row of pictures for each model."""
    columns = len(SNAPSHOTS)
    figure = figure_class(figsize=(3.0 * columns, 2.35 * len(runs) + 0.3), layout="constrained")
    grid = np.reshape(figure.subplots(len(runs), columns), (len(runs), columns))
    for row, each in zip(grid, runs, strict=True):
        for axes, time, picture in zip(row, SNAPSHOTS, each.snapshots, strict=True):
            axes.imshow(picture)
            axes.set(xticks=[], yticks=[], title=f"{each.name}, {time:g} s")
    return figure


def arm_table(rows_of: Mapping[str, Mapping[str, ArmRow]]) -> str:
    """Return a Markdown table of each model's rows."""
    lines = [
        "| model | executed | object to command, mean | median | worst | pan to its command, worst | object lost |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, rows in rows_of.items():
        for way, row in rows.items():
            pan = "-" if way == LAW else f"{1e3 * row.pan_worst:.2f} mm"
            lines.append(
                f"| {name} | {way} | {1e3 * row.rmse_mean:.1f} mm | {1e3 * row.rmse_median:.1f} mm "
                f"| {1e3 * row.rmse_worst:.1f} mm | {pan} | {'-' if way == LAW else row.lost} |"
            )
    return "\n".join(lines)


def _execute(subject: Subject, plan: Plan, control: ControlSettings, closed: bool) -> Results:
    source = open_loop(plan)
    if closed:
        source = closed_loop(subject.follow(plan.command_position), subject.chunk, len(plan))
    arm = SimulatedArm(Simulated(control=control, friction=IN_PYBULLET.kinetic))
    return Results.of(plan, execute(plan, arm, source), IN_PYBULLET.kinetic)
