"""The law fitted to the pieces of a log by multiple shooting: what it says, and what brings that nearer."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import MAX_COEFFICIENT, Friction
from runtime.physics.law import DT, GRAVITY, slide_one, slide_step

LEAST = 0.01
"""Smallest friction that is tried."""

STEPS = {"kinetic": 2e-3, "static": 1e-2, "position": 1e-5, "velocity": 2e-3}
"""Changes by which derivatives are found (dimensionless, m, m/s)."""

ITERATIONS = 25
"""Most steps of a fit."""

SETTLED = 1e-4
"""Share of the cost that a step must win for the fit to go on."""

HUBER = 3.0
"""Standard deviations from which on a frame counts less."""


class Law(NamedTuple):
    """The law of friction, and by how much it is bent: not at all where the rest is 0.

    Attributes:
        kinetic, static: friction coefficients.
        viscous: deceleration by speed (1/s).
        tilt_x, tilt_y: acceleration that a pan that leans gives (m/s^2).
        late: by how much the frames' times are late (s).
    """

    kinetic: float
    static: float
    viscous: float = 0.0
    tilt_x: float = 0.0
    tilt_y: float = 0.0
    late: float = 0.0

    @property
    def friction(self) -> Friction:
        return Friction(max(self.static, self.kinetic), self.kinetic)


class Piece(NamedTuple):
    """A part of a log: accelerations (n, d), frames at (m,) seconds from its begin, and their positions (m, 2)."""

    u: FloatArray
    time: FloatArray
    position: FloatArray


def run(piece: Piece, law: Law, begin: FloatArray) -> FloatArray:
    """Return where the law says the object was in the frames of a piece, (m, 2) (m)."""
    if law.viscous or law.tilt_x or law.tilt_y:
        states = _slide_bent(piece.u, law, begin)
    else:
        states = slide_one(begin, piece.u, law.friction)
    position = np.concatenate([begin[None, :2], states[:, :2]])
    at = np.clip(piece.time - law.late, 0.0, len(piece.u) * DT) / DT
    low = np.minimum(at.astype(int), len(piece.u) - 1)
    share = (at - low)[:, None]
    found: FloatArray = position[low] + share * (position[low + 1] - position[low])
    return found


def _slide_bent(u: FloatArray, law: Law, begin: FloatArray) -> FloatArray:
    """Slide with the terms that bend the law: as accelerations of the pan, which act on the object alike."""
    friction, rows = law.friction, []
    px, py, vx, vy = begin.tolist()
    for ux, uy, *lift in u.tolist():
        normal = GRAVITY + (lift[0] if lift else 0.0)
        ax, ay = ux - law.tilt_x + law.viscous * vx, uy - law.tilt_y + law.viscous * vy
        px, py, vx, vy = slide_step(px, py, vx, vy, ax, ay, friction.static * normal, friction.kinetic * normal, DT)
        rows.append((px, py, vx, vy))
    return np.array(rows)


def residuals(pieces: list[Piece], law: Law, begins: list[FloatArray]) -> list[FloatArray]:
    return [piece.position - run(piece, law, begin) for piece, begin in zip(pieces, begins, strict=True)]


def weights_of(residual: FloatArray, sigma: float) -> FloatArray:
    """Return the weight of each frame: less than 1 beyond HUBER times the noise, or the median of the distances."""
    size = np.hypot(*residual.T)
    scale = HUBER * max(sigma, float(np.median(size)) / 1.1774)
    weights: FloatArray = np.minimum(1.0, scale / np.maximum(size, 1e-12))
    return weights


def derivative(change: Callable[[float], FloatArray], step: float) -> FloatArray:
    slope: FloatArray = (change(step) - change(-step)) / (2.0 * step)
    return slope


def jacobian_of(pieces: list[Piece], law: Law, begins: list[FloatArray]) -> FloatArray:
    """Return (2 m, 2 + 4 pieces) derivatives of the positions by kinetic and static friction and by the begins."""
    rows = [2 * len(piece.time) for piece in pieces]
    full = np.zeros((sum(rows), 2 + 4 * len(pieces)))
    row = 0
    for index, (piece, begin) in enumerate(zip(pieces, begins, strict=True)):
        part = slice(row, row + rows[index])
        full[part, :2], full[part, 2 + 4 * index : 6 + 4 * index] = _slopes(piece, law, begin)
        row += rows[index]
    return full


def _slopes(piece: Piece, law: Law, begin: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of one piece's positions, (2 m, 2) by the frictions and (2 m, 4) by its begin."""
    by_friction = [
        derivative(partial(_with_friction, piece, law, begin, name), STEPS[name]) for name in ("kinetic", "static")
    ]
    by_begin = [
        derivative(partial(_with_begin, piece, law, begin, axis), STEPS["position" if axis < 2 else "velocity"])
        for axis in range(4)
    ]
    return np.stack(by_friction, axis=1), np.stack(by_begin, axis=1)


