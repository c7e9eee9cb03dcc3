"""What a stream carries from one chunk to the next, and how chunks lead on from each other."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple, Self

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.network.reader import Reader
from runtime.observe.frames import Verdict
from runtime.observe.pan import large
from runtime.observe.sight import Sight
from runtime.physics.law import DT, slide_one
from runtime.physics.motion import Motion
from runtime.physics.pan import integrate_pan
from runtime.safety.outside import MIDDLE, Room
from runtime.safety.pan import Pan, state_after
from runtime.safety.stop import PanState, gentle_stop
from runtime.start import Start


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


class Asked(NamedTuple):
    """From what a chunk was asked for: what it takes to be asked again before it has ended.

    Attributes:
        commanded: (6,) the pan by what was commanded alone, before the chunk.
        reader: what gave the chunk, before it went on; None if no network did.
    """

    commanded: FloatArray
    reader: Reader | None = None


class StreamState(NamedTuple):
    """A value, which its methods do not change.

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

    @classmethod
    def begin(
        cls, start: Start, sight: Sight, limits: Limits, chunk: int, last: StreamState | None = None
    ) -> StreamState:
        """Return what is carried before the first chunk.

        Args:
            start: where pan and object are.
            sight: what is known of them.
            limits: of the pan.
            chunk: samples of a chunk.
            last: what was carried before, of which the friction and the delay stay; None for nothing.

        Raises:
            InputError: the pan cannot come to rest within its limits, and it was not believed to be there.
        """
        room = Room(MIDDLE, limits)
        try:
            pan = Pan.at_start(start, limits)
        except InputError:
            state = PanState(*start.pan_position, *start.pan_velocity, *start.pan_acceleration)
            believed = None if last is None else last.sight.pan[-1]
            if believed is None or large(np.array(state[:6]) - believed) or any(state[6:]):
                raise
            room = Room.of(state, limits)
            pan = room.outside(Pan.at(room.seen_inside(state), room.limits))
        u = np.tile(start.pan_acceleration, (chunk, 1))
        still = (np.tile(state, (chunk + 1, 1)) for state in (start.pan_state(), sight.sliding[-1]))
        if last is not None:
            sight = sight.knowing(last.sight)
        status = StreamStatus.OUTSIDE if room.off_limits(limits) else StreamStatus.FOLLOWING
        commanded = start.pan_state()
        return cls(Motion(u, u, *still), pan, pan, commanded, Asked(commanded), sight, room, status)

    @property
    def chunk(self) -> int:
        """Samples of a chunk."""
        return len(self.motion.acceleration)

    def within(self, limits: Limits) -> Self:
        """Return the same with a pan of these limits."""
        return self._replace(before=self.before._replace(limits=limits), after=self.after._replace(limits=limits))

    def after_samples(self, samples: int) -> Self | None:
        """Return what is carried after so many samples of the chunk, None if there is no stop from there."""
        done = self.motion.first(samples)
        if self.status in (StreamStatus.BRAKING, StreamStatus.RESTING):
            after = self.before.braked(samples, done.pan[1:], done.acceleration)
        else:
            state = state_after(done.pan[1:], done.acceleration)
            inside = Pan.at(self.room.seen_inside(state), self.room.limits)
            if not inside.can_stop:
                return None
            after = self.room.outside(inside)
        sight = self.sight.until(self.sight.end - self.chunk + samples)
        return self._replace(after=after, commanded=moved_on(self.asked.commanded, done), sight=sight)

    def going_on(self, samples: int) -> Self:
        """Return what is carried with what is left of the chunk after so many samples, and its stop behind it."""
        u = self.after.brake.accelerations(samples)
        states = integrate_pan(np.array(self.after.state[:6]), u)
        stop = predict(self.after, u, u, states, self.motion.sliding[-1], self.sight.friction)
        done = self.motion.first(samples)
        reader = None if self.asked.reader is None else self.asked.reader.after(samples)
        return self._replace(
            motion=_joined(self.motion, stop, samples),
            before=self.after._replace(state=state_after(done.pan[1:], done.acceleration)),
            after=self.after.braked(samples, stop.pan[1:], u),
            commanded=moved_on(self.commanded, stop),
            asked=Asked(moved_on(self.asked.commanded, done), reader),
            sight=self.sight.then(stop),
            ending=None if self.ending is None else self.ending._replace(left=self.ending.left - samples),
        )

    def followed_by(
        self,
        motion: Motion,
        before: Pan,
        after: Pan,
        room: Room,
        status: StreamStatus,
        reader: Reader | None = None,
        ending: Ending | None = None,
    ) -> Self:
        """Return what is carried with a chunk more, which a reader gave, or none did."""
        commanded, asked = moved_on(self.commanded, motion), Asked(self.commanded, reader)
        return type(self)(motion, before, after, commanded, asked, self.sight.then(motion), room, status, ending)

    def braked(
        self, before: Pan, room: Room, sliding: FloatArray, status: StreamStatus, ending: Ending | None = None
    ) -> Self:
        """Return what is carried with the next chunk of a pan's stop; `sliding` (4,) is the object."""
        u = before.brake.accelerations(self.chunk)
        states = integrate_pan(np.array(before.state[:6]), u)
        motion = predict(before, u, u, states, sliding, self.sight.friction)
        return self.followed_by(motion, before, before.braked(self.chunk, states, u), room, status, ending=ending)

    def stopped(self, before: Pan, room: Room) -> Self:
        """Return what is carried with the next chunk of the stop, which holds until the stream is reset."""
        if self.status is not StreamStatus.BRAKING:
            stop = gentle_stop(room.seen_inside(before.state), before.limits, self.sight.friction)
            before = before if stop is None else before._replace(brake=stop)
        return self.braked(before, room, self.sight.sliding[-1], StreamStatus.BRAKING)

    def located(self, limits: Limits) -> tuple[Pan, Room]:
        """Return the pan where it is believed to be, with a stop from there, and the room for that stop."""
        predicted, room, believed = self.after, self.room, self.sight.pan[-1]
        if believed.tolist() == list(predicted.state[:6]) and not room.off_limits(limits):
            return predicted, room
        state = moved_to(predicted.state, believed)
        room = Room.of(state, limits)
        return room.outside(Pan.at(room.seen_inside(state), room.limits)), room

    def judged(self, room: Room, limits: Limits, missing: bool) -> StreamStatus:
        """Return what the next chunk comes from, and whether a reading is missing."""
        verdict = self.sight.verdict
        if room.off_limits(limits):
            return StreamStatus.OUTSIDE
        if verdict is Verdict.DOUBTED:
            return StreamStatus.DOUBTING
        if verdict is Verdict.BELIEVED:
            return StreamStatus.CONVINCED
        return StreamStatus.PREDICTED if missing else StreamStatus.FOLLOWING

    def stop_from(self, sample: int) -> FloatArray:
        """Return the stop from a sample of the chunk, (n, 3) pan accelerations (m/s^2); see `Stream.brake`."""
        u = self.motion.acceleration
        states = [self.before.state]
        states += [PanState(*row) for row in np.concatenate([self.motion.pan[1:], u], axis=1).tolist()]
        for k in range(sample, len(u) + 1):
            stop = gentle_stop(self.room.seen_inside(states[k]), self.after.limits, self.sight.friction)
            if stop is not None:
                return np.concatenate([u[sample:k], stop.accelerations(stop.samples)])
        brake = self.after.brake
        return np.concatenate([u[sample:], brake.accelerations(max(1, brake.samples))])


