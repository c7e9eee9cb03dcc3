"""The network reads commands: what it is shown in its own units and time, and what its answers are.

Everybody else counts milliseconds and SI. A sample of the network's time lasts `Units.time` milliseconds, so states and
commands are taken at its instants by straight lines between the milliseconds. Its accelerations are on the line through
the middles of its samples, or where these are shorter than a millisecond, the means over each millisecond.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Sequence
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.errors import BundleError
from runtime.limits import Limits
from runtime.network.bundle import Bundle, Float32Array, LstmState
from runtime.network.job import Job
from runtime.network.taps import Taps, Told, answered, observe
from runtime.network.units import (
    AHEAD,
    AHEAD_ROWS,
    CHUNK,
    CONDITIONS,
    ENCODER_CHUNK,
    ENCODER_ROWS,
    OBSERVED,
    SEEN_ROWS,
    UNREAD,
    WINDOW,
    Situation,
    Units,
)

MOST_AT_ONCE = 48
"""Most commands that are decoded together: what the network computes of more of them no longer fits in the caches."""

MOST_REACH, MOST_ACCELERATION = 0.4, 40.0
"""Largest reach (m) and acceleration (m/s^2) that a pan is told to have."""


class Frame(NamedTuple):
    """B jobs whose network's samples last equally long, in the network's units and time.

    Attributes:
        step: duration of a sample of the network's time (ms).
        chunk: milliseconds that an answer is executed for.
        samples: of the longest command, K.
        command: (B, n, 4) positions and velocities, and as much rest behind their ends as the network looks ahead.
        conditions: (B, CONDITIONS) what the network is told.
        scale: (B, 10) what states in SI are multiplied by.
        acceleration: (B,) m/s^2 a unit.
        seen: makes the rows that the decoder sees of the last states.
        ahead: makes those that it sees of the command, from now on.
        answer: makes accelerations of milliseconds of the last one and the network's.
    """

    step: float
    chunk: int
    samples: int
    command: FloatArray
    conditions: Float32Array
    scale: FloatArray
    acceleration: FloatArray
    seen: Taps
    ahead: Taps
    answer: Taps

    @classmethod
    def of(cls, jobs: Sequence[Job]) -> Self:
        """Return the frame of jobs of equal `time_of` and commands of equally many chunks."""
        units = units_of(jobs)
        situation = situation_of(jobs, units)
        step = float(units.time[0])
        chunk = chunk_of(step)
        length, velocity = (1.0 / part[:, None] for part in (units.length, units.velocity))
        samples = max(len(job.command) for job in jobs)
        command = np.zeros((len(jobs), samples + int(AHEAD * step) + 2, 4))
        for row, job in zip(command, jobs, strict=True):
            count = len(job.command)
            row[:count, :2], row[:count, 2:] = job.command.position, job.command.velocity
            row[count:, :2] = job.command.position[-1]
        command *= np.concatenate([length] * 2 + [velocity] * 2, axis=1)[:, None]
        return cls(
            step,
            chunk,
            samples,
            command,
            situation.conditions().astype(np.float32),
            np.ascontiguousarray(np.concatenate([length] * 3 + [velocity] * 3 + [length] * 2 + [velocity] * 2, axis=1)),
            units.acceleration,
            *_taps(step, chunk),
        )

    def told(self, pan: FloatArray, sliding: FloatArray, last: FloatArray, now: int, elapsed: float) -> Told:
        """Return what the decoder is told at sample `now`, of what `Reader.look` is given."""
        return Told(
            pan,
            sliding,
            last,
            self.command,
            min(now, self.samples),
            self.seen,
            self.ahead,
            self.scale,
            self.acceleration,
            self.conditions,
            min(1.0, elapsed),
        )

    def window(self, now: int) -> Float32Array:
        """Return what the encoder reads from sample `now` on, (B, chunks, READ)."""
        left = -(-(self.samples - now) // (ENCODER_CHUNK * self.step))
        chunks = int(max(1, min(WINDOW, left)))
        rows = (ENCODER_CHUNK * np.arange(chunks)[:, None] + ENCODER_ROWS).ravel()
        command = Taps.at(self.step * rows).of(self.command, min(now, self.samples))
        command[..., :2] -= command[:, :1, :2].copy()
        count = len(command)
        told = np.broadcast_to(self.conditions[:, None], (count, chunks, CONDITIONS))
        return np.concatenate([command.reshape(count, chunks, -1).astype(np.float32), told], axis=2)

    def next_read(self, now: int) -> int:
        """Return the sample from which the command is read anew, after it was from `now` on; its end if never."""
        if self.samples - now <= WINDOW * ENCODER_CHUNK * self.step:
            return self.samples
        return now + int((WINDOW - UNREAD) * ENCODER_CHUNK * self.step)


class Reader(NamedTuple):
    """B commands as far as they have been read; a value, which neither `look` nor `after` changes.

    Attributes:
        bundle: the network.
        frame: the commands in its units.
        now: the sample at which it is asked next.
        elapsed: samples of its time that have been executed since it was asked, over CHUNK; 1 at the beginning.
        next_read: the sample from which the encoder reads anew.
        memory: what the decoder carries.
    """

    bundle: Bundle
    frame: Frame
    now: int
    elapsed: float
    next_read: int
    memory: LstmState

    @classmethod
    def at(cls, bundle: Bundle, jobs: Sequence[Job], now: int = 0) -> Self:
        """Read the commands of jobs that are of one group (`group_of`), from sample `now` on."""
        frame = Frame.of(jobs)
        return cls(bundle, frame, now, 1.0, frame.next_read(now), bundle.encode(frame.window(now)))

    @property
    def chunk(self) -> int:
        """Samples of an answer, of 1 ms."""
        return self.frame.chunk

    def look(self, pan: FloatArray, sliding: FloatArray, last: FloatArray) -> tuple[FloatArray, Self]:
        """Ask for the next chunk.

        Args:
            pan: (B, C, 6) the last C pan states relative to the centre of the reach (m, m/s).
            sliding: (B, C, 4) the last C object states relative to the pan (m, m/s).
            last: (B, 3) the pans' accelerations over the sample before (m/s^2).

        Returns:
            (B, C, 3) pan accelerations (m/s^2), and the reader that remembers the question.

        Raises:
            BundleError: an acceleration is no finite number.
        """
        frame, reader = self.frame, self
        if self.next_read <= self.now < frame.samples:
            memory = self.bundle.encode(frame.window(self.now))
            reader = self._replace(next_read=frame.next_read(self.now), memory=memory)
        observation = np.empty((len(pan), OBSERVED), dtype=np.float32)
        told = frame.told(pan, sliding, last, self.now, self.elapsed)
        answer, memory = reader.bundle.decode_step(observe(told, observation), reader.memory)
        u = answered(answer, last, frame.answer, frame.acceleration)
        if u is None:
            name = self.bundle.manifest.name
            raise BundleError(f"the network of bundle {name!r} gave no finite number at sample {self.now}")
        return u, reader._replace(memory=memory, elapsed=0.0)

    def told(self, jobs: Sequence[Job]) -> Self:
        """Go on with the same commands and another friction; what was read and is remembered stays."""
        return self._replace(frame=Frame.of(jobs))

    def after(self, samples: int) -> Self:
        """Go on after so many samples of the answer have been executed."""
        return self._replace(now=self.now + samples, elapsed=self.elapsed + samples / self.frame.step / CHUNK)


def units_of(jobs: Sequence[Job]) -> Units:
    """Return the units of the jobs' pans, (B,)."""
    return Units.of(*np.array([_told(job.limits, job.reach_used) for job in jobs]).T)


