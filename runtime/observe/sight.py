"""What a stream knows of pan and object: where both were and will be by the end of the chunk given last.

Time is counted in samples of what was commanded. An arm that executes late is seen late: a reading that is `age` old
shows what was commanded `age` and the arm's delay ago. Each reading corrects what was believed of its own instant; what
was commanded since leads on from there, for the pan by integration, for the object by the law of friction.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import MAX_COEFFICIENT, Friction
from runtime.observe.delay import DelaySearch
from runtime.observe.estimates import FrictionEstimate, ObjectEstimate
from runtime.observe.frames import NOISES, Verdict, Watch
from runtime.observe.pan import APART, DISTANCE, SETTLING, SPEED, agree, along, large
from runtime.observe.particles import Particles
from runtime.observe.past import KEPT, Past
from runtime.observe.sliding import Frame
from runtime.physics.law import DT, GRAVITY, slide_one
from runtime.physics.motion import Motion
from runtime.start import Start

DELAY_EVERY = 25
"""Of many rows of pan states, every so manieth counts for the delay."""

FINEST = 1e-5
"""Change of a pan (m, m/s) that shows in every reading: an encoder counts finer."""

REMEMBERED = 4
"""Chunks that are remembered at least: of a slow pan's network they are long."""

BENT = 100
"""Samples over which what was believed before a reading is bent towards it."""

INTERVAL = 3.0
"""Standard deviations to each side that make a 95 % interval of the kinetic friction: two would, if the law held."""

OBJECT_DISTANCE, OBJECT_SPEED = 0.01, 0.5
"""Difference (m, m/s) between two states of an object a millisecond apart up to which it is noise or friction."""

PAN_JUMPS = np.array([DISTANCE] * 3 + [SPEED] * 3)
OBJECT_JUMPS = np.array([OBJECT_DISTANCE] * 2 + [OBJECT_SPEED] * 2)


