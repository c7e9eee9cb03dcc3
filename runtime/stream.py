"""The planner inside a controller: the next chunk of accelerations from what is measured, and a stop from any sample.

One policy holds, in `Stream.step`: what is measured is used; what is missing is replaced by the prediction, for one
chunk; after that the pan is braked to rest and stays there until `Stream.reset`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from runtime.command import Command
from runtime.documents.checks import FloatArray
from runtime.errors import BundleError, ConcurrentUseError, InputError
from runtime.measured import check_age, check_states, complete
from runtime.network.bundle import Bundle
from runtime.network.decode import Job
from runtime.network.reader import Reader, held_still
from runtime.physics.law import rollout
from runtime.physics.pan import integrate_pan
from runtime.safety.governor import govern
from runtime.safety.pan import Motion, begin
from runtime.safety.stop import PanState, find_brake, gentle_stop, stop_reach
from runtime.start import Start

MAX_MISSING = 1
"""Chunks in a row that are planned from the prediction alone: an object unseen for longer may be anywhere."""


class StreamStatus(StrEnum):
    """What the last chunk came from."""

    FOLLOWING = "following"
    """What was measured; the start, where nothing has been measured yet."""

    PREDICTED = "predicted"
    """The prediction, at least in part: a measurement was missing."""

    OUTSIDE = "outside"
    """What was measured: the pan, pushed, cannot stop in its reach. It goes no farther than the stop needs."""

    BRAKING = "braking"
    """The stop, until `reset`: too much was missing in a row, or the network gave no finite number."""


class Carried(NamedTuple):
    """What a stream carries from one chunk to the next: the chunk given last, and what led to it.

    Attributes:
        before: the pan before the chunk.
        acceleration: (C, 2) the chunk (m/s^2).
        pan, sliding: (C, 4) the states it is predicted to lead to.
        after: the pan at its end.
        measured: the pan and object states handed in last, None where there were none.
        missing: chunks in a row in which something was missing; -1 before the first.
        status: of the chunk.
    """

    before: Motion
    acceleration: FloatArray
    pan: FloatArray
    sliding: FloatArray
    after: Motion
    measured: tuple[FloatArray | None, FloatArray | None] = (None, None)
    missing: int = -1
    status: StreamStatus = StreamStatus.FOLLOWING


class Stream:
    """One command followed chunk by chunk by a controller that measures where pan and object are.

    Past the end of the command the object is held at its last position. A stream belongs to one thread at a time: a
    call while another is running is refused.

    Args:
        bundle: the network.
        job: the command, the friction that motion is predicted with, the limits and the start.

    Raises:
        InputError: there are no limits, or the pan cannot come to rest within them from its start.
    """

    def __init__(self, bundle: Bundle, job: Job) -> None:
        if not job.limits.finite:
            raise InputError("a stream needs finite limits: without them there is no stop", "limits")
        self._bundle, self._friction, self._limits = bundle, job.friction, job.limits
        self._lock = threading.Lock()
        self._carried = self._begin(job.start, job.command.position[0])
        self._reader = Reader.at(bundle, [job.command])

    @property
    def status(self) -> StreamStatus:
        """What the last chunk came from."""
        return self._carried.status

    def step(
        self, pan_state: ArrayLike | None = None, object_state: ArrayLike | None = None, age: float = 0.0
    ) -> FloatArray:
        """Give the pan accelerations for the next C samples; the first is to act at once.

        They keep the limits and follow the last ones within the jerk limit, whatever is handed in. A state is missing
        if it is None, not finite or beyond all reason (1000 m, 1000 m/s), if nothing of it changed since the last call
        although something moved, or if it is more than a chunk old; then the policy of this module holds, and
        `status` says what happened.

        Args:
            pan_state: (C, 4) the last C measured pan positions (m), relative to the centre of the reach, and
                velocities (m/s) in the world, or (4,) the last one only. Before the first step, the start.
            object_state: the same for the object, relative to the pan.
            age: of the last row (s); it is moved forward along what was commanded since.

        Returns:
            (C, 2) pan accelerations (m/s^2).

        Raises:
            InputError: a state of another shape or type, or an age that is no number: a mistake in the program.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            last = self._carried
            chunk = self._bundle.manifest.chunk
            measured = check_states(pan_state, "pan_state", chunk), check_states(object_state, "object_state", chunk)
            late = check_age(age)
            if last.status is StreamStatus.BRAKING:
                return self._stop(last.after)
            pan = self._seen(measured[0], last.measured[0], last.pan, late, integrate_pan)
            sliding = self._seen(measured[1], last.measured[1], last.sliding, late, self._slide)
            missing = last.missing + 1 if pan is None or sliding is None else 0
            if missing > MAX_MISSING:
                return self._stop(last.after)
            motion, status = self._locate(last.after, pan)
            if missing > 0 and status is StreamStatus.FOLLOWING:
                status = StreamStatus.PREDICTED
            pan, sliding = (last.pan if pan is None else pan), (last.sliding if sliding is None else sliding)
            try:
                acceleration, after, moved = self._follow(motion, pan, sliding)
            except BundleError:
                return self._stop(motion)
            slid = self._slide(sliding[-1], acceleration)
            self._carried = Carried(motion, acceleration, moved, slid, after, measured, missing, status)
            return acceleration.copy()

    def brake(self, sample: int) -> FloatArray:
        """Return the stop from a sample of the chunk given last; nothing of the stream changes.

        It keeps the limits, is as gentle as the reach allows, and where the pan cannot stop at once in its reach,
        follows the chunk until it can. With at most GENTLE mu g a resting object stays at rest. Whoever executes it
        calls `reset` before the next `step`.

        Args:
            sample: number of the chunk's samples that have been executed, 0 to C.

        Returns:
            (n, 2) pan accelerations (m/s^2), n at least 1; the last is zero, and the pan is at rest after it.

        Raises:
            InputError: there is no such sample.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            _, u, pan, _, after, *_ = last = self._carried
            if isinstance(sample, bool) or not isinstance(sample, (int, np.integer)) or not 0 <= sample <= len(u):
                raise InputError(f"sample must be a whole number from 0 to {len(u)}, got {sample!r}")
            state = last.before.state if sample == 0 else PanState(*pan[sample - 1].tolist(), *u[sample - 1].tolist())
            for k in range(sample, len(u) + 1):
                stop = gentle_stop(state, after.limits, self._friction)
                if stop is not None:
                    return np.concatenate([u[sample:k], stop.accelerations(stop.samples)])
                if k < len(u):
                    state = PanState(*pan[k].tolist(), *u[k].tolist())
            return np.concatenate([u[sample:], after.brake.accelerations(max(1, after.brake.samples))])

    def retarget(self, position: Command | ArrayLike) -> None:
        """Follow another command from the next chunk on, from the state that is carried.

        Raises:
            InputError: the command is not usable; the old one is kept.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            command = position if isinstance(position, Command) else Command.from_samples(position)
            self._reader = Reader.at(self._bundle, [command])

    def reset(self, start: Start) -> None:
        """Begin again from where pan and object are, with what is left of the command.

        Raises:
            InputError: the pan cannot come to rest within its limits from there; the stream is as before.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            (command,), first = self._reader.commands, self._reader.chunk
            row = min(first * self._bundle.manifest.chunk, len(command) - 1)
            self._carried = self._begin(start, command.position[row])
            self._reader = Reader.at(self._bundle, [command], first)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Refuse a second caller instead of waiting for the first: a control loop must not block."""
        if not self._lock.acquire(blocking=False):
            raise ConcurrentUseError("the stream is in use by another thread; it belongs to one at a time")
        try:
            yield
        finally:
            self._lock.release()

    def _begin(self, start: Start, mark: FloatArray) -> Carried:
        """Return what is carried before the first chunk; `mark` (2,) is where the object is if nothing is said (m)."""
        motion = begin(start, self._limits)
        pan, sliding = (
            held_still(state[None, None], self._bundle.manifest)[0]
            for state in (start.pan_state(), start.object_state(mark))
        )
        none = np.tile(start.pan_acceleration, (len(pan), 1))
        return Carried(motion, none, pan, sliding, motion)

    def _slide(self, state: FloatArray, u: FloatArray) -> FloatArray:
        return rollout(state, u, self._friction)

    def _seen(
        self,
        measured: FloatArray | None,
        before: FloatArray | None,
        predicted: FloatArray,
        late: int | None,
        move: Callable[[FloatArray, FloatArray], FloatArray],
    ) -> FloatArray | None:
        """Return the last C states by what was measured, None if it is missing; see `step` for what that means."""
        u = self._carried.acceleration
        if measured is None or late is None or late > len(u):
            return None
        until = predicted[: len(predicted) - late]
        if before is not None and np.array_equal(measured, before) and (until != until[:1]).any():
            return None
        return complete(measured, late, predicted, u, move)

    def _locate(self, predicted: Motion, pan: FloatArray | None) -> tuple[Motion, StreamStatus]:
        """Return the pan where it was measured, with a stop from there; its reach is widened to what the stop needs."""
        if pan is None or pan[-1].tolist() == list(predicted.state[:4]):
            return predicted, StreamStatus.FOLLOWING
        state = predicted.state._replace(**dict(zip(("x", "y", "vx", "vy"), pan[-1].tolist(), strict=True)))
        brake = find_brake(state, self._limits)
        needed = stop_reach(state, brake)
        if needed <= self._limits.pan_reach:
            return Motion(state, brake, self._limits), StreamStatus.FOLLOWING
        return Motion(state, brake, replace(self._limits, pan_reach=needed)), StreamStatus.OUTSIDE

    def _follow(self, motion: Motion, pan: FloatArray, sliding: FloatArray) -> tuple[FloatArray, Motion, FloatArray]:
        """Ask the network and govern: the chunk (C, 2), the pan at its end, and its states (C, 4).

        Raises:
            BundleError: the network gave no finite number.
        """
        asked, reader = self._reader.look(pan[None], sliding[None])
        governed = govern([motion], asked)
        self._reader = reader
        return governed.acceleration[0], governed.motions[0], governed.pan[0]

    def _stop(self, motion: Motion) -> FloatArray:
        """Give the next chunk of the stop, which holds until `reset`."""
        last, chunk = self._carried, self._bundle.manifest.chunk
        if last.status is not StreamStatus.BRAKING:
            stop = gentle_stop(motion.state, motion.limits, self._friction)
            motion = motion if stop is None else motion._replace(brake=stop)
        u = motion.brake.accelerations(chunk)
        pan = integrate_pan(np.array(motion.state[:4]), u)
        brake = motion.brake._replace(done=motion.brake.done + min(chunk, motion.brake.samples))
        after = Motion(PanState(*pan[-1].tolist(), *u[-1].tolist()), brake, motion.limits)
        sliding = self._slide(last.sliding[-1], u)
        self._carried = Carried(motion, u, pan, sliding, after, status=StreamStatus.BRAKING)
        return u.copy()
