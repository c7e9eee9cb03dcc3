"""Chunks that keep the limits by themselves, found in one go by numba: most of what the governor looks at.

What `runtime.safety.governor` does with such a chunk, by the same operations in the same order: the same states and the
same stop, to the last bit. Every other chunk is left to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self, overload

import numpy as np
from numpy.typing import NDArray

from runtime.documents.checks import FloatArray
from runtime.limits import LARGEST_SINK, Limits
from runtime.physics.compiled import Compiler, compile_together
from runtime.physics.law import DT
from runtime.safety.pan import Pan
from runtime.safety.stop import (
    Brake,
    PanState,
    change,
    phase,
    quickest,
    size,
    squared_extent,
    strongest,
    with_ramps,
)
from runtime.start import Start


class Free(NamedTuple):
    """What became of B chunks.

    Attributes:
        rows: (B,) whether each keeps the limits by itself; of the others, what follows says nothing.
        states: (B, C, 6) pan position (m) and velocity (m/s) after each sample.
        brakes: (B, 3) braking accelerations (m/s^2) of the stops from their ends.
        ramps: (B, 3) samples of the stops' phases.
    """

    rows: NDArray[np.bool_]
    states: FloatArray
    brakes: FloatArray
    ramps: NDArray[np.int64]

    @classmethod
    def of(cls, count: int, samples: int) -> Self:
        """Return room for so many chunks of so many samples."""
        rows, ramps = np.zeros(count, dtype=np.bool_), np.empty((count, 3), dtype=np.int64)
        return cls(rows, np.empty((count, samples, 6)), np.empty((count, 3)), ramps)


class Pans(Sequence[Pan]):
    """B pans as numbers; each becomes a `Pan` when it is asked for.

    Attributes:
        limits: of each.
        bounds: (B, 6) them as numbers, and whether they are finite.
        states: (B, 9) position (m), velocity (m/s), acceleration of the sample before (m/s^2).
        stops: (B, 3) braking accelerations (m/s^2) of their stops, and (B, 3) samples of the phases of these.
        others: those that are no numbers, by their rows.
    """

    def __init__(
        self,
        limits: Sequence[Limits],
        bounds: FloatArray,
        states: FloatArray,
        stops: tuple[FloatArray, NDArray[np.int64]],
        others: Mapping[int, Pan],
    ) -> None:
        self.limits, self.bounds, self.states, self.stops, self.others = limits, bounds, states, stops, others

    @classmethod
    def of(cls, pans: Sequence[Pan]) -> Pans:
        """Return pans with their numbers."""
        if isinstance(pans, Pans):
            return pans
        limits = [pan.limits for pan in pans]
        bounds = [
            (each.pan_reach, each.height, each.speed, each.acceleration, each.jerk, each.finite) for each in limits
        ]
        none = np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
        states = np.array([pan.state for pan in pans])
        return cls(limits, np.array(bounds, dtype=np.float64), states, none, dict(enumerate(pans)))

    def after(self, u: FloatArray, free: Free, others: Mapping[int, Pan]) -> Pans:
        """Return the pans after a chunk (B, C, 3): of those that are free, and the others by their rows."""
        states = np.concatenate([free.states[:, -1], u[:, -1]], axis=1)
        return Pans(self.limits, self.bounds, states, (free.brakes, free.ramps), others)

    def __len__(self) -> int:
        return len(self.limits)

    @overload
    def __getitem__(self, index: int) -> Pan: ...
    @overload
    def __getitem__(self, index: slice) -> list[Pan]: ...
    def __getitem__(self, index: int | slice) -> Pan | list[Pan]:
        if isinstance(index, slice):
            return [self[row] for row in range(len(self))[index]]
        row = range(len(self))[index]
        if row in self.others:
            return self.others[row]
        state = PanState(*self.states[row].tolist())
        brakes, ramps = self.stops
        brake = Brake(state[6:], tuple(brakes[row].tolist()), *ramps[row].tolist())
        return Pan(state, brake, self.limits[row])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    __hash__ = None  # type: ignore[assignment]  # as a list


class FreeChunks:
    """Finds them.

    Args:
        compile_one: compiles a function.

    Attributes:
        functions: what it is made of, compiled, by name.
    """

    def __init__(self, compile_one: Compiler) -> None:
        self.functions = compile_together(KEEP_LIMITS, compile_one)
        self._keep = self.functions["keep_limits"]
        self.find(Pans.of([Pan.at_start(Start(), Limits())]), np.zeros((1, 2, 3)))  # compiles

    def find(self, pans: Pans, u: FloatArray) -> Free:
        """Look at the chunks of B pans, (B, C, 3) accelerations that are asked for (m/s^2)."""
        free = Free.of(*u.shape[:2])
        self._keep(pans.states, np.ascontiguousarray(u, dtype=np.float64), pans.bounds, *free)
        return free


def keep_limits(
    before: FloatArray,
    u: FloatArray,
    bounds: FloatArray,
    rows: NDArray[np.bool_],
    states: FloatArray,
    brakes: FloatArray,
    ramps: NDArray[np.int64],
) -> None:
    """Fill what `Free` has, to be compiled; `bounds` (B, 6) are the limits, and whether there are any."""
    for row in range(len(u)):
        reach, height, speed, acceleration, jerk, finite = bounds[row]
        if finite == 0.0:
            continue
        step = jerk * DT
        lx, ly, lz = before[row, 6], before[row, 7], before[row, 8]
        good = True
        for k in range(u.shape[1]):
            x, y, z = u[row, k, 0], u[row, k, 1], u[row, k, 2]
            dx, dy, dz = x - lx, y - ly, z - lz
            if (
                x * x + y * y + z * z > acceleration * acceleration
                or dx * dx + dy * dy + dz * dz > step * step
                or z < -LARGEST_SINK
                or (height == 0.0 and z != 0.0)
            ):
                good = False
                break
            lx, ly, lz = x, y, z
        if not good:
            continue
        farthest = highest = fastest = 0.0
        for axis in range(3):
            p, v = before[row, axis], before[row, 3 + axis]
            pushed = moved = 0.0
            for k in range(u.shape[1]):
                a = u[row, k, axis]
                pushed += a
                velocity = v + pushed * DT
                moved += (velocity - a * DT) * DT + a * (0.5 * DT * DT)
                states[row, k, axis] = p + moved
                states[row, k, 3 + axis] = velocity
        for k in range(u.shape[1]):
            x, y, z = states[row, k, 0], states[row, k, 1], states[row, k, 2]
            vx, vy, vz = states[row, k, 3], states[row, k, 4], states[row, k, 5]
            farthest = max(farthest, x * x + y * y)
            highest = max(highest, abs(z))
            fastest = max(fastest, vx * vx + vy * vy + vz * vz)
        if np.sqrt(farthest) > reach or highest > height or fastest > speed * speed:
            continue
        end = PanState(
            states[row, -1, 0], states[row, -1, 1], states[row, -1, 2],
            states[row, -1, 3], states[row, -1, 4], states[row, -1, 5], lx, ly, lz,
        )  # fmt: skip
        brake = quickest(end, step, strongest(end, acceleration, jerk))
        reached, up, fast = squared_extent(end, brake)
        if np.sqrt(reached) <= reach and up <= height and np.sqrt(fast) <= speed:
            rows[row] = True
            w = brake.w
            brakes[row, 0], brakes[row, 1], brakes[row, 2] = w[0], w[1], w[2]
            ramps[row, 0], ramps[row, 1], ramps[row, 2] = brake.ramp_in, brake.hold, brake.ramp_out


KEEP_LIMITS = (size, strongest, with_ramps, change, quickest, phase, squared_extent, keep_limits)
"""`keep_limits`, after what it is made of, to be compiled."""
