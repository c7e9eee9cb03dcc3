"""The reference pages name what the code has: all of it, and nothing else."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import runtime
import runtime.client
from runtime import Plan, Planner, SlideError, Status, StreamStatus
from runtime.many.shard import plans_table
from server.app import create_app
from server.settings import Settings

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PAGES = sorted(path for path in DOCS.rglob("*.md") if path.parent.name != "decisions")
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md", *PAGES]

OTHER_VARIABLES = {
    "SLIDE_CHROMIUM",
    "SLIDE_BROWSER_PLANS",
    "SLIDE_BROWSER_SEQUENCES",
    "SLIDE_SEQUENCES",
    "SLIDE_PLANS",
    "SLIDE_STEPS",
    "SLIDE_FALSE_READINGS",
    "SLIDE_EXAMPLES",
    "SLIDE_ATTACKERS",
    "SLIDE_ATTACK_SECONDS",
}
"""Those of the tests, which no server knows."""


def test_python_reference_has_every_name_of_the_package() -> None:
    assert shown("reference/api.md", r"^::: runtime\.(\w+)$") == set(runtime.__all__) - {"__version__"}
    assert shown("reference/api.md", r"^::: runtime\.client\.(\w+)$") == set(runtime.client.__all__)


def test_command_reference_has_every_program() -> None:
    assert shown("reference/cli.md", r"^<!-- program: (\S+) -->$") == set(PROJECT["scripts"])


@pytest.mark.parametrize("program", sorted(PROJECT["scripts"]))
def test_command_reference_is_what_the_program_prints(hooks: ModuleType, program: str) -> None:
    assert hooks.help_of(program).startswith(f"Usage: {program}")


@pytest.mark.parametrize("program", sorted(PROJECT["scripts"]))
def test_options_in_examples_are_those_of_the_program(hooks: ModuleType, program: str) -> None:
    known = set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", hooks.help_of(program)))
    for document in DOCUMENTS:
        for line in re.findall(
            rf"(?:^ +|`)({program}(?: [^`\n#|]*)?)", document.read_text(encoding="utf-8"), re.MULTILINE
        ):
            used = set(re.findall(r"(?<=\s)--?[a-z][a-z-]*", line))
            assert used <= known, f"{document.name}: {line}"


def test_every_status_is_explained_worst_last() -> None:
    table = section("reference/problems.md", "Statuses of a plan")
    assert re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE) == [status.value for status in Status]


def test_every_stream_status_is_explained() -> None:
    table = section("reference/problems.md", "Statuses of a stream")
    assert re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE) == [status.value for status in StreamStatus]


def test_every_error_is_explained() -> None:
    table = section("reference/problems.md", "Errors in Python")
    errors = {
        name
        for name in runtime.__all__
        if isinstance(each := getattr(runtime, name), type) and issubclass(each, SlideError)
    }
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == errors - {"SlideError"}


def test_every_path_of_the_server_is_listed() -> None:
    listed = set(re.findall(r"`(?:GET|POST|WS) (/[a-z./]*)`", section("reference/http.md", "Paths")))
    described = set(create_app(Settings()).openapi()["paths"])
    assert listed == described | {"/", "/stream", "/openapi.json"}


def test_requests_are_described_by_the_server(hooks: ModuleType) -> None:
    for name in shown("reference/http.md", r"^<!-- schema: (\S+) -->$"):
        assert "| any |" not in hooks.schema_table(name)


def test_settings_named_anywhere_are_settings(hooks: ModuleType) -> None:
    known = set(re.findall(r"`(SLIDE_\w+)`", hooks.settings_table())) | OTHER_VARIABLES
    for document in (*DOCUMENTS, DOCS / "kubernetes" / "slide-planner.yaml", ROOT / "Makefile", ROOT / "Dockerfile"):
        assert set(re.findall(r"\bSLIDE_[A-Z_]+\b", document.read_text(encoding="utf-8"))) <= known, document


def test_plan_format_is_that_of_a_plan() -> None:
    table = section("reference/formats.md", "Plan")
    listed = [
        key for row in re.findall(r"^\| (`[^|]+`) \|", table, re.MULTILINE) for key in re.findall(r"`([^`]+)`", row)
    ]
    document = example_plan().to_dict()
    assert set(listed) == set(dotted(document))
    assert f"`{document['format']}`" in table


def test_table_of_a_plan_has_the_columns_that_are_listed() -> None:
    table = section("reference/formats.md", "A plan as a table")
    rows = re.findall(r"^\| (`[^|]+`) \|", table, re.MULTILINE)
    listed = [name for row in rows for name in re.findall(r"`([^`]+)`", row)]
    assert listed == example_plan().to_csv().partition("\n")[0].split(",")


def test_columns_of_many_plans_are_listed() -> None:
    pytest.importorskip("pyarrow")
    table = section("reference/formats.md", "Many plans")
    rows = re.findall(r"^\| (`[^|]+`) \|", table, re.MULTILINE)
    listed = [name for row in rows for name in re.findall(r"`([^`]+)`", row)]
    assert listed == plans_table([], states=True).column_names


def test_manifest_keys_are_those_of_a_bundle() -> None:
    table = section("reference/formats.md", "Bundle")
    listed = [
        key for row in re.findall(r"^\| (`[^|]+`) \|", table, re.MULTILINE) for key in re.findall(r"`([^`]+)`", row)
    ]
    manifest = Planner().bundle.manifest.to_dict()
    assert set(listed) == set(manifest)
    assert f"`{manifest['format']}`" in table


def test_extras_are_those_of_the_project() -> None:
    table = section("guide/start.md", "Install")
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == set(PROJECT["optional-dependencies"])
    for document in DOCUMENTS:
        used = re.findall(r"pip install[^\n|`]*\[([a-z,]+)\]", document.read_text(encoding="utf-8"))
        assert {name for names in used for name in names.split(",")} <= set(PROJECT["optional-dependencies"]), document


def test_every_folder_of_the_runtime_says_what_it_knows(hooks: ModuleType) -> None:
    for row in hooks.folders_table("runtime").splitlines()[2:]:
        assert re.fullmatch(r"\| `runtime/\w+/` \| [A-Z].+[.:] \|", row), row


def test_every_decision_is_listed() -> None:
    listed = set(re.findall(r"\((\d{3}-[^)]+\.md)\)", (DOCS / "decisions" / "index.md").read_text(encoding="utf-8")))
    assert listed == {path.name for path in (DOCS / "decisions").glob("[0-9]*.md")}


def test_every_figure_of_a_decision_number_is_used_once() -> None:
    numbers = [path.name[:3] for path in (DOCS / "decisions").glob("[0-9]*.md")]
    assert len(set(numbers)) == len(numbers)


def shown(page: str, pattern: str) -> set[str]:
    return set(re.findall(pattern, (DOCS / page).read_text(encoding="utf-8"), flags=re.MULTILINE))


def section(page: str, title: str) -> str:
    """Return a section of a page, without its heading."""
    content = (DOCS / page).read_text(encoding="utf-8")
    found = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", content, flags=re.MULTILINE | re.DOTALL)
    assert found is not None, f"{page} has no section {title!r}"
    return found[1]


def dotted(document: dict[str, Any], prefix: str = "") -> list[str]:
    """Return the keys of a document as the page writes them: quality as a whole, the rest to the last name."""
    names = []
    for key, value in document.items():
        name = prefix + key
        names += dotted(value, f"{name}.") if isinstance(value, dict) and name != "quality" else [name]
    return names


def example_plan() -> Plan:
    return Planner().plan(np.linspace([0.0, 0.0], [0.02, 0.0], 300))
