"""Imports point one way, between packages and between the rooms of runtime, and nowhere in a circle."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {
    "runtime": set(),
    "train": {"runtime"},
    "export": {"train", "runtime"},
    "server": {"runtime"},
    "benchmarks": {"runtime", "train", "export", "server"},
}
"""What a package may import besides itself."""

ROOMS = [
    "interrupt",
    "version",
    "errors",
    "documents",
    "friction",
    "physics",
    "limits",
    "start",
    "sizes",
    "measured",
    "observe",
    "safety",
    "commands",
    "command",
    "network",
    "compilation",
    "refine",
    "quality",
    "assess",
    "outputs",
    "plan",
    "following",
    "stream",
    "planner",
    "many",
    "report",
    "identify",
    "client",
    "arms",
    "arm",
    "cli",
]
"""Folders and files of runtime from the lowest up: each imports from itself and from what stands before it."""

FACADE = "runtime"
"""The package itself names what users import; its own rooms do not import from it."""


class Import(NamedTuple):
    """One import statement's module, and the name it takes from it; no name where it takes the module."""

    module: str
    name: str | None


def files(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def module_of(path: Path) -> str:
    """Return the dotted name of a module's file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def imports(path: Path) -> tuple[Import, ...]:
    """Return what a module imports, wherever in it: in functions, and for type checkers too."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [Import(alias.name, None) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found += [Import(node.module or "", alias.name) for alias in node.names]
    return tuple(found)


@cache
def modules() -> dict[str, Path]:
    """Return the files of all modules of the product and its lab, by their dotted names."""
    return {module_of(path): path for package in MAY_IMPORT for path in files(package)}


def imported_modules(path: Path) -> Iterator[str]:
    """Yield the modules of ours that a module imports."""
    for module, name in imports(path):
        whole = f"{module}.{name}"
        if whole in modules():
            yield whole
        elif module in modules():
            yield module


def top(module: str) -> str:
    return module.partition(".")[0]


def test_no_module_imports_itself_through_others() -> None:
    graph = {name: set(imported_modules(path)) for name, path in modules().items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"import circle: {' <- '.join(error.args[1])}")


@pytest.mark.parametrize("package", sorted(MAY_IMPORT))
def test_packages_import_one_way(package: str) -> None:
    allowed = MAY_IMPORT[package] | {package}
    for path in files(package):
        wrong = {top(module) for module, _ in imports(path)} & {*MAY_IMPORT, "tests"} - allowed
        assert not wrong, f"{path.relative_to(ROOT)} imports {', '.join(sorted(wrong))}"


def room_of(module: str) -> str:
    return module.split(".")[1]


def test_rooms_of_runtime_import_downwards() -> None:
    inside = [name for name in modules() if name.startswith("runtime.")]
    assert {room_of(name) for name in inside} == set(ROOMS), "write new rooms down in ROOMS"
    for name in inside:
        for other in imported_modules(modules()[name]):
            assert other != FACADE, f"{name} imports the package itself, which imports it"
            assert ROOMS.index(room_of(other)) <= ROOMS.index(room_of(name)), f"{name} imports {other}, from above it"


@pytest.mark.parametrize("package", sorted(MAY_IMPORT))
def test_names_with_an_underscore_stay_in_their_module(package: str) -> None:
    for path in files(package):
        for module, name in imports(path):
            private = [part for part in (*module.split("."), name or "") if part.startswith("_")]
            private = [part for part in private if not part.startswith("__")]
            assert top(module) not in MAY_IMPORT or not private, f"{path.relative_to(ROOT)} imports {private[0]}"


@pytest.mark.parametrize("used", ["export.cli, export.write_bundle, export.quantize", "train.evaluation.evaluate"])
def test_networks_are_exported_and_evaluated_without_what_only_training_needs(used: str) -> None:
    pytest.importorskip("torch")
    unwanted = ("tensorboard", "torch.utils.tensorboard", "train.learn.trainer")
    program = f"import sys, {used}; print([name for name in {unwanted} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "[]\n", "")
