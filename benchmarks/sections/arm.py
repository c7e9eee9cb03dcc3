"""The simulated arm: how well pan and object follow, what control and observer are worth, and how fast it is.

Each figure is of a set of runs, never of one: a change in the last digit of a number shifts where the object of one run
ends by a millimetre or two.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject, at_least
from benchmarks.harness.tables import targets_table
from benchmarks.harness.targets import COUNT, MILLIMETRES, TIMES, Target, Unit, Verdict
from benchmarks.suite.families import minimum_jerk, spline
from runtime.arm.controller import FULL_CONTROL, PAPER_CONTROL
from runtime.arm.results import Results
from runtime.arm.run import closed_loop, execute, open_loop
from runtime.arm.simulated import Simulated, Simulator
from runtime.arm.simulation import SETTLING, SimulatedArm
from runtime.documents.options import option
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.physics.law import DT
from runtime.plan import Plan, tracking_error
from runtime.planner import Planner

FRICTION = 0.5
"""The friction of the paper's pybullet, static and kinetic (Section V-A)."""

SLIPPERY = Friction(FRICTION, FRICTION)
"""The law's friction under which it is what pybullet simulates."""

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
class ArmSettings:
    """How many runs.

    Attributes:
        plans: of the network, for the first commands of `spline`.
        motions: test motions.
        repeated: of these that are run twice.
        pictures: rendered.
    """

    plans: int = option("The network's plans to execute on the arm, up to 64.", 20, "N")
    motions: int = option("Test motions to execute on the arm.", 12, "N")
    repeated: int = 3
    pictures: int = 30

    def __post_init__(self) -> None:
        at_least(1, plans=self.plans, motions=self.motions)
        if self.plans > len(spline()):
            raise InputError(f"--plans must be at most {len(spline())}, got {self.plans}")


@dataclass(frozen=True)
class PanTracking:
    """Test motions with full control.

    Attributes:
        rms_worst: distance between the pan and its command, root mean square over a run, the worst run (m).
        max_worst: largest distance of all (m).
        attitude_worst: largest deviation of the pan's attitude (rad).
        law_median, law_worst: distance between the object and the law of friction, root mean square over a run (m).
        real_time_factor: simulated time over the processor time it took, median.
    """

    rms_worst: float
    max_worst: float
    attitude_worst: float
    law_median: float
    law_worst: float
    real_time_factor: float


@dataclass(frozen=True)
class Observer:
    """What the disturbance observer is worth when the model is wrong, on test motions.

    Attributes:
        without_median, with_median: pan to its command, root mean square over a run (m).
        reduction_least: the first over the second, in the run where this is smallest.
    """

    without_median: float
    with_median: float
    reduction_least: float


@dataclass(frozen=True)
class NetworkPlans:
    """The network's plans on the arm.

    Attributes:
        pan_rms_worst: pan to its command, root mean square over a run, the worst run, open and closed loop (m).
        pan_max_worst: the largest distance of all of these (m).
        closed_mean, closed_median, closed_worst: object to command in closed loop, root mean square over a run (m).
        law_mean: the same by the law alone, under the simulator's friction (m).
        closed_over_law: the first over that.
        open_mean, open_worst: object to command in open loop (m).
        paper_closed_mean, paper_open_mean: the same with the controller of Fig. 7 (m).
        closed_lost, open_lost, paper_lost: runs whose object left the pan or toppled.
        held_back: runs in which a limit held the arm back, open and closed loop.
        torque_peak: (N m).
        speed_peak: of a joint (rad/s).
    """

    pan_rms_worst: float
    pan_max_worst: float
    closed_mean: float
    closed_median: float
    closed_worst: float
    law_mean: float
    closed_over_law: float
    open_mean: float
    open_worst: float
    paper_closed_mean: float
    paper_open_mean: float
    closed_lost: int
    open_lost: int
    paper_lost: int
    held_back: int
    torque_peak: float
    speed_peak: float


