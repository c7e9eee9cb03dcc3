"""What every program does: it tells its version, and a dataclass among its parameters is a group of options."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pytest

from runtime import InputError, __version__
from runtime.cli.console import run  # noqa: F401 (used by the subprocess)
from runtime.documents.options import option

ROOT = Path(__file__).parents[3]
SCRIPTS: dict[str, str] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]


@pytest.mark.parametrize("program", sorted(SCRIPTS))
def test_every_program_tells_the_version_of_the_package(
    program: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module, _, function = SCRIPTS[program].partition(":")
    monkeypatch.setattr(sys, "argv", [program, "--version"])
    with pytest.raises(SystemExit) as ended:
        getattr(import_module(module), function)()
    assert (ended.value.code, capsys.readouterr().out) == (0, f"{__version__}\n")


@dataclass(frozen=True)
class Cooking:
    heat: float = option("Of the stove.", 1.0, metavar="KW")
    salt: bool = option("Salt it.", False)
    guest: tuple[str, ...] = option("Who comes; may be repeated.", (), metavar="NAME")

    def __post_init__(self) -> None:
        if self.heat > 10.0:
            raise InputError(f"heat must be at most 10 kW, got {self.heat:g}")


def cook(dish: str, cooking: Cooking = Cooking()) -> None:
    """Cook a dish."""
    print(dish, cooking)


def call(*arguments: str) -> subprocess.CompletedProcess[str]:
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); from test_console import *; run('cook', cook)"
    )
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )


def test_the_fields_of_a_dataclass_are_options_of_the_program() -> None:
    done = call("egg", "--heat", "2", "--salt", "--guest", "Ada", "--guest", "Bob")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"egg {Cooking(2.0, True, ('Ada', 'Bob'))}\n"
    assert call("egg").stdout == f"egg {Cooking()}\n"
    help_text = call("--help").stdout
    assert "--heat KW" in help_text
    assert "Who comes; may be repeated." in help_text


def test_a_dataclass_that_refuses_its_values_is_one_line_and_exit_code_2() -> None:
    done = call("egg", "--heat", "11")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "cook: error: heat must be at most 10 kW, got 11\n"
