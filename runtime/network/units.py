"""The network's own units, in which one pan is like another.

The law of friction has no units of its own: with lengths times L and times times T, velocities are times L/T and
accelerations, gravity among them, times L/T^2, and the law is the same, exactly. A pan with the reach R and the
acceleration limit A has one natural length, R, and one natural time, sqrt(R/A). The network lives in multiples of
these: in its units every pan has the reach REACH and the acceleration limit ACCELERATION, and a chunk of CHUNK samples
lasts 0.72 sqrt(R/A), from 17 ms to 320 ms. What differs from pan to pan is then told by a few pure numbers, the
*conditions*: gravity in these units, jerk, speed, height, and the friction if it is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.limits import WEIGHT_KEPT
from runtime.physics.law import GRAVITY

REACH = 0.2
"""Every pan's reach, in the network's units of length."""

ACCELERATION = 25.0
"""Every pan's largest acceleration, in the network's units."""

CHUNK = 64
"""Samples, of 1 ms in the network's units, that the decoder plans at once."""

ENCODER_CHUNK = 2 * CHUNK
"""Samples that the encoder reads at once."""

ENCODER_ROWS = tuple(range(0, ENCODER_CHUNK, 8))
"""Samples of these that it sees, from the chunk's first."""

SEEN_ROWS = tuple(range(3, CHUNK, 4))
"""Samples of the last CHUNK states that the decoder sees; the last one is now."""

AHEAD = 4 * CHUNK
"""Samples of the command, from now on, that the decoder is given."""

AHEAD_ROWS = (*range(0, CHUNK, 4), *range(CHUNK, AHEAD, 8))
"""Samples of these that it sees."""

LEAST_JERK = 700.0
"""Smallest jerk, in the network's units, that the network is made for.

Under a smaller one the acceleration could not come to its limit within a chunk. The limit that counts is then smaller.
"""

LARGEST_JERK = 25_000.0
"""Jerk, in the network's units, from which there is as good as no limit: a sample takes the acceleration to its own."""

LARGEST_HEIGHT = 0.2
"""Height, in the network's units, beyond which the pan has no use for more."""

LARGEST_SPEED = 3.0
"""Speed, in the network's units, from which there is as good as no limit: to come to sqrt(2 REACH ACCELERATION) = 3.2
and to stop again takes all of the reach."""

FULL_LIFT = 0.02
"""Height, in the network's units, from which the upward acceleration counts in full; below it does in proportion."""

LEAST_FRICTION = 0.05
"""Coefficient that smaller ones are told as."""

USUAL_GRAVITY = 15.0
"""Gravity, in the network's units, whose logarithm is told as 0."""

CONDITIONS = 10
"""Number of the conditions."""


WINDOW = 12
"""Encoder chunks that are read at once: as many as the longest command trained on has."""

UNREAD = 4
"""Encoder chunks at the end of a window that are read and planned again with the next."""

OBSERVED = 10 * len(SEEN_ROWS) + 3 + 4 * len(AHEAD_ROWS) + CONDITIONS + 1
"""Width of what the decoder is given in one row.

16 rows of 10 of SEEN_ROWS: pan x, y, z, vx, vy, vz, object x, y, vx, vy, the object's position relative to where the
command is now; the last acceleration (3); 40 rows (x, y, vx, vy) of the command at AHEAD_ROWS, the position relative to
now's; the conditions; and the samples executed since the decoder was asked before, over CHUNK, 1 the first time.
"""

READ = 4 * len(ENCODER_ROWS) + CONDITIONS
"""Width of what the encoder is given of each of its chunks: rows (x, y, vx, vy) of the command at ENCODER_ROWS, the
position relative to where the window begins, and the conditions."""


@dataclass(frozen=True)
class Constants:
    """The numbers of this module, which a bundle's manifest repeats."""

    chunk: int = CHUNK
    encoder_chunk: int = ENCODER_CHUNK
    encoder_rows: tuple[int, ...] = ENCODER_ROWS
    seen_rows: tuple[int, ...] = SEEN_ROWS
    ahead_rows: tuple[int, ...] = AHEAD_ROWS
    window: int = WINDOW
    unread: int = UNREAD
    reach: float = REACH
    acceleration: float = ACCELERATION
    weight_kept: float = WEIGHT_KEPT
    least_jerk: float = LEAST_JERK
    largest_jerk: float = LARGEST_JERK
    largest_height: float = LARGEST_HEIGHT
    largest_speed: float = LARGEST_SPEED
    full_lift: float = FULL_LIFT
    least_friction: float = LEAST_FRICTION
    conditions: int = CONDITIONS


