"""The server against its own description: what /openapi.json promises holds for whatever is sent."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

EXAMPLES = os.environ.get("SLIDE_EXAMPLES", "5")
"""Examples an operation; `make soak` takes 200."""

SCHEMATHESIS = Path(sys.executable).with_name("schemathesis")
CONFIGURATION = Path(__file__).with_name("schemathesis.toml")


def test_description_names_every_path_and_answer(server: Any) -> None:
    document = server.get("/openapi.json").json()
    assert set(document["paths"]) == {"/plan", "/plans", "/health/live", "/health/ready", "/info", "/metrics"}
    answers = set(document["paths"]["/plan"]["post"]["responses"])
    assert answers == {"200", "400", "401", "406", "408", "413", "415", "422", "429", "500", "503", "504"}
    body = document["paths"]["/plan"]["post"]["requestBody"]["content"]["application/json"]["schema"]["$ref"]
    assert body.rpartition("/")[2] in document["components"]["schemas"]


def test_every_operation_keeps_what_the_description_promises(server: Any, tmp_path: Path) -> None:
    options = ["--checks", "all", "--max-examples", EXAMPLES, "--seed", "1", "--no-color"]
    done = subprocess.run(
        [SCHEMATHESIS, "--config-file", CONFIGURATION, "run", f"{server.url}/openapi.json", *options],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-6000:]
    assert server.get("/health/ready").status_code == 200
