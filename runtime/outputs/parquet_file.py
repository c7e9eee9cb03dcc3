"""A plan as Parquet: the table of `runtime.outputs.columns`, and beside it what is no column."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from runtime.errors import extra
from runtime.outputs.columns import columns

METADATA = b"slide-plan"
"""Key of the file's metadata under which the rest of the document is, as JSON."""


def check_parquet() -> None:
    """Check that Parquet can be written.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """
    with extra("parquet"):
        import pyarrow.parquet  # noqa: F401


def to_parquet(document: Mapping[str, Any]) -> bytes:
    """Return a plan's document as the bytes of a Parquet file.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """
    check_parquet()
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.table(columns(document))
    table = table.replace_schema_metadata({METADATA: json.dumps(scalars(document))})
    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(table, sink)
    data: bytes = sink.getvalue().to_pybytes()
    return data


def scalars(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of a plan's document is no column: format, dt, model, friction, sizes, quality."""
    return {name: value for name, value in document.items() if name not in ("command", "pan", "object", "stop")}
