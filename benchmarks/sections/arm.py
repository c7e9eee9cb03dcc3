"""The simulated arm's figures: `python -m benchmarks.sections.arm --model DIR`, beside what is asked for.

Each is measured over a set of runs, never over one: a change in the last digit of a number shifts where the object of
a single run ends by a millimetre or two.

Exit codes: 0 every figure is what is asked for, 1 one is missed (said in one line), 2 bad input or usage.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.suite.families import minimum_jerk, spline
from runtime.arm.controller import FULL_CONTROL, PAPER_CONTROL
from runtime.arm.motion import plan_of_motion
from runtime.arm.results import Results, judge
from runtime.arm.run import closed_loop, execute, open_loop
from runtime.arm.simulation import Simulated, SimulatedArm
from runtime.arm.video import Camera
from runtime.cli.console import DONE_BUT_MISSED, MM, AsJson, print_json, print_table, run, say
from runtime.friction import Friction
from runtime.physics.law import DT
from runtime.plan import Plan
from runtime.planner import Planner

NAME = "benchmarks.sections.arm"

FRICTION = 0.5
"""The friction of the paper's pybullet, static and kinetic (Section V-A)."""

SLIPPERY = Friction(FRICTION, FRICTION)
"""The law's friction under which it is what pybullet simulates."""

MOTIONS = 12
PLANS = 20

SAMPLES = 1200
PEAKS = (8.0, 15.0)
"""Range of a test motion's largest acceleration (m/s^2): the object slips from 4.9 m/s^2."""

FREQUENCIES = (1.5, 4.0)
"""Range of the frequencies a test motion is made of (Hz)."""

EASE = 0.3
"""Time in which a test motion gets going (s)."""

OBJECT_REACH = 0.12
"""Farthest that the object of a test motion slides from the pan's centre, by the law (m): it touches no rim."""

WRONG_MODEL = 0.8
JOINT_FRICTION = 1.0
"""Dry friction of every joint in the ablation of the observer (N m)."""

FRAME = (320, 240)


@dataclass(frozen=True)
class Figure:
    """One measured figure.

    Attributes:
        what: its name.
        value: what was measured.
        reach: what is asked for; None for a figure that stands beside another.
        at_least: whether more is better.
        unit: of both.
    """

    what: str
    value: float
    reach: float | None
    unit: str = "mm"
    at_least: bool = False

    @property
    def met(self) -> bool:
        """Whether the figure is what is asked for."""
        if self.reach is None:
            return True
        return self.value >= self.reach if self.at_least else self.value <= self.reach

    def __str__(self) -> str:
        asked = "" if self.reach is None else f" ({'>=' if self.at_least else '<='} {self.reach:g})"
        return f"{self.value:.3g} {self.unit}{asked}{'' if self.met else ', MISSED'}".replace("  ", " ")