def _with_friction(piece: Piece, law: Law, begin: FloatArray, name: str, step: float) -> FloatArray:
    return run(piece, _changed(law, name, step), begin).ravel()


def _with_begin(piece: Piece, law: Law, begin: FloatArray, axis: int, step: float) -> FloatArray:
    changed = begin.copy()
    changed[axis] += step
    return run(piece, law, changed).ravel()


def _changed(law: Law, name: str, step: float) -> Law:
    value = getattr(law, name) + step
    return law._replace(**{name: min(max(value, LEAST), MAX_COEFFICIENT) if name in ("kinetic", "static") else value})


def cost_of(residual: FloatArray, sigma: float) -> float:
    """Return the cost of distances: their squares over the noise's, linear beyond HUBER of it."""
    size = np.hypot(*residual.T) / sigma
    return float(np.where(size <= HUBER, size * size, HUBER * (2.0 * size - HUBER)).sum())


def solve(
    pieces: list[Piece],
    law: Law,
    begins: list[FloatArray],
    sigma: float,
    hold_static: bool = False,
    most: int = ITERATIONS,
) -> tuple[Law, list[FloatArray]]:
    """Make the cost small, from a guess."""
    damping = 1e-3
    residual = np.concatenate(residuals(pieces, law, begins))
    cost = cost_of(residual, sigma)
    for _ in range(most):
        jacobian = jacobian_of(pieces, law, begins)
        if hold_static:
            jacobian[:, 1] = 0.0
        weights = np.repeat(weights_of(residual, sigma), 2)
        normal = jacobian.T @ (weights[:, None] * jacobian)
        gradient = jacobian.T @ (weights * residual.ravel())
        won = 0.0
        for _ in range(8):
            scale = np.diag(normal) + 1e-9
            step = np.linalg.solve(normal + np.diag(damping * scale + 1e-12), gradient)
            kinetic = min(max(law.kinetic + float(step[0]), LEAST), MAX_COEFFICIENT)
            static = min(max(law.static + float(step[1]), kinetic), MAX_COEFFICIENT)
            tried = law._replace(kinetic=kinetic, static=law.static if hold_static else static)
            moved = [begin + step[2 + 4 * i : 6 + 4 * i] for i, begin in enumerate(begins)]
            after = np.concatenate(residuals(pieces, tried, moved))
            new = cost_of(after, sigma)
            if new < cost:
                won, damping = cost - new, 0.3 * damping
                law, begins, residual, cost = tried, moved, after, new
                break
            damping *= 5.0
        if won <= SETTLED * cost:
            break
    return law, begins


def covariance_of(pieces: list[Piece], law: Law, begins: list[FloatArray], weights: FloatArray) -> FloatArray:
    """Return the covariance (2, 2) of the frictions for a noise of 1 m, the begins being unknown too."""
    jacobian = jacobian_of(pieces, law, begins)
    normal = jacobian.T @ (np.repeat(weights, 2)[:, None] * jacobian)
    covariance: FloatArray = np.linalg.pinv(normal, rcond=1e-12).astype(np.float64)[:2, :2]
    return covariance
