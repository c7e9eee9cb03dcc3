"""Writes what the Python runtime computes with the shipped bundle, for the browser's planner to be held against.

python browser/test/record.py FILE [PLANS]

Run anew, by the test, for whatever bundle is shipped: nothing of it is kept.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import Command, Friction, Limits, Planner, Start
from runtime.network.bundle import Bundle
from runtime.network.job import Job
from runtime.network.reach import with_reach
from runtime.network.reader import Frame
from runtime.network.units import CONDITIONS, OBSERVED
from runtime.physics.law import slide_one
from runtime.safety.governor import govern
from runtime.safety.pan import Pan

Array = NDArray[np.float64]
Case = dict[str, Any]

LIMITS = {
    "default": Limits(),
    "lifting": Limits(height=0.1),
    "tight": Limits(0.06, acceleration=20.0, jerk=3_000.0),
    "panda": Limits.named("panda"),
    "fr3": Limits.named("fr3"),
    "level": Limits(0.2, speed=1.7, acceleration=13.0, jerk=6_500.0),
    "small": Limits(0.03, height=0.015, acceleration=30.0, jerk=10_000.0),
    "slow": Limits(0.2, height=0.05, speed=0.6, acceleration=6.0, jerk=900.0),
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
        for kind in range(8):
            pans, chunks = [Pan.at_start(Start(), limits)], []
            way, count = rng.normal(0.0, 1.0, 3), int(rng.integers(2, 200))
            for n in range(8):
                if kind % 4 == 0:
                    asked = rng.normal(0.0, 2.0 * limits.acceleration, (1, count, 3))
                elif kind % 4 == 1:
                    asked = np.tile(limits.acceleration * way, (1, count, 1))
                elif kind % 4 == 2:
                    asked = np.tile(limits.acceleration * way * (-1.0) ** (n // 2), (1, count, 1))
                else:
                    asked = 0.3 * limits.acceleration * np.cumsum(rng.normal(0.0, 0.1, (1, count, 3)), axis=1)
                u, states, pans = govern(pans, asked)
                chunks.append({"asked": asked[0].tolist(), "u": u[0].tolist(), "states": states[0].tolist()})
            cases.append({"limits": name, "kind": kind, "chunks": chunks})
    return cases


def tables(rng: np.random.Generator) -> list[Case]:
    """Command files, and what of them becomes at 1 kHz: recordings, sparse waypoints, units, delimiters, JSON."""
    t = np.cumsum(rng.uniform(0.01, 0.03, 60))
    recording = np.stack([0.05 * np.sin(4.0 * t), 0.04 * np.cos(3.0 * t)], axis=1)
    stops = np.array([[0.0, 0.0], [0.05, 0.0], [0.05, 0.04], [0.0, 0.04], [0.0, 0.0]])
    at = np.array([0.0, 0.4, 0.7, 1.4, 1.6])
    mixed = np.concatenate([np.arange(20) * 0.02, 0.4 + np.arange(4) * 0.3])
    drawn = np.stack([0.03 * np.sin(9.0 * mixed), 0.02 * mixed], axis=1)

    def table(header: str, t: Array, position: Array, comma: str = ",", point: str = ".") -> str:
        rows = [
            comma.join(f"{value:.9g}" for value in row).replace(".", point) for row in np.column_stack([t, position])
        ]
        return "\n".join([header, *rows]) + "\n"

    contents = [
        table("t,x,y", t, recording),
        table("t,x,y", at, stops),
        table("t,x,y", mixed, drawn),
        table("time_ms;x [mm];y [mm]", 1e3 * at, 1e3 * stops, ";", ","),
        "# made by hand\n" + table("t x y", at[:3], stops[:3], " "),
        table("x,y", loop(400, 1.0, 0.02)[:, 0], loop(400, 1.0, 0.02)[:, 1:]),
        table("t,x,y", at[:2], stops[:2]),
        json.dumps({"dt": 0.02, "position": recording.tolist()}),
        json.dumps({"dt": 0.001, "position": loop(300, 1.0, 0.02).tolist()}),
        json.dumps({"t": at.tolist(), "position": stops.tolist()}),
    ]
    cases = []
    for content in contents:
        with NamedTemporaryFile("w", suffix=".txt", encoding="utf-8") as file:
            file.write(content)
            file.flush()
            cases.append({"content": content, "position": Command.load(file.name).position.tolist()})
    return cases


def loop(samples: int, turns: float, size: float) -> Array:
    t = np.linspace(0.0, 2.0 * np.pi * turns, samples)
    return size * np.stack([1.0 - np.cos(t), np.sin(t) ** 3], axis=1)


def network(rng: np.random.Generator, bundle: Bundle) -> list[Case]:
    """What the two graphs give, row by row: a command read, and some questions of which each remembers the last."""
    cases = []
    for limits in LIMITS.values():
        job = with_reach(Job(Command(loop(900, 1.0, 0.05)), Friction(1.0, 0.5), limits, Start()))
        frame = Frame.of([job])
        window = frame.window(0)
        memory = bundle.encode(window)
        questions = []
        for _ in range(6):
            observation = rng.normal(0.0, 0.1, (1, OBSERVED)).astype(np.float32)
            observation[:, -1 - CONDITIONS : -1] = frame.conditions
            observation[:, -1] = rng.uniform(0.1, 1.0)
            answer, memory = bundle.decode_step(observation, memory)
            questions.append({"observation": observation[0].tolist(), "answer": answer[0].tolist()})
        cases.append(
            {
                "window": window[0].tolist(),
                "questions": questions,
                "unit": frame.acceleration.item(),
            }
        )
    return cases


def plans(rng: np.random.Generator, planner: Planner, count: int) -> list[Case]:
    """Plans under all of LIMITS in turn: short, odd and long commands, some that rest at their ends, some too wide,
    some from a pan that moves."""
    cases = []
    for n in range(count):
        name, limits = list(LIMITS.items())[n % len(LIMITS)]
        samples = int(rng.integers(2100, 2700) if n % 13 == 11 else rng.integers(2, 1300))
        size = min(1.0, limits.pan_reach / 0.1) * rng.uniform(0.01, 0.06)
        position = np.round(loop(samples, rng.uniform(0.3, 0.9) * samples / 1000, size), 9)
        if n % 5 == 3:
            position = np.concatenate([position, np.repeat(position[-1:], 200, axis=0)])
        static = round(rng.uniform(0.1, 1.4), 3)
        friction = Friction(static, round(rng.uniform(0.5, 1.0) * static, 3))
        start = Start()
        if n % 7 == 5:
            start = Start(
                pan_position=tuple((0.2 * limits.pan_reach * rng.uniform(-1.0, 1.0, 2)).tolist()),
                pan_velocity=tuple((0.3 * limits.pan_reach * rng.uniform(-1.0, 1.0, 2)).tolist()),
                object_position=tuple((position[0] + 0.004).tolist()),
                object_velocity=(0.01, -0.02),
            )
        plan = planner.plan(position, friction, limits=limits, start=start, candidates=1)
        cases.append(
            {
                "limits": name,
                "friction": [friction.static, friction.kinetic],
                "position": position.tolist(),
                "start": [[*start.pan_state().tolist(), 0.0, 0.0, 0.0], start.object_state(position[0]).tolist()],
                "u": plan.pan_acceleration.tolist(),
                "pan": plan.pan_position.tolist(),
                "object": plan.object_position.tolist(),
                "stop": plan.stop_acceleration.tolist(),
                "quality": plan.quality.to_dict(),
            }
        )
    return cases


if __name__ == "__main__":
    rng, planner = np.random.default_rng(0), Planner()
    document = {
        "limits": {name: limits.to_dict() for name, limits in LIMITS.items()},
        "law": law(rng),
        "governed": governed(rng),
        "tables": tables(rng),
        "network": network(rng, planner.bundle),
        "bundle": str(planner.bundle.path),
        "plans": plans(rng, planner, int(sys.argv[2]) if len(sys.argv) > 2 else 24),
    }
    Path(sys.argv[1]).write_text(json.dumps(document), encoding="ascii")