def stick_slip_plan(seed: int) -> Plan:
    """Draw a smooth pan motion of at most 15 m/s^2 under which the object sticks and slips, and stays off the rim.

    Each axis is a sum of three sines that sets in gently.

    Args:
        seed: of what is drawn.

    Returns:
        A plan whose command is what the object does by the law under friction 0.5.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(SAMPLES, dtype=np.float64) * DT
    while True:
        frequency, phase = rng.uniform(*FREQUENCIES, (3, 2)), rng.uniform(0.0, 2.0 * np.pi, (3, 2))
        size = rng.uniform(0.3, 1.0, (3, 2)) / frequency**2
        waves = (size * np.sin(2.0 * np.pi * frequency * t[:, None, None] + phase)).sum(axis=1)
        position = minimum_jerk(t / EASE)[:, None] * waves
        velocity = np.gradient(position, DT, axis=0)
        velocity[0] = 0.0
        u = np.diff(velocity, axis=0, append=velocity[-1:]) / DT
        u *= rng.uniform(*PEAKS) / np.hypot(*u.T).max()
        plan = plan_of_motion(u, SLIPPERY, "test motion")
        if 0.005 < np.hypot(*plan.object_position.T).max() < OBJECT_REACH:
            return plan


def run_plan(plan: Plan, settings: Simulated, planner: Planner | None = None) -> Results:
    """Execute a plan, in closed loop if a planner is given, and return its figures."""
    source = open_loop(plan)
    if planner is not None:
        source = closed_loop(planner.stream(plan.command_position), planner.bundle.manifest.chunk)
    recording = execute(plan, SimulatedArm(settings), source)
    return judge(plan, recording, settings.friction)


def pan_tracking(motions: Sequence[Plan]) -> list[Figure]:
    """Measure the pan on smooth test motions, and the object beside the law of friction."""
    results = [run_plan(plan, Simulated()) for plan in motions]
    law = [result.law_rms or 0.0 for result in results]
    return [
        Figure("pan, test motions: RMS, worst", MM * max(result.pan_rms for result in results), 0.1),
        Figure("pan, test motions: maximum, worst", MM * max(result.pan_max for result in results), 0.3),
        Figure("pan, test motions: attitude, worst", float(np.degrees(_worst(results, "tilt_max"))), 0.1, "deg"),
        Figure("object to the law, test motions: median", MM * float(np.median(law)), 1.5),
        Figure("object to the law, test motions: worst", MM * max(law), 4.0),
        Figure("real-time factor, median", float(np.median(_all(results, "real_time_factor"))), 1.5, "x", True),
    ]


def paper_control(motions: Sequence[Plan]) -> list[Figure]:
    """Measure the pan with the controller of Fig. 7."""
    rms = _all([run_plan(plan, Simulated(control=PAPER_CONTROL)) for plan in motions], "pan_rms")
    return [Figure("pan, paper control, test motions: RMS, median", MM * float(np.median(rms)), 4.0)]


def observer_ablation(motions: Sequence[Plan]) -> list[Figure]:
    """Measure what the disturbance observer is worth when the model is wrong."""
    rms = {}
    for observer in (False, True):
        control = replace(FULL_CONTROL, observer=observer, model_scale=WRONG_MODEL)
        settings = Simulated(control=control, joint_friction=JOINT_FRICTION)
        rms[observer] = np.array(_all([run_plan(plan, settings) for plan in motions], "pan_rms"))
    return [
        Figure("pan, wrong model, no observer: RMS, median", MM * float(np.median(rms[False])), None),
        Figure("pan, wrong model, observer: RMS, median", MM * float(np.median(rms[True])), None),
        Figure("observer cuts RMS by, least", float((rms[False] / rms[True]).min()), 5.0, "x", True),
    ]


def network_plans(planner: Planner, count: int) -> list[Figure]:
    """Measure pan and object on a network's plans for the first commands of `spline`: open, closed, paper control."""
    positions = spline().positions[:count]
    plans = [planner.plan(position) for position in positions]
    on_law = [planner.plan(position, SLIPPERY).quality.tracking_rmse for position in positions]
    opened = [run_plan(plan, Simulated()) for plan in plans]
    closed = [run_plan(plan, Simulated(), planner) for plan in plans]
    paper = [run_plan(plan, Simulated(control=PAPER_CONTROL)) for plan in plans]
    paper_closed = [run_plan(plan, Simulated(control=PAPER_CONTROL), planner) for plan in plans]
    mean = MM * float(np.mean(_all(closed, "object_rms")))
    return [
        Figure("pan, network's plans: RMS, worst", MM * max(_all(opened + closed, "pan_rms")), 0.3),
        Figure("pan, network's plans: maximum, worst", MM * max(_all(opened + closed, "pan_max")), None),
        Figure("object to command, closed loop: mean", mean, 5.0),
        Figure("object to command, closed loop: median", MM * float(np.median(_all(closed, "object_rms"))), None),
        Figure("object to command, closed loop: worst", MM * _worst(closed, "object_rms"), None),
        Figure("the same by the law under 0.5/0.5: mean", MM * float(np.mean(on_law)), None),
        Figure("closed loop over the law", mean / (MM * float(np.mean(on_law))), 1.25, "x"),
        Figure("object to command, open loop: mean", MM * float(np.mean(_all(opened, "object_rms"))), None),
        Figure("object to command, open loop: worst", MM * _worst(opened, "object_rms"), None),
        Figure(
            "object to command, closed loop, paper control: mean",
            MM * float(np.mean(_all(paper_closed, "object_rms"))),
            None,
        ),
        Figure(
            "object to command, open loop, paper control: mean", MM * float(np.mean(_all(paper, "object_rms"))), None
        ),
        Figure("closed loop, object lost", sum(result.lost is not None for result in closed), 0, "runs"),
        Figure("open loop, object lost", sum(result.lost is not None for result in opened), None, "runs"),
        Figure(
            "paper control, object lost", sum(result.lost is not None for result in paper + paper_closed), None, "runs"
        ),
        Figure("runs held back by a limit", sum(bool(result.limits) for result in opened + closed), 0, "runs"),
        Figure("peak torque", max(max(result.torque_peaks) for result in opened + closed), None, "N m"),
        Figure("peak joint speed", max(max(result.speed_peaks) for result in opened + closed), None, "rad/s"),
    ]


