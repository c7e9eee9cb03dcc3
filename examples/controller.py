"""A 1 kHz control loop that embeds the planner: a simulated plant in another thread, disturbed, and its deadlines.

    python examples/controller.py [ROUNDS]

The plant moves pan and object by the law of friction, under another friction than planned for. A camera tells where the
object is, 60 times a second, 20 ms late and with noise, and encoders tell of the pan; half-way the object is pushed.
The controller asks the stream for the next chunk while the plant executes the last one's final sample, one millisecond,
and a stop is at hand for every sample.
"""

from __future__ import annotations

import queue
import sys
import threading
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime import Friction, Planner, StreamStatus
from runtime.physics.law import DT, slide_one
from runtime.physics.pan import integrate_pan

Array = NDArray[np.float64]

DEADLINE = 1e-3
"""Time in which the next chunk must be there (s): one tick."""

CAMERA_NOISE, ENCODER_NOISE = 1e-3, 1e-4
"""Standard deviations of the object's positions (m), and of the pan's positions (m) and velocities (m/s)."""

FRAME_EVERY, LATENCY = 17, 20
"""A frame is taken every so many samples, 60 a second, and told so many later."""

PUSH = np.array([0.02, 0.0, 0.0, 0.0])
"""By which the object is pushed half-way (m)."""

ACTUAL = Friction(0.9, 0.45)
"""The plant's friction; the planner is not told."""


@dataclass(frozen=True)
class Report:
    """What happened: the durations of the steps (s), tracking errors (m) before the push and after, statuses."""

    durations: Array
    error_before: float
    error_after: float
    statuses: tuple[StreamStatus, ...]

    def lines(self) -> list[str]:
        """Return the statistics as text."""
        p50, p99, worst = (np.percentile(self.durations, [50, 99, 100]) * 1e3).tolist()
        missed = int(np.sum(self.durations > DEADLINE))
        return [
            f"step: p50 {p50:.2f} ms, p99 {p99:.2f} ms, worst {worst:.2f} ms of {len(self.durations)}",
            f"deadlines of {DEADLINE * 1e3:g} ms missed: {missed}",
            f"tracking RMSE: {self.error_before * 1e3:.1f} mm before the push, {self.error_after * 1e3:.1f} mm from "
            "3 chunks after it",
            "chunks: " + ", ".join(f"{self.statuses.count(each)} {each}" for each in StreamStatus),
        ]


class Seen(NamedTuple):
    """What the plant tells of one chunk.

    Attributes:
        sliding: (C, 4) where the object truly went, for the report alone.
        frames: positions of the object (m), each with its age (s) and the samples executed when it was told.
        encoders: states of the pan, told at once, each with the samples executed by then.
    """

    sliding: Array
    frames: list[tuple[Array, float, int]]
    encoders: list[tuple[Array, int]]


def plant(commands: queue.Queue[Array | None], seen: queue.Queue[Seen], push_at: int) -> None:
    """Execute chunks until None comes; after each, tell what a camera and the encoders saw."""
    rng = np.random.default_rng(0)
    pan, sliding, now = np.zeros(6), np.zeros(4), 0
    waiting: list[tuple[int, Array]] = []
    for count in range(sys.maxsize):
        u = commands.get()
        if u is None:
            return
        pans, slidings = integrate_pan(pan, u), slide_one(sliding, u, ACTUAL)
        pan, sliding = pans[-1], slidings[-1] + (PUSH if count == push_at else 0.0)
        slidings[-1] = sliding
        encoders = [(pans[k] + rng.normal(0.0, ENCODER_NOISE, 6), k + 1) for k in range(9, len(u), 10)]
        for k in range(len(u)):
            if (now + k + 1) % FRAME_EVERY == 0:
                waiting.append((now + k + 1, slidings[k, :2] + rng.normal(0.0, CAMERA_NOISE, 2)))
        told = [each for each in waiting if each[0] + LATENCY <= now + len(u)]
        waiting = waiting[len(told) :]
        frames = [(position, LATENCY * DT, taken + LATENCY - now) for taken, position in told]
        seen.put(Seen(slidings, frames, encoders))
        now += len(u)


def figure_eight() -> Array:
    """Return a figure eight in 1.4 s, 0.05 m to each side, (1400, 2) (m)."""
    phase = 2.0 * np.pi * np.linspace(0.0, 1.0, 1400) ** 2 * (3.0 - 2.0 * np.linspace(0.0, 1.0, 1400))
    return np.stack([0.05 * np.sin(phase), 0.025 * np.sin(2.0 * phase)], axis=1)


def control(planner: Planner, rounds: int) -> Report:
    """Follow a figure eight a number of times, each from rest, and report."""
    parts = [control_once(planner, figure_eight()) for _ in range(rounds)]
    return Report(
        np.concatenate([part.durations for part in parts]),
        float(np.mean([part.error_before for part in parts])),
        float(np.mean([part.error_after for part in parts])),
        tuple(status for part in parts for status in part.statuses),
    )


def control_once(planner: Planner, position: Array) -> Report:
    """Follow one command, push the object half-way, and report."""
    stream = planner.stream(position, noise=CAMERA_NOISE)
    chunk = stream.chunk
    chunks = len(position) // chunk
    commands: queue.Queue[Array | None] = queue.Queue()
    seen: queue.Queue[Seen] = queue.Queue()
    worker = threading.Thread(target=plant, args=(commands, seen, chunks // 2), daemon=True)
    worker.start()

    durations, statuses, reached = np.empty(chunks), [], []
    for index in range(chunks):
        begin = time.perf_counter()
        u = stream.step()
        durations[index] = time.perf_counter() - begin
        statuses.append(stream.status)
        commands.put(u)
        told = seen.get(timeout=10.0)
        for frame in told.frames:
            stream.see_object(*frame)
        for state, executed in told.encoders:
            stream.see_pan(state, executed=executed)
        reached.append(told.sliding)
    commands.put(None)
    worker.join()

    states = np.concatenate(reached)
    error = np.hypot(*(states[:-1, :2] - position[1 : len(states)]).T)
    before, after = error[: chunks // 2 * chunk], error[(chunks // 2 + 4) * chunk :]
    rms_before, rms_after = (float(np.sqrt(np.mean(part * part))) for part in (before, after))
    return Report(durations, rms_before, rms_after, tuple(statuses))


if __name__ == "__main__":
    report = control(Planner(), int(sys.argv[1]) if len(sys.argv) > 1 else 50)
    print("\n".join(report.lines()))
