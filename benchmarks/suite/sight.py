"""How well a stream follows by what cameras and encoders tell, in a world in which the law of friction holds."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.suite.families import lengths, spline
from benchmarks.suite.world import LawArm
from runtime.arm.eyes import Camera, Eyes, LateArm
from runtime.arm.interface import Measured, PanCommand
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.law import DT
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

FRICTIONS = (Friction(1.0, 0.5), Friction(0.6, 0.45), Friction(0.8, 0.4), Friction(0.5, 0.5), Friction(0.7, 0.6))
"""Those that are to be found."""


@dataclass(frozen=True)
class Followed:
    """How some commands were followed.

    Attributes:
        mean, worst: tracking RMSE of a command (m).
        later: mean of it from LATER samples on (m).
        pan_reach: largest distance of the true pan from its centre (m).
    """

    mean: float
    worst: float
    later: float
    pan_reach: float


@dataclass(frozen=True)
class Pushed:
    """Time (s) after a push of 20 mm until the mean error falls below twice what it is without one."""

    states: float
    camera_30: float


@dataclass(frozen=True)
class Found:
    """How well friction is found while it slides, from 1.2 s at 100 frames a second with 1 mm of noise.

    Attributes:
        kinetic_median, kinetic_worst: relative error of the kinetic one.
        static_share: share of the runs whose interval holds the static one.
    """

    kinetic_median: float
    kinetic_worst: float
    static_share: float


@dataclass(frozen=True)
class Sight:
    """What a stream makes of what it is told.

    Attributes:
        states: told states every millisecond.
        camera_60, camera_30: positions alone, 60 a second and 20 ms old, 30 a second and 50 ms old.
        camera_30_noise: the latter with 1 mm of noise, and a tenth of the frames lost.
        delay_5, delay_10, delay_20: 60 positions a second, and an arm that executes so many ms late, which is told.
        delay_found: 20 ms, which is not told.
        slippery, sticky: as camera_30, told 1.0/0.5 where 0.4/0.4 and 0.7/0.5 are true.
        pushed: how soon a push is corrected.
        found: how well friction is found.
        outside: of streams with one false pan reading, the number whose pan left its reach; `false` is theirs.
        false: number of streams with one false reading each.
        p99: 99th percentile of the time of a step with the frame and the encoders' state before it (s).
    """

    states: Followed
    camera_60: Followed
    camera_30: Followed
    camera_30_noise: Followed
    delay_5: Followed
    delay_10: Followed
    delay_20: Followed
    delay_found: Followed
    slippery: Followed
    sticky: Followed
    pushed: Pushed
    found: Found
    outside: int
    false: int
    p99: float


class Run:
    """One command followed by a stream.

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
        eyes: Eyes | None,
        true: Friction = TRUE,
        command_delay: float | None = 0.0,
        push: FloatArray | None = None,
    ) -> None:
        noise = LEAST_NOISE if eyes is None else max(eyes.noise, LEAST_NOISE)
        self.stream = planner.stream(position, TOLD, command_delay=command_delay, noise=noise)
        arm = LateArm(
            LawArm(true, {} if push is None else {PUSH_AT: push}), 0.0 if eyes is None else eyes.command_delay
        )
        self.durations: list[float] = []
        measured = [arm.reset(position[0])]
        camera, chunk = None if eyes is None else Camera(eyes), self.stream.chunk
        asked = -chunk
        for k in range(len(position) - 1):
            begin, executed = time.perf_counter(), k - asked
            told = _see(self.stream, camera, executed, measured)
            if executed == chunk or self.stream.due:
                u, asked = self.stream.step(*told, executed=executed), k
                self.durations.append(time.perf_counter() - begin)
            command = PanCommand(np.zeros(3), np.zeros(3), u[k - asked])
            measured.append(arm.step(command))
        self.error = lengths(np.array([each.sliding[:2] for each in measured]) - position)
        self.pan_reach = float(lengths(np.array([each.pan[:2] for each in measured])).max())


def _see(
    stream: Stream, camera: Camera | None, executed: int, measured: Sequence[Measured]
) -> tuple[FloatArray | None, FloatArray | None]:
    """Tell a stream what is seen after so many samples of its chunk; return what its step is told."""
    chunk, k = stream.chunk, len(measured) - 1
    if camera is not None:
        for frame in camera.look(k, measured[-1]):
            stream.see_object(frame.position, (k - frame.taken) * DT, executed)
        stream.see_pan(measured[-1].pan, 0.0, executed)
        return None, None
    if executed < chunk or k < chunk:
        return None, None
    return np.array([each.pan for each in measured[-chunk:]]), np.array([each.sliding for each in measured[-chunk:]])


