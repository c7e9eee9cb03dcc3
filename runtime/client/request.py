"""What a client asks for, as the JSON document that the server reads."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from runtime.documents.checks import table
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.law import DT
from runtime.start import Start


def command_document(position: ArrayLike) -> dict[str, Any]:
    """Return the document of a command.

    Args:
        position: (K, 2) where the object should be, relative to the pan (m), at 1 kHz.

    Raises:
        InputError: another shape, or a value that is no finite number. The server checks the rest.
    """
    return {"dt": DT, "position": table(position, "position").tolist()}


def options_document(friction: Friction | None, limits: Limits | None, start: Start | None) -> dict[str, Any]:
    """Return the documents of what is given; the server has values for the rest.

    Raises:
        InputError: the limits are not finite.
    """
    if limits is not None and not limits.finite:
        raise InputError("a server plans within limits: these are not finite", "limits")
    given = {"friction": friction, "limits": limits, "start": start}
    return {
        name: {key: item for key, item in vars(value).items() if item is not None}
        for name, value in given.items()
        if value is not None
    }