class Sight(NamedTuple):
    """A value, which its methods do not change.

    Attributes:
        past: what was commanded, up to the end of the chunk given last.
        pan: (n, 6) believed pan positions (m) and velocities (m/s) at the last samples up to there.
        sliding: (n, 4) the same of the object, relative to the pan.
        watch: what is known of the object and of its static friction.
        particles: what is known of its kinetic friction; None if nobody searches for it.
        delays: what is known of the arm's delay.
        rest: (6,) what of the last pan reading's difference was not believed (m, m/s), and `read`, its sample.
        arrived: samples at which the last usable readings of pan and object came.
        handed: the last pan and object states that came, as they were.
        doubt: (4,) how the last state of the object that cannot be true differed from what was believed.
        verdict: the worst of what became of the readings since the last chunk.
        event: whether something happened since then that the law does not explain.
    """

    past: Past
    pan: FloatArray
    sliding: FloatArray
    watch: Watch
    particles: Particles | None
    delays: DelaySearch
    rest: FloatArray
    read: int
    arrived: tuple[int, int]
    handed: tuple[FloatArray | None, FloatArray | None] = (None, None)
    doubt: FloatArray | None = None
    verdict: Verdict = Verdict.TAKEN
    event: bool = False

    @classmethod
    def begin(cls, start: Start, mark: FloatArray, told: Friction, noise: float, chunk: int, search: bool) -> Self:
        """Return what is known before the first chunk.

        Args:
            start: where pan and object are.
            mark: (2,) where the object is if that is not said (m).
            told: the friction.
            noise: standard deviation of an object's position in a frame (m).
            chunk: samples of a chunk.
            search: whether to search for the kinetic friction.
        """
        pan, sliding = start.pan_state(), start.object_state(mark)
        kept = max(KEPT, REMEMBERED * chunk)
        past = Past.still(np.array(start.pan_acceleration), pan[3:], kept)
        watch = Watch.begin(sliding, told, noise)
        tracks = np.tile(pan, (kept, 1)), np.tile(sliding, (kept, 1))
        particles = Particles.begin(sliding, told) if search else None
        return cls(past, *tracks, watch, particles, DelaySearch.begin(3), np.zeros(6), -1, (0, 0))

    def knowing(self, before: Sight) -> Self:
        """Return it with what was known before of friction and delay."""
        last = self.watch.last
        watch = self.watch._replace(beliefs=(before.watch.last.placed(last.frame.at, last.state),))
        particles = None if before.particles is None else before.particles.placed(last.frame.at, last.state)
        return self._replace(watch=watch, particles=particles, delays=before.delays.again())

    @property
    def end(self) -> int:
        """The sample at which the chunk given last ends."""
        return self.past.end

    @property
    def friction(self) -> Friction:
        """The friction that is believed in."""
        return self.watch.last.friction

    @property
    def friction_estimate(self) -> FrictionEstimate:
        """What is believed of the friction, and how sure that is."""
        last = self.watch.last
        if self.particles is None:
            return FrictionEstimate(last.friction, last.kinetic_interval, last.static_interval)
        kinetic, spread = self.particles.found
        static = max(last.friction.static, kinetic)
        between = max(0.0, kinetic - INTERVAL * spread), min(MAX_COEFFICIENT, kinetic + INTERVAL * spread)
        return FrictionEstimate(Friction(static, kinetic), between, last.static_interval)

    def object_at(self, at: int) -> ObjectEstimate:
        """Return what is believed of the object at a sample up to the end, and how sure that is."""
        state, belief = self.sliding[self._row(at)], self.watch.last
        u = self.past.between(belief.frame.at, max(at, belief.frame.at))
        spread = np.sqrt(np.diag(belief.spread_after(u))).tolist()
        return ObjectEstimate(
            position=state[:2].copy(),
            velocity=state[2:].copy(),
            sticks=not state[2:].any(),
            position_error=max(spread[:2]),
            velocity_error=max(spread[2:4]),
            age=(at - belief.frame.at) * DT,
        )

    def then(self, motion: Motion) -> Self:
        """Return it with a chunk more; nothing has become of readings since."""
        past = self.past.then(motion.acceleration)
        pan = np.concatenate([self.pan, motion.pan[1:]])[-past.kept :]
        sliding = np.concatenate([self.sliding, motion.sliding[1:]])[-past.kept :]
        watch = self.watch.carried(past)
        return self._replace(past=past, pan=pan, sliding=sliding, watch=watch, verdict=Verdict.TAKEN, event=False)

    def until(self, end: int) -> Self:
        """Return it as if the chunk given last ended at an earlier sample, not before it began."""
        left = len(self.pan) - (self.end - end)
        return self._replace(past=self.past.until(end), pan=self.pan[:left], sliding=self.sliding[:left])

    def see_pan(self, state: FloatArray, at: int, late: int, now: int) -> Self:
        """Take in a pan state, or many.

        Args:
            state: (6,) position (m) and velocity (m/s), or (C, 6) the last C.
            at: sample of the last one.
            late: samples by which the arm executes late, which `at` is told without.
            now: sample at which it came.
        """
        rows = state[None] if state.ndim == 1 else state
        if not self._new(at, now, self.read, len(rows)) or self._frozen_pan(state, at):
            return self._but(Verdict.IGNORED)
        row = self._row(at)
        off = rows - self.pan[row + 1 - len(rows) : row + 1]
        delays = self.delays
        for one in range((len(rows) - 1) % DELAY_EVERY, len(rows), DELAY_EVERY):
            delays = delays.see(at + late - (len(rows) - 1 - one), rows[one, 3:], self.past)
        sight = self._replace(read=at, delays=delays, handed=(state, self.handed[1]))
        if not off.any():
            return sight._replace(rest=np.zeros(6), arrived=(now, self.arrived[1]))
        before, time = self.rest, (at - self.read) * DT
        new = max(len(rows) - (at - self.read), 0)  # rows before were there before
        leads_on = len(rows) > 1 and not (
            large(off[new]) and large(off[new] - along(self.rest, (at - len(rows) + 1 + new - self.read) * DT))
        )
        if leads_on and new < len(rows) - APART:
            before, time = off[-1 - APART], APART * DT
        share = 1.0 if len(rows) > 1 else min(1.0, (at - self.read) * DT / SETTLING)
        offset = agree(before, off[-1], time, share)
        verdict = Verdict.TAKEN
        if offset.doubted:
            verdict = Verdict.DOUBTED
        elif offset.moved:
            verdict = Verdict.BELIEVED
        arrived = self.arrived if offset.doubted else (now, self.arrived[1])
        bent = without_glitches(off, PAN_JUMPS) if leads_on else None
        return sight._shifted(offset.believed, row, bent)._replace(rest=offset.rest, arrived=arrived)._but(verdict)

    def see_object(self, position: FloatArray, at: int, now: int, acceleration: float) -> Self:
        """Take in a frame.

        Args:
            position: (2,) of the object relative to the pan (m).
            at: sample at which it was taken.
            now: sample at which it came.
            acceleration: the largest of the pan (m/s^2).
        """
        if not self._new(at, now, -1, 1):
            return self._but(Verdict.IGNORED)
        watch, verdict = self.watch.see(Frame(at, position), self.past, acceleration)
        strange = verdict in (Verdict.DOUBTED, Verdict.BELIEVED) or watch.last.event
        if strange and self.handed[1] is not None and np.array_equal(position, self.handed[1]):
            return self._but(Verdict.IGNORED)  # to the last bit the one before, and no friction would hold it there
        sight = self._replace(watch=watch)._but(verdict)
        if verdict is Verdict.IGNORED:
            return sight
        sight = sight._replace(handed=(self.handed[0], position))
        if verdict is Verdict.DOUBTED:
            return sight
        followed = self._followed()
        if followed is not None:
            sight = sight._replace(particles=followed.offered(Frame(at, position), watch.noise, watch.last.event))
        event = self.event or watch.last.event
        return sight._replace(arrived=(self.arrived[0], now), event=event)._led(watch.now(self.past))

    def searched(self, now: int) -> Self:
        """Return it with more known of the kinetic friction: as much as the samples pay for that have passed by now."""
        followed = self._followed()
        if followed is None:
            return self
        particles, watch = followed.run(self.past, now), self.watch
        if particles.informed and particles.seen > followed.seen:
            watch = watch.knowing(*particles.found)
        return self._replace(watch=watch, particles=particles)

    def see_object_states(self, state: FloatArray, at: int, now: int, acceleration: float) -> Self:
        """Take in a state of the object, (4,) position (m) and velocity (m/s), or the last C, (C, 4); see `see_pan`.

        What is measured with its velocity is taken as it is, if it can be true, and tells nothing of the friction.
        """
        rows = state[None] if state.ndim == 1 else state
        if not self._new(at, now, self.watch.last.frame.at - 1, len(rows)) or self._frozen_object(state, at):
            return self._but(Verdict.IGNORED)
        row, verdict, sight = self._row(at), Verdict.TAKEN, self._replace(handed=(self.handed[0], state))
        first = row + 1 - len(rows)
        off = rows - self.sliding[first : row + 1]
        if not off.any():
            watch = self.watch.placed(at, self.sliding[row])
            return sight._replace(watch=watch, arrived=(self.arrived[0], now), doubt=None)
        clean = without_glitches(off, OBJECT_JUMPS)
        if not np.array_equal(clean[-1], off[-1]):
            verdict = Verdict.DOUBTED
        if len(rows) == 1 and self._impossible(off[0], at, acceleration):
            if self.doubt is None or (np.abs(off[0] - self.doubt) > OBJECT_JUMPS).any():
                return sight._replace(doubt=off[0])._but(Verdict.DOUBTED)
            verdict = Verdict.BELIEVED
        placed = self.watch.placed(at, self.sliding[row] + clean[-1])
        sight = sight._replace(watch=placed, arrived=(self.arrived[0], now), doubt=None)._led(placed.now(self.past))
        if len(rows) > 1:
            sight.sliding[first:row] = self.sliding[first:row] + clean[:-1]
        return sight._but(verdict)

    def _followed(self) -> Particles | None:
        """Return the particles, put where the object is believed to be if that is known otherwise than from frames."""
        last, particles = self.watch.last, self.particles
        if particles is None:
            return None
        if last.frame.at > particles.newest or particles.at < self.past.begin:
            return particles.placed(last.frame.at, last.state)
        return particles

    def _row(self, at: int) -> int:
        """Return the row of a sample in `pan` and `sliding`."""
        return len(self.pan) - 1 - (self.end - at)

    def _new(self, at: int, now: int, last: int, rows: int) -> bool:
        """Whether a reading is later than the last one, not from the future, and not forgotten yet."""
        return last < at <= now and self._row(at) + 1 >= rows and at > self.past.begin

    def _but(self, verdict: Verdict) -> Self:
        """Return it with a verdict that counts if it is worse than the others since the last chunk."""
        worse = SEVERITY.index(verdict) > SEVERITY.index(self.verdict)
        return self._replace(verdict=verdict) if worse else self

    def _frozen_pan(self, state: FloatArray, at: int) -> bool:
        """Whether a pan reading is to the last bit the one before, though the pan moved since."""
        before = self.handed[0]
        if before is None or not np.array_equal(state, before):
            return False
        row, last = self._row(at), max(0, self._row(self.read))
        return bool(np.abs(self.pan[last : row + 1] - self.pan[last]).max() > FINEST)

    def _frozen_object(self, seen: FloatArray, at: int) -> bool:
        """Whether a reading of the object is to the last bit the one before, though no friction would hold it there."""
        before, last = self.handed[1], self.watch.last
        if before is None or not np.array_equal(seen, before) or at <= last.frame.at:
            return False
        if seen.shape[-1] == 4 and seen[..., 2:].any():
            return True
        most = Friction(self.watch.last.static_interval[1], last.friction.kinetic)
        held = np.concatenate([last.state[:2], np.zeros(2)])
        moved = slide_one(held, self.past.between(last.frame.at, at), most)[-1, :2] - held[:2]
        return bool(np.hypot(*moved) > NOISES * self.watch.noise)

    def _impossible(self, off: FloatArray, at: int, acceleration: float) -> bool:
        """Whether neither friction nor a pan that moves otherwise than told explains how a state (4,) is off."""
        time = (at - self.watch.last.frame.at) * DT
        most = acceleration + self.friction.static * GRAVITY
        distance, speed = np.hypot(*off[:2]), np.hypot(*off[2:])
        return bool(distance > 0.5 * most * time * time + OBJECT_DISTANCE or speed > most * time + OBJECT_SPEED)

    def _shifted(self, change: FloatArray, row: int, off: FloatArray | None) -> Self:
        """Return it with the pan changed, (6,), from a row on; before it by `off` (C, 6), or more and more up to it."""
        pan, past = self.pan.copy(), self.past
        bent = min(row, BENT)
        if off is not None:
            pan[row + 1 - len(off) : row] += off[:-1]
        elif change.any():
            pan[row - bent : row] += np.arange(bent)[:, None] / bent * change
        if change.any():
            pan[row:] += change
            pan[row:, :3] += np.arange(len(pan) - row)[:, None] * (DT * change[3:])
            u = past.u.copy()  # what the object felt
            u[row - bent : row] += change[3:] / (bent * DT)
            past = past._replace(u=u)
        return self._replace(pan=pan, past=past)

    def _led(self, states: FloatArray) -> Self:
        """Return it with the object led through states (n, 4) up to the end, and bent towards them before."""
        sliding = self.sliding.copy()
        row = len(sliding) - len(states)
        bent = min(row, BENT)
        sliding[row - bent : row] += np.arange(bent)[:, None] / bent * (states[0] - sliding[row])
        sliding[row:] = states
        return self._replace(sliding=sliding)


SEVERITY = (Verdict.TAKEN, Verdict.IGNORED, Verdict.BELIEVED, Verdict.DOUBTED)
"""Verdicts, the worst last."""


def without_glitches(off: FloatArray, jumps: FloatArray) -> FloatArray:
    """Return differences (C, w) with those that jump, and at once back again, replaced by the one before.

    The last one, of which nobody knows whether it jumps back, is replaced too.
    """
    if len(off) < 3:
        return off
    jump = np.any(np.abs(np.diff(off, axis=0)) > jumps, axis=1)
    if not jump.any():
        return off
    clean = off.copy()
    for one in (np.flatnonzero(jump[:-1] & jump[1:]) + 1).tolist():
        clean[one] = clean[one - 1]
    if jump[-1]:
        clean[-1] = clean[-2]
    return clean