def _told(limits: Limits, reach_used: float) -> tuple[float, float, float]:
    """Return the reach (m), the acceleration (m/s^2) and the jerk (m/s^3) that a pan is told to have.

    No more than networks are trained for: looser limits need not be used, and then make no plan worse.
    """
    return min(reach_used * limits.pan_reach, MOST_REACH), min(limits.acceleration, MOST_ACCELERATION), limits.jerk


def situation_of(jobs: Sequence[Job], units: Units) -> Situation:
    """Return what the network is told of jobs, in the units of their pans: the friction always."""
    told = [
        (job.limits.jerk, job.limits.speed, job.limits.height, job.friction.static, job.friction.kinetic, 1.0)
        for job in jobs
    ]
    return Situation.of(units, *np.array(told).T)


def time_of(limits: Limits, reach_used: float = 1.0) -> float:
    """Return how long a sample of the network's time lasts (ms), for a pan that is told this share of its reach."""
    return float(units_of_one(limits, reach_used).time[0])


@lru_cache(maxsize=1024)
def units_of_one(limits: Limits, reach_used: float = 1.0) -> Units:
    """Return the units of a pan that is told this share of its reach, (1,)."""
    return Units.of(*(np.array([each]) for each in _told(limits, reach_used)))


def chunk_of(step: float) -> int:
    """Return the milliseconds of an answer whose samples last `step` ms each."""
    return max(2, round(CHUNK * step))


