"""A stream that is told one thing that is not so: how far from its centre the true pan comes."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.suite.families import spline
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.law import slide_one
from runtime.physics.pan import integrate_pan
from runtime.planner import Planner
from runtime.stream import Stream

LIMITS = Limits(0.05)
"""A reach that is easily left."""

FRICTION = Friction(1.0, 0.5)

CHUNKS, READINGS = 14, 3
"""Chunks that are followed, and readings in each."""

SIZES = (-3.0, 3.0)
"""Powers of ten between which the size of what is false lies (m, m/s, s)."""


def farthest(planner: Planner, seed: int) -> float:
    """Follow a command in a world without noise, with one false number among all that is told.

    It is one of the pan's state or of the object's position, or the age of either, at any reading and of any size. In
    half of the streams readings are told as they come, in the others with the step.

    Args:
        planner: what follows.
        seed: chooses.

    Returns:
        The largest distance of the true pan from its centre, over that of its limits.
    """
    rng = np.random.default_rng(seed)
    position = spline().positions[seed % len(spline())]
    stream = planner.stream(position[: CHUNKS * 100], FRICTION, limits=LIMITS)
    with_step, false_at = bool(rng.integers(2)), int(rng.integers(1, CHUNKS * READINGS))
    error = np.zeros(10)
    error[rng.integers(len(error))] = 10.0 ** rng.uniform(*SIZES) * rng.choice([-1.0, 1.0])
    pan, sliding = np.zeros(6), np.array([*position[0], 0.0, 0.0])
    reach, borders = 0.0, np.linspace(0, stream.chunk, READINGS + 1).astype(int)
    for chunk in range(CHUNKS):
        u = stream.step() if chunk == 0 or not with_step else _step(stream, pan, sliding, _of(error, chunk, false_at))
        for reading in range(READINGS):
            first, last = borders[reading : reading + 2].tolist()
            pans = integrate_pan(pan, u[first:last])
            pan, sliding = pans[-1], slide_one(sliding, u[first:last], FRICTION)[-1]
            reach = max(reach, float(np.hypot(pans[:, 0], pans[:, 1]).max()))
            if not with_step:
                false = error if chunk * READINGS + reading == false_at else np.zeros(10)
                stream.see_pan(pan + false[:6], float(false[6]), last)
                stream.see_object(sliding[:2] + false[7:9], float(false[9]), last)
    return reach / LIMITS.pan_reach


def _of(error: FloatArray, chunk: int, false_at: int) -> FloatArray:
    """Return what is false of the reading that is told with the step of a chunk."""
    return error if chunk == max(1, false_at // READINGS) else np.zeros(10)


def _step(stream: Stream, pan: FloatArray, sliding: FloatArray, false: FloatArray) -> FloatArray:
    seen = sliding.copy()
    seen[:2] += false[7:9]
    return stream.step(pan + false[:6], seen, pan_age=float(false[6]), object_age=float(false[9]))


def leaves(planner: Planner, seed: int) -> bool:
    """Whether the true pan leaves its reach."""
    return math.isnan(share := farthest(planner, seed)) or share > 1.0 + 1e-9
