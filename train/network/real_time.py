"""The network at work: commands, limits and the law in SI at 1 kHz, the network in its own units and time.

A chunk of the network's time lasts as long as the pan's limits make it. It is executed for a whole number of
milliseconds, and then the decoder is asked again: what it sees, it sees at its own instants, interpolated between the
milliseconds, and its accelerations come back as a line through the middles of its samples. So the jerk of a pan that
is slower than the usual one stays what it was in the network's units.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from runtime.command import command_velocity
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.network.units import AHEAD, CHUNK, ENCODER_CHUNK, UNREAD, WINDOW, Situation, Units
from runtime.physics.law import DT, GRAVITY, slide_step_batch
from train.network.network import Network, Told, observe


class PanLimits(NamedTuple):
    """What a pan keeps to, in SI: reach in the plane, height above and below the start, 0 for a level pan."""

    reach: float
    acceleration: float
    jerk: float
    speed: float = np.inf
    height: float = 0.0


class Followed(NamedTuple):
    """What B pans did, in SI; row k is the instant after sample k.

    Attributes:
        acceleration: (B, K, 3) of the pans.
        pan: (B, K, 6) position and velocity.
        sliding: (B, K, 4) object position and velocity, relative to the pan.
    """

    acceleration: FloatArray
    pan: FloatArray
    sliding: FloatArray


@torch.no_grad()
def follow(
    network: Network,
    position: FloatArray,
    limits: PanLimits,
    friction: Friction,
    told: Friction | None,
    reach_used: float = 1.0,
    executed: float = 1.0,
) -> Followed:
    """Follow B commands from rest in closed loop, with acceleration, jerk and speed held at every sample.

    Reach and height are the network's own affair: nothing here holds them.

    Args:
        network: the network.
        position: (B, K, 2) commands (m).
        limits: of every pan.
        friction: of every object.
        told: the friction that the network is told; None if it is told none.
        reach_used: share of the reach that the network is told. With less it plans finer and shorter motions.
        executed: share of a chunk that is executed before the decoder is asked again.
    """
    count, samples, _ = position.shape
    ones = np.ones(count)
    units = Units.of(reach_used * limits.reach * ones, limits.acceleration * ones, limits.jerk * ones)
    length, step, velocity, acceleration = (
        float(part[0]) for part in (units.length, units.time, units.velocity, units.acceleration)
    )
    friction_told = told or friction
    told_by = Told.of(
        Situation.of(
            units,
            limits.jerk * ones,
            limits.speed * ones,
            limits.height * ones,
            friction_told.static * ones,
            friction_told.kinetic * ones,
            (told is not None) * ones,
        )
    )
    scale = np.array([length] * 3 + [velocity] * 3 + [length] * 2 + [velocity] * 2)
    speeds = np.stack([command_velocity(each, DT) for each in position])
    command = np.concatenate([position / length, speeds / velocity], axis=2)
    rest = np.concatenate([command[:, -1:, :2], 0.0 * command[:, -1:, 2:]], axis=2)
    command = np.concatenate([command, rest, rest], axis=1)

    past = np.zeros((count, int(CHUNK * step) + 3, 10))
    past[..., 6:8] = position[:, :1]
    last = np.zeros((count, 3))
    asked_each = max(1, round(executed * CHUNK * step))
    moved, accelerations = [], []
    now, next_read, elapsed = 0, 0, 1.0
    state = None
    while now < samples:
        if state is None or now >= next_read:
            left = -(-(samples - now) // (ENCODER_CHUNK * step))
            window = _at(command, now + step * np.arange(ENCODER_CHUNK * int(max(1, min(WINDOW, left)))))
            window[..., :2] -= window[:, :1, :2].copy()
            state = network.encode(torch.from_numpy(window), told_by)
            next_read = samples if left <= WINDOW else now + int((WINDOW - UNREAD) * ENCODER_CHUNK * step)
        seen = _at(past, past.shape[1] - 1 - step * np.arange(CHUNK - 1, -1, -1)) / scale
        ahead = _at(command, now + step * np.arange(AHEAD))
        tensors = [torch.from_numpy(part) for part in (seen, ahead, last / acceleration)]
        observation = observe(tensors[0], tensors[1], tensors[2], told_by, elapsed)
        answer, state = network.step(observation, told_by, state)
        u = to_milliseconds(answer.numpy() * acceleration, last, step, min(asked_each, samples - now))
        new = np.empty((count, u.shape[1], 10))
        for k in range(u.shape[1]):
            last = _hold(u[:, k], last, past[:, -1, 3:6] if k == 0 else new[:, k - 1, 3:6], limits)
            new[:, k] = _move(past[:, -1] if k == 0 else new[:, k - 1], last, friction)
            accelerations.append(last)
        past = np.concatenate([past, new], axis=1)[:, -past.shape[1] :]
        moved.append(new)
        now, elapsed = now + u.shape[1], min(1.0, u.shape[1] / step / CHUNK)
    states = np.concatenate(moved, axis=1)
    return Followed(np.stack(accelerations, axis=1), states[..., :6], states[..., 6:])


def to_milliseconds(answer: FloatArray, last: FloatArray, step: float, count: int) -> FloatArray:
    """Return the accelerations of `count` milliseconds.

    Of a network's sample that is longer than a millisecond, they are on the line through the middles of the samples; of
    a shorter one, the means over each millisecond.

    Args:
        answer: (B, n, 3) accelerations, one each `step` milliseconds.
        last: (B, 3) acceleration of the millisecond before.
        step: duration of one of the network's samples (ms).
        count: number of milliseconds; the last acceleration is held beyond the samples' end.

    Returns:
        (B, count, 3).
    """
    if step >= 1.0:
        middles = np.concatenate([[-0.5], step * (np.arange(answer.shape[1]) + 0.5)])
        line = np.concatenate([last[:, None], answer], axis=1)
        return _at(line, np.interp(np.arange(count) + 0.5, middles, np.arange(len(middles))))
    until = np.concatenate([np.zeros_like(last)[:, None], step * np.cumsum(answer, axis=1)], axis=1)
    ends = np.arange(count + 1) / step
    held = np.maximum(ends - answer.shape[1], 0.0)[:, None] * step * answer[:, -1:]
    return np.diff(_at(until, ends) + held, axis=1)


def _hold(wanted: FloatArray, last: FloatArray, velocity: FloatArray, limits: PanLimits) -> FloatArray:
    """Return accelerations (B, 3) within jerk, acceleration and speed; a level pan's have no third part."""
    wanted = wanted * ([1.0, 1.0, 1.0] if limits.height > 0.0 else [1.0, 1.0, 0.0])
    u = last + _shorten(wanted - last, limits.jerk * DT)
    u = _shorten(u, limits.acceleration)
    held: FloatArray = (_shorten(velocity + u * DT, limits.speed) - velocity) / DT
    return held


