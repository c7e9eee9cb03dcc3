"""A plan as one table: a row for each sample, and after the command's rows those of the stop."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import slide_one
from runtime.physics.pan import integrate_pan

AXES = "xyz"

NO_STOP: Mapping[str, Any] = {"acceleration": ()}
"""What documents lack that were written before plans had a stop."""

TIME_DIGITS = 9
"""Decimals of the times (s): 0.007, and not 0.007000000000000001."""


def columns(document: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Return the columns of a plan's table, SI units throughout.

    Of the stop there are a row for each of its accelerations and one in which the pan rests; the object is predicted by
    the law of friction, and the command stays at its last position.

    Args:
        document: a plan's, with the arrays as they are.

    Returns:
        By name: `t`; x and y of `command_`, `object_`, `object_v`, `pan_`, `pan_v` and `pan_a`, of a pan that lifts z
        of the last three too; `stop`, True in the rows after the command.
    """
    command, sliding, pan = (document[part] for part in ("command", "object", "pan"))
    parts = {
        "command_": command["position"],
        "object_": sliding["position"],
        "object_v": sliding["velocity"],
        "pan_": pan["position"],
        "pan_v": pan["velocity"],
        "pan_a": pan["acceleration"],
    }
    samples = len(parts["command_"])
    if len(document.get("stop", NO_STOP)["acceleration"]):
        stop = _stop_rows(document)
        parts = {name: np.concatenate([values, stop[name]]) for name, values in parts.items()}
    rows = np.arange(len(parts["command_"]))
    return {
        "t": np.round(rows * document["dt"], TIME_DIGITS),
        **{f"{name}{axis}": values[:, i] for name, values in parts.items() for i, axis in _axes(values)},
        "stop": rows >= samples,
    }


def _axes(values: FloatArray) -> list[tuple[int, str]]:
    return list(enumerate(AXES[: values.shape[1]]))


def _stop_rows(document: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Return the rows after the command's last, under the names of `columns`."""
    dt, sliding, pan = document["dt"], document["object"], document["pan"]
    last = pan["acceleration"][-1:]
    acceleration = np.concatenate([document["stop"]["acceleration"], np.zeros_like(last)])
    acting = np.concatenate([last, acceleration[:-1]])  # the last row's leads to the stop's first
    moved = integrate_pan(np.concatenate([pan["position"][-1], pan["velocity"][-1]]), acting, dt)
    begin = np.concatenate([sliding["position"][-1], sliding["velocity"][-1]])
    slid = slide_one(begin, acting, Friction.from_dict(document["friction"]), dt)
    axes = last.shape[1]
    return {
        "command_": np.repeat(document["command"]["position"][-1:], len(acceleration), axis=0),
        "object_": slid[:, :2],
        "object_v": slid[:, 2:],
        "pan_": moved[:, :axes],
        "pan_v": moved[:, axes:],
        "pan_a": acceleration,
    }
