"""A plan as npz: its document as arrays with dotted names."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from runtime.errors import InputError


def to_npz(document: Mapping[str, Any]) -> bytes:
    """Return a plan's document as the bytes of an npz file."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **_flatten(document))
    return buffer.getvalue()


def _flatten(document: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Lay a document out as arrays with dotted names; null, which no array can hold, becomes NaN."""
    arrays: dict[str, Any] = {}
    for name, value in document.items():
        if isinstance(value, Mapping):
            arrays.update(_flatten(value, f"{prefix}{name}."))
        elif isinstance(value, list) and not value:  # the only lists that may be empty are those of texts
            arrays[prefix + name] = np.array([], dtype=np.str_)
        else:
            arrays[prefix + name] = np.array(np.nan if value is None else value)
    return arrays


def from_npz(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return the document that `to_npz` laid out as these arrays.

    Raises:
        InputError: a name is both a value and a group.
    """
    document: dict[str, Any] = {}
    for dotted, array in arrays.items():
        *groups, name = dotted.split(".")
        place = document
        for group in groups:
            place = place.setdefault(group, {})
            if not isinstance(place, dict):
                raise InputError(f"{dotted!r} is below a value")
        if name in place:
            raise InputError(f"{dotted!r} is both a value and a group")
        value = array.tolist() if array.ndim == 0 or array.dtype.kind == "U" else array
        place[name] = None if isinstance(value, float) and np.isnan(value) else value
    return document
