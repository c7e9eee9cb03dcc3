"""The planner inside a controller: the next chunk of accelerations from what is measured, and a stop from any sample.

One policy holds, in `Stream.step`: what is measured is used as far as it can be true; what is missing is replaced by
the prediction, for one chunk; after that the pan is braked to rest and stays there until `Stream.reset`. Where the
command ends, the pan comes to rest and stays there as long as the object stays; an object that leaves its mark is
brought back by a short move.

Readings come by `Stream.see_pan` and `Stream.see_object`, at any time and however late, or with `Stream.step`. What is
believed between them and what they tell of friction and delay is the business of `runtime.observe`.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from runtime.command import Command
from runtime.commands.come_back import come_back
from runtime.documents.checks import FloatArray, number
from runtime.errors import BundleError, ConcurrentUseError, InputError
from runtime.friction import Friction
from runtime.measured import check_age, check_pan, check_state, check_states
from runtime.network.bundle import Bundle
from runtime.network.general import GeneralReader
from runtime.network.job import Job
from runtime.network.reader import Reader, read
from runtime.observe.frames import Verdict
from runtime.observe.pan import large
from runtime.observe.sight import Sight
from runtime.physics.law import DT, slide_one
from runtime.physics.motion import Motion
from runtime.physics.pan import integrate_pan
from runtime.safety.governor import govern
from runtime.safety.outside import MIDDLE, Room
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

OBJECT_NOISE = 5e-4
"""Standard deviation of the positions of a camera (m), if none is given."""

NOISES = (1e-5, 0.1)
"""Range of it (m): below is rounding, above is no position."""

LONGEST_DELAY = 0.1
"""Longest time from a command to its execution (s): a chunk of the paper's network."""

NOTICED_DELAY = 2
"""Samples by which an arm must be later than was thought for the command to be read anew."""

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
    """What was measured: the pan, pushed, cannot stop in its reach. It goes no farther than that stop needs."""

    BRAKING = "braking"
    """The stop, until `reset`: too much was missing in a row, or the network gave no finite number."""

    RESTING = "resting"
    """The stop past the end of the command, and the rest after it, until the object is moved."""

    DOUBTING = "doubting"
    """The prediction, in place of a reading that cannot be true."""

    CONVINCED = "convinced"
    """What was measured: it could not be true, but it lasts."""


class Ending(NamedTuple):
    """What goes on past the end of the command.

    Attributes:
        left: samples in which the object may still be brought to its mark.
        place: (2,) where the object was left (m), None while it moves or is being moved.
    """

    left: int
    place: FloatArray | None = None


class ObjectEstimate(NamedTuple):
    """What a stream believes of the object.

    Attributes:
        position: (2,) relative to the pan (m).
        velocity: (2,) relative to the pan (m/s).
        sticks: whether it sticks to the pan; then its velocity is exactly zero.
        position_error, velocity_error: standard deviations, in the worse direction (m, m/s).
        age: time since it was seen last (s).
    """

    position: FloatArray
    velocity: FloatArray
    sticks: bool
    position_error: float
    velocity_error: float
    age: float


class FrictionEstimate(NamedTuple):
    """What a stream believes of the friction.

    Attributes:
        friction: that motion is predicted with.
        kinetic, static: between what each lies, by 95 %; static friction shows only where the object breaks away.
    """

    friction: Friction
    kinetic: tuple[float, float]
    static: tuple[float, float]


class Asked(NamedTuple):
    """From what a chunk was asked for: what it takes to be asked again before it has ended.

    Attributes:
        commanded: (6,) the pan by what was commanded alone, before the chunk.
        reader: what gave the chunk, before it went on; None if no network did.
    """

    commanded: FloatArray
    reader: Reader | None = None


