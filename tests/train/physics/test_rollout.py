"""The differentiable rollout: the compiled law is the law, and its adjoint its derivative."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
import torch

from runtime.friction import Friction
from runtime.physics.law import DT, GRAVITY, slide_one, slide_step
from runtime.physics.linearized import SPEED_FLOOR, linearize
from runtime.physics.pan import integrate_pan
from train.physics.rollout import rollout


def law(static, kinetic, batch):
    return (
        torch.full((batch,), static, dtype=torch.float64),
        torch.full((batch,), kinetic, dtype=torch.float64),
    )


@pytest.mark.parametrize("axes", [2, 3])
def test_compiled_law_equals_the_scalar_one_on_10_000_steps_of_every_branch(axes):
    rng = np.random.default_rng(0)
    u = rng.normal(0, 9, (50, 200, axes))
    u[..., 2:] = np.maximum(u[..., 2:], -0.8 * GRAVITY)
    pan = 2 * axes
    states = rollout(torch.zeros(50, pan + 4, dtype=torch.float64), torch.from_numpy(u), *law(1.0, 0.5, 50)).numpy()
    before = np.concatenate([np.zeros((50, 1, pan + 4)), states[:, :-1]], axis=1)
    normal = GRAVITY + u[..., 2:].sum(-1)
    sliding, push = (before[..., -2:] != 0).any(-1), np.linalg.norm(u[..., :2], axis=-1) >= normal
    stops = sliding & ~(states[..., -2:] != 0).any(-1)
    for branch in (sliding & ~stops, stops, ~sliding & push, ~sliding & ~push):
        assert branch.sum() >= 100
    for b in range(50):
        np.testing.assert_allclose(states[b, :, pan:], slide_one(np.zeros(4), u[b], Friction()), atol=1e-12)
        np.testing.assert_allclose(states[b, :, :pan], integrate_pan(np.zeros(pan), u[b]), atol=1e-12)


def test_pan_that_lifts_by_nothing_is_a_level_one_to_the_last_bit():
    rng = np.random.default_rng(3)
    u = torch.from_numpy(rng.normal(0, 9, (5, 200, 2))).requires_grad_()
    lifting = torch.cat([u.detach(), torch.zeros(5, 200, 1, dtype=torch.float64)], dim=-1).requires_grad_()
    weights = torch.from_numpy(rng.normal(0, 1, (5, 200, 8)))
    columns = [0, 1, 3, 4, 6, 7, 8, 9]
    level = rollout(torch.zeros(5, 8, dtype=torch.float64), u, *law(1.0, 0.5, 5))
    lifted = rollout(torch.zeros(5, 10, dtype=torch.float64), lifting, *law(1.0, 0.5, 5))
    assert torch.equal(level, lifted[..., columns])
    (level * weights).sum().backward()
    (lifted[..., columns] * weights).sum().backward()
    assert torch.equal(u.grad, lifting.grad[..., :2])


def test_law_is_the_same_in_units_in_which_gravity_is_another():
    rng = np.random.default_rng(4)
    u = torch.from_numpy(rng.uniform(-7, 9, (5, 200, 3)))
    start = torch.zeros(5, 10, dtype=torch.float64)
    # Twice as long a unit of time at the same unit of length: accelerations are four times as large, and gravity too.
    one = rollout(start, u, *law(1.0, 0.5, 5))
    other = rollout(start, 4.0 * u, *law(1.0, 0.5, 5), gravity=4.0 * GRAVITY, dt=0.5 * DT)
    np.testing.assert_allclose(other[..., [0, 1, 2, 6, 7]], one[..., [0, 1, 2, 6, 7]], atol=1e-12)
    np.testing.assert_allclose(0.5 * other[..., [3, 4, 5, 8, 9]], one[..., [3, 4, 5, 8, 9]], atol=1e-12)


BRANCHES = {
    "slides": ((0.3, -0.2), (2.0, 1.0, 0.0)),
    "slides on a pan that rises": ((0.3, -0.2), (2.0, 1.0, 4.0)),
    "slides on a pan that sinks": ((0.3, -0.2), (2.0, 1.0, -6.0)),
    "stops": ((0.002, 0.001), (1.0, 0.5, 0.0)),
    "breaks away": ((0.0, 0.0), (9.0, -8.0, 0.0)),
    "breaks away from a pan that sinks": ((0.0, 0.0), (5.0, -4.0, -6.0)),
    "sticks": ((0.0, 0.0), (3.0, 2.0, 0.0)),
}


def point(v, u):
    """One sample's start (1, 10), the object at velocity v, and acceleration u (1, 1, 3), to be differentiated by."""
    start = torch.tensor([[0.0] * 8 + list(v)], dtype=torch.float64, requires_grad=True)
    return start, torch.tensor([[u]], dtype=torch.float64, requires_grad=True)