def chunk_samples(limits: Limits) -> int:
    """Return the samples, of 1 ms, of an answer within these limits, C."""
    return chunk_of(time_of(limits))


def group_of(job: Job) -> Hashable:
    """Return what jobs must have in common to be decoded together: as many questions and readings, of equal length."""
    step, samples = time_of(job.limits, job.reach_used), len(job.command)
    read = -(-samples // (ENCODER_CHUNK * step))
    return step, -(-samples // chunk_of(step)), read if read <= WINDOW else samples


def groups_of(jobs: Sequence[Job]) -> list[list[int]]:
    """Return the numbers of the jobs of each group, MOST_AT_ONCE of them at most."""
    groups: dict[Hashable, list[int]] = defaultdict(list)
    for index, job in enumerate(jobs):
        groups[group_of(job)].append(index)
    return [
        group[first : first + MOST_AT_ONCE] for group in groups.values() for first in range(0, len(group), MOST_AT_ONCE)
    ]


@lru_cache(maxsize=256)
def _taps(step: float, chunk: int) -> tuple[Taps, Taps, Taps]:
    """Return the `seen`, `ahead` and `answer` of a `Frame`."""
    # Of samples much shorter than a millisecond, a chunk's rounding may cut off the first.
    seen = np.maximum(chunk - 1 + step * (np.array(SEEN_ROWS) - SEEN_ROWS[-1]), 0.0)
    return Taps.at(seen, chunk), Taps.at(step * np.array(AHEAD_ROWS)), Taps.of_matrix(milliseconds(step, chunk))


def milliseconds(step: float, count: int) -> FloatArray:
    """Return what makes the accelerations of `count` milliseconds of a chunk whose samples last `step` ms each.

    Returns:
        (count, CHUNK + 1) shares of the millisecond before the chunk, and of the chunk's samples.
    """
    shares = np.zeros((count, CHUNK + 1))
    if step >= 1.0:
        middles = np.concatenate([[-0.5], step * (np.arange(CHUNK) + 0.5)])
        along = np.interp(np.arange(count) + 0.5, middles, np.arange(CHUNK + 1))
        before = np.minimum(along.astype(np.intp), CHUNK - 1)
        rows = np.arange(count)
        shares[rows, before] = 1.0 - (along - before)
        shares[rows, before + 1] = along - before
        return shares
    begin, sample = np.arange(count)[:, None], np.arange(CHUNK)
    overlap = np.minimum(begin + 1.0, step * (sample + 1)) - np.maximum(begin, step * sample)
    shares[:, 1:] = np.maximum(overlap, 0.0)
    shares[:, -1] += 1.0 - shares.sum(axis=1)  # beyond the chunk's end, its last acceleration is held
    return shares
