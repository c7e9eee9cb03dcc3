"""A plan as JSON: its document, every float with all its digits."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np


def to_json(document: Mapping[str, Any]) -> bytes:
    """Return a plan's document as JSON."""
    return json.dumps(listed(document), allow_nan=False).encode("ascii") + b"\n"


def listed(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a document with lists in the place of arrays."""

    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return listed(value)
        return value.tolist() if isinstance(value, np.ndarray) else value

    return {name: plain(value) for name, value in document.items()}