@pytest.mark.parametrize("branch", BRANCHES)
def test_adjoint_equals_central_differences_away_from_the_switching_surfaces(branch):
    v, u = BRANCHES[branch]
    weights = np.array([0.7, -1.3, 0.4, 2.1])
    states = rollout(*(tensors := point(v, u)), *law(1.0, 0.5, 1))
    (states[0, 0, 6:] @ torch.from_numpy(weights)).backward()
    got = np.concatenate([tensors[0].grad[0, 8:], tensors[1].grad[0, 0]])

    def value(x):
        normal = GRAVITY + x[4]
        return weights @ np.array(slide_step(0.0, 0.0, *x[:4], normal, 0.5 * normal, DT))

    x = np.array([*v, *u])
    # At rest v = 0 is itself the switching surface, so there only u is varied.
    varied = range(5) if any(v) else range(2, 5)
    for i in varied:
        h = 1e-6 * max(1.0, abs(x[i])) if i >= 2 else 1e-7
        step = h * np.eye(5)[i]
        slope = (value(x + step) - value(x - step)) / (2 * h)
        assert got[i] == pytest.approx(slope, rel=1e-6, abs=1e-10), (branch, ["vx", "vy", "ux", "uy", "uz"][i])


def test_gradient_through_a_whole_rollout_equals_central_differences():
    rng = np.random.default_rng(1)
    u = torch.from_numpy(rng.normal(0, 1, (1, 60, 3)) + np.array([14.0, 5.0, -3.0])).requires_grad_()
    start = torch.from_numpy(rng.normal(0, 0.1, (1, 10)))
    start[0, 8:] = torch.tensor([-0.5, -0.4])
    start.requires_grad_()
    weights = torch.from_numpy(rng.normal(0, 1, (1, 60, 10)))

    def value(start, u):
        return (rollout(start, u, *law(1.0, 0.5, 1)) * weights).sum()

    states = rollout(start, u, *law(1.0, 0.5, 1))
    assert torch.linalg.vector_norm(states[..., 8:], dim=-1).min() > SPEED_FLOOR
    value(start, u).backward()
    with torch.no_grad():
        of_u = [(u, u.grad, index) for index in ((0, 3, 0), (0, 50, 1), (0, 20, 2))]
        for tensor, grad, index in [*of_u, (start, start.grad, (0, 2)), (start, start.grad, (0, 8))]:
            h = 1e-5
            step = torch.zeros_like(tensor)
            step[index] = h
            high = value(start, u + step) if tensor is u else value(start + step, u)
            low = value(start, u - step) if tensor is u else value(start - step, u)
            assert grad[index].item() == pytest.approx(((high - low) / (2 * h)).item(), rel=1e-6)


def test_gradient_knows_when_an_object_turns_round_and_breaks_away():
    """Over inputs so different that stops and starts move by several samples; sample by sample it would be 40 % off."""
    wave = np.zeros((80, 2))
    wave[:, 0] = 20.0 * np.sin(2.0 * np.pi * np.arange(80) / 60)
    sizes = np.linspace(0.85, 1.15, 2001)
    u = torch.from_numpy(sizes[:, None, None] * wave).requires_grad_()
    states = rollout(torch.zeros(len(sizes), 8, dtype=torch.float64), u, *law(1.0, 0.5, len(sizes)))
    assert (states[..., 6].amin(1) < 0.0).all()
    assert (states[..., 6].amax(1) > 0.0).all()
    position = states[:, -1, 4]
    position.sum().backward()
    mean = (u.grad.numpy() * wave).sum((1, 2)).mean()
    rise = (position[-1] - position[0]).item() / (sizes[-1] - sizes[0])
    assert mean == pytest.approx(rise, rel=0.05)


