"""The planner: decodes a command into pan accelerations, in closed loop with the law of friction (Section II-C)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from runtime.bundle import TRAINED_ON, Bundle, DecoderState, Float32Array, Manifest
from runtime.command import Command
from runtime.documents import FloatArray
from runtime.errors import BundleError, InputError
from runtime.friction import BATCHED_FROM, Friction, integrate_pan, rollout, rollout_batch
from runtime.plan import Plan, assess

DEFAULT_BUNDLE = Path(__file__).parent / "models" / "default"
"""The bundle that is shipped."""


class Planner:
    """Plans with one bundle; may be used from several threads.

    Args:
        path: the bundle's folder; the shipped one if None.

    Attributes:
        bundle: the loaded bundle.

    Raises:
        BundleError: the bundle cannot be trusted or understood.
    """

    def __init__(self, path: str | PathLike[str] | None = None) -> None:
        self.bundle = Bundle.load(DEFAULT_BUNDLE if path is None else path)
        self.plan(np.zeros((2 * self.bundle.manifest.chunk, 2)))  # warms up: the first plan is as fast as the tenth

    def plan(self, position: Command | ArrayLike, friction: Friction | None = None) -> Plan:
        """Plan the pan's motion for one command.

        Args:
            position: a Command, or (K, 2) positions of the object relative to the pan (m) at 1 kHz.
            friction: coefficients; the manifest's if None.

        Returns:
            The plan, K rows, by the time line of `runtime.plan`.

        Raises:
            InputError: the command or the friction is not usable.
            BundleError: the network gave a value that is no finite number.
        """
        return self._decode([_command(position)], [self._friction(friction)])[0]

    def plan_batch(
        self, positions: Iterable[Command | ArrayLike], friction: Friction | Sequence[Friction] | None = None
    ) -> list[Plan]:
        """Plan for many commands at once: those with equally many chunks share the network's batch axis.

        Args:
            positions: commands or position arrays, as for `plan`; lengths may differ.
            friction: coefficients for all, or one for each; the manifest's if None.

        Returns:
            The plans, in the order of the commands.

        Raises:
            InputError: a command or a friction is not usable; the command is named by its index.
            BundleError: the network gave a value that is no finite number.
        """
        commands = []
        for index, position in enumerate(positions):
            try:
                commands.append(_command(position))
            except InputError as error:
                raise InputError(f"command {index}: {error}") from error
        if isinstance(friction, Sequence):
            frictions = [self._friction(each) for each in friction]
        else:
            frictions = [self._friction(friction)] * len(commands)
        if len(frictions) != len(commands):
            raise InputError(f"friction must be one for all or one for each: {len(frictions)} for {len(commands)}")
        groups: dict[int, list[int]] = defaultdict(list)
        for index, command in enumerate(commands):
            groups[_chunk_count(command, self.bundle.manifest)].append(index)
        plans: dict[int, Plan] = {}
        for indices in groups.values():
            made = self._decode([commands[index] for index in indices], [frictions[index] for index in indices])
            plans.update(zip(indices, made, strict=True))
        return [plans[index] for index in range(len(commands))]

    def stream(self, position: Command | ArrayLike) -> Stream:
        """Start to follow a command with a controller that measures; see `Stream`.

        Raises:
            InputError: the command is not usable.
        """
        return Stream(self.bundle, _command(position))

    def _friction(self, friction: Friction | None) -> Friction:
        if friction is not None and not isinstance(friction, Friction):
            raise InputError(f"friction must be a Friction, got {friction!r}")
        return self.bundle.manifest.friction if friction is None else friction

    def _decode(self, commands: Sequence[Command], frictions: Sequence[Friction]) -> list[Plan]:
        """Decode B commands of equally many chunks, in closed loop with the law.

        The encoder reads the commands. Then, chunk by chunk, the decoder sees the C states its last C accelerations
        led to (before the first: the start state C times) and gives the next C accelerations, which move the pan and,
        by the law of friction, the object. The network is float32, what moves is float64.
        """
        chunk = self.bundle.manifest.chunk
        count = _chunk_count(commands[0], self.bundle.manifest)
        ahead = np.stack([_command_chunks(command, self.bundle.manifest) for command in commands])
        start = np.zeros((len(commands), 4))
        start[:, :2] = [command.position[0] for command in commands]
        origin = start[:, None]
        pan = np.zeros((len(commands), chunk, 4))
        sliding = np.repeat(origin, chunk, axis=1)
        accelerations, pans, slidings = [], [pan[:, :1]], [origin]

        memory = self.bundle.encode(ahead[:, :count])
        for n in range(count):
            u, memory = _decode_step(self.bundle, pan, sliding - origin, ahead, n, memory)
            pan = integrate_pan(pan[:, -1], u)
            sliding = _slide(sliding[:, -1], u, frictions)
            accelerations.append(u)
            pans.append(pan)
            slidings.append(sliding)

        batch = zip(
            commands,
            frictions,
            np.concatenate(accelerations, axis=1),
            np.concatenate(pans, axis=1),
            np.concatenate(slidings, axis=1),
            strict=True,
        )
        return [self._plan(*one) for one in batch]

    def _plan(self, command: Command, friction: Friction, u: FloatArray, pan: FloatArray, sliding: FloatArray) -> Plan:
        """Cut what was decoded back to the command's K samples and judge it."""
        manifest, samples = self.bundle.manifest, len(command)
        motion = {
            "command_position": command.position,
            "pan_acceleration": u[:samples],
            "pan_position": pan[:samples, :2],
            "object_velocity": sliding[:samples, 2:],
            "object_position": sliding[:samples, :2],
        }
        # Copies, so that a plan does not keep the whole batch alive that it was made in.
        motion = {name: array.copy() for name, array in motion.items()}
        found = {
            "static": friction.static,
            "kinetic": friction.kinetic,
            "reach": command.reach,
            "speed": command.speed,
            "samples": samples,
        }
        quality = assess(
            **motion,
            dt=manifest.dt,
            limits={"pan_reach": manifest.pan_limit, "acceleration": manifest.acceleration_bound},
            found={name: (value, TRAINED_ON[name]) for name, value in found.items()},
            trained_on=manifest.trained_on,
        )
        return Plan(
            dt=manifest.dt,
            model_name=manifest.name,
            model_sha256=self.bundle.sha256,
            friction=friction,
            quality=quality,
            pan_velocity=pan[:samples, 2:].copy(),
            **motion,
        )


