"""The law of friction between the pan and the object on it (Eqs. 3, 4 and 9 of the paper), in discrete time.

Per sample of `dt` = 1 ms, in float64. The object's position `p` (m) and velocity `v` (m/s) are relative to the
pan, in its plane; the input is the pan's acceleration (m/s^2), `u` in the plane and `w` upwards; `mu` is the static and
`mu'` the kinetic coefficient; n = g + w > 0 is the acceleration that presses the object on the pan:

    if |v| > 0:                         sliding
        a  = -u - mu' n v/|v|
        v+ = v + a dt
        if v+ . v <= 0:                 friction would turn the object round: it comes to rest instead
            a = -v/dt ;  v+ = 0
    elif |u| >= mu n:                   breaks away
        a  = -u + mu n u/|u| ;  v+ = a dt
    else:                               sticks
        a  = 0 ;  v+ = 0
    p+ = p + v dt + a dt^2/2

Rest is exactly `v = 0`: there is no velocity threshold. The pan is the double integrator of Eq. 3. A level pan, the
paper's, has w = 0. Accelerations have two columns, u, for a level pan, or three, u and w, for one that lifts.

`slide_step` is this text for one object, in plain floats: fastest in plain Python for a single trajectory, and
the function that training compiles with numba for the CPU and for CUDA. `slide_one` runs it along a trajectory;
`slide_batch` is the same law over arrays, which wins from about 48 trajectories up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.physics.compiled import Compiler, compile_together, compiler


def slide(state: FloatArray, u: FloatArray, frictions: Sequence[Friction]) -> FloatArray:
    """Slide B objects, each under its friction: (B, 4), (B, C, 2) or (B, C, 3) -> (B, C, 4); see `slide_one`."""
    static = np.array([friction.static for friction in frictions])
    kinetic = np.array([friction.kinetic for friction in frictions])
    compiled = _compiled  # which another thread may replace
    if compiled is not None:
        return compiled.slide(state, u, static, kinetic)
    if len(state) < BATCHED_FROM:
        return np.stack([slide_one(*one) for one in zip(state, u, frictions, strict=True)])
    return slide_batch(state, u, static, kinetic)


GRAVITY = 9.8
"""Gravitational acceleration used throughout (m/s^2), the paper's value."""

DT = 0.001
"""Sampling interval of commands, plans and the law (s)."""

BATCHED_FROM = 48
"""Number of trajectories from which `slide_batch` beats `slide_one` in a loop, as long as that is plain Python
(measured by `slide-bench`)."""


def slide_step(
    px: float,
    py: float,
    vx: float,
    vy: float,
    ux: float,
    uy: float,
    static_limit: float,
    kinetic_limit: float,
    dt: float,
) -> tuple[float, float, float, float]:
    """Advance one object by one sample under the law in the module's docstring (Eqs. 4 and 9).

    Args:
        px, py: object position relative to the pan (m).
        vx, vy: object velocity relative to the pan (m/s).
        ux, uy: pan acceleration over the sample (m/s^2).
        static_limit: mu n, the pan acceleration at which a resting object breaks away (m/s^2).
        kinetic_limit: mu' n, the deceleration by friction while sliding (m/s^2).
        dt: sampling interval (s).

    Returns:
        The next px, py, vx, vy.
    """
    speed = math.sqrt(vx * vx + vy * vy)
    if speed > 0.0:
        ax = -ux - kinetic_limit * vx / speed
        ay = -uy - kinetic_limit * vy / speed
        next_vx = vx + ax * dt
        next_vy = vy + ay * dt
        if next_vx * vx + next_vy * vy <= 0.0:
            ax = -vx / dt
            ay = -vy / dt
            next_vx = 0.0
            next_vy = 0.0
    else:
        push = math.sqrt(ux * ux + uy * uy)
        if push >= static_limit and push > 0.0:
            ax = -ux + static_limit * ux / push
            ay = -uy + static_limit * uy / push
            next_vx = ax * dt
            next_vy = ay * dt
        else:
            ax = 0.0
            ay = 0.0
            next_vx = 0.0
            next_vy = 0.0
    half = 0.5 * dt * dt
    return px + vx * dt + ax * half, py + vy * dt + ay * half, next_vx, next_vy


