"""What is installed: the packages that plan, train, export and serve. The benchmarks stay in the checkout."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

from setuptools import find_packages

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
BENCH = "from runtime.cli.bench import bench_main; bench_main()"


def test_wheel_has_four_packages() -> None:
    include = PROJECT["tool"]["setuptools"]["packages"]["find"]["include"]
    found = {name.partition(".")[0] for name in find_packages(str(ROOT), include=include)}
    assert found == {"runtime", "train", "export", "server"}
    assert {name.partition(".")[0] for name in PROJECT["tool"]["setuptools"]["package-data"]} <= found


def test_every_folder_with_code_is_a_package_of_the_wheel() -> None:
    packages = set(find_packages(str(ROOT), include=["runtime*", "train*", "export*", "server*"]))
    for top in ("runtime", "train", "export", "server"):
        for module in (ROOT / top).rglob("*.py"):
            assert ".".join(module.parent.relative_to(ROOT).parts) in packages, f"{module} has no __init__.py beside it"


def test_slide_bench_works_in_a_checkout_from_any_folder(tmp_path: Path) -> None:
    assert PROJECT["project"]["scripts"]["slide-bench"] == "runtime.cli.bench:bench_main"
    # Only `runtime` is where Python looks, as a finder of an editable install has it.
    (tmp_path / "runtime").symlink_to(ROOT / "runtime")
    (tmp_path / "benchmarks.py").write_text("raise AssertionError('not these benchmarks')", encoding="utf-8")
    done = run(tmp_path, "--version")
    assert (done.returncode, done.stderr) == (0, "")


def test_slide_bench_of_a_wheel_says_where_the_benchmarks_are(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "runtime", tmp_path / "runtime", ignore=shutil.ignore_patterns("models", "__pycache__"))
    done = run(tmp_path, "accuracy")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "slide-bench: error: the benchmarks are not part of the installed package" in done.stderr
    assert "checkout" in done.stderr


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", BENCH, *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
