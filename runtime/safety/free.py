"""Chunks that keep the limits by themselves, found in one go by numba: most of what the governor looks at.

What `runtime.safety.governor` does with such a chunk, by the same operations in the same order: the same states and the
same stop, to the last bit. Every other chunk is left to it.
"""

from __future__ import annotations

from collections.abc import Sequence

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


class Pans:
    """B pans as numbers, which are moved; each is given as a `Pan`, which is not.

    Attributes:
        limits: of each.
        bounds: (B, 6) them as numbers, and whether they are finite.
        states: (B, 9) position (m), velocity (m/s), acceleration of the sample before (m/s^2).
        brakes, ramps: (B, 3) braking accelerations (m/s^2) of their stops, and samples of the phases of these.
        free: (B,) whether the last chunk was; the stops of the others are in `held`.
        held: pans by their rows.
    """

    def __init__(self, pans: Sequence[Pan]) -> None:
        self.limits = [pan.limits for pan in pans]
        bounds = [
            (each.pan_reach, each.height, each.speed, each.acceleration, each.jerk, each.finite) for each in self.limits
        ]
        self.bounds = np.array(bounds, dtype=np.float64)
        self.states = np.array([pan.state for pan in pans])
        self.brakes, self.ramps = np.empty((len(pans), 3)), np.empty((len(pans), 3), dtype=np.int64)
        self.free = np.zeros(len(pans), dtype=np.bool_)
        self.held = dict(enumerate(pans))

    def __len__(self) -> int:
        return len(self.limits)

    def __getitem__(self, row: int) -> Pan:
        if row in self.held:
            return self.held[row]
        state = PanState(*self.states[row].tolist())
        brake = Brake(state[6:], tuple(self.brakes[row].tolist()), *self.ramps[row].tolist())
        return Pan(state, brake, self.limits[row])


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
        self.find(Pans([Pan.at_start(Start(), Limits())]), np.zeros((1, 2, 3)))  # compiles

    def find(self, pans: Pans, u: FloatArray) -> tuple[int, FloatArray]:
        """Look at chunks (B, C, 3) that are asked for (m/s^2), and take the pans along those that are free.

        Returns:
            How many are not free, and (B, C, 6) where the others lead: position (m) and velocity (m/s).
        """
        u, states = np.ascontiguousarray(u, dtype=np.float64), np.empty((*u.shape[:2], 6))
        return self._keep(u, pans.bounds, pans.states, pans.brakes, pans.ramps, pans.free, states), states


def keep_limits(
    u: FloatArray,
    bounds: FloatArray,
    pans: FloatArray,
    brakes: FloatArray,
    ramps: NDArray[np.int64],
    free: NDArray[np.bool_],
    states: FloatArray,
) -> int:
    """Find which chunks keep the limits by themselves, and take their pans along them, to be compiled.

    Args:
        u: (B, C, 3) accelerations that are asked for (m/s^2).
        bounds, pans, brakes, ramps, free: the arrays of `Pans`; where a chunk is not free, only that is noted.
        states: (B, C, 6) filled with pan position (m) and velocity (m/s) after each sample of those that are free.

    Returns:
        How many are not free.
    """
    others = len(u)
    for row in range(len(u)):
        free[row] = False
        reach, height, speed, acceleration, jerk, finite = bounds[row]
        if finite == 0.0:
            continue
        step = jerk * DT
        lx, ly, lz = pans[row, 6], pans[row, 7], pans[row, 8]
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
            p, v = pans[row, axis], pans[row, 3 + axis]
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
            others -= 1
            free[row] = True
            for k in range(6):
                pans[row, k] = states[row, -1, k]
            pans[row, 6], pans[row, 7], pans[row, 8] = lx, ly, lz
            w = brake.w
            brakes[row, 0], brakes[row, 1], brakes[row, 2] = w[0], w[1], w[2]
            ramps[row, 0], ramps[row, 1], ramps[row, 2] = brake.ramp_in, brake.hold, brake.ramp_out
    return others


KEEP_LIMITS = (size, strongest, with_ramps, change, quickest, phase, squared_extent, keep_limits)
"""`keep_limits`, after what it is made of, to be compiled."""
