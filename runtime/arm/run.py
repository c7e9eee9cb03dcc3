"""Executes a plan on an arm: open loop, or in closed loop with a network that sees what is measured (Section V-B)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from runtime.arm.interface import Arm, Measured, ObjectStatus, PanCommand
from runtime.arm.tail import brake
from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.physics.law import DT
from runtime.physics.pan import integrate_pan
from runtime.plan import Plan

MAX_DURATION = 60.0
"""Longest plan executed (s)."""

MAX_ACCELERATION = 1e4
"""Largest pan acceleration of a plan (m/s^2): a thousand times what an arm can do, so it is another unit or broken."""

PAN_MISMATCH = 1e-6
"""Largest difference between a plan's pan position and what its accelerations lead to (m): rounding is far below."""


class Follower(Protocol):
    """What `Planner.stream` gives: decodes a command chunk by chunk from measured states; see `runtime.Stream`."""

    def step(self, pan_state: FloatArray, object_state: FloatArray) -> FloatArray:
        """Give the accelerations (C, 3) (m/s^2) of the next chunk from the last C states, (C, 6) and (C, 4)."""


Source = Callable[[int, Sequence[Measured]], FloatArray | None]
"""Gives the pan acceleration (3,) (m/s^2) from t_k to t_(k+1), given k and what was measured at t_0..t_k; None past its
end."""

RESTED = 3
"""Chunks of rest past the end of the command after which a closed loop is over: an object that slides on rests then."""

LONGEST_ENDING = 2.0
"""Time (s) past the end of the command in which a closed loop should have brought the pan to rest."""

Hook = Callable[[int, Measured], None]
"""Called before each sample with k and what was measured at t_k: an event, a camera, a clock."""


@dataclass(frozen=True, eq=False)
class Recording:
    """What was measured and commanded at t_0, t_1, ..., the tail included; n rows each.

    Attributes:
        measured: one for each sample.
        pan_command: (n, 6) commanded position relative to where the pan began (m) and velocity (m/s).
        pan_acceleration: (n, 3) commanded (m/s^2); row k acts from t_k to t_(k+1).
        duration: time the arm and the network took (s); cameras and other hooks do not count.
        interrupted: whether the run was stopped before its end.
    """

    measured: tuple[Measured, ...]
    pan_command: FloatArray
    pan_acceleration: FloatArray
    duration: float
    interrupted: bool

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.measured)

    @property
    def pan(self) -> FloatArray:
        """(n, 6) measured position relative to where the pan began (m) and velocity (m/s)."""
        return np.array([each.pan for each in self.measured])

    @property
    def sliding(self) -> FloatArray:
        """(n, 4) measured position (m) and velocity (m/s) of the object in the pan's frame."""
        return np.array([each.sliding for each in self.measured])


def check_plan(plan: Plan) -> None:
    """Check that a plan can be executed.

    Raises:
        InputError: it has another dt, is longer than 60 s, has an absurd acceleration, or its pan does not begin at
            rest at the origin and move as its accelerations say.
    """
    if plan.dt != DT:
        raise InputError(f"dt is {plan.dt:g} s, the arm is controlled every {DT:g} s")
    duration = len(plan) * plan.dt
    if duration > MAX_DURATION:
        raise InputError(f"the plan lasts {duration:g} s, at most {MAX_DURATION:g} s are executed")
    largest = float(np.abs(plan.pan_acceleration).max())
    if largest > MAX_ACCELERATION:
        raise InputError(
            f"pan.acceleration has {largest:.3g} m/s^2, at most {MAX_ACCELERATION:g} m/s^2 are tried (is it in m/s^2?)"
        )
    led_to = integrate_pan(np.zeros(6), plan.pan_acceleration)[:-1, :3]
    mismatch = np.abs(plan.pan_position - np.concatenate([np.zeros((1, 3)), led_to])).max()
    if mismatch > PAN_MISMATCH:
        raise InputError(
            f"pan.position differs by {mismatch:.3g} m from what pan.acceleration leads to from rest at the origin, "
            f"at most {PAN_MISMATCH:g} m is rounding"
        )


def open_loop(plan: Plan) -> Source:
    """Give the plan's own accelerations, and those of its stop."""
    u = np.concatenate([plan.pan_acceleration, plan.stop_acceleration])
    return lambda k, measured: u[k] if k < len(u) else None