class Stream:
    """One command followed chunk by chunk by a controller that measures where pan and object are.

    Past the end of the command the object is held at its last position. A stream belongs to one controller: unlike
    the planner it must not be used from two threads at once.

    Args:
        bundle: the network.
        command: where the object should be.
    """

    def __init__(self, bundle: Bundle, command: Command) -> None:
        self._bundle = bundle
        self._start = np.concatenate([command.position[0], (0.0, 0.0)])
        self._ahead = _command_chunks(command, bundle.manifest)[None]
        self._memory = bundle.encode(self._ahead[:, : _chunk_count(command, bundle.manifest)])
        self._iteration = 0

    def step(self, pan_state: object, object_state: object) -> FloatArray:
        """Give the pan accelerations for the next C samples.

        Args:
            pan_state: (C, 4) the last C measured pan positions (m), relative to where the pan began, and velocities
                (m/s) in the world; before the first step, the start state C times.
            object_state: (C, 4) the last C measured object positions (m) and velocities (m/s) relative to the pan;
                before the first step, the start state C times.

        Returns:
            (C, 2) pan accelerations (m/s^2), the first to act at once.

        Raises:
            InputError: another shape, or a value that is no finite number.
            BundleError: the network gave a value that is no finite number.
        """
        chunk = self._bundle.manifest.chunk
        pan = _states(pan_state, "pan_state", chunk)
        sliding = _states(object_state, "object_state", chunk) - self._start
        u, self._memory = _decode_step(
            self._bundle, pan[None], sliding[None], self._ahead, self._iteration, self._memory
        )
        self._iteration += 1
        acceleration: FloatArray = u[0]
        return acceleration


def _decode_step(
    bundle: Bundle, pan: FloatArray, sliding: FloatArray, ahead: Float32Array, n: int, memory: DecoderState
) -> tuple[FloatArray, DecoderState]:
    """Run decoder iteration n.

    Args:
        bundle: the network.
        pan: (B, C, 4) pan states relative to where the pan began (m, m/s).
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


def _slide(state: FloatArray, u: FloatArray, frictions: Sequence[Friction]) -> FloatArray:
    """Slide B objects, each under its friction: (B, 4), (B, C, 2) -> (B, C, 4)."""
    if len(state) < BATCHED_FROM:
        return np.stack([rollout(*one) for one in zip(state, u, frictions, strict=True)])
    static = np.array([friction.static for friction in frictions])
    kinetic = np.array([friction.kinetic for friction in frictions])
    return rollout_batch(state, u, static, kinetic)


def _chunk_count(command: Command, manifest: Manifest) -> int:
    """Return the number of chunks the command fills, the last one maybe in part."""
    return -(-len(command) // manifest.chunk)


def _command_chunks(command: Command, manifest: Manifest) -> Float32Array:
    """Lay a command out as the network reads it.

    Returns:
        (chunks, 4C) rows x, y, vx, vy relative to the first position; `command_ahead` chunks more than the command
        fills, at least one of them if the decoder sees any. Past its end the command is held at rest.
    """
    samples = len(command)
    rows = np.zeros(((_chunk_count(command, manifest) + manifest.command_ahead) * manifest.chunk, 4))
    rows[:samples, :2] = command.position
    rows[:samples, 2:] = command.velocity
    rows[samples:, :2] = command.position[-1]
    rows[:, :2] -= command.position[0]
    return rows.astype(np.float32).reshape(-1, 4 * manifest.chunk)


def _command(position: Command | ArrayLike) -> Command:
    return position if isinstance(position, Command) else Command.from_samples(position)


def _states(value: object, name: str, chunk: int) -> FloatArray:
    """Check measured states.

    Raises:
        InputError: not (C, 4) finite numbers.
    """
    try:
        states: FloatArray = np.asarray(value)
    except ValueError as error:  # ragged
        raise InputError(f"{name} must be ({chunk}, 4) numbers: {error}") from error
    if states.dtype.kind not in "fiu" or states.shape != (chunk, 4):
        raise InputError(f"{name} must be ({chunk}, 4) numbers, got {states.dtype} of the shape {states.shape}")
    for row, axis in np.argwhere(~np.isfinite(states)):
        raise InputError(f"{name}[{row}, {axis}]: {states[row, axis]} is not a finite number")
    return states.astype(np.float64, copy=False)
