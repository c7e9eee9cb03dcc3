"""`slide-serve` before it listens: its help, its options, and what it says where its packages are missing."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

from runtime import __version__
from server.settings import SECRETS, Settings

SLIDE_SERVE = Path(sys.executable).with_name("slide-serve")


def test_help_shows_every_setting_with_its_variable_its_default_and_its_meaning() -> None:
    done = subprocess.run([SLIDE_SERVE, "--help"], capture_output=True, text=True, check=True)
    options = " ".join(done.stdout.split()).split(" --")[1:]
    assert len(Settings.model_fields) > 20
    for name, field in Settings.model_fields.items():
        assert field.description
        if name in SECRETS:
            assert f"SLIDE_{name.upper()}" in done.stdout
            assert f"--{name}" not in done.stdout
            continue
        (option,) = (option for option in options if option.startswith(f"{name.replace('_', '-')} "))
        assert field.description in option
        assert f"[SLIDE_{name.upper()}" in option
        if field.default not in (None, False):
            assert f"default: {field.default}".removesuffix(".0") in option


def test_base_install_is_told_in_one_line_what_to_install() -> None:
    program = """
        import importlib.abc, sys

        class Blocker(importlib.abc.MetaPathFinder):
            def find_spec(self, name, path=None, target=None):
                if name.partition(".")[0] in ("fastapi", "uvicorn", "pydantic", "pydantic_settings", "httptools"):
                    raise ModuleNotFoundError(name + " is blocked", name=name)

        sys.meta_path.insert(0, Blocker())
        from server.cli import serve_main

        serve_main()
    """
    for arguments in (["--help"], []):
        done = subprocess.run(
            [sys.executable, "-c", textwrap.dedent(program), *arguments], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith("slide-serve: error: ")
        assert "is not installed: " in done.stderr
        assert "[server]" in done.stderr
        assert done.stderr.count("\n") == 1
    command = [sys.executable, "-c", textwrap.dedent(program), "--version"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == f"{__version__}\n"


def test_bad_setting_is_named_with_its_value_but_a_secret_is_not_shown() -> None:
    for variable, value, said in (
        ("SLIDE_MAX_QUEUE", "0", "max_queue: Input should be greater than or equal to 1, got '0'\n"),
        ("SLIDE_DEADLINE", "nan", "deadline: Input should be less than or equal to 600, got 'nan'\n"),
        ("SLIDE_TOKEN", "", "token must not be empty\n"),
    ):
        done = subprocess.run(
            [SLIDE_SERVE], env={**os.environ, variable: value}, capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (2, f"slide-serve: error: {said}")