def closed_loop(follower: Follower, chunk: int, samples: int) -> Source:
    """Let a network decode again, every C samples, from the last C measured states.

    An object that has left the pan is shown to the network where it was last seen on it. The source ends when the
    follower has let the pan rest for RESTED chunks past the end of its command, and LONGEST_ENDING after that end at
    the latest.

    Args:
        follower: what decodes.
        chunk: samples it decodes at a time, C.
        samples: of its command, K.
    """
    u, rested = np.zeros((chunk, 3)), 0

    def source(k: int, measured: Sequence[Measured]) -> FloatArray | None:
        nonlocal u, rested
        if k % chunk == 0:
            seen = list(measured[1:][-chunk:]) or [measured[0]] * chunk
            pan, sliding = np.array([each.pan for each in seen]), np.array([each.sliding for each in seen])
            if seen[-1].status is ObjectStatus.OFF_PAN:
                last = next((each for each in reversed(measured) if each.status is not ObjectStatus.OFF_PAN), seen[0])
                sliding[:] = last.sliding
            u = follower.step(pan, sliding)
            rested = 0 if u.any() or k < samples else rested + 1
        now: FloatArray = u[k % chunk]
        return None if rested > RESTED or k >= samples + round(LONGEST_ENDING / DT) else now

    return source


def execute(plan: Plan, arm: Arm, source: Source, hooks: Sequence[Hook] = ()) -> Recording:
    """Execute a plan's command and bring the pan to rest; the arm is closed in the end, whatever happens.

    Each sample: the source gives the pan acceleration, the double integrator of Eq. 3 what it makes of the commanded
    pan, and the arm is told both. Where the source ends the tail takes its place: it brakes a pan that still moves,
    and holds it still. An interrupt from the keyboard ends the run, and what was recorded is returned.

    Args:
        plan: gives the command, the object's start and the friction assumed.
        arm: executes.
        source: gives the pan's accelerations.
        hooks: called before each sample.
    """
    log = _Log()
    try:
        measured, pan = arm.reset(plan.object_position[0]), np.zeros(6)
        measured, pan = log.follow(arm, measured, pan, lambda k: source(k, log.measured), hooks)
        ended, tail = len(log), brake(pan, measured.sliding, plan.friction)
        log.follow(arm, measured, pan, lambda k: tail[k - ended] if k < ended + len(tail) else None, hooks)
    except KeyboardInterrupt:
        return log.recording(interrupted=True)
    finally:
        arm.close()
    return log.recording(interrupted=False)


class _Log:
    """Steps the arm and keeps what was measured and commanded."""

    def __init__(self) -> None:
        self.measured: list[Measured] = []
        self._pan: list[FloatArray] = []
        self._u: list[FloatArray] = []
        self._duration = 0.0

    def __len__(self) -> int:
        """Return the number of samples executed."""
        return len(self._u)

    def follow(
        self,
        arm: Arm,
        measured: Measured,
        pan: FloatArray,
        source: Callable[[int], FloatArray | None],
        hooks: Sequence[Hook],
    ) -> tuple[Measured, FloatArray]:
        """Execute what a source gives, until it ends.

        Args:
            arm: executes.
            measured, pan: what was measured and commanded last; `pan` (6,) position and velocity (m, m/s).
            source: the acceleration (3,) of sample k (m/s^2), None at the end.
            hooks: called before each sample.

        Returns:
            What was measured and commanded last.
        """
        while True:
            k = len(self)
            self.measured.append(measured)
            begin = time.perf_counter()
            u = source(k)
            self._duration += time.perf_counter() - begin
            if u is None:
                self.measured.pop()
                return measured, pan
            for hook in hooks:
                hook(k, measured)
            begin = time.perf_counter()
            measured = arm.step(PanCommand(pan[:3], pan[3:], u))
            self._duration += time.perf_counter() - begin
            self._pan.append(pan)
            self._u.append(u)
            pan = integrate_pan(pan, u[None])[0]

    def recording(self, interrupted: bool) -> Recording:
        """Return what was recorded; of a sample cut short nothing is kept."""
        samples = len(self._u)
        pan, u = np.array(self._pan[:samples]).reshape(-1, 6), np.array(self._u).reshape(-1, 3)
        return Recording(tuple(self.measured[:samples]), pan, u, self._duration, interrupted)
