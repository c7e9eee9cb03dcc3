"""A pan that shakes, and an object on it by the law: what cameras and encoders would see."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime import Friction
from runtime.observe.past import Past
from runtime.physics.law import slide_one
from runtime.physics.pan import integrate_pan

Array = NDArray[np.float64]


class World(NamedTuple):
    """What truly happens: accelerations (n, 2), pan and object states (n + 1, 4)."""

    u: Array
    pan: Array
    sliding: Array

    @classmethod
    def shaken(cls, friction: Friction, samples: int = 1200, seed: int = 0, strength: float = 12.0) -> World:
        """Shake a pan by smooth random accelerations."""
        rng = np.random.default_rng(seed)
        knots = rng.uniform(-strength, strength, (samples // 60 + 2, 2))
        knots[0] = 0.0
        at = np.arange(samples) / 60.0
        u = np.stack([np.interp(at, np.arange(len(knots)), knots[:, axis]) for axis in (0, 1)], axis=1)
        pan = np.concatenate([np.zeros((1, 4)), integrate_pan(np.zeros(4), u)])
        return cls(u, pan, np.concatenate([np.zeros((1, 4)), slide_one(np.zeros(4), u, friction)]))

    def past(self, until: int) -> Past:
        return Past.still(np.zeros(2), np.zeros(2)).then(self.u[:until])