class StreamState(NamedTuple):
    """What a stream carries from one chunk to the next.

    Attributes:
        motion: the chunk given last, with the states that it is predicted to lead to.
        before, after: the pan before and after it.
        commanded: (6,) the pan by what was commanded alone: position (m) and velocity (m/s).
        asked: from what the chunk was asked for.
        sight: what is known of pan and object, up to the end of the chunk.
        room: where the pan may be.
        status: of the chunk.
        ending: what goes on past the end of the command, None before.
    """

    motion: Motion
    before: Pan
    after: Pan
    commanded: FloatArray
    asked: Asked
    sight: Sight
    room: Room
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
        command_delay: time from a command to its execution (s): the network is shown where pan and object will be when
            its chunk begins to act. None to use what the encoders tell of it.
        noise: standard deviation of the positions that `see_object` is told (m).

    Attributes:
        chunk: samples in a chunk, C: of a network for every pan as many as its limits make it.

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
    ) -> None:
        if not job.limits.finite:
            raise InputError("a stream needs finite limits: without them there is no stop", "limits")
        self._bundle, self._job = bundle, job
        self._friction, self._limits, self._sizes = job.friction, job.limits, job.sizes
        self._tolerance = tolerance
        self._command_delay = None if command_delay is None else number(command_delay, "command_delay")
        if self._command_delay is not None and not 0.0 <= self._command_delay <= LONGEST_DELAY:
            raise InputError(
                f"command_delay must be between 0 and {LONGEST_DELAY:g} s, got {command_delay:g} s", "command_delay"
            )
        self._noise = number(noise, "noise")
        if not NOISES[0] <= self._noise <= NOISES[1]:
            raise InputError(f"noise must be between {NOISES[0]:g} and {NOISES[1]:g} m, got {noise:g} m", "noise")
        self._lock = threading.Lock()
        self._command = job.command
        self._advance = round((self._command_delay or 0.0) / DT)
        self._followed = self._ahead = self._in_advance(job.command)
        self._reader = self._read(self._ahead)
        self.chunk = self._reader.chunk
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
        sight, at = self._state.sight, self._now(executed) - self._late
        state, belief = sight.sliding[at - sight.end - 1], sight.watch.last
        u = sight.past.between(belief.frame.at, max(at, belief.frame.at))
        spread = np.sqrt(np.diag(belief.spread_after(u))).tolist()
        return ObjectEstimate(
            position=state[:2].copy(),
            velocity=state[2:].copy(),
            sticks=not state[2:].any(),
            position_error=max(spread[:2]),
            velocity_error=max(spread[2:4]),
            age=(at - belief.frame.at) * DT,
        )

    def pan(self, executed: int | None = None) -> FloatArray:
        """Return (6,) what is believed of the pan, position (m) and velocity (m/s), as `object` does of the object."""
        sight, at = self._state.sight, self._now(executed) - self._late
        pan: FloatArray = sight.pan[at - sight.end - 1].copy()
        return pan

    @property
    def friction(self) -> FrictionEstimate:
        """What is believed of the friction: what was told, until frames tell more; see `see_object`."""
        belief = self._state.sight.watch.last
        return FrictionEstimate(belief.friction, belief.kinetic_interval, belief.static_interval)

    @property
    def delay(self) -> float | None:
        """Time from a command to its execution (s), as the encoders tell it; None while they tell too little."""
        return self._state.sight.delays.delay

    @property
    def due(self) -> bool:
        """Whether the network should be asked before its chunk has ended: something was seen since the last step that
        the law does not explain, a push or a slip, and the network can be asked at any time.
        """
        return self._state.sight.event and isinstance(self._reader, GeneralReader)

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
                self._state = self._state._replace(sight=sight)

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
                self._state = self._state._replace(sight=sight)

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

        A network for every pan may be asked before its chunk has ended. Where the pan could not stop from there, what
        is left of the chunk is given again, and its stop behind it.

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
            InputError: a state of another shape or type, an age that is no number, or a network for one pan that is
                asked before its chunk has ended: a mistake in the program.
            ConcurrentUseError: called while another call is running.
        """
        with self._alone():
            samples = self._check_executed(executed)
            self._take(
                samples, pan_state, object_state, *(age if each is None else each for each in (pan_age, object_age))
            )
            if samples < self.chunk:
                early = self._after(samples)
                if early is None:
                    self._state = self._go_on(samples)
                    return self._state.motion.acceleration.copy()
                self._state = early
            last = self._state
            sight = last.sight
            if last.status is StreamStatus.BRAKING:
                return self._stop(last.after, last.room)
            missing = (sight.end - min(sight.arrived)) // self.chunk
            if missing > MAX_MISSING:
                return self._stop(last.after, last.room)
            self._learn_delay()
            before, room = self._locate(last.after, sight.pan[-1])
            status = self._judged(room, missing)
            pan, sliding = sight.pan[-self.chunk :], sight.sliding[-self.chunk :]
            ending = self._ending(sliding[-1], samples)
            if ending is not None and self._rests(ending, sliding[-1]):
                self._state = self._rest(ending, before, room, sliding[-1])
                return self._state.motion.acceleration.copy()
            if self._over:
                self._followed = Command(come_back(sliding[-1, :2], self._mark, sight.friction))
                self._reader = self._read(self._followed)
            try:
                motion, after, question = self._follow(before, room, pan, sliding)
            except BundleError:
                return self._stop(before, room)
            commanded, asked = _commanded(last.commanded, motion), Asked(last.commanded, question)
            self._state = StreamState(motion, before, after, commanded, asked, sight.then(motion), room, status, ending)
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
            motion, before, after, room = self._state.motion, self._state.before, self._state.after, self._state.room
            u = motion.acceleration
            sample = self._sample(sample)
            states = [before.state]
            states += [PanState(*row) for row in np.concatenate([motion.pan[1:], u], axis=1).tolist()]
            for k in range(sample, len(u) + 1):
                stop = gentle_stop(room.seen_inside(states[k]), after.limits, self._state.sight.friction)
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
            self._followed = self._ahead = self._in_advance(self._command)
            self._reader = self._read(self._ahead)
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
            command, now = self._ahead, self._reader.now
            if self._followed is not command:  # the object was being brought back
                now = len(command)
            self._state = self._begin(start, command.position[min(now, len(command) - 1)], self._state)
            self._reader, self._followed = self._read(command, now), command

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

    def _in_advance(self, command: Command) -> Command:
        """Return a command as it must be told to an arm that executes late."""
        late = self._advance
        return replace(command, position=command.position[late:]) if 0 < late < len(command) - 1 else command

    def _learn_delay(self) -> None:
        """Read the command farther in advance if the encoders say that the arm is later than was thought."""
        late = self._late
        if self._command_delay is not None or abs(late - self._advance) < NOTICED_DELAY or self._over:
            return
        following = self._followed is self._ahead
        self._advance = late
        self._ahead = self._in_advance(self._command)
        if following:
            self._followed = self._ahead
            self._reader = self._read(self._ahead, self._reader.now)

    def _read(self, command: Command, now: int = 0) -> Reader:
        return read(self._bundle, [self._job._replace(command=command)], now)

    def _sample(self, sample: Any, name: str = "sample") -> int:
        """Return a number of samples of a chunk.

        Raises:
            InputError: it is none.
        """
        if isinstance(sample, bool) or not isinstance(sample, (int, np.integer)) or not 0 <= sample <= self.chunk:
            raise InputError(f"{name} must be a whole number from 0 to {self.chunk}, got {sample!r}", name)
        return int(sample)

    def _now(self, executed: int | None) -> int:
        """Return the sample at which something comes, counted from the beginning."""
        samples = self.chunk if executed is None else self._sample(executed, "executed")
        return max(0, self._state.sight.end - self.chunk + samples)

    def _begin(self, start: Start, mark: FloatArray, last: StreamState | None = None) -> StreamState:
        """Return what is carried before the first chunk.

        Args:
            start: where pan and object are.
            mark: (2,) where the object is if nothing is said (m).
            last: what was carried before, of which the friction and the delay stay; None for nothing.

        Raises:
            InputError: the pan cannot come to rest within its limits, and it was not believed to be there.
        """
        room = Room(MIDDLE, self._limits)
        try:
            pan = Pan.at_start(start, self._limits)
        except InputError:
            state = PanState(*start.pan_position, *start.pan_velocity, *start.pan_acceleration)
            believed = None if last is None else last.sight.pan[-1]
            if believed is None or large(np.array(state[:6]) - believed) or any(state[6:]):
                raise
            room = Room.of(state, self._limits)
            pan = room.outside(Pan.at(room.seen_inside(state), room.limits))
        u = np.tile(start.pan_acceleration, (self.chunk, 1))
        still = (np.tile(state, (self.chunk + 1, 1)) for state in (start.pan_state(), start.object_state(mark)))
        sight = Sight.begin(start, mark, self._friction, self._noise, self.chunk)
        if last is not None:
            sight = sight.knowing(last.sight)
        status = StreamStatus.OUTSIDE if room.off_limits(self._limits) else StreamStatus.FOLLOWING
        commanded = start.pan_state()
        return StreamState(Motion(u, u, *still), pan, pan, commanded, Asked(commanded), sight, room, status)

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

        The reader goes back to where the command is then.
        """
        last = self._state
        done = last.motion.first(samples)
        if last.status in (StreamStatus.BRAKING, StreamStatus.RESTING):
            after = last.before.braked(samples, done.pan[1:], done.acceleration)
        else:
            state = state_after(done.pan[1:], done.acceleration)
            inside = Pan.at(last.room.seen_inside(state), last.room.limits)
            if not inside.can_stop:
                return None
            after = last.room.outside(inside)
        if last.asked.reader is not None:
            self._reader = last.asked.reader.after(samples)
        sight = last.sight.until(last.sight.end - self.chunk + samples)
        return last._replace(after=after, commanded=_commanded(last.asked.commanded, done), sight=sight)

    def _go_on(self, samples: int) -> StreamState:
        """Return what is carried with what is left of the chunk after so many samples, and its stop behind it."""
        last = self._state
        u = last.after.brake.accelerations(samples)
        states = integrate_pan(np.array(last.after.state[:6]), u)
        stop = self._predict(last.after, u, u, states, last.motion.sliding[-1])
        done = last.motion.first(samples)
        reader = None if last.asked.reader is None else last.asked.reader.after(samples)
        return last._replace(
            motion=_joined(last.motion, stop, samples),
            before=last.after._replace(state=state_after(done.pan[1:], done.acceleration)),
            after=last.after.braked(samples, stop.pan[1:], u),
            commanded=_commanded(last.commanded, stop),
            asked=Asked(_commanded(last.asked.commanded, done), reader),
            sight=last.sight.then(stop),
            ending=None if last.ending is None else last.ending._replace(left=last.ending.left - samples),
        )

    def _slide(self, state: FloatArray, u: FloatArray) -> FloatArray:
        return slide_one(state, u, self._state.sight.friction)

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

    def _locate(self, predicted: Pan, believed: FloatArray) -> tuple[Pan, Room]:
        """Return the pan where it is believed to be, (6,), with a stop from there, and the room for that stop."""
        room = self._state.room
        if believed.tolist() == list(predicted.state[:6]) and not room.off_limits(self._limits):
            return predicted, room
        state = _moved_to(predicted.state, believed)
        room = Room.of(state, self._limits)
        return room.outside(Pan.at(room.seen_inside(state), room.limits)), room

    def _judged(self, room: Room, missing: int) -> StreamStatus:
        """Return what the next chunk comes from."""
        verdict = self._state.sight.verdict
        if room.off_limits(self._limits):
            return StreamStatus.OUTSIDE
        if verdict is Verdict.DOUBTED:
            return StreamStatus.DOUBTING
        if verdict is Verdict.BELIEVED:
            return StreamStatus.CONVINCED
        return StreamStatus.PREDICTED if missing > 0 else StreamStatus.FOLLOWING

    def _follow(self, before: Pan, room: Room, pan: FloatArray, sliding: FloatArray) -> tuple[Motion, Pan, Reader]:
        """Ask the network and govern: the motion of the next chunk, the pan at its end, and what was asked.

        Raises:
            BundleError: the network gave no finite number.
        """
        asked, reader = self._reader.look(pan[None], sliding[None], np.array([before.state[6:]]))
        acceleration, states, (after,) = govern([room.inside(before)], asked)
        self._reader = reader.after(self.chunk)
        states[..., :2] += room.centre
        motion = self._predict(before, asked[0], acceleration[0], states[0], sliding[-1])
        return motion, room.outside(after), reader

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
            sliding: (4,) the object, as it is believed to be.
            samples: executed since it was asked before.
        """
        last = self._state.ending
        if last is None:
            if not self._over:
                return None
            return Ending(round(ENDING_TIME / DT) - (self._reader.now - len(self._ahead)))
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
        needed = len(come_back(sliding[:2], self._mark, self._state.sight.friction)) + round(STOPPING_TIME / DT)
        return needed > ending.left

    def _rest(self, ending: Ending, before: Pan, room: Room, sliding: FloatArray) -> StreamState:
        """Return the next chunk of the stop past the end of the command, or of the rest after it.

        Args:
            ending: what goes on.
            before: the pan, where it is believed to be; looked at again only if it has left its place.
            room: where it may be.
            sliding: (4,) the object.
        """
        last = self._state
        state = before.state
        commanded = _moved_to(state, last.commanded)
        moved = math.dist(state[:3], last.after.state[:3]) > self._tolerance
        if last.status is StreamStatus.RESTING and not moved:
            before, room = last.after, last.room
            if before.brake.samples == 0 and math.hypot(sliding[2], sliding[3]) <= STILL_SPEED:
                ending = ending._replace(place=sliding[:2].copy())
        else:
            near = math.dist(state[:3], commanded[:3]) <= self._tolerance
            if near and math.dist(state[3:6], commanded[3:6]) <= SAME_SPEED:
                state = commanded
            inside = room.seen_inside(state)
            brake = kindest_stop(inside, sliding, self._mark, before.limits, last.sight.friction)
            before = before if brake is None else before._replace(state=state, brake=brake)
        return self._braked(before, room, sliding)._replace(status=StreamStatus.RESTING, ending=ending)

    def _stop(self, before: Pan, room: Room) -> FloatArray:
        """Give the next chunk of the stop, which holds until `reset`."""
        last = self._state
        if last.status is not StreamStatus.BRAKING:
            stop = gentle_stop(room.seen_inside(before.state), before.limits, last.sight.friction)
            before = before if stop is None else before._replace(brake=stop)
        self._state = self._braked(before, room, last.sight.sliding[-1])._replace(status=StreamStatus.BRAKING)
        return self._state.motion.acceleration.copy()

    def _braked(self, before: Pan, room: Room, sliding: FloatArray) -> StreamState:
        """Return the next chunk of a pan's stop."""
        last = self._state
        u = before.brake.accelerations(self.chunk)
        states = integrate_pan(np.array(before.state[:6]), u)
        motion = self._predict(before, u, u, states, sliding)
        after, commanded = before.braked(self.chunk, states, u), _commanded(last.commanded, motion)
        return StreamState(motion, before, after, commanded, Asked(last.commanded), last.sight.then(motion), room)

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


def _joined(first: Motion, then: Motion, samples: int) -> Motion:
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