def slide_one(state: FloatArray, acceleration: FloatArray, friction: Friction, dt: float = DT) -> FloatArray:
    """Slide one object along a sequence of pan accelerations (Eqs. 4 and 9).

    Args:
        state: (4,) object position (m) and velocity (m/s) relative to the pan before the first sample.
        acceleration: (n, 2) or, of a pan that lifts, (n, 3) pan acceleration (m/s^2).
        friction: coefficients.
        dt: sampling interval (s).

    Returns:
        (n, 4) object states after each sample.

    Raises:
        InputError: the pan falls away from the object.
    """
    static, kinetic = friction.static, friction.kinetic
    compiled = _compiled  # which another thread may replace
    if compiled is not None:
        along = compiled.slide(state[None], acceleration[None], np.array([static]), np.array([kinetic]), dt)
        return along.reshape(-1, 4)
    px, py, vx, vy = state.tolist()
    lifts = acceleration.shape[1] == 3 and bool(acceleration[:, 2].any())
    if lifts:
        check_contact(acceleration)
    states = []
    if lifts:
        for ux, uy, w in acceleration.tolist():
            normal = GRAVITY + w
            px, py, vx, vy = slide_step(px, py, vx, vy, ux, uy, static * normal, kinetic * normal, dt)
            states.append((px, py, vx, vy))
    else:
        static_limit, kinetic_limit = static * GRAVITY, kinetic * GRAVITY
        for ux, uy in acceleration[:, :2].tolist():
            px, py, vx, vy = slide_step(px, py, vx, vy, ux, uy, static_limit, kinetic_limit, dt)
            states.append((px, py, vx, vy))
    # An array is made of numbers in half the time that it takes of tuples.
    return np.fromiter(chain.from_iterable(states), np.float64, 4 * len(states)).reshape(-1, 4)


def check_contact(acceleration: FloatArray) -> None:
    """Check that a pan's accelerations (..., 3) keep the object pressed on it.

    Raises:
        InputError: one of them does not; the sample is named.
    """
    kept = acceleration[..., 2] > -GRAVITY
    if not kept.all():
        where = tuple(np.argwhere(~kept)[0].tolist())
        raise InputError(
            f"the pan falls away from the object: it accelerates upwards by {acceleration[..., 2][where]:g} m/s^2 in "
            f"sample {where[-1]}, which must be above -{GRAVITY:g} m/s^2"
        )


