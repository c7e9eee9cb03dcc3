"""The families of commands that everyone is measured on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import DT

SAMPLES = 1200
"""Samples of a command, K: the length of the paper's own evaluation (Section V-B)."""

NOMINAL = Friction(static=1.0, kinetic=0.5)
"""The paper's friction (Section IV-B); every family but `friction` is measured under it."""

FRICTION_GRID = tuple(
    Friction(static, kinetic)
    for static in (0.5, 0.8, 1.0, 1.2, 1.4)
    for kinetic in (0.3, 0.5, 0.7)
    if kinetic <= static
)
"""The frictions of the family `friction`; the planner may know them, the network is not told (Fig. 11)."""

SPLINE_KNOTS = (0.15, 0.4)
"""Range of the spacing of the knots (s)."""

SPLINE_REACH = (0.03, 0.15)
"""Range of the largest distance of a spline command from its start (m)."""

SHAPE_RADII = (0.03, 0.05, 0.08)
"""Sizes of the shapes (m); each is twice that wide."""

SHAPE_EASE = 0.3
"""Time in which a circle, an eight, or a stroke back and forth gets up to speed (s)."""

SHAPE_TILT = np.pi / 6
"""All shapes are turned by this angle (rad), so that none lies along an axis."""

STOPS_RADIUS = 0.1
"""The points of `stops` are drawn from the disc of this radius round the origin (m)."""

STOPS_REST = (0.1, 0.4)
"""Range of the time spent at rest, all rests of a command together (s)."""

STOPS_MAX_ACCELERATION = 8.0
"""Largest acceleration in a move (m/s^2); points too far apart for that are all drawn closer to the origin.

Five moves between the farthest points in 1.2 s would take 60 m/s^2, which no pan within 0.2 m gives: a command that
nobody can follow measures nobody.
"""

MINIMUM_JERK_ACCELERATION = 10.0 / 3.0**0.5
"""Largest acceleration of a minimum-jerk move over distance 1 in time 1."""


@dataclass(frozen=True, eq=False)
class Family:
    """Some commands of one kind, each with the friction to plan for.

    Attributes:
        name: the family's name.
        positions: one (K, 2) array a command, object relative to the pan (m), read-only; K may differ.
        frictions: one for each command.
        labels: one for each command, such as "circle 0.03 m".
    """

    name: str
    positions: tuple[FloatArray, ...]
    frictions: tuple[Friction, ...]
    labels: tuple[str, ...]

    def __len__(self) -> int:
        """Return the number of commands."""
        return len(self.positions)

    def first(self, commands: int) -> Family:
        """Return the family with its first commands only."""
        some = slice(commands)
        return Family(self.name, self.positions[some], self.frictions[some], self.labels[some])


@cache
def spline() -> Family:
    """Return the 64 spline commands."""
    return _spline_family("spline", seed=1, count=64, samples=SAMPLES)


@cache
def shapes() -> Family:
    """Return the 12 shapes, which start and end at the origin, except for point to point.

    A shape of radius r is 2r wide: the circle, the eight from side to side, the stroke back and forth from end to end,
    and the way from point to point. One cycle takes all K samples; it starts softly and ends at full speed.
    """
    t = _times(SAMPLES)
    # The phase rate rises by the minimum-jerk profile, which loses half of the time it takes.
    phase = 2.0 * np.pi * _eased_time(t, SHAPE_EASE) / (t[-1] - 0.5 * SHAPE_EASE)
    unit = {
        "circle": (np.cos(phase) - 1.0, np.sin(phase)),
        "eight": (np.sin(phase), np.sin(phase) * np.cos(phase)),
        "point to point": (2.0 * minimum_jerk(t / t[-1]), np.zeros(SAMPLES)),
        "back and forth": (1.0 - np.cos(phase), np.zeros(SAMPLES)),
    }
    c, s = np.cos(SHAPE_TILT), np.sin(SHAPE_TILT)
    sizes = [(name, radius) for name in unit for radius in SHAPE_RADII]
    positions = [
        radius * np.stack([c * x - s * y, s * x + c * y], axis=1) for name, radius in sizes for x, y in [unit[name]]
    ]
    return same_friction("shapes", positions, [f"{name} {radius:.2f} m" for name, radius in sizes])


@cache
def stops() -> Family:
    """Return the 24 commands that stop: 1, 2, 3, 4, 5, 1, 2, ... moves."""
    rng = np.random.default_rng(2)
    moves = [1 + index % 5 for index in range(24)]
    positions = [_moves_and_rests(rng, count) for count in moves]
    labels = [f"stops {index}, {count} move{'s'[: count > 1]}" for index, count in enumerate(moves)]
    return same_friction("stops", positions, labels)


@cache
def long() -> Family:
    """Return 8 spline commands of K = 1500."""
    return _spline_family("long", seed=3, count=8, samples=1500)


@cache
def short() -> Family:
    """Return 8 spline commands of K = 500."""
    return _spline_family("short", seed=4, count=8, samples=500)


@cache
def odd() -> Family:
    """Return 8 spline commands of K = 777, which ends in the middle of a chunk."""
    return _spline_family("odd", seed=5, count=8, samples=777)