@dataclass(frozen=True)
class Units:
    """Factors from the network's units to SI: of a number, or of one for each of B pans, (B,).

    Attributes:
        length: metres a unit.
        time: seconds a unit; a sample of the network's time lasts that many milliseconds.
    """

    length: FloatArray
    time: FloatArray

    @property
    def velocity(self) -> FloatArray:
        """m/s a unit."""
        return self.length / self.time

    @property
    def acceleration(self) -> FloatArray:
        """m/s^2 a unit."""
        return self.length / self.time**2

    @property
    def jerk(self) -> FloatArray:
        """m/s^3 a unit."""
        return self.length / self.time**3

    @classmethod
    def of(cls, reach: FloatArray, acceleration: FloatArray, jerk: FloatArray) -> Units:
        """Return the units of pans with these limits (m, m/s^2, m/s^3).

        Under a jerk limit so low that the acceleration takes long to come to its own, it is a lower acceleration that
        counts: the one that LEAST_JERK belongs to.
        """
        reach = np.asarray(reach, dtype=np.float64)
        length = reach / REACH
        # jerk / (length / time^3) = LEAST_JERK with time = sqrt(reach / usable) / sqrt(REACH / ACCELERATION)
        natural = math.sqrt(REACH / ACCELERATION)
        usable = (np.asarray(jerk) * ACCELERATION * np.sqrt(reach) / (natural * LEAST_JERK)) ** (2.0 / 3.0)
        return cls(length, np.sqrt(reach / np.minimum(acceleration, usable)) / natural)


class Situation(NamedTuple):
    """B pans and their objects in the network's units, each (B,): what the conditions tell.

    Attributes:
        gravity: that of the earth.
        jerk, speed, height: the limits, no larger than LARGEST_JERK, LARGEST_SPEED and LARGEST_HEIGHT; height 0 is a
            level pan.
        static, kinetic: coefficients of friction.
        told: whether the network is told them.
    """

    gravity: FloatArray
    jerk: FloatArray
    speed: FloatArray
    height: FloatArray
    static: FloatArray
    kinetic: FloatArray
    told: FloatArray

    @classmethod
    def of(
        cls,
        units: Units,
        jerk: FloatArray,
        speed: FloatArray,
        height: FloatArray,
        static: FloatArray,
        kinetic: FloatArray,
        told: FloatArray,
    ) -> Situation:
        """Return the situation of pans with these limits, in SI; an infinite speed is none."""
        gravity = np.asarray(GRAVITY / units.acceleration)
        parts = (
            gravity,
            np.minimum(jerk / units.jerk, LARGEST_JERK),
            np.minimum(speed / units.velocity, LARGEST_SPEED),
            np.minimum(height / units.length, LARGEST_HEIGHT),
            static,
            kinetic,
            told,
        )
        return cls(*(np.asarray(part, dtype=np.float64) + np.zeros_like(gravity) for part in parts))

    @property
    def floor(self) -> FloatArray:
        """Largest downward acceleration (B,), which leaves WEIGHT_KEPT of the weight."""
        return (1.0 - WEIGHT_KEPT) * self.gravity

    @property
    def lift(self) -> FloatArray:
        """How much the upward acceleration counts (B,): 0 for a level pan, 1 from FULL_LIFT on."""
        return np.minimum(1.0, self.height / FULL_LIFT)

    def conditions(self) -> FloatArray:
        """Return what the network is told, (B, CONDITIONS), each number of the order of one."""
        static, kinetic = (np.maximum(mu, LEAST_FRICTION) for mu in (self.static, self.kinetic))
        weight = self.gravity / ACCELERATION
        return np.stack(
            [
                np.log(self.gravity / USUAL_GRAVITY),
                self.lift,
                self.height / 0.1,
                np.log(self.jerk / 5_000.0) / 1.5,
                self.speed / 2.0 - 1.0,
                self.told,
                self.told * np.log(static / 0.4),
                self.told * np.log(kinetic / 0.3),
                self.told * (2.0 * static * weight - 1.0),
                self.told * (2.0 * kinetic * weight - 0.6),
            ],
            axis=1,
        )
