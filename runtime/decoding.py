"""The decode loop: a command becomes pan accelerations, in closed loop with governor and law (Section II-C)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from runtime.bundle import Bundle, DecoderState, Float32Array, Manifest
from runtime.command import Command
from runtime.documents import FloatArray
from runtime.errors import BundleError, InputError
from runtime.friction import Friction, one_by_one, rollout, rollout_batch
from runtime.governor import Motion, govern
from runtime.limits import RESTING, Limits, PanState, find_brake, stop_reach
from runtime.start import Start

WINDOW: int | None = None
"""Chunks that are read at once; None for as many as the longest command trained on had."""

UNREAD = 7
"""Chunks at the end of a window that are read and planned again with the next: where a command goes on, the network
must not think it ends. Which number is best depends on the commands; 7 was never far from it."""


class Job(NamedTuple):
    """One command to be planned: where the object should be, on what, within what, and from where."""

    command: Command
    friction: Friction
    limits: Limits
    start: Start


class Decoded(NamedTuple):
    """What B commands of n chunks became; rows as in `runtime.plan`, and past the end of a command.

    Attributes:
        acceleration: (B, nC, 2) of the pan (m/s^2).
        asked: (B, nC, 2) what the network asked for (m/s^2).
        pan: (B, nC + 1, 4) pan position (m) and velocity (m/s).
        sliding: (B, nC + 1, 4) object position (m) and velocity (m/s), relative to the pan.
    """

    acceleration: FloatArray
    asked: FloatArray
    pan: FloatArray
    sliding: FloatArray

    def one(self, index: int) -> Decoded:
        """Return what one command became, without the axis B."""
        return Decoded(*(part[index] for part in self))


def decode(bundle: Bundle, jobs: Sequence[Job]) -> Decoded:
    """Decode B commands of equally many chunks.

    The encoder reads a window of the commands, all of it unless they are long. Then, chunk by chunk, the decoder
    sees the C states its last C accelerations led to and asks for the next C accelerations; the governor makes them
    keep the limits, and they move the pan and, by the law of friction, the object. The network is float32, what
    moves is float64.

    Raises:
        InputError: a pan cannot come to rest in its reach from its start.
        BundleError: an acceleration is no finite number.
    """
    commands, frictions = [job.command for job in jobs], [job.friction for job in jobs]
    motions = [begin(job.start, job.limits) for job in jobs]
    pan = np.stack([job.start.pan_state() for job in jobs])[:, None]
    sliding = np.stack([job.start.object_state(job.command.position[0]) for job in jobs])[:, None]
    accelerations, askeds, pans, slidings = [], [], [pan], [sliding]
    pan, sliding = (history(state, bundle.manifest) for state in (pan, sliding))

    count, last = chunk_count(commands[0], bundle.manifest), 0
    while last < count:
        first, (last, seen) = last, window(last, count, bundle.manifest)
        ahead = np.stack([command_chunks(command, bundle.manifest, first, seen) for command in commands])
        origin = origins(commands, first * bundle.manifest.chunk)
        memory = bundle.encode(ahead[:, : seen - first])
        for n in range(last - first):
            asked, memory = decode_step(bundle, pan, sliding - origin, ahead, n, memory)
            u, pan, motions = govern(motions, asked)
            sliding = slide(sliding[:, -1], u, frictions)
            accelerations.append(u)
            askeds.append(asked)
            pans.append(pan)
            slidings.append(sliding)
    return Decoded(*(np.concatenate(parts, axis=1) for parts in (accelerations, askeds, pans, slidings)))


def begin(start: Start, limits: Limits) -> Motion:
    """Return the pan at its start, with a stop from there.

    Raises:
        InputError: it is outside its limits already, or too fast to stop inside; the numbers are named.
    """
    state = PanState(*start.pan_position, *start.pan_velocity, *start.pan_acceleration)
    if not limits.finite:
        return Motion(state, RESTING, limits)
    size, distance, speed = math.hypot(state.ux, state.uy), math.hypot(*state[:2]), math.hypot(*state[2:4])
    if size > limits.acceleration:
        raise InputError(f"start: pan acceleration {size:.4g} m/s^2 exceeds the limit, {limits.acceleration:g} m/s^2")
    if distance > limits.pan_reach:
        raise InputError(f"start: the pan is {distance:.4g} m from its centre, its reach is {limits.pan_reach:g} m")
    shortest = 0.5 * speed * speed / limits.acceleration
    if shortest > 2.0 * limits.pan_reach:
        raise InputError(
            f"start: the pan is too fast to stop inside its reach: at {speed:.4g} m/s it needs {shortest:.4g} m within "
            f"{limits.acceleration:g} m/s^2, and its reach of {limits.pan_reach:g} m is {2 * limits.pan_reach:g} m wide"
        )
    brake = find_brake(state, limits)
    needed = stop_reach(state, brake)
    if needed > limits.pan_reach:
        raise InputError(
            f"start: the pan, {distance:.4g} m from its centre at {speed:.4g} m/s, cannot be sure to stop inside its "
            f"reach of {limits.pan_reach:g} m: within {limits.acceleration:g} m/s^2 and {limits.jerk:g} m/s^3 it may "
            f"need {needed:.4g} m"
        )
    return Motion(state, brake, limits)


def history(state: FloatArray, manifest: Manifest) -> FloatArray:
    """Return the states that the decoder sees first, (B, C, 4): the start, (B, 1, 4), C times."""
    return np.repeat(state, manifest.chunk, axis=1)


def window(first: int, count: int, manifest: Manifest) -> tuple[int, int]:
    """Return the chunk up to which a command of `count` chunks is planned at once from chunk `first`, and read.

    A command as long as those trained on, or shorter, is one window. Of a longer one the encoder reads as much, and
    the next window begins UNREAD chunks before the end of that, with the pan and the object where they are by then:
    the memory needed does not grow with the length, and the decoder never works past what it was trained for.
    """
    trained = int(manifest.trained_on["samples"][1]) // manifest.chunk
    most = max(UNREAD + 1, trained if WINDOW is None else WINDOW)
    seen = min(count, first + most)
    return (count if seen == count else seen - UNREAD), seen


def origins(commands: Sequence[Command], row: int) -> FloatArray:
    """Return (B, 1, 4) object states at rest on the commands' positions at a row."""
    states = np.zeros((len(commands), 1, 4))
    states[:, 0, :2] = [command.position[min(row, len(command) - 1)] for command in commands]
    return states


