"""How well a stream follows by what cameras and encoders tell: in the law's own world, or on a simulated arm."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from benchmarks.suite.false_reading import leaves
from benchmarks.suite.families import lengths, spline
from benchmarks.suite.world import LawArm
from runtime.arm.eyes import Camera, Eyes, LateArm
from runtime.arm.interface import Arm, Measured, PanCommand
from runtime.arm.simulated import Simulated, Simulator
from runtime.arm.simulation import SimulatedArm
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import DT
from runtime.physics.pan import integrate_pan
from runtime.planner import Planner
from runtime.stream import Stream

TOLD, TRUE = Friction(1.0, 0.5), Friction(0.5, 0.5)
"""Friction planned for, and that of the world, where nothing else is said."""

LEAST_NOISE = 2e-4
"""Noise that a stream is told of a camera that has none (m)."""

LATER = 600
"""Samples after which friction should be found."""

PUSH_AT, PUSH = 620, 0.02
"""Sample at which an object is pushed, and how far (m)."""

OBJECT_LATE = 50
"""Samples that an object's states are late where the pan's are fresh."""

FRICTIONS = (Friction(1.0, 0.5), Friction(0.6, 0.45), Friction(0.8, 0.4), Friction(0.5, 0.5), Friction(0.7, 0.6))
"""Those that are to be found."""


class Place(StrEnum):
    """Where commands are followed."""

    LAW = "law"
    PYBULLET = "pybullet"
    MUJOCO = "mujoco"

    def arm(self, true: Friction, push: FloatArray | None = None) -> Arm:
        """Return an arm there; a simulator has one coefficient of friction, and nobody who pushes."""
        if self is Place.LAW:
            return LawArm(true, {} if push is None else {PUSH_AT: push})
        return SimulatedArm(Simulated(friction=true.kinetic, simulator=Simulator(self.value)))


@dataclass(frozen=True)
class Followed:
    """How some commands were followed.

    Attributes:
        mean, median, p90, worst: tracking RMSE of a command (m).
        later: mean of it from LATER samples on (m).
        pan_reach: largest distance of the true pan from its centre (m).
    """

    mean: float
    median: float
    p90: float
    worst: float
    later: float
    pan_reach: float

    @classmethod
    def of(cls, runs: Sequence[Run]) -> Followed:
        """Return how they were."""
        rms, later = (np.array([np.sqrt(np.mean(run.error[first:] ** 2)) for run in runs]) for first in (0, LATER))
        median, p90 = (float(each) for each in np.percentile(rms, (50, 90)))
        reach = max(run.pan_reach for run in runs)
        return cls(float(rms.mean()), median, p90, float(rms.max()), float(later.mean()), reach)


@dataclass(frozen=True)
class Pushed:
    """Time (s) after a push of 20 mm until the mean error falls below twice what it is without one.

    Attributes:
        positions: told positions every millisecond.
        camera_30: 30 a second, 50 ms old.
        median: of single commands, told positions every millisecond: until each one's error falls below that.
    """

    positions: float
    camera_30: float
    median: float


@dataclass(frozen=True)
class Found:
    """How well friction is found while it slides, from 1.2 s at 100 frames a second with 1 mm of noise.

    Attributes:
        kinetic_median, kinetic_worst: relative error of the kinetic one.
        kinetic_share, static_share: share of the runs whose interval holds the true one.
    """

    kinetic_median: float
    kinetic_worst: float
    kinetic_share: float
    static_share: float


@dataclass(frozen=True)
class InLaw:
    """What is measured in the law's world alone.

    Attributes:
        sticky: as camera_30, told 1.0/0.5 where 0.7/0.5 is true.
        pushed: how soon a push is corrected.
        found: how well friction is found.
        outside: of streams with one false reading each, the number whose pan left its reach; `false` is theirs.
        false: number of streams with one false reading each.
        p99: 99th percentile of the time of a step with the frame and the encoders' state before it (s).
    """

    sticky: Followed
    pushed: Pushed
    found: Found
    outside: int
    false: int
    p99: float


@dataclass(frozen=True)
class Sight:
    """What a stream makes of what it is told.

    Attributes:
        states: told states every millisecond.
        camera_60, camera_30: positions alone, 60 a second and 20 ms old, 30 a second and 50 ms old.
        camera_30_noise: the latter with 1 mm of noise, and a tenth of the frames lost.
        object_late: told states with every step, the object's 50 ms old, the pan's fresh.
        delay_5, delay_10, delay_20: 60 positions a second, and an arm that executes so many ms late, which is told.
        delay_found: 20 ms, which is not told.
        slippery: as camera_30, told 1.0/0.5 where 0.4/0.4 is true.
        pan_reach: the largest of all of these (m).
        law: what is measured in the law's world alone; None on a simulated arm.
    """

    states: Followed
    camera_60: Followed
    camera_30: Followed
    camera_30_noise: Followed
    object_late: Followed
    delay_5: Followed
    delay_10: Followed
    delay_20: Followed
    delay_found: Followed
    slippery: Followed
    pan_reach: float
    law: InLaw | None


class Run:
    """One command followed by a stream.

    Args:
        planner: what follows.
        position: the command (K, 2) (m).
        arm: what executes.
        eyes: what sees; None to tell states with every step.
        command_delay: as the stream is told it.
        late: samples that the object's states are old, where there are no eyes.

    Attributes:
        error: (K,) distance between object and command (m).
        pan_reach: largest distance of the true pan from its centre (m).
        durations: of each step with what was told right before it (s).
        stream: what followed.
    """

    def __init__(
        self,
        planner: Planner,
        position: FloatArray,
        arm: Arm,
        eyes: Eyes | None = None,
        command_delay: float | None = 0.0,
        late: int = 0,
    ) -> None:
        noise = LEAST_NOISE if eyes is None else max(eyes.noise, LEAST_NOISE)
        self.stream = planner.stream(position, TOLD, command_delay=command_delay, noise=noise)
        arm = LateArm(arm, 0.0 if eyes is None else eyes.command_delay)
        self.durations: list[float] = []
        measured = [arm.reset(position[0])]
        camera, chunk = None if eyes is None else Camera(eyes), self.stream.chunk
        asked, told = -chunk, np.zeros(6)
        for k in range(len(position) - 1):
            begin, executed = time.perf_counter(), k - asked
            if camera is not None:
                _see(self.stream, camera, executed, measured)
            if executed == chunk or self.stream.due:
                pan, sliding = _states(measured, chunk, late) if camera is None else (None, None)
                u, asked = self.stream.step(pan, sliding, executed=executed, object_age=late * DT), k
                self.durations.append(time.perf_counter() - begin)
            now = u[k - asked]
            measured.append(arm.step(PanCommand(told[:3], told[3:], now)))
            told = integrate_pan(told, now[None])[0]
        arm.close()
        self.error = lengths(np.array([each.sliding[:2] for each in measured]) - position)
        self.pan_reach = float(lengths(np.array([each.pan[:2] for each in measured])).max())


def _see(stream: Stream, camera: Camera, executed: int, measured: Sequence[Measured]) -> None:
    """Tell a stream what is seen after so many samples of its chunk."""
    k = len(measured) - 1
    for frame in camera.look(k, measured[-1]):
        stream.see_object(frame.position, (k - frame.taken) * DT, executed)
    stream.see_pan(measured[-1].pan, 0.0, executed)


def _states(measured: Sequence[Measured], chunk: int, late: int) -> tuple[FloatArray, FloatArray] | tuple[None, None]:
    """Return what a step is told: the last states of the pan, and those of the object so many samples ago."""
    seen = measured[: len(measured) - late][-chunk:]
    if len(seen) < chunk:
        return None, None
    return np.array([each.pan for each in measured[-chunk:]]), np.array([each.sliding for each in seen])


def measure_sight(planner: Planner, commands: int, false: int, place: Place = Place.LAW) -> Sight:
    """Measure, with the first commands of the family spline and so many false readings."""
    positions = spline().positions[:commands]

    def runs(
        eyes: Eyes | None = None, true: Friction = TRUE, command_delay: float | None = 0.0, late: int = 0
    ) -> list[Run]:
        seen = [None if eyes is None else replace(eyes, seed=seed) for seed in range(len(positions))]
        return [
            Run(planner, position, place.arm(true), each, command_delay, late)
            for position, each in zip(positions, seen, strict=True)
        ]

    slow = Eyes(camera_rate=30.0, latency=0.05)
    slow_runs = runs(slow)
    followed = {
        "states": Followed.of(runs()),
        "camera_60": Followed.of(runs(Eyes(60.0, 0.02))),
        "camera_30": Followed.of(slow_runs),
        "camera_30_noise": Followed.of(runs(Eyes(30.0, 0.05, 1e-3, 0.1))),
        "object_late": Followed.of(runs(late=OBJECT_LATE)),
        "delay_found": Followed.of(runs(Eyes(60.0, command_delay=0.02), command_delay=None)),
        "slippery": Followed.of(runs(slow, Friction(0.4, 0.4))),
    }
    for late in (5, 10, 20):
        eyes = Eyes(60.0, command_delay=late * DT)
        followed[f"delay_{late}"] = Followed.of(runs(eyes, command_delay=eyes.command_delay))
    law = None
    if place is Place.LAW:
        law = InLaw(
            sticky=Followed.of(runs(slow, Friction(0.7, 0.5))),
            pushed=_pushed(planner, positions, slow, slow_runs),
            found=_found(planner, positions),
            outside=sum(leaves(planner, seed) for seed in range(false)),
            false=false,
            p99=float(np.percentile(np.concatenate([run.durations[1:] for run in slow_runs]), 99)),
        )
    return Sight(**followed, pan_reach=max(each.pan_reach for each in followed.values()), law=law)


def _pushed(planner: Planner, positions: Sequence[FloatArray], slow: Eyes, slow_runs: Sequence[Run]) -> Pushed:
    fast = Eyes(1000.0)
    nominal = np.mean([Run(planner, each, Place.LAW.arm(TRUE), fast).error for each in positions])
    each = np.array([_after_push(planner, position, index, fast) for index, position in enumerate(positions)])
    slowly = np.array([_after_push(planner, position, index, slow) for index, position in enumerate(positions)])
    return Pushed(
        positions=_back(each.mean(axis=0), nominal),
        camera_30=_back(slowly.mean(axis=0), np.mean([run.error for run in slow_runs])),
        median=float(np.median([_back(error, nominal) for error in each])),
    )


def _after_push(planner: Planner, position: FloatArray, index: int, eyes: Eyes) -> FloatArray:
    """Return the errors (m) from the push on."""
    angle = 2.4 * index
    push = PUSH * np.array([math.cos(angle), math.sin(angle)])
    return Run(planner, position, Place.LAW.arm(TRUE, push), eyes).error[PUSH_AT:]


def _back(error: FloatArray, nominal: np.floating) -> float:
    """Return when an error (m) falls below twice the nominal one (s)."""
    over = error > 2.0 * nominal
    return float(over.argmin() if not over.all() else len(over)) * DT


def _found(planner: Planner, positions: Sequence[FloatArray]) -> Found:
    errors, kinetic_held, static_held = [], [], []
    for index, position in enumerate(positions):
        true = FRICTIONS[index % len(FRICTIONS)]
        run = Run(planner, position, Place.LAW.arm(true), Eyes(100.0, 0.02, 1e-3, seed=index))
        friction, kinetic, static = run.stream.friction
        errors.append(abs(friction.kinetic / true.kinetic - 1.0))
        kinetic_held.append(kinetic[0] <= true.kinetic <= kinetic[1])
        static_held.append(static[0] <= true.static <= static[1])
    return Found(float(np.median(errors)), max(errors), float(np.mean(kinetic_held)), float(np.mean(static_held)))
