"""The sweep of trainings: trials run, are counted, and make a table."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("optuna")

COMMON = {"epochs": 2, "trajectories": 16, "batch": 16}


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("slide_sweep", Path(__file__).parents[2] / "examples" / "sweep.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_trials_go_on_where_they_were_stopped_and_stand_in_a_table(example: ModuleType, tmp_path: Path) -> None:
    first = example.sweep(tmp_path, 1, COMMON)
    both = example.sweep(tmp_path, 2, COMMON)
    assert [trial.params for trial in both[:1]] == [trial.params for trial in first]
    assert both[0].params != both[1].params
    for trial in both:
        assert trial.value > 0.0
        assert (tmp_path / f"trial-{trial.number}" / "checkpoint.pt").exists()
    header, _, *rows = example.table(both).splitlines()
    assert header == "| trial | units | learning_rate | gamma | average | epochs | error (mm) |"
    errors = [float(row.split("|")[-2]) for row in rows]
    assert len(rows) == 2
    assert errors == sorted(errors)
