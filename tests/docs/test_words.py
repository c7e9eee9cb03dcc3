"""Documents speak to a user: no history, nobody's orders, and no home-made links."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("runtime", "server", "train", "export", "benchmarks", "examples")
PAGES = [path for path in (ROOT / "docs").rglob("*.md") if path.parent.name != "decisions"]
DOCUMENTS = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md", *PAGES])
SOURCES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))

HISTORY = re.compile(
    r"\b(as the issue|the issue asks|asked for today|asked for beside|not done yet|not done unasked|"
    r"has not been run|they were not run|nothing has been run|given up for time|no longer part of|before this one)\b",
    flags=re.IGNORECASE,
)
"""What belongs into decisions or the changelog, or nowhere."""


@pytest.mark.parametrize("path", [*DOCUMENTS, *SOURCES], ids=lambda path: str(path.relative_to(ROOT)))
def test_nothing_is_told_of_the_projects_history(path: Path) -> None:
    text = " ".join(path.read_text(encoding="utf-8").split())
    found = HISTORY.search(text)
    assert found is None, text[max(0, found.start() - 60) : found.end() + 60] if found else ""


@pytest.mark.parametrize("path", [*DOCUMENTS, *SOURCES], ids=lambda path: str(path.relative_to(ROOT)))
def test_modules_that_are_named_exist(path: Path) -> None:
    for name in re.findall(
        r"`((?:runtime|server|train|export|benchmarks)(?:\.\w+)+)`", path.read_text(encoding="utf-8")
    ):
        assert known(name), name


def known(dotted: str) -> bool:
    """Whether a name leads to a module, or to a word of one."""
    parts = dotted.split(".")
    for count in range(len(parts), 0, -1):
        module = ROOT.joinpath(*parts[:count])
        file = module / "__init__.py" if module.is_dir() else module.with_suffix(".py")
        if file.exists():
            return count == len(parts) or parts[count] in re.findall(r"\w+", file.read_text(encoding="utf-8"))
    return False


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 900


@pytest.mark.parametrize("word", ["int8", "Muon", "asked for", "missed"])
def test_readme_leaves_out_what_no_newcomer_needs(word: str) -> None:
    assert word not in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_line_needs_an_index_that_has_the_package(path: Path) -> None:
    assert not re.search(r"pip install [^\n]*\bslide-planner\b", path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", [*DOCUMENTS, ROOT / "CHANGELOG.md"], ids=lambda path: str(path.relative_to(ROOT)))
def test_every_link_leads_somewhere(path: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8")):
        if not target.startswith("https://"):
            assert (path.parent / target).exists(), target


def test_moving_picture_is_small() -> None:
    assert (ROOT / "docs" / "pictures" / "plan.webp").stat().st_size < 1_500_000
