"""Ctrl-C in a program: 130 and no traceback, also while it imports; in scripts of others Python's way."""

from __future__ import annotations

import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from runtime.interrupt import PROGRAMS

ROOT = Path(__file__).parents[2]
SCRIPTS: dict[str, str] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]

INTERRUPTED_IMPORT = """
import importlib.abc, os, signal, sys

class Interrupt(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)

sys.argv = [{name!r}, *{arguments!r}]
sys.meta_path.insert(0, Interrupt())
import {package}
{package}.{function}()
print("not interrupted")
"""


def interrupt_import(
    name: str, module: str, *arguments: str, entry: str = "", folder: Path = ROOT
) -> subprocess.CompletedProcess[str]:
    """Run a program in which Ctrl-C comes while it imports a module; those of the folder are found first."""
    package, _, function = (entry or SCRIPTS[name]).partition(":")
    code = INTERRUPTED_IMPORT.format(
        module=module, name=name, arguments=list(arguments), package=package, function=function
    )
    obey = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)  # noqa: E731 (a shell's background ignores SIGINT)
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        preexec_fn=obey,
    )


def test_every_program_answers_ctrl_c() -> None:
    assert set(SCRIPTS) <= PROGRAMS


@pytest.mark.parametrize("module", ["numpy", "typer"])
@pytest.mark.parametrize("program", sorted(SCRIPTS))
def test_interrupted_while_it_imports_a_program_exits_130_and_says_nothing(program: str, module: str) -> None:
    done = interrupt_import(program, module, "--version")
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


@pytest.mark.parametrize("module", ["onnxruntime", "onnxruntime.capi._pybind_state", "rich.table"])
def test_interrupted_in_an_import_of_its_work_a_program_exits_130_and_says_nothing(
    module: str, bundle_path: Path
) -> None:
    done = interrupt_import("slide-info", module, str(bundle_path))
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_what_a_library_makes_of_ctrl_c_while_it_loads_is_ctrl_c_all_the_same(
    bundle_path: Path, tmp_path: Path
) -> None:
    (tmp_path / "onnxruntime.py").write_text(
        "import os, signal\n"
        "try:\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "except KeyboardInterrupt:\n"
        "    raise ImportError('initialization failed')\n"
    )
    done = interrupt_import("slide-info", "nothing", str(bundle_path), folder=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_a_script_that_imports_runtime_keeps_pythons_ctrl_c() -> None:
    done = interrupt_import("mine.py", "numpy", entry="runtime.cli.info:info_main")
    assert done.returncode == -signal.SIGINT
    assert "KeyboardInterrupt" in done.stderr


def test_what_ignores_ctrl_c_goes_on_ignoring_it(bundle_path: Path) -> None:
    code = INTERRUPTED_IMPORT.format(
        module="onnxruntime",
        name="slide-info",
        arguments=[str(bundle_path)],
        package="runtime.cli.info",
        function="info_main",
    )
    ignore = lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)  # noqa: E731
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60, preexec_fn=ignore
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "tiny" in done.stdout


DROPPED = """
import ctypes, os, signal, sys
sys.argv = ["slide-train"]
from runtime.interrupt import interrupted, raising

print(interrupted())
with raising():
    print(interrupted())
    ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))()  # C code that calls Python
    print(interrupted())
print(interrupted())
"""


def test_a_loop_can_ask_whether_ctrl_c_was_dropped_on_its_way() -> None:
    done = subprocess.run([sys.executable, "-c", DROPPED], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split(), done.stderr) == (0, ["False", "False", "True", "False"], "")
