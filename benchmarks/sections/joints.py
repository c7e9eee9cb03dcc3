"""Arms that people own: how many commands their joints follow, slowed down how much, and tracked how well."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject, at_least
from benchmarks.harness.tables import table
from benchmarks.harness.targets import COUNT, MILLIMETRES, MILLISECONDS, TIMES, Target, Verdict
from benchmarks.suite.families import spline
from runtime.arm.results import Results
from runtime.arm.run import closed_loop, execute
from runtime.arm.simulated import Simulated, Simulator
from runtime.arm.simulation import SimulatedArm
from runtime.arms.check import JointCheck
from runtime.arms.fit import CANDIDATES, Fitted, fit
from runtime.arms.load import load_arm
from runtime.arms.model import ArmModel
from runtime.arms.motion import JointMotion, follow_pan, follow_plan
from runtime.arms.place import Place, find_place
from runtime.command import Command
from runtime.documents.options import option
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.law import DT
from runtime.plan import Plan
from runtime.planner import Planner

STRONG, WEAK = ("ur5e", "ur10e", "xarm6"), ("fr3", "panda", "iiwa14")
"""Arms whose joints break an object away at the first of the frictions below, and those that need the second."""

PLAIN, SLIPPERY = Friction(0.3, 0.25), Friction(0.15, 0.1)

EIGHT = Path(__file__).parents[2] / "examples" / "figure_eight.csv"
"""The README's command."""

TRACKED = 3e-3
"""Distance between object and path that is to be reached, planned and executed (m)."""

HEADER = ("arm", "friction", "hold", "slowed", "planned (mm)", "MuJoCo (mm)", "lost", "passed")
"""Columns of the table."""

DURATION = 1.2
"""Time for which that of the inverse kinematics is told (s)."""


@dataclass(frozen=True)
class JointsSettings:
    """What is planned: a figure eight and the first commands of `spline`.

    Attributes:
        splines: how many of these.
        arms: for which arms.
        executed: how many of the plans for each arm are executed in MuJoCo, in closed loop.
    """

    splines: int = option("Commands of `spline` to plan for each arm, up to 64.", 12, "N")
    arms: tuple[str, ...] = (*STRONG, *WEAK)
    executed: int = 64

    def __post_init__(self) -> None:
        at_least(1, splines=self.splines, executed=self.executed)
        if self.splines > len(spline()):
            raise InputError(f"--splines must be at most {len(spline())}, got {self.splines}")


@dataclass(frozen=True)
class OnArm:
    """The commands on one arm.

    Attributes:
        commands: how many there were.
        missed: how many of them its joints do not hold, or are not tracked within TRACKED.
        stretch: most that one of them is slowed down.
        tracking: mean tracking RMSE (m).
        solving: median time of the processor for the inverse kinematics of a plan of 1.2 s (s).
        position_error: farthest that the joints hold the pan off its path (m).
        executed: mean distance between object and command in MuJoCo, root mean square over a run (m).
        lost: how many objects fell off the pan there or toppled.
        touched: in how many runs a limit of the joints acted.
        passed: in how many runs a joint was commanded more than its limits.
    """

    commands: int
    missed: int
    stretch: float
    tracking: float
    solving: float
    position_error: float
    executed: float
    lost: int
    touched: int
    passed: int


@dataclass(frozen=True)
class Joints:
    """Everything this section measures, by the arm's name."""

    arms: dict[str, OnArm] = field(default_factory=dict)


def _targets(name: str, most: float) -> tuple[Target, ...]:
    return (
        Target(f"arms.{name}.missed", f"{name}: commands whose joints do not hold", COUNT, "<=", 0.0),
        Target(f"arms.{name}.stretch", "  slowed down, at most", TIMES, "<=", most),
        Target(f"arms.{name}.tracking", "  tracking RMSE, mean", MILLIMETRES, "<=", TRACKED),
        Target(f"arms.{name}.solving", "  inverse kinematics of 1.2 s", MILLISECONDS, "<=", 0.3),
        Target(f"arms.{name}.position_error", "  pan off its path, at most", MILLIMETRES, "<=", 1e-4),
        Target(f"arms.{name}.executed", "  object to command in MuJoCo, mean", MILLIMETRES, "<=", TRACKED),
        Target(f"arms.{name}.lost", "  objects lost there", COUNT, "<=", 0.0),
        Target(f"arms.{name}.touched", "  runs in which a limit acted", COUNT, "<=", 0.0),
        Target(f"arms.{name}.passed", "  runs in which a joint was told more than its limit", COUNT, "<=", 0.0),
    )


