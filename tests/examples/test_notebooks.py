"""Notebooks run, show what they have shown, and are pages of the site."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))

LARGEST = 200_000
"""Bytes of a notebook, with what it shows."""

SLOW = {"limits_of_an_arm", "train_a_network"}
"""Those that only `make check` runs."""


def cells(path: Path) -> list[dict[str, Any]]:
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_was_run_from_top_to_bottom_without_an_error_and_is_small(path: Path) -> None:
    assert path.stat().st_size <= LARGEST
    assert [cell["execution_count"] for cell in cells(path)] == list(range(1, len(cells(path)) + 1))
    kinds = {output["output_type"] for cell in cells(path) for output in cell["outputs"]}
    assert kinds <= {"stream", "display_data", "execute_result"}
    assert not [output for cell in cells(path) for output in cell["outputs"] if output.get("name") == "stderr"]


@pytest.mark.parametrize("path", [path for path in NOTEBOOKS if path.stem not in SLOW], ids=lambda path: path.stem)
def test_notebook_runs(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib").use("Agg")
    pytest.importorskip("pandas")
    module = ModuleType("notebook")
    monkeypatch.setitem(sys.modules, "notebook", module)
    for cell in cells(path):
        exec(compile("".join(cell["source"]), path.name, "exec"), vars(module))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_a_page_of_the_site(path: Path) -> None:
    page = ROOT / "docs" / "notebooks" / f"{path.stem}.md"
    assert f"<!-- notebook: {path.stem} -->" in page.read_text(encoding="utf-8")
    assert f"notebooks/{page.name}" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