def decode_step(
    bundle: Bundle, pan: FloatArray, sliding: FloatArray, ahead: Float32Array, n: int, memory: DecoderState
) -> tuple[FloatArray, DecoderState]:
    """Run decoder iteration n.

    Args:
        bundle: the network.
        pan: (B, C, 4) pan states relative to the centre of the reach (m, m/s).
        sliding: (B, C, 4) object states relative to the pan and to the command's first position (m, m/s).
        ahead: (B, chunks, 4C) the command, held at rest in its last chunk.
        n: the iteration.
        memory: what the decoder carries.

    Returns:
        (B, C, 2) pan accelerations (m/s^2), and what the decoder carries on.

    Raises:
        BundleError: an acceleration is no finite number.
    """
    batch = len(pan)
    seen = np.arange(n, n + bundle.manifest.command_ahead)
    command = ahead[:, np.minimum(seen, ahead.shape[1] - 1)]
    states = np.concatenate([pan, sliding], axis=2)
    observation = np.concatenate([states.reshape(batch, -1), command.reshape(batch, -1)], axis=1)
    u, memory = bundle.decode_step(observation.astype(np.float32), memory)
    if not np.isfinite(u).all():
        raise BundleError(f"the network of bundle {bundle.manifest.name!r} gave no finite number in iteration {n}")
    return u.astype(np.float64), memory


def slide(state: FloatArray, u: FloatArray, frictions: Sequence[Friction]) -> FloatArray:
    """Slide B objects, each under its friction: (B, 4), (B, C, 2) -> (B, C, 4)."""
    if one_by_one(len(state)):
        return np.stack([rollout(*one) for one in zip(state, u, frictions, strict=True)])
    static = np.array([friction.static for friction in frictions])
    kinetic = np.array([friction.kinetic for friction in frictions])
    return rollout_batch(state, u, static, kinetic)


def chunk_count(command: Command, manifest: Manifest) -> int:
    """Return the number of chunks the command fills, the last one maybe in part."""
    return -(-len(command) // manifest.chunk)


def command_chunks(command: Command, manifest: Manifest, first: int, last: int) -> Float32Array:
    """Lay chunks `first` to `last` of a command out as the network reads them.

    Returns:
        (chunks, 4C) rows x, y, vx, vy relative to the first position of chunk `first`; `command_ahead` chunks more
        than asked for. Past its end the command is held at rest.
    """
    chunk = manifest.chunk
    part = slice(first * chunk, (last + manifest.command_ahead) * chunk)
    position, velocity = command.position[part], command.velocity[part]
    samples = len(position)
    origin = command.position[min(part.start, len(command) - 1)]
    rows = np.zeros((part.stop - part.start, 4), dtype=np.float32)
    rows[:samples, :2] = position - origin
    rows[:samples, 2:] = velocity
    rows[samples:, :2] = command.position[-1] - origin
    return rows.reshape(-1, 4 * chunk)