TARGETS = (
    *(target for name in STRONG for target in _targets(name, 2.0)),
    *(target for name in WEAK for target in _targets(name, 4.0)),
)


def measure_joints(subject: Subject, settings: JointsSettings) -> Measured:
    """Plan the commands for each arm.

    Raises:
        MissingExtraError: mujoco is not installed.
    """
    commands = [
        Command.load(EIGHT),
        *(Command.from_samples(position) for position in spline().positions[: settings.splines]),
    ]
    planner = Planner()
    return Measured(Joints({name: _on_arm(name, planner, commands, settings.executed) for name in settings.arms}))


def _on_arm(name: str, planner: Planner, commands: Sequence[Command], executed: int) -> OnArm:
    model, friction = ArmModel(load_arm(name)), PLAIN if name in STRONG else SLIPPERY
    place = find_place(model)

    def make(command: Command, limits: Limits) -> Plan:
        return planner.plan(command, friction=friction, limits=limits, candidates=CANDIDATES)

    fitted = [fit(make, command, model, place, Limits(), stretch=True) for command in commands]
    solving = []
    for each in fitted:
        begin = time.process_time()
        follow_plan(model, place, each.plan)
        solving.append((time.process_time() - begin) * DURATION / (len(each.joints) * DT))
    runs = [_execute(each.plan, planner, model, place) for each in fitted[:executed]]
    errors = [each.plan.quality.tracking_rmse for each in fitted]
    return OnArm(
        len(commands),
        sum(not _good(each) for each in fitted),
        max(each.stretch for each in fitted),
        float(np.mean(errors)),
        float(np.median(solving)),
        max(each.joints.position_error for each in fitted),
        float(np.mean([run.object_rms for run, _ in runs])),
        sum(run.lost is not None for run, _ in runs),
        sum(bool(run.limits) for run, _ in runs),
        sum(bool(commanded.exceeded) for _, commanded in runs),
    )


def _execute(plan: Plan, planner: Planner, model: ArmModel, place: Place) -> tuple[Results, JointMotion]:
    """Execute a plan in closed loop, under the kinetic friction it was made for, which is static friction there too.

    Returns:
        How it went, and the joints along what was commanded.
    """
    settings = Simulated(simulator=Simulator.MUJOCO, friction=plan.friction.kinetic)
    limits = Limits.from_dict(plan.quality.limits)
    check = JointCheck(model, place)
    stream = planner.stream(plan.command_position, plan.friction, limits=limits, sizes=plan.sizes, check=check)
    arm = SimulatedArm(settings, model.arm, place.home)
    recording = execute(plan, arm, closed_loop(stream, stream.chunk, len(plan)))
    return Results.of(plan, recording, settings.friction), follow_pan(model, place, recording.pan_command)


def _good(fitted: Fitted) -> bool:
    return fitted.holds and fitted.plan.quality.tracking_rmse <= TRACKED


def joints_tables(joints: Joints, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return a row for each arm, and what is asked for at most; `--page` writes the arms into their guide."""
    asked = ["asked for", "", "all", "2 or 4", MILLIMETRES.text(TRACKED), MILLIMETRES.text(TRACKED), "0", "0"]
    return [table("Arms that people own", HEADER, [*(_row(name, arm) for name, arm in joints.arms.items()), asked])]


def _row(name: str, arm: OnArm) -> list[str]:
    friction = PLAIN if name in STRONG else SLIPPERY
    return [
        f"`{name}`",
        f"{friction.static:g}/{friction.kinetic:g}",
        f"{arm.commands - arm.missed} of {arm.commands}",
        f"{arm.stretch:.2f}",
        MILLIMETRES.text(arm.tracking),
        MILLIMETRES.text(arm.executed),
        str(arm.lost),
        str(arm.passed),
    ]


SECTION = Section(
    "joints",
    "commands that the joints of arms follow, slowed down how much",
    JointsSettings(),
    measure_joints,
    TARGETS,
    joints_tables,
    usual=False,
)
