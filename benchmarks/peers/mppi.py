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

TEMPERATURE = 1e-5
"""What a price is divided by in a candidate's weight exp(-price/temperature), for knots of KNOT samples."""

SPREAD = 2.0
"""Standard deviation of the perturbations (m/s^2), for ACCELERATION of the objective."""

WIDTH = objective.WIDTH + 4
"""Numbers in a state: those of the objective, three of the knot before, and the price of the last knot."""


class PathIntegral(objective.SamplingPlanner):
    """The planner; in an iteration, the nominal plan is moved by the candidates, which are perturbations of it."""

    KIND = "MPPI"

    def plan(self, position: FloatArray, friction: Friction) -> FloatArray:
        """Plan one command."""
        law = _Law(objective.held_command(position, self.span), self.span, friction, self.bounds)
        samples = len(position)
        u = np.empty((samples + self.span * objective.REPLAN, self.axes))
        with torch.random.fork_rng(devices=[]), torch.no_grad():
            torch.manual_seed(self.seed)
            controller = self._controller(law)
            for law.first in range(0, samples, self.span * objective.REPLAN):
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
            noise_sigma=(SPREAD * self.strength) ** 2 * torch.eye(self.axes, dtype=torch.float64),
            num_samples=self.candidates,
            horizon=objective.HORIZON,
            lambda_=TEMPERATURE * self.span / objective.KNOT,
            u_max=torch.full((self.axes,), float(self.bounds[0]), dtype=torch.float64),
            U_init=torch.zeros(objective.HORIZON, self.axes, dtype=torch.float64),
            step_dependent_dynamics=True,
        )


class _Law:
    """The law as the library wants it: a batch of states and accelerations to the states one knot later.

    Attributes:
        first: sample at which the horizon begins.
        state: (WIDTH,) where pan and object are then.
    """

    def __init__(self, command: FloatArray, span: int, friction: Friction, bounds: FloatArray) -> None:
        self.first = 0
        self.state = np.zeros(WIDTH)
        self._command, self._span = command, span
        self._law = friction.static, friction.kinetic, bounds

    def step(self, states: Tensor, u: Tensor, knot: int) -> Tensor:
        """Move (n, WIDTH) states by (n, axes) accelerations through the knot of that number in the horizon."""
        moved = states.numpy().copy()
        _move_all(moved, u.numpy(), self._command, self.first + self._span * knot, self._span, *self._law)
        return torch.from_numpy(moved)

    def price(self, states: Tensor, u: Tensor, knot: int) -> Tensor:
        """Return the prices (n,) of the knot that led to the states."""
        return states[:, -1]

    def execute(self, knots: FloatArray, u: FloatArray) -> None:
        """Move the state by the first knots of a plan, (n, axes), and write their samples into `u`."""
        for knot, asked in enumerate(knots):
            target = np.zeros(3)
            target[: len(asked)] = asked
            objective.bound(target, self._law[2])
            begin = self.first + self._span * knot
            objective.execute(self.state, target, self._command, begin, self._span, *self._law, u)
            self.state[13:16] = target


@numba.njit  # type: ignore[untyped-decorator]
def _move_all(
    states: Any, u: Any, command: Any, first: int, span: int, static: float, kinetic: float, bounds: Any
) -> None:
    """Move states (n, WIDTH) in place through a knot of `span` samples, each by its own acceleration.

    The price is left in the last column.
    """
    target = np.zeros(3)
    for row in range(len(states)):
        state = states[row]
        target[:] = 0.0
        target[: u.shape[1]] = u[row]
        objective.bound(target, bounds)
        price = objective.price_of_change(target, state[13:16], span, bounds)
        state[16] = price + objective.move(state, target, command, first, span, static, kinetic, bounds)
        state[13:16] = target