@dataclass(frozen=True)
class InSimulator:
    """What is measured in one simulator.

    Attributes:
        pan: test motions with full control.
        paper_control: pan to its command with the controller of Fig. 7, test motions, root mean square, median (m).
        observer: test motions with a wrong model.
        network: the network's plans.
        differing: test motions whose second run differs from the first in any bit.
        frame_time: processor time of a picture, median (s).
    """

    pan: PanTracking
    paper_control: float
    observer: Observer
    network: NetworkPlans
    differing: int
    frame_time: float


@dataclass(frozen=True)
class Arm:
    """Everything this section measures.

    Attributes:
        pybullet, mujoco: the same figures in either simulator.
        apart_motions: distance between the object's paths in the two, test motions, root mean square, median (m).
        apart_plans: the same of the network's plans in open loop (m).
    """

    pybullet: InSimulator
    mujoco: InSimulator
    apart_motions: float
    apart_plans: float


FINE_MILLIMETRES = Unit("mm", 1e3, "{:.3f}")
DEGREES = Unit("deg", 180.0 / np.pi, "{:.3f}")

IN_ONE = (
    Target("pan.rms_worst", "pan, test motions: RMS, worst", FINE_MILLIMETRES, "<=", 0.1e-3),
    Target("pan.max_worst", "pan, test motions: maximum, worst", FINE_MILLIMETRES, "<=", 0.3e-3),
    Target("pan.attitude_worst", "pan, test motions: attitude, worst", DEGREES, "<=", np.radians(0.1)),
    Target("pan.law_median", "object to the law, test motions: median", MILLIMETRES, "<=", 1.5e-3),
    Target("pan.law_worst", "object to the law, test motions: worst", MILLIMETRES, "<=", 4e-3),
    Target("pan.real_time_factor", "real-time factor, median", TIMES, ">=", 2.0),
    Target("paper_control", "pan, paper control: RMS, median", MILLIMETRES, "<=", 4e-3),
    Target("observer.without_median", "pan, wrong model, no observer: RMS", MILLIMETRES),
    Target("observer.with_median", "pan, wrong model, observer: RMS", MILLIMETRES),
    Target("observer.reduction_least", "observer cuts RMS by, least", TIMES, ">=", 5.0),
    Target("network.pan_rms_worst", "pan, network's plans: RMS, worst", FINE_MILLIMETRES, "<=", 0.1e-3),
    Target("network.pan_max_worst", "pan, network's plans: maximum, worst", FINE_MILLIMETRES),
    Target("network.closed_mean", "object, closed loop: RMS, mean", MILLIMETRES, "<=", 1.3e-3),
    Target("network.closed_median", "object, closed loop: median", MILLIMETRES),
    Target("network.closed_worst", "object, closed loop: worst", MILLIMETRES),
    Target("network.law_mean", "the same by the law under 0.5/0.5: mean", MILLIMETRES),
    Target("network.closed_over_law", "closed loop over the law", TIMES, "<=", 1.25),
    Target("network.open_mean", "object, open loop: mean", MILLIMETRES, "<=", 4e-3),
    Target("network.open_worst", "object, open loop: worst", MILLIMETRES),
    Target("network.paper_closed_mean", "object, paper control, closed loop: mean", MILLIMETRES),
    Target("network.paper_open_mean", "object, paper control, open loop: mean", MILLIMETRES),
    Target("network.closed_lost", "object lost, closed loop (runs)", COUNT, "<=", 0),
    Target("network.open_lost", "object lost, open loop (runs)", COUNT),
    Target("network.paper_lost", "object lost, paper control (runs)", COUNT),
    Target("network.held_back", "held back by a limit (runs)", COUNT, "<=", 0),
    Target("network.torque_peak", "peak torque", Unit("N m", show="{:.0f}")),
    Target("network.speed_peak", "peak joint speed", Unit("rad/s", show="{:.1f}")),
    Target("differing", "runs that differ when repeated", COUNT, "<=", 0),
    Target("frame_time", "picture of 320 x 240, median", Unit("ms", 1e3, "{:.1f}")),
)
"""Of the figures in either simulator."""

