"""Parquet files; needs the extra [parquet], which is pyarrow."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from runtime.errors import InputError, extra


def parse_parquet(data: bytes) -> dict[str, NDArray[Any]]:
    """Read the columns of a Parquet file.

    Raises:
        InputError: it is not readable.
        MissingExtraError: pyarrow is not installed.
    """
    with extra("parquet"):
        import pyarrow
        from pyarrow import parquet
    try:
        table = parquet.read_table(pyarrow.BufferReader(data))
        return {name: table.column(name).to_numpy() for name in table.column_names}
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise InputError(f"not a readable Parquet file: {' '.join(str(error).split())}") from error