def _shorten(vectors: FloatArray, longest: float) -> FloatArray:
    sizes = np.linalg.norm(vectors, axis=1, keepdims=True)
    shortened: FloatArray = vectors * np.minimum(1.0, longest / np.maximum(sizes, 1e-12))
    return shortened


def _move(states: FloatArray, u: FloatArray, friction: Friction) -> FloatArray:
    """Move B pans and objects, (B, 10), by one sample."""
    normal = GRAVITY + u[:, 2]
    law = (friction.static * normal, friction.kinetic * normal, DT)
    p, v = slide_step_batch(states[:, 6:8].T, states[:, 8:].T, u[:, :2].T, *law)
    position = states[:, :3] + states[:, 3:6] * DT + u * (0.5 * DT * DT)
    return np.concatenate([position, states[:, 3:6] + u * DT, p.T, v.T], axis=1)


def _at(rows: FloatArray, t: NDArray[np.floating[Any]]) -> FloatArray:
    """Return (B, n, d) rows at fractional indices t, (B, len(t), d), by straight lines; the ends are held."""
    t = np.clip(t, 0.0, rows.shape[1] - 1)
    before = np.minimum(t.astype(int), rows.shape[1] - 2)
    share = (t - before)[:, None]
    between: FloatArray = rows[:, before] * (1.0 - share) + rows[:, before + 1] * share
    return between