TARGETS = (
    *(
        replace(target, figure=f"{simulator}.{target.figure}", what=f"{simulator}: {target.what}")
        for simulator in Simulator
        for target in IN_ONE
    ),
    Target("apart_motions", "object, pybullet to MuJoCo, test motions: median", MILLIMETRES, "<=", 1.5e-3),
    Target("apart_plans", "object, pybullet to MuJoCo, network's plans: median", MILLIMETRES, "<=", 1.5e-3),
)


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
        plan = Plan.of_accelerations(u, SLIPPERY, "test motion")
        if 0.005 < np.hypot(*plan.object_position.T).max() < OBJECT_REACH:
            return plan


def run_plan(plan: Plan, settings: Simulated, planner: Planner | None = None) -> Results:
    """Execute a plan, in closed loop if a planner is given, and return its figures."""
    source = open_loop(plan)
    if planner is not None:
        stream = planner.stream(plan.command_position)
        source = closed_loop(stream, stream.chunk, len(plan))
    recording = execute(plan, SimulatedArm(settings), source)
    return Results.of(plan, recording, settings.friction)


def apart(plans: Sequence[Plan]) -> float:
    """Return the distance between the object's paths in either simulator, RMS over a run, median over plans (m)."""
    distances = []
    for plan in plans:
        first, second = (
            execute(plan, SimulatedArm(Simulated(simulator=simulator)), open_loop(plan)).sliding[: len(plan), :2]
            for simulator in Simulator
        )
        distances.append(tracking_error(first, second)[0])
    return float(np.median(distances))


def pan_tracking(motions: Sequence[Plan], simulator: Simulator) -> PanTracking:
    """Run test motions: the pan beside its command, the object beside the law of friction."""
    results, factors = [], []
    for plan in motions:
        begin = time.process_time()  # what other programs take does not count
        recording = execute(plan, SimulatedArm(Simulated(simulator=simulator)), open_loop(plan))
        factors.append((len(recording) * DT + SETTLING) / (time.process_time() - begin))
        results.append(Results.of(plan, recording, FRICTION))
    law = [result.law_rms or 0.0 for result in results]
    return PanTracking(
        rms_worst=max(_all(results, "pan_rms")),
        max_worst=max(_all(results, "pan_max")),
        attitude_worst=max(_all(results, "tilt_max")),
        law_median=float(np.median(law)),
        law_worst=max(law),
        real_time_factor=float(np.median(factors)),
    )


def paper_control(motions: Sequence[Plan], simulator: Simulator) -> float:
    """Return the pan's distance from its command with the controller of Fig. 7, RMS over a run, median (m)."""
    results = [run_plan(plan, Simulated(control=PAPER_CONTROL, simulator=simulator)) for plan in motions]
    return float(np.median(_all(results, "pan_rms")))


def observer_ablation(motions: Sequence[Plan], simulator: Simulator) -> Observer:
    """Run test motions with a wrong model, without the disturbance observer and with it."""
    rms = []
    for observer in (False, True):
        control = replace(FULL_CONTROL, observer=observer, model_scale=WRONG_MODEL)
        settings = Simulated(control=control, joint_friction=JOINT_FRICTION, simulator=simulator)
        rms.append(np.array(_all([run_plan(plan, settings) for plan in motions], "pan_rms")))
    without, with_it = rms
    return Observer(float(np.median(without)), float(np.median(with_it)), float((without / with_it).min()))


