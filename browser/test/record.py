"""Writes what the Python runtime computes, for the browser's planner to be held against.

python browser/test/record.py FILE [PLANS]
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import Friction, Limits, Planner
from runtime.physics.law import slide_one
from runtime.safety.governor import govern
from runtime.safety.pan import Pan
from runtime.start import Start

Array = NDArray[np.float64]
Case = dict[str, Any]

LIMITS = {
    "default": Limits(),
    "tight": Limits(0.06, acceleration=20.0, jerk=3_000.0),
    "panda": Limits.named("panda"),
    "level": Limits(0.2, speed=1.7, acceleration=13.0, jerk=6_500.0),
}


def law(rng: np.random.Generator) -> list[Case]:
    cases = []
    for size in (0.5, 8.0, 40.0):
        for _ in range(4):
            u = np.cumsum(rng.normal(0.0, 0.3 * size, (300, 3)), axis=0) * 0.2
            u[100:150] = 0.0
            u[:, 2] = np.clip(u[:, 2], -8.0, 20.0)
            state = np.array([*rng.normal(0.0, 0.05, 2), *rng.normal(0.0, 0.2, 2)])
            static, kinetic = sorted(rng.uniform(0.1, 1.2, 2).tolist(), reverse=True)
            states = slide_one(state, u, Friction(static, kinetic))
            cases.append(
                {"state": state.tolist(), "u": u.tolist(), "friction": [static, kinetic], "states": states.tolist()}
            )
    return cases


def governed(rng: np.random.Generator) -> list[Case]:
    """Sequences of accelerations that are against every limit: noise, pushes one way, jumps to and fro."""
    cases = []
    for name, limits in LIMITS.items():
        for kind in range(4):
            pans, chunks = [Pan.at_start(Start(), limits)], []
            way = rng.normal(0.0, 1.0, 3)
            for n in range(8):
                if kind == 0:
                    asked = rng.normal(0.0, 2.0 * limits.acceleration, (1, 100, 3))
                elif kind == 1:
                    asked = np.tile(limits.acceleration * way, (1, 100, 1))
                elif kind == 2:
                    asked = np.tile(limits.acceleration * way * (-1.0) ** (n // 2), (1, 100, 1))
                else:
                    asked = 0.3 * limits.acceleration * np.cumsum(rng.normal(0.0, 0.1, (1, 100, 3)), axis=1)
                u, _, pans = govern(pans, asked)
                chunks.append({"asked": asked[0].tolist(), "u": u[0].tolist()})
            cases.append({"limits": name, "kind": kind, "chunks": chunks})
    return cases


def loop(samples: int, turns: float, size: float) -> Array:
    t = np.linspace(0.0, 2.0 * np.pi * turns, samples)
    return size * np.stack([1.0 - np.cos(t), np.sin(t) ** 3], axis=1)


def plans(rng: np.random.Generator, count: int) -> list[Case]:
    """Plans under all of LIMITS in turn: short, odd and long commands, some that rest at their ends, some too wide."""
    planner, cases = Planner("fp32"), []
    for n in range(count):
        name, limits = list(LIMITS.items())[n % len(LIMITS)]
        samples = int(rng.integers(2100, 2700) if n % 12 == 11 else rng.integers(300, 1300))
        position = np.round(loop(samples, rng.uniform(0.3, 0.9) * samples / 1000, rng.uniform(0.01, 0.06)), 9)
        if n % 4 == 3:
            position = np.concatenate([position, np.repeat(position[-1:], 200, axis=0)])
        static = round(rng.uniform(0.4, 1.5), 3)
        friction = Friction(static, round(rng.uniform(0.2, min(0.8, static)), 3))
        plan = planner.plan(position, friction, limits=limits)
        cases.append(
            {
                "limits": name,
                "friction": [friction.static, friction.kinetic],
                "position": position.tolist(),
                "pan": plan.pan_position.tolist(),
                "object": plan.object_position.tolist(),
                "stop": plan.stop_acceleration.tolist(),
                "quality": plan.quality.to_dict(),
            }
        )
    return cases


if __name__ == "__main__":
    rng = np.random.default_rng(0)
    document = {
        "limits": {name: limits.to_dict() for name, limits in LIMITS.items()},
        "law": law(rng),
        "governed": governed(rng),
        "plans": plans(rng, int(sys.argv[2]) if len(sys.argv) > 2 else 24),
    }
    Path(sys.argv[1]).write_text(json.dumps(document), encoding="ascii")
