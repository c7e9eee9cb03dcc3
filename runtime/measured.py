"""Measured states as a controller hands them in: checked, completed, and moved to the present."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from runtime.documents.checks import FloatArray, number
from runtime.errors import InputError
from runtime.physics.law import DT
from runtime.physics.pan import IN_PLANE
from runtime.start import FARTHEST

Move = Callable[[FloatArray, FloatArray], FloatArray]
"""Moves a state (d,) along accelerations (n, 3): the states after each, (n, d)."""


def check_pan(value: object, chunk: int, level: bool) -> FloatArray | None:
    """Return measured pan states as (C, 6) or (6,), as `check_states` does.

    Args:
        value: what was handed in; for a level pan it may have rows of 4, x, y, vx, vy.
        chunk: number of the last states, C.
        level: whether the pan is level: what is measured of its height is its frame's or the sensor's, and becomes 0.

    Raises:
        InputError: another shape, or no numbers.
    """
    states = check_states(value, "pan_state", chunk, (4, 6) if level else (6,))
    if states is None or not level:
        return states
    flat = np.zeros((*states.shape[:-1], 6))
    flat[..., IN_PLANE] = states if states.shape[-1] == 4 else states[..., IN_PLANE]
    return flat


def check_states(value: object, name: str, chunk: int, widths: Sequence[int] = (4,)) -> FloatArray | None:
    """Return measured states as (C, w) or (w,) float64, None if there are none or one cannot be true.

    What cannot be true is no finite number, or beyond FARTHEST: a sensor's error, which must not end a control loop.

    Args:
        value: what was handed in.
        name: what the message calls it.
        chunk: number of the last states, C.
        widths: which w may be.

    Raises:
        InputError: another shape, or no numbers.
    """
    if value is None:
        return None
    several, one = (" or ".join(form.format(width) for width in widths) for form in (f"({chunk}, {{}})", "({},)"))
    expected = f"{name} must be {several} numbers, the last states, or {one}, the last one only"
    try:
        states: FloatArray = np.asarray(value)
    except ValueError as error:  # ragged
        raise InputError(f"{expected}: {error}", name) from error
    if states.dtype.kind not in "fiu" or states.shape not in [shape for w in widths for shape in ((chunk, w), (w,))]:
        raise InputError(f"{expected}, got {states.dtype} of the shape {states.shape}", name)
    found = states.astype(np.float64)
    return found if (np.abs(found) <= FARTHEST).all() else None  # false for what is not a number, too


def check_age(age: object) -> int | None:
    """Return how many samples ago a state was measured, None if it is no age: negative or no finite number.

    Raises:
        InputError: no number at all.
    """
    if isinstance(age, (float, np.floating)) and not math.isfinite(age):
        return None
    samples = round(number(age, "age") / DT)
    return samples if samples >= 0 else None


def complete(measured: FloatArray, late: int, predicted: FloatArray, u: FloatArray, move: Move) -> FloatArray:
    """Return the last C states, from what was measured and what was predicted.

    Args:
        measured: (C, d), or (d,), the last state only.
        late: samples that have passed since the last one, at most C.
        predicted: (C, d) by the last prediction.
        u: (C, 3) what was commanded meanwhile (m/s^2).
        move: moves a state along accelerations.

    Returns:
        (C, d) states. What has passed since is the measured state moved along; where only the last state was
        measured, the prediction is bent towards it, more and more over the chunk.
    """
    chunk = len(predicted)
    last = measured if measured.ndim == 1 else measured[-1]
    since = move(last, u[chunk - late :]) if late else last[None]
    if measured.ndim == 1:
        share = np.arange(1, chunk + 1)[:, None] / chunk
        bent: FloatArray = predicted + share * (since[-1] - predicted[-1])
        return bent
    return np.concatenate([measured[late:], since])[-chunk:] if late else measured
