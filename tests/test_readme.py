"""What the README shows a newcomer works as it stands there."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_python_example_runs_and_plans(tmp_path, monkeypatch):
    (block,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(block, names)
    plan = names["plan"]
    assert plan.quality.status in ("ok", "governed")
    assert plan.quality.tracking_rmse < 0.01
    assert (tmp_path / "plan.json").exists()
    assert len(names["u"]) == names["stream"].chunk
    assert names["stop"].ndim == 2


def test_every_program_shown_is_installed_by_the_project():
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    shown = set(re.findall(r"\bslide-[a-z]+\b", README)) - {"slide-planner"}
    assert shown <= set(scripts)


def test_every_verb_shown_is_in_the_makefile():
    verbs = set(re.findall(r"^    make ([a-z]+)", README, flags=re.MULTILINE))
    assert {"run", "test", "check", "docs", "help"} <= verbs
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    assert verbs <= targets


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#\s]+)\)", README))))
def test_every_file_linked_is_there(target):
    assert target.startswith("https://doi.org/") or (ROOT / target).exists()
