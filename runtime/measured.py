"""Measured states as a controller hands them in, checked."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from runtime.documents.checks import FloatArray, number
from runtime.errors import InputError
from runtime.physics.law import DT
from runtime.physics.pan import IN_PLANE
from runtime.start import FARTHEST


def check_pan(value: object, chunk: int | None, level: bool) -> FloatArray | None:
    """Return measured pan states as (C, 6) or (6,), as `check_states` does.

    Args:
        value: what was handed in; for a level pan it may have rows of 4, x, y, vx, vy.
        chunk: number of the last states, C; None where it must be one.
        level: whether the pan is level: what is measured of its height is its frame's or the sensor's, and becomes 0.

    Raises:
        InputError: another shape, or no numbers.
    """
    widths = (4, 6) if level else (6,)
    states = check_state(value, "state", widths) if chunk is None else check_states(value, "pan_state", chunk, widths)
    if states is None or not level:
        return states
    flat = np.zeros((*states.shape[:-1], 6))
    flat[..., IN_PLANE] = states if states.shape[-1] == 4 else states[..., IN_PLANE]
    return flat


def check_state(value: object, name: str, widths: Sequence[int]) -> FloatArray | None:
    """Return one measured state as (w,), as `check_states` does; `widths` says which w may be.

    Raises:
        InputError: another shape, or no numbers.
    """
    shapes = [(width,) for width in widths]
    return _checked(value, name, f"{name} must be {' or '.join(map(str, shapes))} numbers", shapes)


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
    several, one = (" or ".join(form.format(width) for width in widths) for form in (f"({chunk}, {{}})", "({},)"))
    expected = f"{name} must be {several} numbers, the last states, or {one}, the last one only"
    return _checked(value, name, expected, [shape for width in widths for shape in ((chunk, width), (width,))])


def _checked(value: object, name: str, expected: str, shapes: Sequence[tuple[int, ...]]) -> FloatArray | None:
    if value is None:
        return None
    try:
        states: FloatArray = np.asarray(value)
    except ValueError as error:  # ragged
        raise InputError(f"{expected}: {error}", name) from error
    if states.dtype.kind not in "fiu" or states.shape not in shapes:
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
    samples = number(age, "age") / DT
    return round(samples) if math.isfinite(samples) and round(samples) >= 0 else None
