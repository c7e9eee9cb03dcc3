"""A plan as a DataFrame of pandas: the table of `runtime.outputs.columns`, by time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from runtime.errors import extra
from runtime.outputs.columns import columns

if TYPE_CHECKING:
    import pandas


def to_dataframe(document: Mapping[str, Any]) -> pandas.DataFrame:
    """Return a plan's document as a DataFrame whose index is the time `t` (s).

    Raises:
        MissingExtraError: pandas is not installed.
    """
    with extra("pandas"):
        import pandas
    return pandas.DataFrame(columns(document)).set_index("t")