def repeatability(motions: Sequence[Plan]) -> list[Figure]:
    """Count the plans whose second run differs from the first in any bit."""
    differing = 0
    for plan in motions:
        first, second = (execute(plan, SimulatedArm(), open_loop(plan)) for _ in range(2))
        differing += not (np.array_equal(first.pan, second.pan) and np.array_equal(first.sliding, second.sliding))
    return [Figure("runs that differ when repeated", differing, 0, "runs")]


def frame_time() -> list[Figure]:
    """Measure the rendering of a picture."""
    arm = SimulatedArm()
    arm.reset(np.zeros(2))
    camera = Camera(arm, np.zeros((2, 2)), FRAME)
    times = []
    for _ in range(30):
        begin = time.process_time()  # what other programs take is not asked about
        camera.picture(0)
        times.append(time.process_time() - begin)
    arm.close()
    return [Figure(f"picture of {FRAME[0]} x {FRAME[1]}, median", 1e3 * float(np.median(times)), 20.0, "ms")]


def _all(results: Iterable[Results], name: str) -> list[float]:
    return [float(getattr(result, name)) for result in results]


def _worst(results: Iterable[Results], name: str) -> float:
    return max(_all(results, name))


def measure(planner: Planner, plans: int = PLANS, motions: int = MOTIONS) -> list[Figure]:
    """Measure every figure.

    Args:
        planner: the network whose plans are executed.
        plans: how many of them.
        motions: how many test motions.
    """
    tests = [stick_slip_plan(seed) for seed in range(motions)]
    parts: list[Callable[[], list[Figure]]] = [
        lambda: pan_tracking(tests),
        lambda: paper_control(tests),
        lambda: observer_ablation(tests),
        lambda: network_plans(planner, plans),
        lambda: repeatability(tests[:3]),
        frame_time,
    ]
    return [figure for part in parts for figure in part()]


def bench_arm(
    model: Annotated[
        Path | None, typer.Option("--model", help="Bundle folder; the shipped one if not given.", metavar="DIR")
    ] = None,
    plans: Annotated[int, typer.Option("--plans", help="Commands of the suite to execute.", min=1, max=64)] = PLANS,
    motions: Annotated[int, typer.Option("--motions", help="Test motions to execute.", min=3)] = MOTIONS,
    as_json: AsJson = False,
) -> None:
    """Measure the simulated arm."""
    planner = Planner(model)
    figures = measure(planner, plans, motions)
    if as_json:
        rows = {figure.what: {"value": figure.value, "reach": figure.reach, "unit": figure.unit} for figure in figures}
        print_json({"model": planner.bundle.manifest.name, "plans": plans, "motions": motions, "figures": rows})
    else:
        title = f"simulated arm, {planner.bundle.manifest.name}: {motions} test motions, {plans} spline commands"
        print_table(title, [(figure.what, str(figure)) for figure in figures])
    missed = [f"{figure.what} {figure}" for figure in figures if not figure.met]
    if missed:
        say(NAME, f"missed {len(missed)}: {'; '.join(missed)}")
        raise typer.Exit(DONE_BUT_MISSED)


if __name__ == "__main__":
    run(NAME, bench_arm)
