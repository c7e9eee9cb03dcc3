"""A plan as CSV: the table of `runtime.outputs.columns`, every float with all its digits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from runtime.outputs.columns import columns


def to_csv(document: Mapping[str, Any]) -> bytes:
    """Return a plan's document as a table: a line of names, commas, points; 1 in the column `stop` is True."""
    table = columns(document)
    texts = [map(repr, (values.astype(int) if values.dtype == bool else values).tolist()) for values in table.values()]
    lines = [",".join(table), *map(",".join, zip(*texts, strict=True))]
    return "\n".join([*lines, ""]).encode("ascii")
