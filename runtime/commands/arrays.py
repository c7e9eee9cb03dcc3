"""Arrays of other libraries, without importing them: pandas, torch, masked arrays, numpy's dates."""

from __future__ import annotations

import re
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any

import numpy as np

from runtime.commands.columns import choose, choose_unnamed, told
from runtime.commands.points import Points
from runtime.commands.reading import Reading
from runtime.documents.checks import FloatArray, column, number, table
from runtime.errors import InputError

DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
"""How a date in a document begins."""


def plain(value: object, key: str) -> object:
    """Return an array-like value as a numpy array, and anything else as it is.

    Args:
        value: a numpy array, masked or not, a torch tensor, a pandas Series or Index, a list.
        key: its name, for the message.

    Raises:
        InputError: an element is masked or missing; its row is named.
    """
    if hasattr(value, "detach"):  # a torch tensor that takes part in a gradient, or lies on a GPU
        value = value.detach().cpu()
    if np.ma.isMaskedArray(value):
        masked: Any = value
        for row in np.flatnonzero(np.ma.getmaskarray(masked).reshape(len(masked), -1).any(axis=1))[:1]:
            raise InputError(f"{key}[{row}] is masked: a value is missing there", f"{key}[{row}]")
        return masked.filled()
    if isinstance(value, np.ndarray) or not hasattr(value, "__array__"):
        return value
    try:
        return np.asarray(value)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{key} is no array of numbers: {error}") from error


def times(value: object, key: str) -> FloatArray:
    """Return times (n,) in seconds; dates of numpy or pandas are taken from the first on.

    Raises:
        InputError: they are not a list of finite numbers or of dates.
    """
    value = plain(value, key)
    if isinstance(value, list) and value and all(isinstance(each, str) and DATE.match(each) for each in value):
        with suppress(ValueError):
            dates = [datetime.fromisoformat(each) for each in value]
            dates = [date if date.tzinfo else date.replace(tzinfo=UTC) for date in dates]
            value = np.array([(date - dates[0]).total_seconds() for date in dates])
    if isinstance(value, np.ndarray) and value.dtype.kind in "mM":
        for row in np.flatnonzero(np.isnat(value))[:1]:
            raise InputError(f"{key}[{row}] is missing", f"{key}[{row}]")
        return np.asarray(value - value[:1]) / np.timedelta64(1, "s")
    return column(value, key)


def interval(value: object) -> float:
    """Return a sampling interval (s).

    Raises:
        InputError: it is no number above zero.
    """
    dt = number(value, "dt")
    if dt <= 0.0:
        raise InputError(f"dt must be greater than 0 s, got {dt:g} s", "dt")
    return dt


def positions(value: object, key: str = "position") -> FloatArray:
    """Return positions (n, 2), unchecked by size.

    Raises:
        InputError: they are not pairs of finite numbers.
    """
    return table(plain(value, key), key)


def from_samples(value: object, reading: Reading) -> Points:
    """Read positions (n, 2), or a DataFrame by the names of its columns.

    Raises:
        InputError: they are not pairs of finite numbers, or columns are not found.
    """
    if is_frame(value) and not _is_nameless(value):
        return from_frame(value, reading)
    return Points(positions(value))


def from_array(value: object, reading: Reading) -> Points:
    """Read positions (n, 2), or a table of more columns that `reading.columns` names.

    Raises:
        InputError: another shape, or columns that nobody named.
    """
    if is_frame(value) and not _is_nameless(value):
        return from_frame(value, reading)
    value = _stacked(plain(value, "position"))
    if isinstance(value, np.ndarray) and value.ndim == 2 and len(value) in (2, 3) and value.shape[1] > 3:
        wanted = value.shape[::-1]
        raise InputError(
            f"position must have a row for each sample, got the shape {value.shape}: transpose it, {wanted}"
        )
    if isinstance(value, np.ndarray) and value.dtype.names:
        return from_columns({name: value[name] for name in value.dtype.names}, reading)
    if not isinstance(value, np.ndarray) or value.ndim != 2 or (value.shape[1] == 2 and not reading.columns):
        return Points(table(value, "position"))
    if value.shape[1] == 1:
        raise InputError(f"position must have the shape (K, 2), got {value.shape}")
    choice = choose_unnamed(value.shape[1], reading.columns)
    t = [column(value[:, index], "t") for index, _ in choice.t]
    return Points(
        table(value[:, [choice.x, choice.y]], "position"),
        t[0] if t else None,
        found=told([str(index + 1) for index in range(value.shape[1])], choice),
    )


def is_frame(value: object) -> bool:
    """Return whether a value is a DataFrame of pandas, or of a library that looks like it."""
    return hasattr(value, "columns") and hasattr(value, "__getitem__") and hasattr(value, "to_numpy")


def _is_nameless(frame: Any) -> bool:
    """Return whether a DataFrame's columns are only numbered."""
    return all(str(name).isdecimal() for name in frame.columns)


def from_frame(value: Any, reading: Reading) -> Points:
    """Read a DataFrame by its columns' names; a DatetimeIndex or TimedeltaIndex is its time if no column is."""
    names = [str(name) for name in value.columns]
    columns = {
        name: value.iloc[:, index] if hasattr(value, "iloc") else value[name] for index, name in enumerate(names)
    }
    index: Any = getattr(value, "index", None)
    if getattr(getattr(index, "dtype", None), "kind", "") in ("m", "M"):
        columns.setdefault("time", index)
    elif getattr(index, "name", None):
        columns.setdefault(str(index.name), index)
    return from_columns(columns, reading)


def from_columns(columns: dict[str, Any], reading: Reading) -> Points:
    """Read a table that is given by its columns, each under its name.

    Raises:
        InputError: columns are not found, differ in length, or hold something else than finite numbers.
    """
    names = list(columns)
    choice = choose(names, reading.columns)
    x, y = (column(plain(columns[names[index]], names[index]), names[index]) for index in (choice.x, choice.y))
    if len(x) != len(y):
        raise InputError(f"{names[choice.x]} has {len(x)} rows, {names[choice.y]} has {len(y)}")
    parts = [(times(columns[names[index]], names[index]), unit) for index, unit in choice.t]
    t, unit = None, None
    if parts:
        t, unit = parts[0] if len(parts) == 1 else (np.sum([part * each for part, each in parts if each], axis=0), 1.0)
        if getattr(plain(columns[names[choice.t[0][0]]], "t"), "dtype", np.dtype(float)).kind in "mM":
            unit = 1.0
    return Points(np.column_stack([x, y]), t, unit=choice.unit, time_unit=unit, found=told(names, choice))


def _stacked(value: object) -> object:
    """Return a list of rows of three numbers or more as an array, and anything else as it is.

    Raises:
        InputError: a row has another length than the first, or an element is no finite number.
    """
    if not (isinstance(value, list) and value and isinstance(value[0], (list, tuple)) and len(value[0]) > 2):
        return value
    rows = []
    for index, row in enumerate(value):
        place = f"position[{index}]"
        if not isinstance(row, (list, tuple)) or len(row) != len(value[0]):
            raise InputError(f"{place} must have {len(value[0])} numbers, as the first row has", place)
        rows.append([number(item, f"{place}[{column}]") for column, item in enumerate(row)])
    return np.array(rows, dtype=np.float64)
