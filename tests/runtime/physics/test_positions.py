"""The law in complex numbers is the law."""

from __future__ import annotations

import numpy as np
import pytest

from runtime import Friction
from runtime.physics.law import GRAVITY, run_compiled, slide_one
from runtime.physics.positions import slide_positions, slide_positions_batch, slide_to_rest

FRICTIONS = [Friction(1.0, 0.5), Friction(0.4, 0.4), Friction(0.2, 0.0), Friction(0.0, 0.0), Friction(10.0, 1.0)]


@pytest.mark.parametrize("columns", [2, 3])
@pytest.mark.parametrize("size", [0.5, 8.0, 40.0])
def test_positions_are_the_rollouts(columns: int, size: float) -> None:
    rng = np.random.default_rng(int(size))
    branches = set()
    for _ in range(40):
        u = np.cumsum(rng.normal(0.0, 0.3 * size, (400, columns)), axis=0) * 0.2
        u[100:150] = 0.0
        if columns == 3:
            u[:, 2] = np.clip(u[:, 2], -0.9 * GRAVITY, 20.0)
        state = np.array([*rng.normal(0.0, 0.05, 2), *(rng.normal(0.0, 0.2, 2) if rng.random() < 0.5 else (0.0, 0.0))])
        found = slide_positions(state, u, FRICTIONS)
        for positions, friction in zip(found, FRICTIONS, strict=True):
            states = np.concatenate([state[None], slide_one(state, u, friction)])
            np.testing.assert_allclose(positions, states[:, :2], rtol=1e-12, atol=1e-12)
            moving = states[:, 2:].any(axis=1)
            branches |= set(zip(moving[:-1].tolist(), moving[1:].tolist(), strict=True))
    assert len(branches) == 4 or size == 0.5  # it slides, stops, breaks away and sticks


def test_compiled_law_gives_the_same_positions() -> None:
    pytest.importorskip("numba")
    u = np.random.default_rng(0).normal(0.0, 12.0, (300, 2))
    plain = slide_positions(np.zeros(4), u, FRICTIONS)
    try:
        assert run_compiled(True)
        compiled = slide_positions(np.zeros(4), u, FRICTIONS)
        at_once = slide_positions_batch(np.zeros((3, 4)), np.stack([u] * 3), [FRICTIONS] * 3)
    finally:
        run_compiled(False)
    np.testing.assert_allclose(compiled, plain, atol=1e-12)
    np.testing.assert_array_equal(at_once, [compiled] * 3)


def test_compiled_law_comes_to_rest_at_the_same_place() -> None:
    pytest.importorskip("numba")
    rng = np.random.default_rng(3)
    u = np.cumsum(rng.normal(0.0, 1.5, (20, 130, 3)), axis=1) * 0.2
    states = rng.normal(0.0, 0.2, (20, 4))
    plain = [slide_to_rest(*one, Friction(1.0, 0.5)) for one in zip(states, u, strict=True)]
    try:
        assert run_compiled(True)
        compiled = [slide_to_rest(*one, Friction(1.0, 0.5)) for one in zip(states, u, strict=True)]
    finally:
        run_compiled(False)
    np.testing.assert_allclose(compiled, plain, atol=1e-12)


def test_no_sample_is_the_start() -> None:
    found = slide_positions(np.array([0.1, 0.2, 1.0, 0.0]), np.zeros((0, 2)), FRICTIONS)
    np.testing.assert_array_equal(found, np.tile([0.1, 0.2], (5, 1, 1)))


@pytest.mark.parametrize("columns", [2, 3])
@pytest.mark.parametrize("objects", [1, 16, 37])
def test_many_at_once_are_each_by_itself_to_the_last_bit(columns: int, objects: int) -> None:
    rng = np.random.default_rng(objects)
    u = np.cumsum(rng.normal(0.0, 1.5, (objects, 130, columns)), axis=1) * 0.4
    u[:, 40:60] = 0.0
    if columns == 3:
        u[..., 2] = np.clip(u[..., 2], -0.9 * GRAVITY, 20.0)
    states = rng.normal(0.0, 0.1, (objects, 4))
    states[::2, 2:] = 0.0
    frictions = [Friction(static, share * static).corners(0.1) for static, share in rng.uniform(0.1, 1.0, (objects, 2))]
    together = slide_positions_batch(states, u, frictions)
    apart = [slide_positions(*one) for one in zip(states, u, frictions, strict=True)]
    np.testing.assert_array_equal(together, np.stack(apart))
