"""Strict checks of what was written by somebody else: numbers, texts, columns and tables, each named by its place.

A key is the text of a path, as in `limits.jerk`; it stands in the message, and the error carries it as its place.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.errors import InputError

FloatArray = NDArray[np.float64]


def fields(value: object, where: str, names: Sequence[str], optional: Sequence[str] = ()) -> Mapping[str, Any]:
    """Check that a value is an object with exactly these keys.

    Args:
        value: the parsed value.
        where: its key in the document, "" for the document itself.
        names: the keys it must have.
        optional: the keys it may have.

    Raises:
        InputError: not an object, a key is missing, or a key is unknown.
    """
    place = f"{where}: " if where else ""
    if not isinstance(value, Mapping):
        raise InputError(f"{place}must be an object with the keys {', '.join(names)}, got {reprlib.repr(value)}", where)
    for name in names:
        if name not in value:
            raise InputError(f"{place}missing key {name!r}", where)
    for name in value:
        if name not in names and name not in optional:
            raise InputError(f"{place}unknown key {reprlib.repr(name)}", where)
    return value


def check_format(value: object, expected: str, way_out: str = "") -> None:
    """Check the `format` of a document, before anything else of it is looked at.

    Args:
        value: the parsed document.
        expected: its format.
        way_out: what to do about another one, for the message.

    Raises:
        InputError: not an object, or of another format or version.
    """
    found = value.get("format") if isinstance(value, Mapping) else None
    if not isinstance(found, str) or found != expected:
        hint = f": {way_out}" if way_out else ""
        raise InputError(f"format must be {expected!r}, got {reprlib.repr(found)}{hint}", "format")


def number(value: object, key: str, place: str | None = None) -> float:
    """Check that a value is a finite number: not a boolean, not a string, not null.

    Args:
        value: the value.
        key: what the message calls it.
        place: the text of its path, where that is another.

    Raises:
        InputError: it is not.
    """
    place = key if place is None else place
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InputError(f"{key} must be a number, got {reprlib.repr(value)}", place)
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise InputError(f"{key}: {reprlib.repr(value)} is not a finite number", place)
    return result


def check_ranges(values: object, ranges: Sequence[tuple[str, float, float, str]]) -> None:
    """Check that attributes of an object are within their ranges.

    Args:
        values: the object.
        ranges: of each its name, the lowest and the highest value, and the unit as the message has it, with a space.

    Raises:
        InputError: one is not, or is not a number.
    """
    for name, low, high, unit in ranges:
        value = getattr(values, name)
        if not low <= value <= high:  # which a NaN is not either
            words = name.replace("_", " ")
            raise InputError(f"{words} must be between {low:g} and {high:g}{unit}, got {value:g}", name)


def text(value: object, key: str) -> str:
    """Check that a value is a line of printable text, which a terminal can be shown.

    Raises:
        InputError: not a string, or it holds control characters.
    """
    if not isinstance(value, str) or not value.isprintable():
        raise InputError(f"{key} must be printable text, got {reprlib.repr(value)}", key)
    return value


def column(value: object, key: str) -> FloatArray:
    """Check that a value is a list of finite numbers.

    Returns:
        (n,) a fresh array.

    Raises:
        InputError: another shape, an element that is no finite number; the index is named (from 0).
    """
    if not isinstance(value, (np.ndarray, list, tuple)):
        raise InputError(f"{key} must be a list of numbers, got {reprlib.repr(value)}", key)
    if isinstance(value, np.ndarray):
        _check_dtype(value, key)
        if value.ndim != 1:
            raise InputError(f"{key} must have the shape (K,), got {value.shape}", key)
        result = value.astype(np.float64)
    else:
        result = np.array([number(item, f"{key}[{index}]") for index, item in enumerate(value)], dtype=np.float64)
    for index in np.flatnonzero(~np.isfinite(result)):
        raise InputError(f"{key}[{index}]: {result[index]} is not a finite number", f"{key}[{index}]")
    return result


ROWS = {2: "a pair of numbers [x, y]", 3: "a triple of numbers [x, y, z]"}
"""What a row of a table is, by its width."""


def table(value: object, key: str, width: int = 2) -> FloatArray:
    """Check that a value is a list of pairs [x, y], or of triples [x, y, z], of finite numbers.

    Args:
        value: nested lists or an array (anything with `__array__`).
        key: its name, for the message.
        width: numbers in a row, 2 or 3.

    Returns:
        (n, width) a fresh array.

    Raises:
        InputError: another shape, ragged, an element that is no finite number; row (from 0) and column are named.
    """
    if hasattr(value, "__array__"):
        value = np.asarray(value)
        _check_dtype(value, key)
        if value.ndim != 2 or value.shape[1] != width:
            raise InputError(f"{key} must have the shape (K, {width}), got {value.shape}", key)
        with np.errstate(invalid="ignore"):  # NaN of any kind is named below
            result = value.astype(np.float64)
    elif isinstance(value, (list, tuple)):
        items: list[float] = []
        for index, row in enumerate(value):
            if not isinstance(row, (list, tuple, np.ndarray)) or len(row) != width:
                place = f"{key}[{index}]"
                raise InputError(f"{place} must be {ROWS[width]}, got {reprlib.repr(row)}", place)
            for axis, item in enumerate(row):
                plain = type(item) is float  # most are: no message is put together for them
                if not plain:
                    item = number(item, f"{key}[{index}], column {'xyz'[axis]}", f"{key}[{index}][{axis}]")
                items.append(item)
        result = np.array(items, dtype=np.float64).reshape(-1, width)
    else:
        rows = "pairs of numbers [x, y]" if width == 2 else "triples of numbers [x, y, z]"
        raise InputError(f"{key} must be a list of {rows}, got {reprlib.repr(value)}", key)
    for row, axis in np.argwhere(~np.isfinite(result)):
        message = f"{key}[{row}], column {'xyz'[axis]}: {result[row, axis]} is not a finite number"
        raise InputError(message, f"{key}[{row}][{axis}]")
    return result


def _check_dtype(array: NDArray[Any], key: str) -> None:
    if array.dtype.kind not in "fiu":
        raise InputError(f"{key} must hold numbers, got an array of {array.dtype}", key)
