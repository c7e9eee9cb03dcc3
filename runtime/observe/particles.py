"""What the friction is, by a particle filter: the law run under many frictions at once, against the frames.

Where an object breaks away and where it stops turns on the friction by jerks, so no derivative leads far, and the
filters of `runtime.observe.sliding` that say where the object is are poor judges of the kinetic friction. Here each
particle has frictions and a velocity of its own; its position, on which nothing depends, is a Kalman filter's
(Rao-Blackwellised: A. Doucet et al., 2000). Particles that no frame fits give way to others near the fitting ones,
drawn from a kernel that keeps mean and covariance (J. Liu and M. West, 2001).

That is much work for one instant, and nothing waits for it: frames wait in line, and each reading that comes pays for
a few samples.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import NamedTuple, Self

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import MAX_COEFFICIENT, Friction
from runtime.observe.past import Past
from runtime.observe.sliding import (
    KINETIC_SPREAD,
    LEAST_KINETIC,
    POSITION_DRIFT,
    PUSHED_SPEED,
    STATIC_SPREAD,
    SURE,
    Frame,
)
from runtime.physics.law import DT, compiled_law, slide_batch

PARTICLES = 512
"""Their number: with half of them the worst error doubles, with half as many more it stays."""

WIDER = 4.0
"""Times that every fourth particle is at first farther from what was told: nobody may have known."""

KEPT_SHARE = 0.97
"""Share of its distance from the mean that a particle's friction keeps when it is drawn again."""

WORN = 0.5
"""Share of the particles below which, as their weights count them, they are drawn again."""

LEAST_NOISE = 5e-4
"""Noise of a frame (m) that is reckoned with at least: a sharper eye would find no particle that fits."""

SPACING = 5
"""Samples between two frames that count: more would cost more than they tell."""

WAITING = 32
"""Frames that wait at most: the oldest give way."""

VELOCITY_DRIFT, KINETIC_DRIFT, STATIC_DRIFT = 0.01, 0.003, 0.02
"""How far a velocity (m/s), the kinetic friction and the logarithm of the static one may leave the law in a second
(standard deviations)."""

PACE, MOST = 2, 10
"""Samples that are run for each sample that passes, and at most at once."""


class Waiting(NamedTuple):
    """A frame in line.

    Attributes:
        frame: the frame.
        noise: standard deviation of its position (m).
        event: whether something happened that the law does not explain.
    """

    frame: Frame
    noise: float
    event: bool


