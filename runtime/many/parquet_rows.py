"""Parquet data sets of commands: a row for each; needs the extra [parquet], which is pyarrow.

Columns: `position`, a list of pairs (m); where the positions are not at 1 kHz, `t`, a list of times (s); where they are
not the same for all rows, `friction` and `limits`, each a struct, or a list of its numbers in the order of its fields;
limits also by their name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from runtime.documents.parameters import Parameters
from runtime.errors import InputError, extra
from runtime.friction import Friction
from runtime.limits import Limits

ROWS_AT_ONCE = 64
"""Rows that are unpacked at once."""

BUFFER = 1 << 20
"""Bytes that are read at once; without a buffer a whole column of a row group would be."""

PARAMETERS: Mapping[str, type[Parameters]] = {"friction": Friction, "limits": Limits}


def is_data_set(file: Path) -> bool:
    """Return whether a Parquet file has a row for each command, and not a row for each sample of one.

    Raises:
        InputError: it is not readable.
        MissingExtraError: pyarrow is not installed.
    """
    with extra("parquet"):
        import pyarrow
    schema = _opened(file).schema_arrow
    return any(pyarrow.types.is_nested(field.type) for field in schema) or "position" in schema.names


def check_schema(file: Path) -> list[str]:
    """Check that a file's columns are those of commands.

    Returns:
        The columns that are passed by.

    Raises:
        InputError: it is not readable, a column is missing, or one is of another type; it is named.
    """
    import pyarrow

    schema = _opened(file).schema_arrow
    if "position" not in schema.names:
        raise InputError(
            f"{file}: there is no column 'position', a list of pairs [x, y] (m); there are {', '.join(schema.names)}"
        )
    for name in ("position", "t", *PARAMETERS):
        if name not in schema.names:
            continue
        if schema.names.count(name) > 1:
            raise InputError(f"{file}: there are {schema.names.count(name)} columns '{name}'")
        found = schema.field(name).type
        if name == "position" and not (
            _is_list(found) and _is_list(found.value_type) and _of_numbers(found.value_type)
        ):
            raise InputError(f"{file}: column 'position' must be a list of pairs [x, y] (m), it is {found}")
        if name == "t" and not (_is_list(found) and _of_numbers(found)):
            raise InputError(f"{file}: column 't' must be a list of times (s), it is {found}")
        if name in PARAMETERS:
            names = [each.name for each in fields(PARAMETERS[name])]
            told = (_is_list(found) and _of_numbers(found)) or (name == "limits" and _is_text(found))
            if not told and not (pyarrow.types.is_struct(found) and {each.name for each in found} <= set(names)):
                text = ", or the name of some" if name == "limits" else ""
                raise InputError(
                    f"{file}: column '{name}' must be a struct of {', '.join(names)}, or a list of these{text}; it is "
                    f"{found}"
                )
    return [name for name in schema.names if name not in ("position", "t", *PARAMETERS)]


def count_rows(file: Path) -> int:
    """Return the number of a file's rows."""
    count: int = _opened(file).metadata.num_rows
    return count


def rows(file: Path) -> Iterator[tuple[str, dict[str, Any], int]]:
    """Yield each row's place, columns and size (bytes).

    Raises:
        InputError: the file is damaged.
    """
    import pyarrow

    opened = _opened(file)
    known = [name for name in opened.schema_arrow.names if name in ("position", "t", *PARAMETERS)]
    number = 0
    try:
        for batch in opened.iter_batches(ROWS_AT_ONCE, columns=known):
            for row in range(len(batch)):
                columns = {name: _value(name, batch.column(name)[row]) for name in known}
                size = sum(each.nbytes for each in columns.values() if isinstance(each, np.ndarray))
                yield f", row {number}", columns, size
                number += 1
    except (pyarrow.ArrowException, OSError) as error:
        raise InputError(f"{file}: not a readable Parquet file: {' '.join(str(error).split())}") from error


def _opened(file: Path) -> Any:
    import pyarrow
    from pyarrow import parquet

    try:
        # pre_buffer would keep every row group that was read until the file is closed
        return parquet.ParquetFile(file, buffer_size=BUFFER, pre_buffer=False, page_checksum_verification=True)
    except (pyarrow.ArrowException, OSError) as error:
        raise InputError(f"{file}: not a readable Parquet file: {' '.join(str(error).split())}") from error


def _is_list(kind: Any) -> bool:
    import pyarrow.types as types

    return bool(types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind))


def _of_numbers(kind: Any) -> bool:
    import pyarrow.types as types

    inner = kind.value_type
    return bool(types.is_floating(inner) or types.is_integer(inner))


def _is_text(kind: Any) -> bool:
    import pyarrow.types as types

    if types.is_dictionary(kind):
        kind = kind.value_type
    return bool(types.is_string(kind) or types.is_large_string(kind) or types.is_string_view(kind))


def _value(name: str, scalar: Any) -> Any:
    """Return a row's value: an array (n, 2) or (n,) where it is one, and a list where numbers or pairs are missing."""
    if name in PARAMETERS:
        value = scalar.as_py()
        if isinstance(value, dict):  # every row of a struct has all of its names: nothing stands there for absent
            return {key: each for key, each in value.items() if each is not None} or None
        return value
    if not scalar.is_valid:
        return None
    values = scalar.values
    if name == "position":
        pairs, values = values, values.flatten()
        lengths = pairs.value_lengths().to_numpy(zero_copy_only=False)  # NaN for one that is missing
        if values.null_count or not (lengths == 2).all():
            return scalar.as_py()
        return values.to_numpy(zero_copy_only=False).reshape(-1, 2)
    return scalar.as_py() if values.null_count else values.to_numpy(zero_copy_only=False)
