"""The law of friction: its invariants, and that every form of it is the same law."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.errors import InputError
from runtime.friction import Friction
from runtime.physics.law import DT, GRAVITY, run_compiled, slide, slide_batch, slide_one, slide_step, slide_step_batch
from runtime.physics.pan import integrate_pan

CASES = 10_000


def reference_step(p, v, u, w, mu, mu_kinetic, dt):
    """The law as the module states it, in vectors, written for reading; returns the branch taken as well."""
    speed = np.linalg.norm(v)
    n = GRAVITY + w
    if speed > 0:
        branch = "slides"
        a = -u - mu_kinetic * n * v / speed
        v_next = v + a * dt
        if v_next @ v <= 0:
            branch, a, v_next = "stops", -v / dt, np.zeros(2)
    elif np.linalg.norm(u) >= mu * n:
        branch = "breaks away"
        a = -u + mu * n * u / np.linalg.norm(u)
        v_next = a * dt
    else:
        branch, a, v_next = "sticks", np.zeros(2), np.zeros(2)
    return p + v * dt + a * dt * dt / 2, v_next, branch


def seeded_cases():
    """Cases of which about a quarter falls to each branch: p, v, u (CASES, 2), w and the coefficients (CASES,)."""
    rng = np.random.default_rng(1)
    p = rng.uniform(-0.2, 0.2, (CASES, 2))
    speed = np.choose(rng.integers(0, 3, CASES), [0.0, rng.uniform(0, 0.01, CASES), rng.uniform(0, 1, CASES)])
    angle = rng.uniform(0, 2 * np.pi, CASES)
    v = speed[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    u = rng.normal(0, 10, (CASES, 2))
    static = rng.uniform(0.4, 1.5, CASES)
    kinetic = rng.uniform(0.2, 1.0, CASES) * static
    w = rng.uniform(-0.8 * GRAVITY, 10, CASES)
    return p, v, u, w, static, kinetic


@pytest.mark.parametrize("lifts", [False, True])
def test_scalar_and_batched_law_agree_with_the_reference_in_all_branches(lifts):
    p, v, u, w, static, kinetic = seeded_cases()
    w = w if lifts else np.zeros(CASES)
    n = GRAVITY + w
    batched_p, batched_v = slide_step_batch(p.T, v.T, u.T, static * n, kinetic * n, DT)
    rolled = slide_batch(
        np.concatenate([p, v], axis=1), np.concatenate([u, w[:, None]], axis=1)[:, None], static, kinetic
    )
    branches = {"slides": 0, "stops": 0, "breaks away": 0, "sticks": 0}
    for i in range(CASES):
        want_p, want_v, branch = reference_step(p[i], v[i], u[i], w[i], static[i], kinetic[i], DT)
        branches[branch] += 1
        scalar = np.array(slide_step(*p[i], *v[i], *u[i], static[i] * n[i], kinetic[i] * n[i], DT))
        want = np.concatenate([want_p, want_v])
        along = slide_one(np.concatenate([p[i], v[i]]), np.array([[*u[i], w[i]]]), Friction(static[i], kinetic[i]))
        assert np.abs(rolled[i, 0] - want).max() <= 1e-12
        assert np.abs(along[0] - want).max() <= 1e-12
        assert np.abs(scalar - want).max() <= 1e-12
        assert np.abs(np.concatenate([batched_p[:, i], batched_v[:, i]]) - want).max() <= 1e-12
    assert min(branches.values()) >= 500, branches


@pytest.mark.parametrize("lifts", [False, True])
def test_batched_rollout_equals_the_scalar_one_along_trajectories(lifts):
    rng = np.random.default_rng(2)
    u = rng.normal(0, 8, (20, 300, 2))
    if lifts:
        u = np.concatenate([u, rng.uniform(-0.8 * GRAVITY, 10, (20, 300, 1))], axis=2)
    start = np.concatenate([rng.uniform(-0.1, 0.1, (20, 2)), rng.normal(0, 0.3, (20, 2))], axis=1)
    static = rng.uniform(0.4, 1.5, 20)
    kinetic = static * rng.uniform(0.3, 1.0, 20)
    batched = slide_batch(start, u, static, kinetic)
    for b in range(20):
        np.testing.assert_allclose(batched[b], slide_one(start[b], u[b], Friction(static[b], kinetic[b])), atol=1e-12)


@pytest.mark.parametrize("compiled", [False, True])
def test_pan_that_lifts_by_nothing_is_a_level_one_to_the_last_bit(compiled):
    rng = np.random.default_rng(7)
    u = np.repeat(rng.normal(0, 10, (20, 60, 2)), 10, axis=1)
    lifting = np.concatenate([u, np.zeros((20, 600, 1))], axis=2)
    starts = np.concatenate([rng.uniform(-0.1, 0.1, (20, 2)), rng.normal(0, 0.3, (20, 2))], axis=1)
    if compiled:
        pytest.importorskip("numba")
    try:
        assert run_compiled(compiled) == compiled
        for start, level, lifted in zip(starts, u, lifting, strict=True):
            np.testing.assert_array_equal(slide_one(start, lifted, Friction()), slide_one(start, level, Friction()))
    finally:
        run_compiled(False)
    np.testing.assert_array_equal(slide_batch(starts, lifting, 1.0, 0.5), slide_batch(starts, u, 1.0, 0.5))
    pan = integrate_pan(np.zeros((20, 6)), lifting)
    np.testing.assert_array_equal(pan[..., [0, 1, 3, 4]], integrate_pan(np.zeros((20, 4)), u))
    assert (pan[..., [2, 5]] == 0.0).all()


@pytest.mark.parametrize("w", [-5.0, 5.0])
def test_object_slides_and_breaks_away_as_it_would_under_the_gravity_that_presses_it_on_the_pan(w):
    """The law has no other place for gravity: a pan that rises all the time is a level one where things weigh more."""
    rng = np.random.default_rng(8)
    u = rng.normal(0, 8, (500, 2))
    lifted = slide_one(np.zeros(4), np.column_stack([u, np.full(500, w)]), Friction(1.0, 0.5))
    share = (GRAVITY + w) / GRAVITY
    np.testing.assert_allclose(lifted, slide_one(np.zeros(4), u, Friction(share, 0.5 * share)), atol=1e-12)


@pytest.mark.parametrize("w", [-GRAVITY, -12.0, math.nan])
def test_pan_that_falls_away_from_the_object_is_refused_with_its_sample(w):
    u = np.zeros((5, 3))
    u[3, 2] = w
    with pytest.raises(InputError, match=f"upwards by {w:g} m/s\\^2 in sample 3, which must be above -9.8"):
        slide_one(np.zeros(4), u, Friction())
    with pytest.raises(InputError, match="in sample 3, "):
        slide_batch(np.zeros((1, 4)), u[None], 1.0, 0.5)


@pytest.mark.parametrize("kinetic", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("speed", [0.1, 0.7])
def test_sliding_object_stops_after_v_squared_over_two_mu_g(kinetic, speed):
    states = slide_one(np.array([0.0, 0.0, speed, 0.0]), np.zeros((2000, 2)), Friction(1.0, kinetic))
    # The discrete time line gives the distance to within the last sample's travel.
    assert states[-1, 0] == pytest.approx(speed**2 / (2 * kinetic * GRAVITY), abs=speed * DT)
    assert (states[-1, 2:] == 0.0).all()


def test_friction_alone_never_adds_energy_nor_turns_the_object_round():
    rng = np.random.default_rng(3)
    for _ in range(50):
        v = rng.normal(0, 0.5, 2)
        states = slide_one(np.concatenate([[0, 0], v]), np.zeros((300, 2)), Friction(1.0, rng.uniform(0.1, 1.0)))
        speeds = np.linalg.norm(states[:, 2:], axis=1)
        assert (np.diff(np.concatenate([[np.linalg.norm(v)], speeds])) <= 0).all()
        assert (states[:, 2:] @ v >= 0).all()


@given(st.floats(0, 0.9999), st.floats(0, 2 * math.pi), st.floats(0.01, 2))
def test_resting_object_sticks_below_the_threshold_and_breaks_away_above(share, angle, static):
    direction = np.array([math.cos(angle), math.sin(angle)])
    below = slide_one(np.zeros(4), np.tile(share * static * GRAVITY * direction, (3, 1)), Friction(static, 0.0))
    assert (below == 0.0).all()
    above = slide_one(np.zeros(4), np.tile(1.0001 * static * GRAVITY * direction, (3, 1)), Friction(static, 0.0))
    assert above[-1, 2:] @ direction < 0


def test_law_has_no_preferred_direction():
    rng = np.random.default_rng(4)
    u = rng.normal(0, 8, (500, 2))
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    plain = slide_one(np.zeros(4), u, Friction())
    turned = slide_one(np.zeros(4), u @ turn.T, Friction())
    np.testing.assert_allclose(turned[:, :2], plain[:, :2] @ turn.T, atol=1e-12)


def test_object_without_friction_stays_where_it_is_in_the_world():
    # A push to one side only: the law brings even a frictionless object to rest where its velocity turns round.
    u = np.random.default_rng(5).uniform(1, 5, (400, 2))
    pan = integrate_pan(np.zeros(4), u)
    states = slide_one(np.zeros(4), u, Friction(0.0, 0.0))
    np.testing.assert_allclose(states + pan, 0.0, atol=1e-12)


@pytest.mark.parametrize("axes", [2, 3])
def test_pan_is_the_double_integrator_of_equation_3(axes):
    rng = np.random.default_rng(6)
    u, state = rng.normal(0, 5, (50, axes)), rng.normal(0, 1, 2 * axes)
    eye, none = np.eye(axes), np.zeros((axes, axes))
    a = np.block([[eye, DT * eye], [none, eye]])
    b = np.vstack([DT**2 / 2 * eye, DT * eye])
    states = integrate_pan(state, u)
    for k in range(50):
        state = a @ state + b @ u[k]
        np.testing.assert_allclose(states[k], state, atol=1e-12)


@pytest.mark.parametrize(
    ("static", "kinetic", "words"),
    [
        (-0.1, 0.0, "friction static must be between 0 and 10, got -0.1"),
        (1.0, -0.5, "friction kinetic must be between 0 and 10, got -0.5"),
        (0.5, 0.6, "kinetic friction 0.6 must not exceed static friction 0.5"),
        (math.nan, 0.5, "friction static must be finite, got nan"),
        (math.inf, 0.5, "friction static must be finite, got inf"),
        (11.0, 0.5, "got 11"),
        ("1.0", 0.5, "friction static must be a number, got '1.0'"),
        (True, 0.5, "friction static must be a number, got True"),
    ],
)
def test_impossible_friction_is_refused_by_name_and_value(static, kinetic, words):
    with pytest.raises(InputError, match=words):
        Friction(static, kinetic)


@pytest.mark.parametrize("lifts", [False, True])
def test_compiled_law_moves_objects_as_the_plain_one_does_to_the_last_bit(lifts):
    pytest.importorskip("numba")
    rng = np.random.default_rng(5)
    starts = np.concatenate([rng.uniform(-0.1, 0.1, (20, 2)), rng.normal(0, 0.3, (20, 2))], axis=1)
    u = np.repeat(rng.normal(0, 10, (20, 60, 2)), 10, axis=1)
    if lifts:
        u = np.concatenate([u, rng.uniform(-0.8 * GRAVITY, 10, (20, 600, 1))], axis=2)
    plain = [slide_one(*one, Friction(1.0, 0.5)) for one in zip(starts, u, strict=True)]
    assert not np.array(plain)[:, :, 2:].any(axis=2).all()  # some rest
    try:
        assert run_compiled(True)
        compiled = [slide_one(*one, Friction(1.0, 0.5)) for one in zip(starts, u, strict=True)]
        at_once = slide(starts, u, [Friction(1.0, 0.5)] * len(starts))
    finally:
        assert not run_compiled(False)
    np.testing.assert_array_equal(compiled, plain)
    np.testing.assert_array_equal(at_once, plain)
