"""The planner inside a controller: the next chunk of accelerations from what is measured, and a stop from any sample.

One policy holds, in `Stream.step`: what is measured is used; what is missing is replaced by the prediction, for one
chunk; after that the pan is braked to rest and stays there until `Stream.reset`. Where the command ends, the pan comes
to rest and stays there as long as the object stays; an object that leaves its mark is brought back by a short move.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from runtime.command import Command
from runtime.commands.come_back import come_back
from runtime.documents.checks import FloatArray
from runtime.errors import BundleError, ConcurrentUseError, InputError
from runtime.measured import check_age, check_pan, check_states, complete
from runtime.network.bundle import Bundle
from runtime.network.general import GeneralReader
from runtime.network.job import Job
from runtime.network.reader import Reader, read
from runtime.physics.law import DT, slide_one
from runtime.physics.motion import Motion
from runtime.physics.pan import integrate_pan
from runtime.safety.governor import govern
from runtime.safety.pan import Pan, state_after
from runtime.safety.rest import kindest_stop
from runtime.safety.stop import PanState, gentle_stop
from runtime.start import Start

MAX_MISSING = 1
"""Chunks in a row that are planned from the prediction alone: an object unseen for longer may be anywhere."""

REST_TOLERANCE = 0.01
"""Distance of the object from its mark (m) up to which the pan rests past the end of the command, if none is given."""

ENDING_TIME, RETURN_TIME = 1.0, 3.0
"""Time (s) in which the object may be brought to its mark: past the end of the command, and after it was moved."""

STOPPING_TIME = 0.3
"""Time (s) that is kept for the stop after the object was brought back."""

STILL_SPEED = 0.05
"""Speed (m/s) up to which an object counts as at rest when it is measured: noise is below."""

SAME_SPEED = 0.05
"""Difference (m/s) between a measured pan and what was commanded, up to which it is taken for noise: the stop brings to
rest what was commanded, so that nothing drifts."""


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

    RESTING = "resting"
    """The stop past the end of the command, and the rest after it, until the object is moved."""


class Ending(NamedTuple):
    """What goes on past the end of the command.

    Attributes:
        left: samples in which the object may still be brought to its mark.
        place: (2,) where the object was left (m), None while it moves or is being moved.
    """

    left: int
    place: FloatArray | None = None


class Asked(NamedTuple):
    """From what a chunk was asked for: what it takes to be asked again before it has ended.

    Attributes:
        motion: the C samples before.
        commanded: (6,) the pan by what was commanded alone, before the chunk.
        reader: what gave the chunk, before it went on; None if no network did.
    """

    motion: Motion
    commanded: FloatArray
    reader: Reader | None = None


class StreamState(NamedTuple):
    """What a stream carries from one chunk to the next.

    Attributes:
        motion: the chunk given last, with the states that it is predicted to lead to.
        before, after: the pan before and after it.
        commanded: (6,) the pan by what was commanded alone: position (m) and velocity (m/s).
        asked: from what the chunk was asked for.
        measured: the pan and object states handed in last, None where there were none.
        missing: chunks in a row in which something was missing; -1 before the first.
        status: of the chunk.
        ending: what goes on past the end of the command, None before.
    """

    motion: Motion
    before: Pan
    after: Pan
    commanded: FloatArray
    asked: Asked
    measured: tuple[FloatArray | None, FloatArray | None] = (None, None)
    missing: int = -1
    status: StreamStatus = StreamStatus.FOLLOWING
    ending: Ending | None = None


class Stream:
    """One command followed chunk by chunk by a controller that measures where pan and object are.

    Past the end of the command the pan comes to rest. An object that lies farther from the command's last position than
    the tolerance is brought there, if that can be done within ENDING_TIME. Then all accelerations are exactly zero
    until the object is moved by more than the tolerance; it is brought back, and the pan rests again. A stream belongs
    to one thread at a time: a call while another is running is refused.

    Args:
        bundle: the network.
        job: the command, the friction that motion is predicted with, the limits, the start and the sizes.
        tolerance: distance of the object from its mark (m) up to which the pan rests past the end of the command.

    Attributes:
        chunk: samples in a chunk, C: of a network for every pan as many as its limits make it.

    Raises:
        InputError: there are no limits, or the pan cannot come to rest within them from its start.
    """

    def __init__(self, bundle: Bundle, job: Job, tolerance: float = REST_TOLERANCE) -> None:
        if not job.limits.finite:
            raise InputError("a stream needs finite limits: without them there is no stop", "limits")
        self._bundle, self._job, self._tolerance = bundle, job, tolerance
        self._friction, self._limits, self._sizes = job.friction, job.limits, job.sizes
        self._lock = threading.Lock()
        self._command = self._followed = job.command
        self._reader = read(bundle, [job])
        self.chunk = self._reader.chunk
        self._state = self._begin(job.start, job.command.position[0])

    @property
    def status(self) -> StreamStatus:
        """What the last chunk came from."""
        return self._state.status

    def step(
        self,
        pan_state: ArrayLike | None = None,
        object_state: ArrayLike | None = None,
        age: float = 0.0,
        executed: int | None = None,
    ) -> FloatArray:
        """Give the pan accelerations for the next C samples; the first is to act at once.

        They keep the limits and follow the last ones within the jerk limit, whatever is handed in. A state is missing
        if it is None, not finite or beyond all reason (1000 m, 1000 m/s), if nothing of it changed since the last call
        although something moved, or if it is more than a chunk old; then the policy of this module holds, and
        `status` says what happened.

        A network for every pan may be asked before its chunk has ended. Where the pan could not stop from there, what
        is left of the chunk is given again, and its stop behind it.

        Args:
            pan_state: (C, 6) the last C measured pan positions (m), relative to the centre of the reach, and
                velocities (m/s) in the world, x, y, z of each, or (6,) the last one only; of a level pan also (C, 4)
                or (4,), x and y of each. Before the first step, the start.
            object_state: (C, 4) or (4,), the same for the object, relative to the pan.
            age: of the last row (s); it is moved forward along what was commanded since.
            executed: samples of the chunk given last that have been executed, 1 to C; all of them if None.

        Returns:
            (C, 3) pan accelerations (m/s^2).

        Raises:
            InputError: a state of another shape or type, an age that is no number, or a network for one pan that is
                asked before its chunk has ended: a mistake in the program.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            measured = (
                check_pan(pan_state, self.chunk, self._limits.level),
                check_states(object_state, "object_state", self.chunk),
            )
            late, samples = check_age(age), self._check_executed(executed)
            if samples < self.chunk:
                early = self._after(samples)
                if early is None:
                    self._state = self._go_on(samples)._replace(measured=measured)
                    return self._state.motion.acceleration.copy()
                self._state = early
            last = self._state
            if last.status is StreamStatus.BRAKING:
                return self._stop(last.after)
            predicted = last.motion.pan[1:], last.motion.sliding[1:]
            pan = self._seen(measured[0], last.measured[0], predicted[0], late, integrate_pan)
            sliding = self._seen(measured[1], last.measured[1], predicted[1], late, self._slide)
            missing = last.missing + 1 if pan is None or sliding is None else 0
            if missing > MAX_MISSING:
                return self._stop(last.after)
            before, status = self._locate(last.after, pan)
            if missing > 0 and status is StreamStatus.FOLLOWING:
                status = StreamStatus.PREDICTED
            pan, sliding = (predicted[0] if pan is None else pan), (predicted[1] if sliding is None else sliding)
            ending = self._ending(sliding[-1], samples)
            if ending is not None and self._rests(ending, sliding[-1]):
                self._state = self._rest(ending, before, sliding[-1])._replace(measured=measured, missing=missing)
                return self._state.motion.acceleration.copy()
            if self._over:
                move = come_back(sliding[-1, :2], self._mark, self._friction)
                self._followed = Command(move)
                self._reader = read(self._bundle, [self._job._replace(command=self._followed)])
            try:
                motion, after, question = self._follow(before, pan, sliding)
            except BundleError:
                return self._stop(before)
            commanded = _commanded(last.commanded, motion)
            asked = Asked(last.motion, last.commanded, question)
            self._state = StreamState(motion, before, after, commanded, asked, measured, missing, status, ending)
            return motion.acceleration.copy()

    def brake(self, sample: int) -> FloatArray:
        """Return the stop from a sample of the chunk given last; nothing of the stream changes.

        It keeps the limits, is as gentle as the reach allows, and where the pan cannot stop at once in its reach,
        follows the chunk until it can. With at most GENTLE mu g a resting object stays at rest. Whoever executes it
        calls `reset` before the next `step`.

        Args:
            sample: number of the chunk's samples that have been executed, 0 to C.

        Returns:
            (n, 3) pan accelerations (m/s^2), n at least 1; the last is zero, and the pan is at rest after it.

        Raises:
            InputError: there is no such sample.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            motion, before, after, *_ = self._state
            u = motion.acceleration
            if isinstance(sample, bool) or not isinstance(sample, (int, np.integer)) or not 0 <= sample <= len(u):
                raise InputError(f"sample must be a whole number from 0 to {len(u)}, got {sample!r}")
            states = [before.state]
            states += [PanState(*row) for row in np.concatenate([motion.pan[1:], u], axis=1).tolist()]
            for k in range(sample, len(u) + 1):
                stop = gentle_stop(states[k], after.limits, self._friction)
                if stop is not None:
                    return np.concatenate([u[sample:k], stop.accelerations(stop.samples)])
            return np.concatenate([u[sample:], after.brake.accelerations(max(1, after.brake.samples))])

    def retarget(self, position: Command | ArrayLike) -> None:
        """Follow another command from the next chunk on, from the state that is carried.

        Raises:
            InputError: the command is not usable; the old one is kept.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            self._command = position if isinstance(position, Command) else Command.from_samples(position)
            self._followed = self._command
            self._reader = read(self._bundle, [self._job._replace(command=self._command)])
            status = self._state.status
            if status is StreamStatus.RESTING:
                status = StreamStatus.FOLLOWING
            asked = self._state.asked._replace(reader=None)
            self._state = self._state._replace(status=status, ending=None, asked=asked)

    def reset(self, start: Start) -> None:
        """Begin again from where pan and object are, with what is left of the command.

        Raises:
            InputError: the pan cannot come to rest within its limits from there; the stream is as before.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            command, now = self._command, self._reader.now
            if self._followed is not command:  # the object was being brought back
                now = len(command)
            self._state = self._begin(start, command.position[min(now, len(command) - 1)])
            self._reader = read(self._bundle, [self._job._replace(command=command)], now)
            self._followed = command

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Refuse a second caller instead of waiting for the first: a control loop must not block."""
        if not self._lock.acquire(blocking=False):
            raise ConcurrentUseError("the stream is in use by another thread; it belongs to one at a time")
        try:
            yield
        finally:
            self._lock.release()

    def _begin(self, start: Start, mark: FloatArray) -> StreamState:
        """Return what is carried before the first chunk; `mark` (2,) is where the object is if nothing is said (m)."""
        pan = Pan.at_start(start, self._limits)
        u = np.tile(start.pan_acceleration, (self.chunk, 1))
        still = (np.tile(state, (self.chunk + 1, 1)) for state in (start.pan_state(), start.object_state(mark)))
        motion = Motion(u, u, *still)
        commanded = start.pan_state()
        return StreamState(motion, pan, pan, commanded, Asked(motion, commanded))

    def _check_executed(self, executed: int | None) -> int:
        """Return how many samples of the chunk given last have been executed.

        Raises:
            InputError: there are not so many, or the network cannot be asked then.
        """
        if executed is None:
            return self.chunk
        whole = isinstance(executed, (int, np.integer)) and not isinstance(executed, bool)
        if not whole or not 1 <= executed <= self.chunk:
            raise InputError(f"executed must be a whole number from 1 to {self.chunk}, got {executed!r}", "executed")
        if executed < self.chunk and not isinstance(self._reader, GeneralReader):
            raise InputError(
                f"a network for one pan is asked after all {self.chunk} samples of its chunk, not after {executed}: "
                "use one for every pan",
                "executed",
            )
        return int(executed)

    def _after(self, samples: int) -> StreamState | None:
        """Return what is carried when so many samples of the chunk have been executed; None without a stop from there.

        Its motion is that of the last C samples. The reader goes back to where the command is then.
        """
        last = self._state
        motion = _last(last.asked.motion, last.motion, samples)
        states, u = motion.pan[1:], motion.acceleration
        if last.status in (StreamStatus.BRAKING, StreamStatus.RESTING):
            after = last.before.braked(samples, states, u)
        else:
            after = Pan.at(state_after(states, u), last.after.limits)
            if not after.can_stop:
                return None
        if last.asked.reader is not None:
            self._reader = last.asked.reader.after(samples)
        commanded = _commanded(last.asked.commanded, last.motion.first(samples))
        return last._replace(motion=motion, after=after, commanded=commanded)

    def _go_on(self, samples: int) -> StreamState:
        """Return what is carried with what is left of the chunk after so many samples, and its stop behind it."""
        last = self._state
        past = _last(last.asked.motion, last.motion, samples)
        u = last.after.brake.accelerations(samples)
        stop = self._predict(
            last.after, u, u, integrate_pan(np.array(last.after.state[:6]), u), last.motion.sliding[-1]
        )
        motion = _last(last.motion, stop, samples)
        asked = Asked(
            past,
            _commanded(last.asked.commanded, last.motion.first(samples)),
            None if last.asked.reader is None else last.asked.reader.after(samples),
        )
        return last._replace(
            motion=motion,
            before=last.after._replace(state=state_after(past.pan[1:], past.acceleration)),
            after=last.after.braked(samples, stop.pan[1:], u),
            commanded=_commanded(last.commanded, stop),
            asked=asked,
            ending=None if last.ending is None else last.ending._replace(left=last.ending.left - samples),
        )

    def _slide(self, state: FloatArray, u: FloatArray) -> FloatArray:
        return slide_one(state, u, self._friction)

    def _seen(
        self,
        measured: FloatArray | None,
        before: FloatArray | None,
        predicted: FloatArray,
        late: int | None,
        move: Callable[[FloatArray, FloatArray], FloatArray],
    ) -> FloatArray | None:
        """Return the last C states by what was measured, None if it is missing; see `step` for what that means."""
        u = self._state.motion.acceleration
        if measured is None or late is None or late > len(u):
            return None
        until = predicted[: len(predicted) - late]
        if before is not None and np.array_equal(measured, before) and (until != until[:1]).any():
            return None
        return complete(measured, late, predicted, u, move)

    def _locate(self, predicted: Pan, states: FloatArray | None) -> tuple[Pan, StreamStatus]:
        """Return the pan where it was measured, with a stop from there; its limits are widened to what the stop needs.

        Those on reach, height and speed: what it does to come to rest keeps the others.
        """
        if states is None or states[-1].tolist() == list(predicted.state[:6]):
            return predicted, StreamStatus.FOLLOWING
        limits, pan = self._limits, Pan.at(_moved_to(predicted.state, states[-1]), self._limits)
        needed = pan.stop_extent
        if needed.within(limits):
            return pan, StreamStatus.FOLLOWING
        wider = replace(
            limits,
            pan_reach=max(limits.pan_reach, needed.reach),
            height=max(limits.height, needed.height),
            speed=max(limits.speed, needed.speed),
        )
        return pan._replace(limits=wider), StreamStatus.OUTSIDE

    def _follow(self, before: Pan, pan: FloatArray, sliding: FloatArray) -> tuple[Motion, Pan, Reader]:
        """Ask the network and govern: the motion of the next chunk, the pan at its end, and what was asked.

        Raises:
            BundleError: the network gave no finite number.
        """
        asked, reader = self._reader.look(pan[None], sliding[None], self._state.motion.acceleration[None, -1])
        acceleration, states, (after,) = govern([before], asked)
        self._reader = reader.after(self.chunk)
        return self._predict(before, asked[0], acceleration[0], states[0], sliding[-1]), after, reader

    @property
    def _mark(self) -> FloatArray:
        """(2,) where the object should be once the command is over (m)."""
        mark: FloatArray = self._command.position[-1]
        return mark

    @property
    def _over(self) -> bool:
        """Whether the next chunk begins past the end of the command, or of the move that brings the object back."""
        return self._reader.now >= len(self._followed)

    def _ending(self, sliding: FloatArray, samples: int) -> Ending | None:
        """Return what goes on past the end of the command, None before.

        Args:
            sliding: (4,) the object, as it is measured.
            samples: executed since it was asked before.
        """
        last = self._state.ending
        if last is None:
            if not self._over:
                return None
            return Ending(round(ENDING_TIME / DT) - (self._reader.now - len(self._command)))
        if last.place is not None and math.dist(sliding[:2], last.place) > self._tolerance:
            return Ending(round(RETURN_TIME / DT))
        return last._replace(left=last.left - samples)

    def _rests(self, ending: Ending, sliding: FloatArray) -> bool:
        """Whether the pan is to come to rest, or to stay there, rather than to bring the object (4,) to its mark."""
        last = self._state
        if not self._over:
            return False
        if last.status is not StreamStatus.RESTING or last.after.brake.samples > 0 or ending.place is not None:
            return True
        off, speed = math.dist(sliding[:2], self._mark), math.hypot(sliding[2], sliding[3])
        lost = math.hypot(sliding[0], sliding[1]) > self._sizes.pan_radius
        if off <= self._tolerance or speed > STILL_SPEED or lost:
            return True
        needed = len(come_back(sliding[:2], self._mark, self._friction)) + round(STOPPING_TIME / DT)
        return needed > ending.left

    def _rest(self, ending: Ending, before: Pan, sliding: FloatArray) -> StreamState:
        """Return the next chunk of the stop past the end of the command, or of the rest after it.

        Args:
            ending: what goes on.
            before: the pan, where it was measured; looked at again only if it has left its place.
            sliding: (4,) the object.
        """
        last = self._state
        state = before.state
        commanded = _moved_to(state, last.commanded)
        moved = math.dist(state[:3], last.after.state[:3]) > self._tolerance
        if last.status is StreamStatus.RESTING and not moved:
            before = last.after
            if before.brake.samples == 0 and math.hypot(sliding[2], sliding[3]) <= STILL_SPEED:
                ending = ending._replace(place=sliding[:2].copy())
        else:
            near = math.dist(state[:3], commanded[:3]) <= self._tolerance
            if near and math.dist(state[3:6], commanded[3:6]) <= SAME_SPEED:
                state = commanded
            brake = kindest_stop(state, sliding, self._mark, before.limits, self._friction)
            before = before if brake is None else before._replace(state=state, brake=brake)
        return self._braked(before, sliding)._replace(status=StreamStatus.RESTING, ending=ending)

    def _stop(self, before: Pan) -> FloatArray:
        """Give the next chunk of the stop, which holds until `reset`."""
        last = self._state
        if last.status is not StreamStatus.BRAKING:
            stop = gentle_stop(before.state, before.limits, self._friction)
            before = before if stop is None else before._replace(brake=stop)
        self._state = self._braked(before, last.motion.sliding[-1])._replace(status=StreamStatus.BRAKING)
        return self._state.motion.acceleration.copy()

    def _braked(self, before: Pan, sliding: FloatArray) -> StreamState:
        """Return the next chunk of a pan's stop."""
        last = self._state
        u = before.brake.accelerations(self.chunk)
        states = integrate_pan(np.array(before.state[:6]), u)
        motion = self._predict(before, u, u, states, sliding)
        after, commanded = before.braked(self.chunk, states, u), _commanded(last.commanded, motion)
        return StreamState(motion, before, after, commanded, Asked(last.motion, last.commanded))

    def _predict(
        self, before: Pan, asked: FloatArray, u: FloatArray, states: FloatArray, sliding: FloatArray
    ) -> Motion:
        """Return the motion of a chunk whose pan states after each sample are known, by the law of friction."""
        pan = np.concatenate([[before.state[:6]], states])
        return Motion(u, asked, pan, np.concatenate([sliding[None], self._slide(sliding, u)]))


def _commanded(before: FloatArray, motion: Motion) -> FloatArray:
    """Return the pan by what was commanded alone, after a motion and (6,) before it: position (m), velocity (m/s)."""
    pan, free = motion.pan, len(motion.acceleration) * DT
    position, velocity = before[:3], before[3:]
    moved = pan[-1, :3] - pan[0, :3] + (velocity - pan[0, 3:]) * free
    return np.concatenate([position + moved, velocity + pan[-1, 3:] - pan[0, 3:]])


def _last(first: Motion, then: Motion, samples: int) -> Motion:
    """Return as many samples as `first` has, the last of them so many of the motion that goes on from it."""
    done = then.first(samples)
    return Motion(
        np.concatenate([first.acceleration[samples:], done.acceleration]),
        np.concatenate([first.asked[samples:], done.asked]),
        np.concatenate([first.pan[samples:-1], done.pan]),
        np.concatenate([first.sliding[samples:-1], done.sliding]),
    )


def _moved_to(state: PanState, there: FloatArray) -> PanState:
    """Return a pan with its acceleration at (6,) position (m) and velocity (m/s)."""
    x, y, z, vx, vy, vz = there.tolist()
    return state._replace(x=x, y=y, z=z, vx=vx, vy=vy, vz=vz)
