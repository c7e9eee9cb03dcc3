"""Frames of a camera as they come: late, twice, out of order, lost, and now and then of something else."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import NamedTuple, Self

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.observe.past import Past
from runtime.observe.sliding import PUSHED_SPEED, Belief, Frame
from runtime.physics.law import DT, GRAVITY, slide_one

BELIEFS = 16
"""Frames that are remembered: one that comes late is taken in among them."""

LASTING = 0.01
"""Time (s) after which an object that is seen where it cannot be is believed to be there, if two frames say so."""

NOISES = 5.0
"""Standard deviations of a frame that count as noise."""


class Verdict(StrEnum):
    """What became of a reading."""

    TAKEN = "taken"
    """It was taken in."""

    DOUBTED = "doubted"
    """It cannot be true; the prediction stands in its place."""

    BELIEVED = "believed"
    """It could not be true, but it lasts: what was believed before is given up for it."""

    IGNORED = "ignored"
    """It is there already, is older than what is remembered, or is from the future."""


class Watch(NamedTuple):
    """What is known of the object; a value, which its methods do not change.

    Attributes:
        noise: standard deviation of a frame's position (m).
        beliefs: at the last frames, oldest first; never empty.
        doubted: frames after the last of these that cannot be true.
    """

    noise: float
    beliefs: tuple[Belief, ...]
    doubted: tuple[Frame, ...] = ()

    @classmethod
    def begin(cls, state: FloatArray, told: Friction, noise: float) -> Self:
        """Return what is known before the first frame: the state (4,) of the object, and the friction told."""
        return cls(noise, (Belief.begin(0, state, told),))

    @property
    def last(self) -> Belief:
        """What is believed at the last frame."""
        return self.beliefs[-1]

    def placed(self, at: int, state: FloatArray) -> Self:
        """Return it with the object in a state (4,) that was measured at a sample, later than all frames."""
        return self._replace(beliefs=(self.last.placed(at, state),), doubted=())

    def knowing(self, kinetic: float, spread: float) -> Self:
        """Return it with a kinetic friction found elsewhere; see `Belief.knowing`."""
        return self._replace(beliefs=(*self.beliefs[:-1], self.last.knowing(kinetic, spread)))

    def see(self, frame: Frame, past: Past, acceleration: float) -> tuple[Self, Verdict]:
        """Take in a frame, and return what became of it.

        Args:
            frame: the object seen.
            past: what the pan did.
            acceleration: the largest of the pan (m/s^2).
        """
        known = [belief.frame.at for belief in self.beliefs]
        seen = {*known, *(doubt.at for doubt in self.doubted)}
        if frame.at in seen or not max(known[0], past.begin) < frame.at <= past.end:
            return self, Verdict.IGNORED
        if frame.at > max(seen):
            return self._next(frame, past, acceleration)
        later = [belief.frame for belief in self.beliefs if belief.frame.at > frame.at] + list(self.doubted)
        first = self._replace(beliefs=tuple(each for each in self.beliefs if each.frame.at < frame.at), doubted=())
        watch, verdict = first._next(frame, past, acceleration)
        for each in sorted(later):
            watch, _ = watch._next(each, past, acceleration)
        return watch, verdict

    def now(self, past: Past) -> FloatArray:
        """Return (n + 1, 4) the object's states from the last frame that was believed up to the end of the past."""
        last = self.last
        u = past.between(last.frame.at, past.end)
        return np.concatenate([last.state[None], slide_one(last.state, u, last.friction)])

    def carried(self, past: Past) -> Self:
        """Return it with the object moved along to now, if the past is about to forget its last frame."""
        if past.end - self.last.frame.at <= past.kept // 2:
            return self
        return self.placed(past.end, self.now(past)[-1])

    def _next(self, frame: Frame, past: Past, acceleration: float) -> tuple[Self, Verdict]:
        """Take in a frame that is later than all others."""
        last = self.last
        u = past.between(last.frame.at, frame.at)
        expected = slide_one(last.state, u, last.friction)[:, :2]

        def off(seen: Frame) -> FloatArray:
            difference: FloatArray = seen.position - expected[seen.at - last.frame.at - 1]
            return difference

        verdict = Verdict.TAKEN
        if not self._possible(math.hypot(*off(frame)), len(u) * DT, acceleration):
            verdict = Verdict.DOUBTED
            for doubt in self.doubted:
                time = (frame.at - doubt.at) * DT
                apart = math.dist(off(frame), off(doubt)) - PUSHED_SPEED * time
                if time >= LASTING and self._possible(apart, time, acceleration):
                    verdict = Verdict.BELIEVED
        if verdict is Verdict.DOUBTED:
            return self._replace(doubted=(*self.doubted, frame)[-BELIEFS:]), verdict
        belief = last.see(frame, u, self.noise, pushed=verdict is Verdict.BELIEVED)
        return self._replace(beliefs=(*self.beliefs, belief)[-BELIEFS:], doubted=()), verdict

    def _possible(self, off: float, time: float, acceleration: float) -> bool:
        """Whether friction and a pan that accelerates otherwise than told explain so much of a difference (m)."""
        most = acceleration + self.last.friction.static * GRAVITY
        return off <= 0.5 * most * time * time + NOISES * self.noise
