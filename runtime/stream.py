"""The planner inside a controller: the next chunk of accelerations from what is measured, and a stop from any sample.

One policy holds, in `runtime.following`: what is measured is used as far as it can be true; what is missing is replaced
by the prediction, for 0.2 s or two chunks; after that the pan is braked to rest and stays there until `Stream.reset`.
Where the command ends, the pan comes to rest and stays there as long as the object stays; an object that leaves its
mark is brought back by a short move.

Readings come by `Stream.see_pan` and `Stream.see_object`, at any time and however late, or with `Stream.step`. What is
believed between them and what they tell of friction and delay is the business of `runtime.observe`.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from runtime.command import Command
from runtime.documents.checks import FloatArray, number
from runtime.errors import ConcurrentUseError, InputError
from runtime.following.chunk import next_chunk
from runtime.following.course import Course
from runtime.following.end import End
from runtime.following.state import StreamState, StreamStatus
from runtime.following.tighten import Check, checked_chunk
from runtime.measured import check_age, check_pan, check_state, check_states
from runtime.network.bundle import Bundle
from runtime.network.job import Job
from runtime.observe.estimates import FrictionEstimate, ObjectEstimate
from runtime.observe.sight import Sight
from runtime.physics.law import DT
from runtime.start import Start

__all__ = ["FrictionEstimate", "ObjectEstimate", "Stream", "StreamStatus"]

REST_TOLERANCE = 0.01
"""Distance of the object from its mark (m) up to which the pan rests past the end of the command, if none is given."""

OBJECT_NOISE = 5e-4
"""Standard deviation of the positions of a camera (m), if none is given."""

NOISES = (1e-5, 0.1)
"""Range of it (m): below is rounding, above is no position."""

LONGEST_DELAY = 0.1
"""Longest time from a command to its execution (s): a chunk of the paper's network."""


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
        command_delay: time from a command to its execution (s): the network is shown where pan and object will be when
            its chunk begins to act. None to use what the encoders tell of it.
        noise: standard deviation of the positions that `see_object` is told (m).
        every: samples after which the network should be asked again at the latest; None for the whole chunk, which
            follows best.
        check: tells what the arm comes to along a motion, so that its joints hold too; see `JointCheck` of
            `runtime.arms.check`. None for the pan's limits alone.
        search: search for the kinetic friction by a particle filter, in `see_object` and `see_pan`: 5 % of a core.

    Attributes:
        chunk: samples in a chunk, C: as many as the limits make it.

    Raises:
        InputError: there are no limits, the pan cannot come to rest within them from its start, or delay or noise are
            out of range.
    """

    def __init__(
        self,
        bundle: Bundle,
        job: Job,
        tolerance: float = REST_TOLERANCE,
        command_delay: float | None = 0.0,
        noise: float = OBJECT_NOISE,
        every: int | None = None,
        check: Check | None = None,
        search: bool = True,
    ) -> None:
        if not job.limits.finite:
            raise InputError("a stream needs finite limits: without them there is no stop", "limits")
        self._friction, self._limits = job.friction, job.limits
        self._command_delay = None if command_delay is None else number(command_delay, "command_delay")
        if self._command_delay is not None and not 0.0 <= self._command_delay <= LONGEST_DELAY:
            raise InputError(
                f"command_delay must be between 0 and {LONGEST_DELAY:g} s, got {command_delay:g} s", "command_delay"
            )
        self._noise = number(noise, "noise")
        if not NOISES[0] <= self._noise <= NOISES[1]:
            raise InputError(f"noise must be between {NOISES[0]:g} and {NOISES[1]:g} m, got {noise:g} m", "noise")
        self._search = search
        self._lock = threading.Lock()
        self._end = End(tolerance, job.sizes.pan_radius)
        self._course = Course.begin(bundle, job, round((self._command_delay or 0.0) / DT))
        self.chunk = self._course.reader.chunk
        self._every = None if every is None else self._sample(every, "every", 1)
        self._check = check
        self._state = self._begin(job.start, job.command.position[0])

    @property
    def status(self) -> StreamStatus:
        """What the last chunk came from."""
        return self._state.status

    def object(self, executed: int | None = None) -> ObjectEstimate:
        """Return what is believed of the object, and how sure that is.

        Args:
            executed: when so many samples of the chunk given last have been executed, 0 to C; all of them if None.

        Raises:
            InputError: there is no such sample.
        """
        return self._state.sight.object_at(self._now(executed) - self._late)

    def pan(self, executed: int | None = None) -> FloatArray:
        """Return (6,) what is believed of the pan, position (m) and velocity (m/s), as `object` does of the object."""
        sight, at = self._state.sight, self._now(executed) - self._late
        pan: FloatArray = sight.pan[at - sight.end - 1].copy()
        return pan

    @property
    def friction(self) -> FrictionEstimate:
        """What is believed of the friction: what was told, until frames tell more; see `see_object`."""
        return self._state.sight.friction_estimate

    @property
    def delay(self) -> float | None:
        """Time from a command to its execution (s), as the encoders tell it; None while they tell too little."""
        return self._state.sight.delays.delay

    @property
    def due(self) -> bool:
        """Whether the network should be asked before its chunk has ended: something was seen since the last step that
        the law does not explain, a push or a slip, or `every` samples have been executed.
        """
        sight = self._state.sight
        executed = max(sight.arrived) - (sight.end - self.chunk)
        late = self._every is not None and executed >= self._every
        return sight.event or late

    def see_object(self, position: ArrayLike | None, age: float = 0.0, executed: int | None = None) -> None:
        """Take in where the object was seen: at any time, however late, in any order; no velocity is needed.

        What cannot be used is passed over, and told by `status` after the next step.

        Args:
            position: (2,) of the object relative to the pan (m).
            age: time since it was there (s): a camera's exposure, reading and computing.
            executed: samples of the chunk given last that have been executed, 0 to C; all of them if None.

        Raises:
            InputError: another shape or type, or there is no such sample: a mistake in the program.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            seen, late = check_state(position, "position", (2,)), check_age(age)
            sight, now = self._state.sight, self._now(executed)
            if seen is not None and late is not None:
                at = now - late - self._late
                sight = sight.see_object(seen, at, now, self._limits.acceleration)
                self._state = self._state._replace(sight=self._searched(sight, executed, now))

    def see_pan(self, state: ArrayLike | None, age: float = 0.0, executed: int | None = None) -> None:
        """Take in where the encoders say that the pan was; as `see_object`.

        Args:
            state: (6,) position relative to the centre of the reach (m) and velocity (m/s), x, y, z of each; of a level
                pan also (4,), x and y of each.
            age: time since it was there (s).
            executed: samples of the chunk given last that have been executed, 0 to C; all of them if None.

        Raises:
            InputError: another shape or type, or there is no such sample: a mistake in the program.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            seen, late = check_pan(state, None, self._limits.level), check_age(age)
            sight, now = self._state.sight, self._now(executed)
            if seen is not None and late is not None:
                sight = sight.see_pan(seen, now - late - self._late, self._late, now)
                self._state = self._state._replace(sight=self._searched(sight, executed, now))

    def step(
        self,
        pan_state: ArrayLike | None = None,
        object_state: ArrayLike | None = None,
        age: float = 0.0,
        executed: int | None = None,
        *,
        pan_age: float | None = None,
        object_age: float | None = None,
    ) -> FloatArray:
        """Give the pan accelerations for the next C samples; the first is to act at once.

        They keep the limits and follow the last ones within the jerk limit, whatever is handed in. States are handed in
        here, or before by `see_pan` and `see_object`. One is missing if none came since the last chunk, or if what came
        is None, not finite or beyond all reason (1000 m, 1000 m/s), more than a chunk old, from the future, older than
        what is known, or to the last bit the one before although it must have changed. Then the policy of this module
        holds, and `status` says what happened. A pan is believed as far as the reading before agrees, an object as far
        as physics allows.

        The network may be asked before its chunk has ended. Where the pan could not stop from there, what is left of
        the chunk is given again, and its stop behind it.

        Args:
            pan_state: (C, 6) the last C measured pan positions (m), relative to the centre of the reach, and
                velocities (m/s) in the world, x, y, z of each, or (6,) the last one only; of a level pan also (C, 4)
                or (4,), x and y of each. Before the first step, the start.
            object_state: (C, 4) or (4,), the same for the object, relative to the pan.
            age: of the last rows (s); they are moved forward along what was commanded since.
            executed: samples of the chunk given last that have been executed, 1 to C; all of them if None.
            pan_age, object_age: the same for each by itself; `age` if None.

        Returns:
            (C, 3) pan accelerations (m/s^2).

        Raises:
            InputError: a state of another shape or type, or an age that is no number: a mistake in the program.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            samples = self._check_executed(executed)
            self._take(
                samples, pan_state, object_state, *(age if each is None else each for each in (pan_age, object_age))
            )
            if samples < self.chunk:
                early = self._state.after_samples(samples)
                if early is None:
                    self._state = self._state.going_on(samples)
                    return self._state.motion.acceleration.copy()
                asked = self._state.asked.reader
                if asked is not None:
                    self._course = self._course._replace(reader=asked.after(samples))
                self._state = early
            late = self._late if self._command_delay is None else None
            given = self._state, self._course, self._end, self._limits, samples, late
            following = next_chunk(*given) if self._check is None else checked_chunk(*given, self._check)
            self._state, self._course = following
            return self._state.motion.acceleration.copy()

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
            return self._state.stop_from(self._sample(sample))

    def retarget(self, position: Command | ArrayLike) -> None:
        """Follow another command from the next chunk on, from the state that is carried.

        Raises:
            InputError: the command is not usable; the old one is kept.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            command = position if isinstance(position, Command) else Command.from_samples(position)
            self._course = self._course.retargeted(command)
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
            course, mark = self._course.again()
            self._state, self._course = self._begin(start, mark, self._state), course

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Refuse a second caller instead of waiting for the first: a control loop must not block."""
        if not self._lock.acquire(blocking=False):
            raise ConcurrentUseError("the stream is in use by another thread; it belongs to one at a time")
        try:
            yield
        finally:
            self._lock.release()

    @property
    def _late(self) -> int:
        """Samples from a command to its execution."""
        delay = self._command_delay
        if delay is None:
            found = self._state.sight.delays.delay
            delay = 0.0 if found is None else found
        return round(delay / DT)

    def _sample(self, sample: Any, name: str = "sample", least: int = 0) -> int:
        """Return a number of samples of a chunk.

        Raises:
            InputError: it is none.
        """
        whole = isinstance(sample, (int, np.integer)) and not isinstance(sample, bool)
        if not whole or not least <= sample <= self.chunk:
            raise InputError(f"{name} must be a whole number from {least} to {self.chunk}, got {sample!r}", name)
        return int(sample)

    def _now(self, executed: int | None) -> int:
        """Return the sample at which something comes, counted from the beginning."""
        samples = self.chunk if executed is None else self._sample(executed, "executed")
        return max(0, self._state.sight.end - self.chunk + samples)

    def _searched(self, sight: Sight, executed: int | None, now: int) -> Sight:
        """Return what is known after a search for the friction, unless the chunk is over: then a step is due."""
        return sight if executed == self.chunk else sight.searched(now)

    def _begin(self, start: Start, mark: FloatArray, last: StreamState | None = None) -> StreamState:
        """Return what is carried before the first chunk; see `StreamState.begin`."""
        sight = Sight.begin(start, mark, self._friction, self._noise, self.chunk, self._search)
        return StreamState.begin(start, sight, self._limits, self.chunk, last)

    def _check_executed(self, executed: int | None) -> int:
        """Return how many samples of the chunk given last have been executed.

        Raises:
            InputError: there are not so many.
        """
        if executed is None:
            return self.chunk
        return self._sample(executed, "executed", 1)

    def _take(
        self,
        samples: int,
        pan_state: ArrayLike | None,
        object_state: ArrayLike | None,
        pan_age: float,
        object_age: float,
    ) -> None:
        """Take in the states that a step is handed.

        Raises:
            InputError: another shape or type, or an age that is no number.
        """
        pan = check_pan(pan_state, self.chunk, self._limits.level)
        sliding = check_states(object_state, "object_state", self.chunk)
        ages = check_age(pan_age), check_age(object_age)
        sight, late, now = self._state.sight, self._late, self._now(samples)
        if pan is not None and ages[0] is not None and ages[0] <= self.chunk:
            sight = sight.see_pan(pan, now - ages[0] - late, late, now)
        if sliding is not None and ages[1] is not None and ages[1] <= self.chunk:
            sight = sight.see_object_states(sliding, now - ages[1] - late, now, self._limits.acceleration)
        self._state = self._state._replace(sight=sight)
