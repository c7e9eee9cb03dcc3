"""What a client asks for, as the JSON document that the server reads."""

from __future__ import annotations

import dataclasses
from typing import Any

from numpy.typing import ArrayLike

from runtime.command import Command
from runtime.documents.checks import number, table
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.law import DT
from runtime.sizes import Sizes
from runtime.start import Start

Option = Friction | Limits | Start | Sizes | float | None


def command_document(position: Command | ArrayLike) -> dict[str, Any]:
    """Return the document of a command.

    Args:
        position: a Command, or (K, 2) where the object should be, relative to the pan (m), at 1 kHz.

    Raises:
        InputError: another shape, or a value that is no finite number. The server checks the rest.
    """
    points = position.position if isinstance(position, Command) else table(position, "position")
    return {"dt": DT, "position": points.tolist()}


def options_document(**options: Option) -> dict[str, Any]:
    """Return the documents of the options that are given; the server has values for the rest.

    Raises:
        InputError: the limits are not finite, or a number is none.
    """
    return {name: _document(name, value) for name, value in options.items() if value is not None}


def _document(name: str, value: Option) -> Any:
    if isinstance(value, Limits) and not value.finite:
        raise InputError("a server plans within limits: these are not finite", name)
    if isinstance(value, (Friction, Limits, Start, Sizes)):
        if not isinstance(value, Start):
            return value.to_dict()
        return {key: item for key, item in dataclasses.asdict(value).items() if item is not None}
    number(value, name)
    return value
