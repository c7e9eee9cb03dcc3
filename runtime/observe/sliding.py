"""What is believed of the object at the instant of a frame: several Kalman filters whose model is the law of friction.

Constant velocity is no model of stick and slip: an object that sticks has no velocity, and it may break away within a
millisecond. So between two frames the law runs along what the pan did. There is one filter for each of a few static
frictions, since that one shows only where the object breaks away, at once and not by degrees; each keeps a position, a
velocity and a kinetic friction of its own, and a weight by how well its predictions fit the frames. All share the gain
of the best one: its law is run three times more, with each velocity and the kinetic friction changed by as much as they
are uncertain, and the differences say how far each of them shows in the next frame. Positions, which the law only adds,
need no run. A static friction that no frame fits any more gives way to one nearer to the best.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import MAX_COEFFICIENT, Friction
from runtime.physics.law import DT, slide_one

FILTERS = 8
"""Static frictions that are followed at once."""

STATIC_RANGE = (0.15, 2.5)
"""Where they lie at first: from ice to rubber."""

LEAST_KINETIC = 0.01
"""Smallest kinetic friction that is believed."""

STATIC_SPREAD, KINETIC_SPREAD = 0.6, 0.1
"""How far the frictions may be from what was told (standard deviation; of the static one, of its logarithm)."""

KINETIC_DRIFT, VELOCITY_DRIFT, POSITION_DRIFT = 0.008, 0.02, 0.0005
"""How far friction, velocity (m/s) and position (m) may leave the law in a second (standard deviations): no pan moves
quite as it is told, and none is equally rough everywhere."""

SMALLEST_CHANGE = 0.01
"""Smallest change of a velocity (m/s) or a friction whose effect is tried: of a smaller one, rounding shows."""

RESTING_SPEED = 0.05
"""Speed (m/s) up to which a frame does not wake an object that the law says rests."""

TAILS = 4.0
"""Degrees of freedom of Student's t that weighs the static frictions: one bad frame must not rule one out."""

SURE = 5.0
"""Standard deviations beyond which a frame is no noise: something happened."""

PUSHED_SPEED = 0.2
"""Largest speed (m/s) that a push is thought to leave: friction takes it within 40 ms."""

DEAD = 8.0
"""Logarithm of the weight, below the best one's, at which a static friction gives way to another."""

LIKELY = 3.0
"""The same at which it is outside the interval that is given: exp(-3) is 5 %."""

AGREES = 2.0
"""Standard deviations up to which the kinetic friction that the particles find is no other than the filters'."""

FINEST = 0.06
"""Smallest distance of two static frictions, of their logarithms: closer ones break away in the same millisecond."""


class Frame(NamedTuple):
    """The object seen at a sample: `position` (2,) relative to the pan (m)."""

    at: int
    position: FloatArray


