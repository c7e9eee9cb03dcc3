"""A long search for the best plan of one command: many begun, all refined, and the better ones of these further."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from benchmarks.peers.cross_entropy import CrossEntropy
from benchmarks.suite.pans import tracking
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.planner import Planner
from runtime.refine.refine import Effort, refine
from runtime.safety.pan import Pan
from runtime.start import Start

TURNS = 12
"""Angles by which the command is turned, mirrored and not, for the network to plan it."""

SEEDS = 3
"""Plans that the cross-entropy optimizer begins."""

KEPT = (6, 2, 1)
"""Plans that are kept after each third of the steps."""


def search(
    planner: Planner,
    position: FloatArray,
    friction: Friction,
    limits: Limits,
    steps: int,
    known: Iterable[FloatArray] = (),
) -> FloatArray:
    """Search for the level plan that tracks a command best.

    Args:
        planner: the network, whose plans of the command turned and mirrored are begun from.
        position: (K, 2) the command (m).
        friction: told.
        limits: of a level pan.
        steps: of refinement, all plans together.
        known: plans (K, 2) (m/s^2) to begin from besides.

    Returns:
        (K, 2) pan accelerations (m/s^2), within the limits.
    """
    found = [*known, *_turned(planner, position, friction, limits)]
    found += [CrossEntropy(seed=seed, limits=limits).plan(position, friction) for seed in range(SEEDS)]
    for count in KEPT:
        share = max(steps // len(KEPT) // len(found), 1)
        found = [_refined(u, position, friction, limits, share) for u in found]
        errors = tracking([position] * len(found), found, friction)
        found = [found[index] for index in np.argsort(errors)[:count]]
    return found[0]


def _turned(planner: Planner, position: FloatArray, friction: Friction, limits: Limits) -> list[FloatArray]:
    """Plan a command turned and mirrored, and turn the plans back."""
    turns = []
    for angle in 2.0 * math.pi * np.arange(TURNS) / TURNS:
        cos, sin = math.cos(angle), math.sin(angle)
        turns += [np.array([[cos, -sin * mirror], [sin, cos * mirror]]) for mirror in (1.0, -1.0)]
    plans = planner.plan_batch([(position - position[0]) @ turn.T for turn in turns], friction, limits=limits)
    return [plan.pan_acceleration[:, :2] @ turn for plan, turn in zip(plans, turns, strict=True)]


def _refined(u: FloatArray, position: FloatArray, friction: Friction, limits: Limits, steps: int) -> FloatArray:
    asked = np.concatenate([u, np.zeros((len(u), 1))], axis=1)
    sliding = np.array([*position[0], 0.0, 0.0])
    pan, effort = Pan.at_start(Start(), limits), Effort(0.0, steps, robust=0.0)
    better = refine(asked, pan, sliding, position, friction, len(u), effort)
    return u if better is None else better[0].acceleration[:, :2]
