"""Model predictive path integral control by the library pytorch-mppi, on the compiled law, told the friction.

The library draws perturbations of a nominal plan, prices each by a function of ours, and moves the plan to their mean,
weighted by exp(-price/temperature): Williams et al., "Information Theoretic MPC for Model-Based Reinforcement
Learning", ICRA 2017. All candidates move a knot at a time through the law compiled by numba, which spares the tensor
operations that a law in torch would take at every sample.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import torch
from pytorch_mppi import MPPI
from torch import Tensor

from benchmarks.peers import objective
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import GRAVITY

TEMPERATURE = 1e-5
"""What a price is divided by in a candidate's weight exp(-price/temperature), in the prices' own unit."""

SPREAD = 2.0
"""Standard deviation of the perturbations (m/s^2)."""

WIDTH = 11
"""Numbers in a state: eight of pan and object, two of the acceleration before, and the price of the last knot."""


class PathIntegral(objective.SamplingPlanner):
    """The planner; in an iteration, the nominal plan is moved by the candidates, which are perturbations of it."""

    KIND = "MPPI"

    def plan(self, position: FloatArray, friction: Friction) -> FloatArray:
        """Plan one command."""
        law = _Law(objective.held_command(position), friction)
        samples = len(position)
        u = np.empty((samples + objective.KNOT * objective.REPLAN, 2))
        with torch.random.fork_rng(devices=[]), torch.no_grad():
            torch.manual_seed(self.seed)
            controller = self._controller(law)
            for law.first in range(0, samples, objective.KNOT * objective.REPLAN):
                for _ in range(objective.REPLAN if law.first else 0):
                    controller.shift_nominal_trajectory()
                for _ in range(self.iterations):
                    controller.command(torch.from_numpy(law.state), shift_nominal_trajectory=False)
                law.execute(controller.get_action_sequence()[: objective.REPLAN].numpy(), u)
        return u[:samples]

    def _controller(self, law: _Law) -> MPPI:
        return MPPI(
            law.step,
            law.price,
            nx=WIDTH,
            noise_sigma=SPREAD**2 * torch.eye(2, dtype=torch.float64),
            num_samples=self.candidates,
            horizon=objective.HORIZON,
            lambda_=TEMPERATURE,
            u_max=torch.full((2,), objective.ACCELERATION, dtype=torch.float64),
            U_init=torch.zeros(objective.HORIZON, 2, dtype=torch.float64),
            step_dependent_dynamics=True,
        )


class _Law:
    """The law as the library wants it: a batch of states and accelerations to the states one knot later.

    Attributes:
        first: sample at which the horizon begins.
        state: (WIDTH,) where pan and object are then.
    """

    def __init__(self, command: FloatArray, friction: Friction) -> None:
        self.first = 0
        self.state = np.zeros(WIDTH)
        self._command = command
        self._limits = friction.static * GRAVITY, friction.kinetic * GRAVITY

    def step(self, states: Tensor, u: Tensor, knot: int) -> Tensor:
        """Move (n, WIDTH) states by (n, 2) accelerations through the knot of that number in the horizon."""
        moved = states.numpy().copy()
        _move_all(moved, u.numpy(), self._command, self.first + objective.KNOT * knot, *self._limits)
        return torch.from_numpy(moved)

    def price(self, states: Tensor, u: Tensor, knot: int) -> Tensor:
        """Return the prices (n,) of the knot that led to the states."""
        return states[:, -1]

    def execute(self, knots: FloatArray, u: FloatArray) -> None:
        """Move the state by the first knots of a plan, (n, 2), and write their samples into `u`."""
        for knot, (ux, uy) in enumerate(knots):
            begin = self.first + objective.KNOT * knot
            u[begin : begin + objective.KNOT] = objective.bounded(ux, uy)
            _move_all(self.state[None], u[None, begin], self._command, begin, *self._limits)


@numba.njit  # type: ignore[untyped-decorator]
def _move_all(states: Any, u: Any, command: Any, first: int, static_limit: float, kinetic_limit: float) -> None:
    """Move states (n, WIDTH) in place, each by its own acceleration, and leave the price in the last column."""
    for row in range(len(states)):
        state = states[row]
        ux, uy = objective.bounded(u[row, 0], u[row, 1])
        price = objective.price_of_change(ux, uy, state[8], state[9])
        state[10] = price + objective.move(state, ux, uy, command, first, static_limit, kinetic_limit)
        state[8], state[9] = ux, uy