def measure_sight(planner: Planner, commands: int, false: int) -> Sight:
    """Measure, with the first commands of the family spline and so many false readings."""
    positions = spline().positions[:commands]

    def runs(eyes: Eyes | None, true: Friction = TRUE, command_delay: float | None = 0.0) -> list[Run]:
        seen = [None if eyes is None else _seeded(eyes, seed) for seed in range(len(positions))]
        return [Run(planner, each, eye, true, command_delay) for each, eye in zip(positions, seen, strict=True)]

    def followed(made: list[Run]) -> Followed:
        rms = [float(np.sqrt(np.mean(run.error**2))) for run in made]
        later = [float(np.sqrt(np.mean(run.error[LATER:] ** 2))) for run in made]
        return Followed(float(np.mean(rms)), max(rms), float(np.mean(later)), max(run.pan_reach for run in made))

    slow = Eyes(camera_rate=30.0, latency=0.05)
    states, slow_runs = runs(None), runs(slow)
    delays = {late: followed(runs(Eyes(60.0, command_delay=late), command_delay=late)) for late in (0.005, 0.01, 0.02)}
    durations = np.concatenate([run.durations[1:] for run in slow_runs])
    return Sight(
        states=followed(states),
        camera_60=followed(runs(Eyes(60.0, 0.02))),
        camera_30=followed(slow_runs),
        camera_30_noise=followed(runs(Eyes(30.0, 0.05, 1e-3, 0.1))),
        delay_5=delays[0.005],
        delay_10=delays[0.01],
        delay_20=delays[0.02],
        delay_found=followed(runs(Eyes(60.0, command_delay=0.02), command_delay=None)),
        slippery=followed(runs(slow, Friction(0.4, 0.4))),
        sticky=followed(runs(slow, Friction(0.7, 0.5))),
        pushed=Pushed(_recovery(planner, positions, None, states), _recovery(planner, positions, slow, slow_runs)),
        found=_found(planner, positions),
        outside=sum(_leaves_its_reach(planner, seed) for seed in range(false)),
        false=false,
        p99=float(np.percentile(durations, 99)),
    )


def _seeded(eyes: Eyes, seed: int) -> Eyes:
    return Eyes(**{**vars(eyes), "seed": seed})


def _recovery(
    planner: Planner, positions: Sequence[FloatArray], eyes: Eyes | None, undisturbed: Sequence[Run]
) -> float:
    errors = []
    for index, position in enumerate(positions):
        angle = 2.4 * index
        push = PUSH * np.array([math.cos(angle), math.sin(angle)])
        errors.append(Run(planner, position, eyes, push=push).error[PUSH_AT:])
    nominal = np.mean([run.error for run in undisturbed])
    over = np.mean(errors, axis=0) > 2.0 * nominal
    return float(over.argmin() if not over.all() else len(over)) * DT


def _found(planner: Planner, positions: Sequence[FloatArray]) -> Found:
    errors, held = [], []
    for index, position in enumerate(positions):
        true = FRICTIONS[index % len(FRICTIONS)]
        friction, _, static = Run(planner, position, Eyes(100.0, 0.02, 1e-3, seed=index), true).stream.friction
        errors.append(abs(friction.kinetic / true.kinetic - 1.0))
        held.append(static[0] <= true.static <= static[1])
    return Found(float(np.median(errors)), max(errors), float(np.mean(held)))


def _leaves_its_reach(planner: Planner, seed: int) -> bool:
    """Whether a pan with encoders that tell three times a chunk, and once something false, leaves its reach."""
    rng, limits = np.random.default_rng(seed), Limits(0.05)
    position = spline().positions[seed % len(spline())][:400]
    stream, arm = planner.stream(position, TOLD, limits=limits), LawArm(TOLD)
    measured, chunk, farthest = arm.reset(position[0]), stream.chunk, 0.0
    at, channel, size = int(rng.integers(1, 300)), int(rng.integers(0, 7)), 10.0 ** rng.uniform(-3.0, 3.0)
    falsify: Callable[[FloatArray], tuple[FloatArray, float]] = _falsify(channel, size * rng.choice([-1.0, 1.0]))
    for k in range(len(position) - 1):
        executed = k % chunk or chunk
        if k == at:
            stream.see_pan(*falsify(measured.pan), executed)
        elif k % (chunk // 3) == 0:
            stream.see_pan(measured.pan, 0.0, executed)
        if k % 20 == 0:
            stream.see_object(measured.sliding[:2], 0.0, executed)
        if k % chunk == 0:
            u = stream.step()
        measured = arm.step(PanCommand(np.zeros(3), np.zeros(3), u[k % chunk]))
        farthest = max(farthest, math.hypot(*measured.pan[:2]))
    return farthest > limits.pan_reach * (1.0 + 1e-9)


def _falsify(channel: int, size: float) -> Callable[[FloatArray], tuple[FloatArray, float]]:
    """Return what falsifies one of the six numbers of a pan state, or as the seventh its age."""

    def falsify(pan: FloatArray) -> tuple[FloatArray, float]:
        if channel == 6:
            return pan, size
        false = pan.copy()
        false[channel] += size
        return false, 0.0

    return falsify
