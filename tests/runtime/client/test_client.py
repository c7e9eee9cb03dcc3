"""The client stands by itself: it needs no server package, and no file of a user's gets in its way."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

WITHOUT_SERVER = (
    "import sys; sys.modules.update(dict.fromkeys(('fastapi', 'uvicorn', 'starlette', 'orjson', 'pydantic')))"
)


def test_client_needs_nothing_of_the_server(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        f"{WITHOUT_SERVER}\n"
        "from runtime import ServerError\n"
        "from runtime.client import Client\n"
        "try:\n"
        "    Client('http://127.0.0.1:9').plan([[0.0, 0.0]] * 300)\n"
        "except ServerError as error:\n"
        "    print(error)\n",
        encoding="utf-8",
    )
    assert ": cannot be reached: " in run(script)


def test_client_is_imported_without_a_network_and_without_its_own_packages_until_it_is_used(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    heavy = ("onnxruntime", "httpx", "websockets", "typer", "fastapi", "pydantic")
    script.write_text(
        f"import sys\nimport runtime.client\nprint([name for name in {heavy} if name in sys.modules])\n",
        encoding="utf-8",
    )
    assert run(script) == "[]"


@pytest.mark.parametrize(
    ("package", "call"), [("httpx", "Client('http://x')"), ("websockets", "RemoteStream('http://x', [])")]
)
def test_missing_package_is_said_with_the_line_that_brings_it(tmp_path: Path, package: str, call: str) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        f"import sys; sys.modules['{package}'] = None\n"
        "from runtime import MissingExtraError\n"
        "from runtime.client import Client, RemoteStream\n"
        f"try:\n    {call}\n"
        "except MissingExtraError as error:\n"
        "    print(error)\n",
        encoding="utf-8",
    )
    assert f"{package} is not installed: pip install './[client]' in a checkout" in run(script)


def run(script: Path) -> str:
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False, cwd=script.parent)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()