def test_gradient_knows_what_lifting_does_to_an_object_that_turns_round_and_breaks_away():
    """As above, by how much the pan sinks while it goes one way and rises while it goes the other."""
    wave = np.zeros((80, 3))
    wave[:, 2] = np.sin(2.0 * np.pi * np.arange(80) / 60)
    to_and_fro = np.zeros((80, 3))
    to_and_fro[:, 0] = 20.0 * wave[:, 2]
    sizes = np.linspace(1.0, 7.0, 2001)
    u = torch.from_numpy(to_and_fro + sizes[:, None, None] * wave).requires_grad_()
    states = rollout(torch.zeros(len(sizes), 10, dtype=torch.float64), u, *law(1.0, 0.5, len(sizes)))
    assert (states[..., 8].amin(1) < 0.0).all()
    assert (states[..., 8].amax(1) > 0.0).all()
    position = states[:, -1, 6]
    position.sum().backward()
    mean = (u.grad.numpy() * wave).sum((1, 2)).mean()
    rise = (position[-1] - position[0]).item() / (sizes[-1] - sizes[0])
    assert mean == pytest.approx(rise, rel=0.05)


def test_gradient_is_tamed_below_the_speed_floor_only():
    slow, fast = 0.5 * SPEED_FLOOR, 2 * SPEED_FLOOR
    for speed, divisor in ((slow, SPEED_FLOOR), (fast, fast)):
        # Across the direction of motion, dv+/dv = 1 - mu' g dt / |v|.
        across = linearize(speed, 0.0, 0.0, 0.0, 0.0, 0.0, 9.8, 4.9, DT)[2]
        assert across == pytest.approx(1 - 4.9 * DT / divisor)


def test_cuda_kernels_give_the_same_motion_and_gradient():
    """Runs the CUDA kernels in numba's simulator, so that it needs no GPU; a process of its own, as it must be."""
    code = """
import numpy as np, torch
from train.physics import cuda as rollout_cuda
from train.physics.rollout import rollout
rng = np.random.default_rng(0)
u = torch.from_numpy(rng.normal(0, 9, (3, 40, 3)).clip(-7, None)).requires_grad_()
start = torch.from_numpy(rng.normal(0, 0.2, (3, 10))).requires_grad_()
one = torch.ones(3, dtype=torch.float64)
grad = torch.from_numpy(rng.normal(0, 1, (3, 40, 10)))
states = rollout(start, u, one, one / 2, 9.8 * one)
states.backward(grad)
got, got_start, got_u = np.empty((3, 40, 10)), np.empty((3, 10)), np.empty((3, 40, 3))
inputs = (start.detach().numpy(), u.detach().numpy(), one.numpy(), one.numpy() / 2, 9.8 * one.numpy())
rollout_cuda.forward[1, 4](*inputs, 1e-3, got)
rollout_cuda.backward[1, 4](*inputs, 1e-3, got, grad.numpy(), got_start, got_u)
assert np.abs(got - states.detach().numpy()).max() < 1e-12
assert np.abs(got_u - u.grad.numpy()).max() < 1e-12
assert np.abs(got_start - start.grad.numpy()).max() < 1e-12
print("same")
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"NUMBA_ENABLE_CUDASIM": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.strip() == "same", done.stderr


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_gpu_gives_the_same_motion_and_gradient():
    rng = np.random.default_rng(1)
    static = rng.uniform(0.05, 1.5, 768)
    drawn = (
        rng.normal(0, 0.2, (768, 10)) * rng.integers(0, 2, (768, 1)),
        rng.normal(0, 9, (768, 64, 3)).clip(-4, None),
        static,
        static * rng.uniform(0.4, 1.0, 768),
        rng.uniform(5, 60, 768),
        rng.normal(0, 1, (768, 64, 10)),
    )
    found = []
    for device in ("cpu", "cuda"):
        start, u, static, kinetic, gravity, grad = (torch.from_numpy(part).to(device) for part in drawn)
        start, u = start.requires_grad_(), u.requires_grad_()
        states = rollout(start, u, static, kinetic, gravity)
        states.backward(grad)
        found.append([each.detach().cpu() for each in (states, start.grad, u.grad)])
    for on_cpu, on_gpu in zip(*found, strict=True):
        assert (on_cpu - on_gpu).abs().max() < 1e-12 * max(1.0, on_cpu.abs().max().item())