@cache
def friction() -> Family:
    """Return the spline commands under every friction of the grid, one friction after the other."""
    return under_every_friction(spline())


def under_every_friction(base: Family) -> Family:
    """Return the commands of a family under every friction of the grid, one friction after the other."""
    cells = [
        (position, each, f"{label}, {each.static:g}/{each.kinetic:g}")
        for each in FRICTION_GRID
        for position, label in zip(base.positions, base.labels, strict=True)
    ]
    positions, frictions, labels = zip(*cells, strict=True)
    return Family("friction", positions, frictions, labels)


def minimum_jerk(x: FloatArray) -> FloatArray:
    """Return the minimum-jerk profile from 0 to 1 over x in [0, 1], held outside."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))


def lengths(vectors: FloatArray) -> FloatArray:
    """Return the Euclidean lengths (n,) of (n, 2) vectors."""
    return np.sqrt(vectors[:, 0] * vectors[:, 0] + vectors[:, 1] * vectors[:, 1])


def spline_position(rng: np.random.Generator, samples: int, reach: float, spacing: float) -> FloatArray:
    """Draw a motion whose acceleration is a cubic B-spline with normal control points on uniform knots.

    Args:
        rng: source of the control points.
        samples: K.
        reach: largest distance from the start (m).
        spacing: of the knots (s).

    Returns:
        (K, 2) positions (m) from the origin, at rest, by the double integrator of Eq. 3.
    """
    t = _times(samples)
    piece = np.floor(t / spacing).astype(np.int64)
    control = rng.standard_normal((int(piece[-1]) + 4, 2))
    x = (t / spacing - piece)[:, None]
    y = 1.0 - x
    basis = (
        y * y * y / 6.0,
        (4.0 + x * x * (3.0 * x - 6.0)) / 6.0,
        (4.0 + y * y * (3.0 * y - 6.0)) / 6.0,
        x * x * x / 6.0,
    )
    acceleration = sum((weight * control[piece + j] for j, weight in enumerate(basis)), np.zeros((samples, 2)))
    velocity = _from_zero(np.cumsum(acceleration, axis=0) * DT)
    position = _from_zero(np.cumsum(velocity * DT + acceleration * (0.5 * DT * DT), axis=0))
    scale = reach / float(lengths(position).max())
    return position * scale


def _spline_family(name: str, seed: int, count: int, samples: int) -> Family:
    rng = np.random.default_rng(seed)
    positions = []
    for _ in range(count):
        spacing, reach = rng.uniform(*SPLINE_KNOTS), rng.uniform(*SPLINE_REACH)
        positions.append(spline_position(rng, samples, reach, spacing))
    return same_friction(name, positions, [f"{name} {index}" for index in range(count)])


def _moves_and_rests(rng: np.random.Generator, count: int) -> FloatArray:
    """Draw `count` minimum-jerk moves from the origin to random points, with a rest after each: (SAMPLES, 2) m.

    A move takes a time in proportion to the root of its length, give or take a third, so that all of a command's
    moves are about as brisk.
    """
    radius = STOPS_RADIUS * np.sqrt(rng.uniform(size=count))
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    points = _from_origin(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1))
    legs = np.diff(points, axis=0)
    resting = rng.uniform(*STOPS_REST)
    rests = _shares(rng.uniform(0.5, 1.5, count)) * resting
    t = _times(SAMPLES)
    durations = _shares(np.sqrt(lengths(legs)) * rng.uniform(0.67, 1.33, count)) * (t[-1] - resting)
    briskest = float((MINIMUM_JERK_ACCELERATION * lengths(legs) / durations**2).max())
    legs *= min(1.0, STOPS_MAX_ACCELERATION / briskest)
    begins = np.cumsum(durations + rests) - (durations + rests)
    position = np.zeros((SAMPLES, 2))
    for leg, begin, duration in zip(legs, begins, durations, strict=True):
        position += minimum_jerk((t - begin) / duration)[:, None] * leg
    return position


def same_friction(name: str, positions: Sequence[FloatArray], labels: Sequence[str]) -> Family:
    """Return a family of commands (K, 2) (m), all of them under nominal friction."""
    for position in positions:
        position.setflags(write=False)
    return Family(name, tuple(positions), (NOMINAL,) * len(positions), tuple(labels))


def _eased_time(t: FloatArray, ease: float) -> FloatArray:
    """Return the integral over t (s) of a rate that rises from 0 to 1 by the minimum-jerk profile within `ease` (s)."""
    x = np.minimum(t / ease, 1.0)
    return ease * x * x * x * x * (2.5 + x * (x - 3.0)) + np.maximum(t - ease, 0.0)


def _times(samples: int) -> FloatArray:
    """Return t_k = k dt, k = 0..samples-1 (s)."""
    return np.arange(samples, dtype=np.float64) * DT


def _shares(weights: FloatArray) -> FloatArray:
    shares: FloatArray = weights / weights.sum()
    return shares


def _from_zero(after: FloatArray) -> FloatArray:
    """Shift values after each sample, (K, 2), to values before it, the first being zero."""
    return np.concatenate([np.zeros((1, 2)), after[:-1]])


def _from_origin(points: FloatArray) -> FloatArray:
    return np.concatenate([np.zeros((1, 2)), points])
