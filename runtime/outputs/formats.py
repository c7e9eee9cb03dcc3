"""In which file formats a plan is written, by the suffix."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from runtime.documents.writing import is_stream
from runtime.errors import OutputError
from runtime.outputs.csv_file import to_csv
from runtime.outputs.json_file import to_json
from runtime.outputs.npz_file import to_npz
from runtime.outputs.parquet_file import check_parquet, to_parquet

FORMATS: dict[str, Callable[[Mapping[str, Any]], bytes]] = {
    ".json": to_json,
    ".npz": to_npz,
    ".csv": to_csv,
    ".parquet": to_parquet,
}


def format_of(path: Path) -> str:
    """Return the suffix in FORMATS in which a plan is written here; a pipe or device without one gets JSON.

    Raises:
        OutputError: another suffix, or none.
        MissingExtraError: it is Parquet, and pyarrow is not installed.
    """
    suffix = path.suffix.lower()
    if suffix in FORMATS:
        if suffix == ".parquet":
            check_parquet()
        return suffix
    if not suffix and is_stream(path):
        return ".json"
    raise OutputError(f"{path}: a plan is written as .json, .npz, .csv or .parquet, got the suffix {path.suffix!r}")
