"""What every program does: it tells its version, and a dataclass among its parameters is a group of options."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pytest

from runtime import InputError, __version__
from runtime.cli.console import run
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


COOK = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); from test_console import *; run('cook', cook)"


def call(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", COOK, *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=60)


def call_by_shell(line: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a line of bash in which $COOK is the program, buffered as it is where nobody asks for anything else."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    environment |= {"PYTHON": sys.executable, "CODE": COOK, **variables}
    line = 'set -o pipefail; cook() { "$PYTHON" -c "$CODE" "$@"; }; ' + line
    return subprocess.run(
        ["bash", "-c", line], cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=60
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


ASCII = {"LC_ALL": "C", "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def test_an_ascii_terminal_is_shown_what_it_cannot_show_escaped() -> None:
    done = call_by_shell("cook 'Rührei' --guest 'Zoë'", **ASCII)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("R")
    assert done.stdout.isascii()
    assert call_by_shell("cook --help", **ASCII).returncode == 0
    refused = call_by_shell("cook 'Rührei' --heat 'ß'", **ASCII)
    assert refused.returncode == 2
    assert "Traceback" not in refused.stderr


@pytest.mark.parametrize("arguments", ["egg", "--version", "--help"])
def test_a_reader_that_goes_away_ends_a_program_quietly(arguments: str) -> None:
    done = call_by_shell(f"sleep 0.1; cook {arguments} | true; echo ${{PIPESTATUS[0]}}")
    assert done.stderr == ""
    assert int(done.stdout) in (0, 1, 141)  # 0: it was done before; 1: typer's own, of --help


def test_where_the_reader_is_gone_the_exit_code_says_so() -> None:
    done = call_by_shell("exec 3> >(exec true); sleep 0.3; cook egg >&3; echo $?")
    assert (done.stdout, done.stderr) == ("141\n", "")


@pytest.mark.parametrize("streams", [">&-", "<&- >&-", "2>&-", "<&- >&- 2>&-"])
def test_a_program_works_with_closed_streams(streams: str) -> None:
    assert call_by_shell(f"cook egg {streams}").returncode == 0
    assert call_by_shell(f"cook egg --heat 11 {streams}").returncode == 2


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (KeyboardInterrupt(), 130, ""),
        (OSError(5, "Input/output error", "disk"), 2, "cook: error: [Errno 5] Input/output error: 'disk'\n"),
    ],
)
def test_interrupt_and_unexpected_os_error_end_without_a_traceback(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], error: BaseException, code: int, line: str
) -> None:
    def fail() -> None:
        raise error

    monkeypatch.setattr(sys, "argv", ["cook"])
    with pytest.raises(SystemExit) as ended:
        run("cook", fail)
    assert ended.value.code == code
    assert capfd.readouterr() == ("", line)


def test_standard_output_on_a_full_disk_is_one_line_and_exit_code_2() -> None:
    done = call_by_shell("cook egg > /dev/full")
    assert (done.returncode, done.stderr) == (2, "cook: error: [Errno 28] No space left on device\n")
