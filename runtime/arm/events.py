"""Events of a simulated run, as they are written on the command line: `push@0.5=1.0,0` or `friction@0.5=0.3`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from runtime.arm.engine import Engine
from runtime.arm.interface import Measured
from runtime.arm.run import Hook
from runtime.errors import InputError
from runtime.friction import MAX_COEFFICIENT
from runtime.physics.law import DT

PUSH_DURATION = 0.05
"""Time for which a push lasts (s)."""

MAX_PUSH = 100.0
"""Largest force of a push (N)."""

FORMS = "push@SECONDS=FX,FY (N, for 0.05 s) or friction@SECONDS=MU"


@dataclass(frozen=True)
class Event:
    """Something that happens to the object at a given time.

    Attributes:
        kind: "push" or "friction".
        time: when (s).
        values: the force (N), x and y in the world, or the new friction coefficient.
    """

    kind: str
    time: float
    values: tuple[float, ...]

    @classmethod
    def parse(cls, text: str) -> Event:
        """Read an event as it is written on the command line.

        Raises:
            InputError: not of the form, or a number beyond what makes sense.
        """
        head, _, tail = text.partition("=")
        kind, _, moment = head.partition("@")
        try:
            time, values = float(moment), tuple(float(part) for part in tail.split(","))
        except ValueError:
            raise InputError(f"--disturb {text!r} must be {FORMS}") from None
        if {"push": 2, "friction": 1}.get(kind) != len(values):
            raise InputError(f"--disturb {text!r} must be {FORMS}")
        if not 0.0 <= time < math.inf:
            raise InputError(f"--disturb {text!r}: the time must be 0 s or later")
        if kind == "push" and not math.hypot(*values) <= MAX_PUSH:
            raise InputError(f"--disturb {text!r}: the force must be at most {MAX_PUSH:g} N")
        if kind == "friction" and not 0.0 <= values[0] <= MAX_COEFFICIENT:
            raise InputError(f"--disturb {text!r}: friction must be between 0 and {MAX_COEFFICIENT:g}")
        return cls(kind, time, values)

    def hook(self, engine: Engine) -> Hook:
        """Return what lets it happen in a simulated arm's engine."""
        first = round(self.time / DT)
        act: Callable[[], None]
        if self.kind == "push":
            last, act = first + round(PUSH_DURATION / DT), lambda: engine.push(np.array(self.values))
        else:
            last, act = first + 1, lambda: engine.set_friction(self.values[0])

        def hook(k: int, measured: Measured) -> None:
            if first <= k < last:
                act()

        return hook
