"""Plans and streams are what they were: recorded once, compared to the last bit.

`python tests/runtime/test_recorded.py` records them anew, which only a change of the model or of the law justifies.

What the network computes depends, in its last bits, on the processor and on onnxruntime. Where it gives other numbers
than where the plans were recorded, plans are compared to within ELSEWHERE; where it gives the same, to the last bit.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from runtime import Friction, Limits, Planner, Start
from runtime.network.units import OBSERVED, READ

RECORDED = Path(__file__).parents[1] / "data" / "recorded.npz"

ELSEWHERE = 0.05
"""Largest difference of an acceleration from the recorded one on another processor (m/s^2)."""


def loop(samples: int, turns: float, size: float = 0.03) -> np.ndarray:
    t = np.linspace(0.0, 2.0 * np.pi * turns, samples)
    return size * np.stack([1.0 - np.cos(t), np.sin(t) ** 3], axis=1)


def planned(planner: Planner) -> dict[str, np.ndarray]:
    tight = Limits(pan_reach=0.06, acceleration=20.0, jerk=3_000.0)
    moving = Start((0.05, -0.02), (0.4, 0.3), (2.0, 1.0), (0.01, 0.02), (0.1, -0.2))
    plans = {
        "plain": planner.plan(loop(1200, 1.0), candidates=1),
        "odd": planner.plan(loop(777, 0.7), Friction(0.8, 0.4), candidates=1),
        "governed": planner.plan(loop(1000, 1.5, 0.05), limits=tight, candidates=1),
        "moving": planner.plan(loop(600, 0.5), start=moving, candidates=1),
        "long": planner.plan(loop(6000, 5.0), candidates=1),
        "lifting": planner.plan(loop(1000, 0.8), Friction(0.5, 0.3), limits=Limits.named("panda"), candidates=1),
        "candidates": planner.plan(loop(700, 0.7), limits=Limits(height=0.1), candidates=4, robust=0.1),
    }
    batch = planner.plan_batch([loop(800 + 100 * n, 0.8, 0.02 + 0.01 * n) for n in range(5)])
    plans |= {f"batch{n}": plan for n, plan in enumerate(batch)}
    pan, sliding = ("pan_acceleration", "pan_position", "pan_velocity"), ("object_position", "object_velocity")
    return {
        name: np.concatenate(
            [
                *(held_level(getattr(plan, row), name in ("lifting", "candidates")) for row in pan),
                *(getattr(plan, row) for row in sliding),
            ],
            axis=1,
        )
        for name, plan in plans.items()
    }


def held_level(rows: np.ndarray, lifts: bool = False) -> np.ndarray:
    """Return rows (n, 3), after looking at z: of a level pan it is exactly 0."""
    assert rows.shape[1] == 3
    assert rows[:, 2].any() == lifts
    assert lifts or not np.signbit(rows[:, 2]).any()
    return rows


def streamed(planner: Planner) -> dict[str, np.ndarray]:
    """Closed loops in which much goes wrong: noise, pushes, gaps, another command, a pan outside, a stop."""
    rng = np.random.default_rng(5)
    stream = planner.stream(loop(1500, 1.2), Friction(0.9, 0.45))
    chunk = stream.chunk
    given, pan, sliding = [], np.zeros((chunk, 4)), np.zeros((chunk, 4))
    for n in range(24):
        if n == 9:
            stream.retarget(loop(3000, 2.0))
        pan_seen = None if n in (4, 13) else pan + rng.normal(0.0, 1e-3, pan.shape)
        object_seen = None if n in (6, 13, 14, 15) else sliding + rng.normal(0.0, 1e-3, sliding.shape)
        if n == 11:
            pan_seen = pan + np.array([0.19, 0.0, 1.0, 0.0])
        if n == 7 and pan_seen is not None:
            pan_seen = pan_seen[-1]
        if n == 18:
            stream.reset(Start((0.02, 0.01), (0.1, 0.0)))
        u = stream.step(pan_seen, object_seen, age=0.007 if n == 5 else 0.0)
        given += [held_level(u), held_level(stream.brake(50))]
        end = np.repeat(pan[-1:], chunk, axis=0)
        time = np.arange(1, chunk + 1)[:, None] * 1e-3
        end[:, 2:] += np.cumsum(u[:, :2], axis=0) * 1e-3
        end[:, :2] += time * pan[-1, 2:]
        pan, sliding = end, 0.5 * sliding + rng.normal(0.0, 0.01, 4)
    return {"stream": np.concatenate(given)}


def network(planner: Planner) -> np.ndarray:
    """Return what the network computes from one observation: what makes one machine's plans another's."""
    rng = np.random.default_rng(1)
    memory = planner.bundle.encode(rng.normal(0.0, 0.1, (2, 3, READ)).astype(np.float32))
    observation = rng.normal(0.0, 0.1, (2, OBSERVED)).astype(np.float32)
    u, memory = planner.bundle.decode_step(observation, memory)
    return np.concatenate([u.ravel(), memory.hidden.ravel(), memory.cell.ravel()])


def test_plans_and_streams_are_bit_for_bit_what_they_were() -> None:
    planner = Planner()
    with np.load(RECORDED) as file:
        recorded = dict(file)
    same = np.array_equal(network(planner), recorded.pop("network"))
    made = planned(planner) | streamed(planner)
    assert made.keys() == recorded.keys()
    for key, rows in recorded.items():
        if same:
            assert np.array_equal(made[key], rows), key
        else:
            np.testing.assert_allclose(made[key], rows, rtol=0.0, atol=ELSEWHERE, err_msg=key)


if __name__ == "__main__":
    shipped = Planner()
    np.savez_compressed(RECORDED, **planned(shipped), **streamed(shipped), network=network(shipped))
