"""What the Dockerfile does, step by step without Docker, and whether what stands in docs/ fits the server."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml

from runtime import Plan
from server.app import create_app
from server.metrics import Metrics
from server.settings import Settings

ROOT = Path(__file__).parents[2]
TOKEN = "a token of the test"


def instructions() -> list[tuple[str, str]]:
    """Return the Dockerfile's instructions in order: name and arguments, continued lines joined."""
    text = re.sub(r"\\\n\s*", "", (ROOT / "Dockerfile").read_text())
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [(name, rest) for name, _, rest in (line.partition(" ") for line in lines)]


def final(name: str) -> str:
    """Return the arguments of the last instruction of this name."""
    return [rest for each, rest in instructions() if each == name][-1]


def health_check() -> list[str]:
    command: list[str] = json.loads(final("HEALTHCHECK").partition("CMD ")[2])
    return command


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Carry out the build stage below a folder of our own, and return what would be /opt/slide."""
    root = tmp_path_factory.mktemp("image")
    places = {"/src": root / "src", "/wheels": root / "wheels", "/opt/slide": root / "opt"}
    places["/src"].mkdir()
    build = instructions()
    stages = [index for index, (name, _) in enumerate(build) if name == "FROM"]
    for name, rest in build[stages[0] : stages[1]]:
        if name == "COPY":
            copy(rest.split(), places["/src"])
        elif name == "RUN":
            for path, place in places.items():
                rest = rest.replace(path, str(place))
            path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
            environment = {**os.environ, "PATH": path, "PIP_NO_COMPILE": "1"}  # compiling takes most of the time
            done = subprocess.run(
                ["sh", "-ec", rest], cwd=places["/src"], env=environment, capture_output=True, text=True
            )
            assert done.returncode == 0, done.stderr
    return places["/opt/slide"]


def copy(arguments: list[str], into: Path) -> None:
    *sources, target = arguments
    for source in sources:
        origin = ROOT / source
        if origin.is_dir():
            shutil.copytree(origin, into / target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(origin, into / target)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port: int = listening.getsockname()[1]
    return port


@pytest.mark.timeout(600)
def test_what_the_dockerfile_builds_serves_plans_from_an_empty_folder_and_writes_nothing(
    image: Path, tmp_path: Path
) -> None:
    folders = [tmp_path / name for name in ("cwd", "home", "tmp")]
    for folder in folders:
        folder.mkdir()
    cwd, home, temporary = folders
    settings = dict(setting.split("=", 1) for setting in shlex.split(final("ENV")))
    environment = {
        **settings,
        "PATH": settings["PATH"].replace("/opt/slide", str(image)),
        "HOME": str(home),
        "TMPDIR": str(temporary),
        "SLIDE_PORT": str(free_port()),
        "SLIDE_TOKEN": TOKEN,
    }
    program, *arguments = json.loads(final("ENTRYPOINT"))
    python, *check = health_check()
    process = subprocess.Popen([image / "bin" / program, *arguments], cwd=cwd, env=environment, stderr=subprocess.PIPE)
    try:
        healthy = [image / "bin" / python, *check]
        until = time.monotonic() + 60.0
        while subprocess.run(healthy, cwd=cwd, env=environment, capture_output=True).returncode:
            assert process.poll() is None
            assert time.monotonic() < until, "the health check never passes"
            time.sleep(0.2)
        url = f"http://127.0.0.1:{environment['SLIDE_PORT']}"
        page = httpx.get(f"{url}/")
        for address in re.findall(r'(?:href|src)="(?!https:)([^"]+)"', page.text):
            assert httpx.get(f"{url}/{address}").status_code == 200, address
        command = {"t": [0.0, 0.3, 0.6], "position": [[0.0, 0.0], [0.03, 0.01], [0.05, 0.0]]}
        answer = httpx.post(f"{url}/plan", json={"command": command}, headers={"Authorization": f"Bearer {TOKEN}"})
        assert len(Plan.from_dict(answer.json())) == 601
    finally:
        process.terminate()
        process.wait(timeout=20)
    assert process.returncode == 0
    assert subprocess.run(healthy, cwd=cwd, env=environment, capture_output=True).returncode != 0
    assert [list(folder.iterdir()) for folder in folders] == [[], [], []]


@pytest.mark.timeout(600)
def test_what_the_dockerfile_installs_is_pinned_and_has_no_torch(image: Path) -> None:
    freeze = subprocess.run([image / "bin/python", "-m", "pip", "freeze"], capture_output=True, text=True, check=True)
    pinned = set((ROOT / "constraints.txt").read_text().lower().splitlines())
    installed = [line.lower() for line in freeze.stdout.splitlines() if not line.startswith("slide-planner")]
    assert len(installed) > 10
    assert {line.replace("_", "-") for line in installed} <= {line.replace("_", "-") for line in pinned}
    assert not any(line.startswith("torch==") for line in installed)


def test_the_container_is_no_root_and_listens_where_it_says() -> None:
    user = final("USER").split(":")[0]
    assert user.isdecimal()
    assert int(user) > 0
    assert f"SLIDE_PORT={final('EXPOSE')}" in final("ENV").split()


def documents() -> list[Any]:
    return list(yaml.safe_load_all((ROOT / "docs/kubernetes/slide-planner.yaml").read_text()))


def routes() -> set[str]:
    paths: set[str] = set(create_app(Settings()).openapi()["paths"])
    return paths


def test_the_manifests_name_paths_ports_and_settings_that_the_server_has() -> None:
    deployment = next(each for each in documents() if each["kind"] == "Deployment")
    pod = deployment["spec"]["template"]["spec"]
    (container,) = pod["containers"]
    for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
        assert container[probe]["httpGet"]["path"] in routes()
    given = {each["name"]: each.get("value", "") for each in container["env"]}
    ports = {port["name"]: port["containerPort"] for port in container["ports"]}
    assert ports == {"http": int(final("EXPOSE")), "metrics": int(given["SLIDE_METRICS_PORT"])}
    assert deployment["spec"]["template"]["metadata"]["annotations"]["prometheus.io/port"] == str(ports["metrics"])
    ingress = next(each for each in documents() if each["kind"] == "Ingress")
    services = {each["metadata"]["name"] for each in documents() if each["kind"] == "Service"}
    assert {rule["host"] for rule in ingress["spec"]["rules"]} | services == set(given["SLIDE_HOSTS"].split(","))
    assert {each["name"].removeprefix("SLIDE_").lower() for each in container["env"]} <= set(Settings.model_fields)
    assert pod["securityContext"]["runAsUser"] == int(final("USER").split(":")[0])
    assert container["securityContext"]["readOnlyRootFilesystem"]
    assert pod["terminationGracePeriodSeconds"] > 3 + Settings().drain_timeout


def test_the_manifests_send_a_stream_back_to_where_it_was_and_select_the_pods() -> None:
    services = {each["metadata"]["name"]: each["spec"] for each in documents() if each["kind"] == "Service"}
    ingress = next(each for each in documents() if each["kind"] == "Ingress")
    paths = {each["path"]: each["backend"]["service"]["name"] for each in ingress["spec"]["rules"][0]["http"]["paths"]}
    assert services[paths["/stream"]]["sessionAffinity"] == "ClientIP"
    assert "sessionAffinity" not in services[paths["/"]]
    deployment = next(each for each in documents() if each["kind"] == "Deployment")
    for service in services.values():
        assert service["selector"].items() <= deployment["spec"]["template"]["metadata"]["labels"].items()


def test_the_dashboard_shows_every_metric_and_none_that_is_not_there() -> None:
    given = set()
    for family in Metrics().registry.collect():
        ends = {"counter": ["_total"], "histogram": ["_bucket", "_sum", "_count"]}.get(family.type, [""])
        given |= {family.name + end for end in ends}
    dashboard = json.loads((ROOT / "docs/grafana-dashboard.json").read_text())
    queries = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    used = {name for query in queries for name in re.findall(r"slide_\w+", query)}
    assert used <= given
    families = {re.sub("_(total|bucket|sum|count)$", "", name) for name in given}
    assert families == {re.sub("_(total|bucket|sum|count)$", "", name) for name in used}