class Particles(NamedTuple):
    """A value, which its methods do not change.

    Attributes:
        told: kinetic friction, before anything was seen.
        at: the sample up to which they have run.
        states: (N, 4) object position (m) and velocity (m/s) relative to the pan.
        kinetic, static: (N,) friction of each.
        weight: (N,) logarithm of its weight; the best one's is 0.
        variance: of each one's position (m^2).
        seen: sample of the last frame that they took in.
        drawn: sample at which they were drawn last.
        informed: whether they were ever drawn: before that, no frame has told of the friction.
        waiting: frames in line, oldest first.
        newest: sample of the last frame that was offered.
        paid: sample up to which readings have paid.
    """

    told: float
    at: int
    states: FloatArray
    kinetic: FloatArray
    static: FloatArray
    weight: FloatArray
    variance: float
    seen: int = 0
    drawn: int = 0
    informed: bool = False
    waiting: tuple[Waiting, ...] = ()
    newest: int = 0
    paid: int = 0

    @classmethod
    def begin(cls, state: FloatArray, told: Friction) -> Self:
        """Return what is believed at first: the object in a state (4,), and friction near what was told."""
        wide = np.where(np.arange(PARTICLES) % 4, 1.0, WIDER)
        kinetic = told.kinetic + KINETIC_SPREAD * wide * SCATTERED[:, 0]
        kinetic = np.where(kinetic > 0.0, kinetic, told.kinetic * np.exp(SCATTERED[:, 0]))
        kinetic = np.clip(kinetic, LEAST_KINETIC, MAX_COEFFICIENT)
        static = max(told.static, LEAST_KINETIC) * np.exp(STATIC_SPREAD * np.sqrt(wide) * SCATTERED[:, 1])
        static = np.clip(static, kinetic, MAX_COEFFICIENT)
        return cls(told.kinetic, 0, np.tile(state, (PARTICLES, 1)), kinetic, static, np.zeros(PARTICLES), 0.0)

    @property
    def found(self) -> tuple[float, float]:
        """The kinetic friction and its standard deviation: what was told, before a frame has told anything."""
        if not self.informed:
            return self.told, KINETIC_SPREAD
        share = self._share()
        mean = float(share @ self.kinetic)
        return mean, math.sqrt(float(share @ (self.kinetic - mean) ** 2))

    def placed(self, at: int, state: FloatArray) -> Self:
        """Return it with the object in a state (4,) that is known; what is believed of the friction stays."""
        states = np.tile(state, (PARTICLES, 1))
        return self._replace(at=at, states=states, variance=0.0, seen=at, drawn=at, waiting=(), newest=at)

    def offered(self, frame: Frame, noise: float, event: bool) -> Self:
        """Return it with a frame more in line, if it is late enough.

        Args:
            frame: the frame.
            noise: standard deviation of its position (m).
            event: whether something happened that the law does not explain.
        """
        last = self.waiting[-1].frame.at if self.waiting else self.seen
        particles = self._replace(newest=max(self.newest, frame.at))
        if frame.at < last + (1 if event else SPACING):
            return particles
        return particles._replace(waiting=(*self.waiting, Waiting(frame, max(noise, LEAST_NOISE), event))[-WAITING:])

    def run(self, past: Past, now: int) -> Self:
        """Return it as far along the past as the samples pay for that have passed up to `now`."""
        left, particles = min(PACE * (now - self.paid), MOST), self._replace(paid=max(now, self.paid))
        while left > 0 and particles.waiting:
            first = particles.waiting[0]
            samples = min(left, first.frame.at - particles.at)
            particles = particles._along(past.between(particles.at, particles.at + samples))
            left -= samples
            if particles.at == first.frame.at:
                particles = particles._see(first)._replace(waiting=particles.waiting[1:])
        return particles

    def _share(self) -> FloatArray:
        share = np.exp(self.weight)
        normalized: FloatArray = share / share.sum()
        return normalized

    def _along(self, u: FloatArray) -> Self:
        """Return it after pan accelerations (n, d) more (m/s^2)."""
        law = compiled_law()
        if law is None:
            along = slide_batch(self.states, np.broadcast_to(u, (PARTICLES, *u.shape)), self.static, self.kinetic)
        else:
            along = law.slide(self.states, u[None], self.static, self.kinetic)
        return self._replace(at=self.at + len(u), states=along[:, -1])

    def _see(self, waiting: Waiting) -> Self:
        """Take in a frame of the sample up to which they have run."""
        rng, time = np.random.default_rng(self.at), (self.at - self.seen) * DT
        states, seen = self.states.copy(), waiting.noise**2
        slides = states[:, 2:].any(axis=1)
        states[slides, 2:] += VELOCITY_DRIFT * math.sqrt(time) * rng.standard_normal((int(slides.sum()), 2))
        variance = self.variance + POSITION_DRIFT**2 * time
        innovation = waiting.frame.position - states[:, :2]
        squares = (innovation * innovation).sum(axis=1)
        weight = self.weight
        if waiting.event or squares.min() > SURE**2 * (variance + seen):
            size = math.sqrt(float(squares[weight.argmax()]))
            variance += size**2
            pushed = min(size / max(time, DT), PUSHED_SPEED)
            states[::2, 2:] += pushed * rng.standard_normal((PARTICLES - PARTICLES // 2, 2))
        else:
            weight = weight - 0.5 * squares / (variance + seen)
            weight = weight - weight.max()
        gain = variance / (variance + seen)
        states[:, :2] += gain * innovation
        particles = self._replace(states=states, weight=weight, variance=gain * seen, seen=self.at)
        return particles._drawn(rng) if particles._worn else particles

    @property
    def _worn(self) -> bool:
        share = self._share()
        return float(share @ share) * WORN * PARTICLES > 1.0

    def _drawn(self, rng: np.random.Generator) -> Self:
        """Draw them again, as often as their weights say, with frictions changed by a little."""
        share, time = self._share(), (self.at - self.drawn) * DT
        frictions = np.column_stack([self.kinetic, np.log(self.static)])
        mean = share @ frictions
        apart = frictions - mean
        spread = (1.0 - KEPT_SHARE**2) * (share[:, None] * apart).T @ apart
        spread += np.diag([KINETIC_DRIFT**2 * time, STATIC_DRIFT**2 * time])
        chosen = np.searchsorted(np.cumsum(share), (np.arange(PARTICLES) + 0.5) / PARTICLES).clip(max=PARTICLES - 1)
        changed = rng.standard_normal((PARTICLES, 2)) @ np.linalg.cholesky(spread).T
        frictions = mean + KEPT_SHARE * apart[chosen] + changed
        kinetic = np.clip(frictions[:, 0], LEAST_KINETIC, MAX_COEFFICIENT)
        static = np.clip(np.exp(frictions[:, 1]), kinetic, MAX_COEFFICIENT)
        weight = np.zeros(PARTICLES)
        particles = self._replace(states=self.states[chosen], kinetic=kinetic, static=static, weight=weight)
        return particles._replace(drawn=self.at, informed=True)


def _scattered() -> FloatArray:
    """Return (N, 2) numbers of the normal distribution that fill the plane evenly (the R2 sequence)."""
    golden = 1.3247179572447460  # x^3 = x + 1
    part = (0.5 + np.outer(np.arange(1, PARTICLES + 1), [1.0 / golden, 1.0 / golden**2])) % 1.0
    normal = NormalDist()
    return np.array([[normal.inv_cdf(value) for value in row] for row in part.tolist()])


SCATTERED = _scattered()
"""Where particles are at first, in standard deviations."""
