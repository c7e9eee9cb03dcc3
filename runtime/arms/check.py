"""What the joints come to along a chunk of a closed loop, quickly: a stream asks before it gives the chunk."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arms.description import HAND_LIMITS
from runtime.arms.fit import TORQUE_SHARE
from runtime.arms.model import ArmModel, pose_error
from runtime.arms.motion import HOMING
from runtime.arms.place import Place
from runtime.documents.checks import FloatArray
from runtime.physics.law import DT
from runtime.physics.pan import integrate_pan
from runtime.safety.stop import PanState

APART = 8
"""Samples from one posture that is solved for to the next; between them the Jacobian is on straight lines."""

CONVERGED = 1e-6
"""Error of the pan's pose with which a posture is left (m, rad)."""

CORRECTIONS = 8
"""Most Newton steps to a posture: two are the rule, and more mean that the arm does not reach it."""

UNREACHED = 10.0
"""What a motion counts as on which the arm does not follow: so many times what it may."""

EXACT = 0.998
"""Share of a limit that counts as all of it: what a motion comes to is known to a thousandth."""

SAME_TIME = 0.1
"""Time (s) that makes a distance of a difference of speeds, to tell which posture is nearest."""


class JointCheck:
    """Tells what an arm's joints come to along motions of its pan, each of which goes on from the one before.

    They are those of `runtime.arms.motion.follow` to a thousandth of their limits: few postures are solved for, and
    torques are looked at there alone. The joints go on from where they were, on the motion told last, when the pan was
    where it is now.

    Args:
        model: of the arm.
        place: where the pan begins.
    """

    def __init__(self, model: ArmModel, place: Place) -> None:
        self._model, self._place = model, place
        self._limits = {name: EXACT * model.arm.limit(name) for name in (*HAND_LIMITS, "torque")}
        self._limits["torque"] *= TORQUE_SHARE
        self._pan, self._postures = np.zeros((1, 6)), place.home[None]

    def __call__(self, state: PanState, acceleration: FloatArray) -> dict[str, float]:
        """Return how many times as much as it may a joint comes to, by what is less where the pan's is less.

        Torques count as acceleration.

        Args:
            state: of the pan, relative to where it began, along the axes of a plan.
            acceleration: (n, 3) that follow (m/s^2).
        """
        u, pan = _from_before(state, acceleration)
        rows = np.append(np.arange(0, len(u), APART), len(u))
        solved = self._solve(pan[rows], np.diff(rows) * DT)
        if solved is None:
            return {"acceleration": UNREACHED}
        postures, moves = solved
        self._pan, self._postures = pan[rows], postures

        attitude = self._place.rotation.T
        velocity, u = pan[:, 3:] @ attitude, u @ attitude
        changes = np.gradient(moves, rows * DT, axis=0)
        speeds = _along(moves, rows, np.arange(len(pan)), velocity, (velocity * velocity).sum(axis=1))
        middles = np.arange(len(u)) + 0.5
        between = velocity[:-1] + 0.5 * DT * u
        accelerations = _along(moves, rows, middles, u, 2.0 * (between * u).sum(axis=1))
        accelerations += _along(changes, rows, middles, between, (between * between).sum(axis=1))
        at = np.minimum(rows, len(u) - 1)
        torques = self._model.torque(postures, speeds[rows], accelerations[at])
        jerks = np.diff(accelerations, axis=0) / DT
        return {
            "speed": self._share("speed", speeds),
            "acceleration": max(self._share("acceleration", accelerations[1:]), self._share("torque", torques)),
            "jerk": self._share("jerk", jerks),
        }

    def _share(self, name: str, values: FloatArray) -> float:
        return float((np.abs(values) / self._limits[name]).max())

    def _solve(self, pan: FloatArray, times: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the joints at states of the pan (m, 6), and how they move; None where the arm does not follow.

        Args:
            pan: states, one after another.
            times: from each to the next (s).

        Returns:
            Postures (m, n), and (m, 4, n): the speeds of the joints are the pan's velocity in the world times the first
            three rows, and the square of its speed times the last.
        """
        model, place = self._model, self._place
        position = place.position + pan[:, :3] @ place.rotation.T
        velocity = pan[:, 3:] @ place.rotation.T
        away = self._pan - pan[0]
        away[:, 3:] *= SAME_TIME
        q = self._postures[(away * away).sum(axis=1).argmin()]
        postures, moves = np.empty((len(pan), len(q))), np.empty((len(pan), 4, len(q)))
        for row, target in enumerate(position):
            for _ in range(CORRECTIONS):
                at, rotation, jacobian = model.pan(q)
                error = pose_error(target, place.rotation, at, rotation)
                weighted = jacobian * model.weight
                try:
                    inverse = np.linalg.solve(weighted @ jacobian.T, weighted).T
                except np.linalg.LinAlgError:
                    return None
                if np.abs(error).max() < CONVERGED:
                    break
                q = q + inverse @ error
            else:
                return None
            postures[row] = q
            back = HOMING * (place.home - q)
            moves[row, :3] = inverse[:, :3].T
            moves[row, 3] = back - inverse @ (jacobian @ back)
            if row + 1 < len(pan):
                squares = 0.5 * (velocity[row] @ velocity[row] + velocity[row + 1] @ velocity[row + 1])
                q = q + (position[row + 1] - target) @ moves[row, :3] + times[row] * squares * moves[row, 3]
        return postures, moves


def _from_before(state: PanState, acceleration: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a motion with the sample before it, of which the first jerk is the step: (n + 1, 3) and (n + 2, 6)."""
    u = np.concatenate([[state[6:]], acceleration])
    velocity = np.array(state[3:6]) - DT * u[0]
    begin = np.concatenate([np.array(state[:3]) - DT * velocity - 0.5 * DT * DT * u[0], velocity])
    return u, np.concatenate([begin[None], integrate_pan(begin, u)])


def _along(
    moves: FloatArray, rows: NDArray[np.intp], at: NDArray[Any], vector: FloatArray, square: FloatArray
) -> FloatArray:
    """Return joint speeds (k, n), or accelerations, between rows: `moves` there times vectors (k, 3), squares (k,)."""
    before = np.minimum(np.searchsorted(rows, at, side="right") - 1, len(rows) - 2)
    share = ((at - rows[before]) / (rows[before + 1] - rows[before]))[:, None, None]
    between = moves[before] + share * (moves[before + 1] - moves[before])
    times = np.concatenate([vector, square[:, None]], axis=1)
    joints: FloatArray = np.einsum("ki,kin->kn", times, between)
    return joints