def predict(
    before: Pan, asked: FloatArray, u: FloatArray, states: FloatArray, sliding: FloatArray, friction: Friction
) -> Motion:
    """Return the motion of a chunk whose pan states after each sample are known, by the law of friction."""
    pan = np.concatenate([[before.state[:6]], states])
    return Motion(u, asked, pan, np.concatenate([sliding[None], slide_one(sliding, u, friction)]))


def moved_on(before: FloatArray, motion: Motion) -> FloatArray:
    """Return the pan by what was commanded alone, after a motion and (6,) before it: position (m), velocity (m/s)."""
    pan, free = motion.pan, len(motion.acceleration) * DT
    position, velocity = before[:3], before[3:]
    moved = pan[-1, :3] - pan[0, :3] + (velocity - pan[0, 3:]) * free
    return np.concatenate([position + moved, velocity + pan[-1, 3:] - pan[0, 3:]])


def moved_to(state: PanState, there: FloatArray) -> PanState:
    """Return a pan with its acceleration at (6,) position (m) and velocity (m/s)."""
    x, y, z, vx, vy, vz = there.tolist()
    return state._replace(x=x, y=y, z=z, vx=vx, vy=vy, vz=vz)


def _joined(first: Motion, then: Motion, samples: int) -> Motion:
    """Return as many samples as `first` has, the last of them so many of the motion that goes on from it."""
    done = then.first(samples)
    return Motion(
        np.concatenate([first.acceleration[samples:], done.acceleration]),
        np.concatenate([first.asked[samples:], done.asked]),
        np.concatenate([first.pan[samples:-1], done.pan]),
        np.concatenate([first.sliding[samples:-1], done.sliding]),
    )
