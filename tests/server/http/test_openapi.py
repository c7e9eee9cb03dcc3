"""The server against its own description: what /openapi.json promises holds for whatever is sent."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = os.environ.get("SLIDE_EXAMPLES", "5")
"""Examples an operation; `make soak` takes 200."""

SCHEMATHESIS = Path(sys.executable).with_name("schemathesis")
CONFIGURATION = Path(__file__).with_name("schemathesis.toml")


def test_description_names_every_path_and_answer(server: Any) -> None:
    document = server.get("/openapi.json").json()
    assert set(document["paths"]) == {
        "/plan",
        "/plans",
        "/command",
        "/health/live",
        "/health/ready",
        "/info",
        "/metrics",
    }
    answers = set(document["paths"]["/plan"]["post"]["responses"])
    assert answers == {"200", "400", "401", "406", "408", "413", "415", "421", "422", "429", "500", "503", "504"}
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


def test_a_client_generator_makes_a_typed_plan_of_the_description(server: Any, tmp_path: Path) -> None:
    generator = shutil.which(os.environ.get("SLIDE_CLIENT_GENERATOR", "openapi-python-client"))
    if generator is None:
        pytest.skip("openapi-python-client is not installed: pip install it in an environment of its own")
    document, made = tmp_path / "openapi.json", tmp_path / "made"
    document.write_text(server.get("/openapi.json").text)
    subprocess.run([generator, "generate", "--path", document, "--output-path", made], cwd=tmp_path, check=True)
    command = {"dt": 0.001, "position": [[0.0, 0.0]] * 100}
    plan = server.post("/plan", json={"command": command}).json()
    program = (
        "import json, sys; from slide_planner_client.models.plan import Plan;"
        " plan = Plan.from_dict(json.load(sys.stdin));"
        " print(len(plan.pan.acceleration), plan.quality.status.value, plan.quality.limits.jerk)"
    )
    python = Path(generator).with_name("python")
    done = subprocess.run(
        [python, "-c", program], input=json.dumps(plan), cwd=made, capture_output=True, text=True, check=False
    )
    limit = plan["quality"]["limits"]["jerk"]
    assert done.stdout == f"100 {plan['quality']['status']} {limit}\n", done.stderr