def slide_along(
    states: FloatArray,
    u: FloatArray,
    static: FloatArray,
    kinetic: FloatArray,
    gravity: float,
    dt: float,
    out: FloatArray,
) -> None:
    """Fill `out` (B, n, 4) with the states after each of the accelerations `u` (A, n, 2 or 3), to be compiled."""
    each = len(states) // len(u)
    lifts = u.shape[2] == 3
    for row in range(len(states)):
        pushed = u[row // each]
        px, py, vx, vy = states[row, 0], states[row, 1], states[row, 2], states[row, 3]
        for k in range(len(pushed)):
            normal = gravity + pushed[k, 2] if lifts else gravity
            px, py, vx, vy = slide_step(
                px, py, vx, vy, pushed[k, 0], pushed[k, 1], static[row] * normal, kinetic[row] * normal, dt
            )
            out[row, k, 0], out[row, k, 1], out[row, k, 2], out[row, k, 3] = px, py, vx, vy


def add_squares(
    state: FloatArray,
    u: FloatArray,
    command: FloatArray,
    static: FloatArray,
    kinetic: FloatArray,
    gravity: float,
    dt: float,
    out: FloatArray,
) -> None:
    """Fill `out` (F,) with the sums of the squared distances between object and command, to be compiled.

    The rest is as for `CompiledLaw.squares`.
    """
    lifts = u.shape[1] == 3
    for row in range(len(out)):
        px, py, vx, vy = state[0], state[1], state[2], state[3]
        total = 0.0
        for k in range(len(command)):
            dx, dy = px - command[k, 0], py - command[k, 1]
            total += dx * dx + dy * dy
            if k + 1 < len(command):
                normal = gravity + u[k, 2] if lifts else gravity
                px, py, vx, vy = slide_step(
                    px, py, vx, vy, u[k, 0], u[k, 1], static[row] * normal, kinetic[row] * normal, dt
                )
        out[row] = total


class CompiledLaw:
    """The law as numba runs it: `slide_one` of many objects, to the last bit.

    Args:
        compile_one: compiles a function.

    Attributes:
        functions: what it is made of, compiled, by name.
    """

    def __init__(self, compile_one: Compiler) -> None:
        self.functions = compile_together((slide_step, slide_along, add_squares), compile_one)
        self._along, self._add_squares = self.functions["slide_along"], self.functions["add_squares"]
        self.slide(np.zeros((1, 4)), np.zeros((1, 1, 2)), np.ones(1), np.ones(1))  # compiles
        self.squares(np.zeros(4), np.zeros((1, 3)), np.zeros((2, 2)), [Friction()])

    def slide(
        self, states: FloatArray, acceleration: FloatArray, static: FloatArray, kinetic: FloatArray, dt: float = DT
    ) -> FloatArray:
        """Slide B objects along A sequences of pan accelerations, B / A of them along each.

        Args:
            states: (B, 4) object position (m) and velocity (m/s) relative to the pan before the first sample.
            acceleration: (A, n, 2) or, of pans that lift, (A, n, 3) pan acceleration (m/s^2).
            static, kinetic: (B,) friction coefficients.
            dt: sampling interval (s).

        Returns:
            (B, n, 4) object states after each sample.

        Raises:
            InputError: a pan falls away from its object.
        """
        if acceleration.shape[2] == 3:
            check_contact(acceleration)
        states, u = (np.ascontiguousarray(each, dtype=np.float64) for each in (states, acceleration))
        out = np.empty((len(states), u.shape[1], 4))
        self._along(states, u, static, kinetic, GRAVITY, dt, out)
        return out

    def squares(
        self, state: FloatArray, acceleration: FloatArray, command: FloatArray, frictions: Sequence[Friction]
    ) -> FloatArray:
        """Slide an object along pan accelerations under F frictions, and add up its squared distances to the command.

        Args:
            state: (4,) object position (m) and velocity (m/s) relative to the pan before the first sample.
            acceleration: (n, 2) or (n, 3) of the pan (m/s^2), of which it stays in contact; n at least K - 1.
            command: (K, 2) where the object should be before each sample (m).
            frictions: F of them.

        Returns:
            (F,) sums (m^2).
        """
        state, u = (np.ascontiguousarray(each, dtype=np.float64) for each in (state, acceleration))
        command = np.ascontiguousarray(command, dtype=np.float64).view()
        command.setflags(write=False)  # as a command's positions are: numba compiles for each kind
        static, kinetic = np.array([(each.static, each.kinetic) for each in frictions]).T.copy()
        out = np.empty(len(frictions))
        self._add_squares(state, u, command, static, kinetic, GRAVITY, DT, out)
        return out


_compiled: CompiledLaw | None = None


def run_compiled(use: bool) -> bool:
    """Let numba run the law from now on, in all of this process, or no longer; see `runtime.compilation.compile_law`.

    Returns:
        Whether numba is used: False where it is not installed.
    """
    global _compiled
    compile_one = compiler() if use else None
    if compile_one is None:
        _compiled = None
        return False
    _compiled = CompiledLaw(compile_one)
    return True


def compiled_law() -> CompiledLaw | None:
    """Return the law as numba runs it, None where it does not."""
    return _compiled


def slide_step_batch(
    p: FloatArray,
    v: FloatArray,
    u: FloatArray,
    static_limit: FloatArray,
    kinetic_limit: FloatArray,
    dt: float,
) -> tuple[FloatArray, FloatArray]:
    """Advance many objects by one sample: `slide_step` over arrays, operation for operation.

    Args:
        p, v, u: (2, B) object position (m), object velocity (m/s), pan acceleration (m/s^2).
        static_limit, kinetic_limit: (B,) mu n and mu' n (m/s^2).
        dt: sampling interval (s).

    Returns:
        The next p and v, each (2, B).
    """
    speed = np.sqrt(v[0] * v[0] + v[1] * v[1])
    sliding = speed > 0.0
    push = np.sqrt(u[0] * u[0] + u[1] * u[1])
    breaking = ~sliding & (push >= static_limit) & (push > 0.0)
    # The divisors of objects that take another branch are replaced by 1, so that nothing divides by zero.
    slide = -u - kinetic_limit * v / np.where(sliding, speed, 1.0)
    breakaway = -u + static_limit * u / np.where(breaking, push, 1.0)
    a = np.where(sliding, slide, np.where(breaking, breakaway, 0.0))
    next_v = v + a * dt
    stops = sliding & (next_v[0] * v[0] + next_v[1] * v[1] <= 0.0)
    a = np.where(stops, -v / dt, a)
    next_v = np.where(stops, 0.0, next_v)
    return p + v * dt + a * (0.5 * dt * dt), next_v


def slide_batch(
    states: FloatArray,
    acceleration: FloatArray,
    static: FloatArray | float,
    kinetic: FloatArray | float,
    dt: float = DT,
) -> FloatArray:
    """Slide many objects, each along its own sequence of pan accelerations (Eqs. 4 and 9).

    Args:
        states: (B, 4) object position (m) and velocity (m/s) relative to the pan before the first sample.
        acceleration: (B, n, 2) or, of pans that lift, (B, n, 3) pan acceleration (m/s^2).
        static, kinetic: friction coefficients, one for all or (B,).
        dt: sampling interval (s).

    Returns:
        (B, n, 4) object states after each sample.

    Raises:
        InputError: a pan falls away from its object.
    """
    batch, samples, columns = acceleration.shape
    inputs = np.ascontiguousarray(acceleration.transpose(1, 2, 0))
    normal = np.broadcast_to(GRAVITY, (samples, 1))
    if columns == 3 and inputs[:, 2].any():
        check_contact(acceleration)
        normal = GRAVITY + inputs[:, 2]
    static_limits = np.broadcast_to(np.asarray(static, dtype=np.float64) * normal, (samples, batch))
    kinetic_limits = np.broadcast_to(np.asarray(kinetic, dtype=np.float64) * normal, (samples, batch))
    p, v = states.T[:2], states.T[2:]
    out = np.empty((samples, 4, batch))
    for k in range(samples):
        p, v = slide_step_batch(p, v, inputs[k, :2], static_limits[k], kinetic_limits[k], dt)
        out[k, :2], out[k, 2:] = p, v
    return np.ascontiguousarray(out.transpose(2, 0, 1))