class Belief(NamedTuple):
    """What is believed at the instant of a frame; a value, which `see` does not change.

    Attributes:
        frame: the frame, which is taken in already.
        states: (F, 4) object position (m) and velocity (m/s) relative to the pan, by each filter.
        kinetic, static: (F,) friction of each.
        weight: (F,) logarithm of its weight; the best one's is 0.
        spread: (5, 5) covariance of state and kinetic friction, the same for each.
        best: number of the filter that is believed.
        event: whether the frame was no noise: a push, or a slip that no friction explains.
    """

    frame: Frame
    states: FloatArray
    kinetic: FloatArray
    static: FloatArray
    weight: FloatArray
    spread: FloatArray
    best: int
    event: bool = False

    @classmethod
    def begin(cls, at: int, state: FloatArray, told: Friction) -> Self:
        """Return what is believed at first: the object in a state (4,), and friction near what was told."""
        static = np.geomspace(*STATIC_RANGE, FILTERS)
        if told.static > 0.0:
            static[int(np.abs(np.log(static / told.static)).argmin())] = told.static
            weight = -0.5 * (np.log(static / told.static) / STATIC_SPREAD) ** 2
        else:
            static[0], weight = 0.0, -np.arange(FILTERS, dtype=np.float64)
        kinetic = np.full(FILTERS, told.kinetic)
        spread = np.zeros((5, 5))
        spread[4, 4] = KINETIC_SPREAD**2
        states = np.tile(state, (FILTERS, 1))
        return cls(Frame(at, state[:2]), states, kinetic, static, weight, spread, int(weight.argmax()))

    @property
    def state(self) -> FloatArray:
        """(4,) the object's position (m) and velocity (m/s) at the frame; a velocity of exactly zero is rest."""
        state: FloatArray = self.states[self.best]
        return state

    @property
    def friction(self) -> Friction:
        """The friction believed in."""
        return self._friction(self.best)

    @property
    def kinetic_interval(self) -> tuple[float, float]:
        """Between what the kinetic friction is, by 95 %."""
        kinetic, spread = float(self.kinetic[self.best]), 2.0 * math.sqrt(self.spread[4, 4])
        return max(0.0, kinetic - spread), min(MAX_COEFFICIENT, kinetic + spread)

    @property
    def static_interval(self) -> tuple[float, float]:
        """Between what the static friction is, by 95 %: the nearest ones to both sides that the frames rule out."""
        order = np.argsort(self.static)
        likely = self.weight[order] > -LIKELY
        first, last = int(likely.argmax()), FILTERS - 1 - int(likely[::-1].argmax())
        low = float(self.static[order[first - 1]]) if first > 0 else 0.0
        return low, float(self.static[order[last + 1]]) if last < FILTERS - 1 else MAX_COEFFICIENT

    def placed(self, at: int, state: FloatArray) -> Self:
        """Return it with the object in a state (4,) that is known; what is believed of the friction stays."""
        spread = np.zeros((5, 5))
        spread[4, 4] = self.spread[4, 4]
        states = np.tile(state, (FILTERS, 1))
        return self._replace(frame=Frame(at, state[:2]), states=states, spread=spread, event=False)

    def knowing(self, kinetic: float, spread: float) -> Self:
        """Return it with a kinetic friction found elsewhere and its standard deviation, if surer or another."""
        own = math.sqrt(self.spread[4, 4])
        if own < spread and abs(self.kinetic[self.best] - kinetic) < AGREES * spread:
            return self
        known = self.spread.copy()
        known[4], known[:, 4] = 0.0, 0.0
        known[4, 4] = spread * spread
        return self._replace(kinetic=np.full(FILTERS, kinetic), spread=known)

    def see(self, frame: Frame, u: FloatArray, noise: float, pushed: bool = False) -> Self:
        """Take in a later frame.

        Args:
            frame: the object seen.
            u: (n, d) pan accelerations from this frame to that one (m/s^2).
            noise: standard deviation of the frame's position (m).
            pushed: whether it is known that something happened.
        """
        ends = self._run(u)
        spread = self._spread(u, ends[self.best])
        seen = np.eye(2) * noise * noise
        innovation = frame.position - ends[:, :2]
        misfit = np.einsum("fi,ij,fj->f", innovation, np.linalg.inv(spread[:2, :2] + seen), innovation)
        event = pushed or bool(misfit.min() > SURE * SURE)
        weight = self.weight if event else self.weight - 0.5 * TAILS * np.log1p(misfit / TAILS)
        weight = np.maximum(weight - weight.max(), -DEAD - 1.0)

        # Where the static frictions disagree, the object may be with any of them.
        share = np.exp(weight)
        share /= share.sum()
        stacked = np.column_stack([ends, self.kinetic])
        apart = stacked - share @ stacked
        wide = spread + (apart * share[:, None]).T @ apart
        if event:
            size = float(np.abs(innovation[self.best]).max())
            pushed_by = min(size / max(len(u) * DT, DT), PUSHED_SPEED)
            widened = np.diag([size**2, size**2, pushed_by**2, pushed_by**2, 0.0])
            spread, wide = spread + widened, wide + widened
        gain = wide[:, :2] @ np.linalg.inv(wide[:2, :2] + seen)

        change = innovation @ gain.T
        states = ends + change[:, :4]
        rests = ~ends[:, 2:].any(axis=1) & (np.hypot(change[:, 2], change[:, 3]) < RESTING_SPEED)
        if not event:
            states[rests, 2:] = 0.0
        best = int(weight.argmax())
        left = np.eye(5)
        left[:, :2] -= gain
        spread = left @ spread @ left.T + gain @ seen @ gain.T
        if rests[best] and not event:
            spread[2:4] = 0.0
            spread[:, 2:4] = 0.0
        kinetic = np.clip(self.kinetic + change[:, 4], LEAST_KINETIC, MAX_COEFFICIENT)
        return type(self)(frame, states, kinetic, self.static, weight, spread, best, event)._refined()

    def spread_after(self, u: FloatArray) -> FloatArray:
        """Return (5, 5) the covariance after pan accelerations (n, d) more (m/s^2)."""
        return self._spread(u, slide_one(self.state, u, self.friction)[-1]) if len(u) else self.spread

    def _friction(self, one: int) -> Friction:
        kinetic = float(self.kinetic[one])
        return Friction(max(float(self.static[one]), kinetic), kinetic)

    def _run(self, u: FloatArray) -> FloatArray:
        """Return (F, 4) where each filter says the object is after the accelerations u; a dead one says as the best."""
        if not len(u):
            return self.states.copy()
        ends = np.empty((FILTERS, 4))
        ends[:] = slide_one(self.state, u, self.friction)[-1]
        for one in np.flatnonzero(self.weight > -DEAD).tolist():
            if one != self.best:
                ends[one] = slide_one(self.states[one], u, self._friction(one))[-1]
        return ends

    def _spread(self, u: FloatArray, end: FloatArray) -> FloatArray:
        """Return the covariance after the accelerations u, which lead the best filter to `end` (4,)."""
        if not len(u):
            return self.spread
        friction, slope = self.friction, np.eye(5)
        for axis in (2, 3):
            step = max(math.sqrt(self.spread[axis, axis]), SMALLEST_CHANGE)
            changed = self.state.copy()
            changed[axis] += step
            slope[:4, axis] = (slide_one(changed, u, friction)[-1] - end) / step
        step = max(math.sqrt(self.spread[4, 4]), SMALLEST_CHANGE)
        kinetic = min(friction.kinetic + step, MAX_COEFFICIENT)
        rougher = Friction(max(friction.static, kinetic), kinetic)
        slope[:4, 4] = (slide_one(self.state, u, rougher)[-1] - end) / step
        time, slides = len(u) * DT, float(end[2:].any())
        drift = np.array(
            [POSITION_DRIFT, POSITION_DRIFT, slides * VELOCITY_DRIFT, slides * VELOCITY_DRIFT, KINETIC_DRIFT]
        )
        spread: FloatArray = slope @ self.spread @ slope.T + np.diag(drift * drift * time)
        return spread

    def _refined(self) -> Self:
        """Return it with one static friction that is ruled out moved to half-way between the best and a neighbour."""
        order = np.argsort(self.static)
        place = int(np.flatnonzero(order == self.best)[0])
        near = order[max(place - 2, 0) : place + 3]
        dead = np.setdiff1d(np.flatnonzero(self.weight < -DEAD), near)
        if not len(dead):
            return self
        below, above = order[max(place - 1, 0)], order[min(place + 1, FILTERS - 1)]
        found = float(self.static[self.best])
        gaps = [(abs(math.log(max(float(self.static[one]), 1e-9) / max(found, 1e-9))), one) for one in (below, above)]
        gap, neighbour = max(gaps)
        if gap < FINEST:
            return self
        one = int(dead[0])
        static, states, kinetic, weight = (
            part.copy() for part in (self.static, self.states, self.kinetic, self.weight)
        )
        static[one] = math.sqrt(found * float(static[neighbour]))
        states[one], kinetic[one] = states[self.best], kinetic[self.best]
        weight[one] = 0.5 * weight[neighbour]
        return self._replace(static=static, states=states, kinetic=kinetic, weight=weight)