def network_plans(planner: Planner, count: int, simulator: Simulator) -> NetworkPlans:
    """Run a network's plans for the first commands of `spline`: in open and closed loop, with either control."""
    positions = spline().positions[:count]
    plans = [planner.plan(position) for position in positions]
    on_law = float(np.mean([planner.plan(position, SLIPPERY).quality.tracking_rmse for position in positions]))
    full, as_drawn = Simulated(simulator=simulator), Simulated(control=PAPER_CONTROL, simulator=simulator)
    opened = [run_plan(plan, full) for plan in plans]
    closed = [run_plan(plan, full, planner) for plan in plans]
    paper = [run_plan(plan, as_drawn) for plan in plans]
    paper_closed = [run_plan(plan, as_drawn, planner) for plan in plans]
    errors = _all(closed, "object_rms")
    return NetworkPlans(
        pan_rms_worst=max(_all(opened + closed, "pan_rms")),
        pan_max_worst=max(_all(opened + closed, "pan_max")),
        closed_mean=float(np.mean(errors)),
        closed_median=float(np.median(errors)),
        closed_worst=max(errors),
        law_mean=on_law,
        closed_over_law=float(np.mean(errors)) / on_law,
        open_mean=float(np.mean(_all(opened, "object_rms"))),
        open_worst=max(_all(opened, "object_rms")),
        paper_closed_mean=float(np.mean(_all(paper_closed, "object_rms"))),
        paper_open_mean=float(np.mean(_all(paper, "object_rms"))),
        closed_lost=_lost(closed),
        open_lost=_lost(opened),
        paper_lost=_lost(paper + paper_closed),
        held_back=sum(bool(result.limits) for result in opened + closed),
        torque_peak=max(max(result.torque_peaks) for result in opened + closed),
        speed_peak=max(max(result.speed_peaks) for result in opened + closed),
    )


def count_differing(motions: Sequence[Plan], simulator: Simulator) -> int:
    """Count the plans whose second run differs from the first in any bit."""
    differing = 0
    for plan in motions:
        first, second = (execute(plan, SimulatedArm(Simulated(simulator=simulator)), open_loop(plan)) for _ in range(2))
        differing += not (np.array_equal(first.pan, second.pan) and np.array_equal(first.sliding, second.sliding))
    return differing


def frame_time(pictures: int, simulator: Simulator) -> float:
    """Return the processor time of a picture, median (s)."""
    arm = SimulatedArm(Simulated(simulator=simulator))
    arm.reset(np.zeros(2))
    camera = arm.camera(np.zeros((2, 2)), FRAME)
    times = []
    for _ in range(pictures):
        begin = time.process_time()  # what other programs take does not count
        camera.picture(0)
        times.append(time.process_time() - begin)
    arm.close()
    return float(np.median(times))


def _all(results: Iterable[Results], name: str) -> list[float]:
    return [float(getattr(result, name)) for result in results]


def _lost(results: Iterable[Results]) -> int:
    return sum(result.lost is not None for result in results)


def measure_arm(subject: Subject, settings: ArmSettings) -> Measured:
    """Run test motions and the network's plans on the simulated arm, in either simulator.

    Raises:
        MissingExtraError: pybullet or mujoco is not installed.
    """
    tests = [stick_slip_plan(seed) for seed in range(settings.motions)]
    plans = [subject.planner.plan(position) for position in spline().positions[: settings.plans]]
    pybullet, mujoco = (_measure_in(simulator, subject.planner, tests, settings) for simulator in Simulator)
    return Measured(Arm(pybullet, mujoco, apart(tests), apart(plans)))


def _measure_in(simulator: Simulator, planner: Planner, tests: Sequence[Plan], settings: ArmSettings) -> InSimulator:
    return InSimulator(
        pan=pan_tracking(tests, simulator),
        paper_control=paper_control(tests, simulator),
        observer=observer_ablation(tests, simulator),
        network=network_plans(planner, settings.plans, simulator),
        differing=count_differing(tests[: settings.repeated], simulator),
        frame_time=frame_time(settings.pictures, simulator),
    )


def arm_tables(arm: Arm, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the figures of the arm, beside their targets."""
    return targets_table("The simulated arm", verdicts)


SECTION = Section(
    "arm",
    "the simulated arm: pan and object on test motions and on the network's plans",
    ArmSettings(),
    measure_arm,
    TARGETS,
    arm_tables,
    usual=False,
)
