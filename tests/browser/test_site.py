"""The page that plans by itself: its planner is that of Python, and it needs no server and then no network."""

from __future__ import annotations

import functools
import gzip
import json
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import Command, Friction, Limits, Plan, Planner

ROOT = Path(__file__).parents[2]
BROWSER = ROOT / "browser"
CHROMIUM = os.environ.get("SLIDE_CHROMIUM", shutil.which("chromium") or "")

pytestmark = pytest.mark.skipif(
    not (BROWSER / "node_modules").is_dir() or shutil.which("node") is None,
    reason="the packages of browser/ are not installed: npm ci --prefix browser",
)

PATIENCE = 120_000
"""Time for the page to load its planner or to plan, on a busy machine (ms)."""

LOADED = "document.getElementById('footer').textContent.startsWith('Model')"


def run(*arguments: object, **environment: str) -> None:
    done = subprocess.run(
        [str(each) for each in arguments],
        cwd=BROWSER,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]


def test_types_fit() -> None:
    run("npx", "tsc", "-p", ".")


PLANS = int(os.environ.get("SLIDE_BROWSER_PLANS", "32"))
"""Plans that the browser's planner makes again; `make nightly` makes more."""


def test_planner_does_what_pythons_does(tmp_path: Path) -> None:
    run(sys.executable, "test/record.py", tmp_path / "recorded.json", PLANS, PYTHONPATH=str(ROOT))
    run("npm", "test", SLIDE_RECORDED=str(tmp_path / "recorded.json"))


def test_lock_file_names_no_registry() -> None:
    lock = (BROWSER / "package-lock.json").read_text(encoding="utf-8")
    assert not re.search(r'"resolved"', lock)
    exact = json.loads((BROWSER / "package.json").read_text(encoding="utf-8"))
    for packages in ("dependencies", "devDependencies"):
        assert all(re.fullmatch(r"[0-9.]+", version) for version in exact.get(packages, {}).values())


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site") / "plan"
    run("node", "build.mjs", folder)
    return folder


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def server(site: Path) -> Iterator[ThreadingHTTPServer]:
    """What any static host does."""
    found = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(site)))
    threading.Thread(target=found.serve_forever, daemon=True).start()
    yield found
    found.shutdown()
    found.server_close()


@pytest.fixture
def page() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api")
    if not CHROMIUM:
        pytest.skip("there is no Chromium: SLIDE_CHROMIUM names one")
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser.new_page()
        browser.close()


def plan_here(page: Any) -> Plan:
    page.wait_for_function(LOADED, timeout=PATIENCE)
    page.click("#plan")
    page.wait_for_selector("#quality:not([hidden])", timeout=PATIENCE)
    with page.expect_download() as download:
        page.click("#download")
    return Plan.from_dict(json.loads(Path(download.value.path()).read_text(encoding="utf-8")))


def test_page_plans_without_a_server_and_again_without_a_network(server: ThreadingHTTPServer, page: Any) -> None:
    page.goto(f"http://127.0.0.1:{server.server_port}/")
    plan = plan_here(page)
    assert not page.is_visible("#copy")
    python = Planner().plan(plan.command_position, Friction(1.0, 0.5), candidates=1)
    assert plan.model_sha256 == python.model_sha256
    assert plan.quality.status in ("ok", "governed")
    assert abs(plan.quality.tracking_rmse - python.quality.tracking_rmse) < 1e-3
    np.testing.assert_allclose(plan.replay()[:, :2], plan.object_position, atol=1e-9)
    page.evaluate("navigator.serviceWorker.ready.then(() => null)")
    server.shutdown()
    server.server_close()
    page.reload()
    again = plan_here(page)
    np.testing.assert_array_equal(again.pan_acceleration, plan.pan_acceleration)


ASKED = """async (asked) => {
    const { start } = await import("./local.js");
    const planner = await start(() => {});
    const way = (size) => Array.from({ length: 400 }, (_, k) => [size * (1 - Math.cos(k / 100)), 0]);
    return await (%s)(planner, way, asked);
}"""
"""Asks the page's planner; a way goes to and fro on a line."""


def ask(page: Any, script: str, asked: Any = None) -> Any:
    return page.evaluate(ASKED % script, asked)


@pytest.fixture
def loaded(server: ThreadingHTTPServer, page: Any) -> Any:
    page.goto(f"http://127.0.0.1:{server.server_port}/")
    page.wait_for_function(LOADED, timeout=PATIENCE)
    return page


def test_questions_put_at_once_get_each_its_own_answer(loaded: Any) -> None:
    asked = """async (planner, way) => {
        const plans = await Promise.all([0.01, 0.02, 0.03].map((size) => planner.plan(way(size))));
        return plans.map(({ plan }) => Math.max(...plan.command.position.map(([x]) => x)));
    }"""
    assert ask(loaded, asked) == pytest.approx([0.02, 0.04, 0.06], rel=1e-3)


@pytest.mark.parametrize(
    ("wanted", "limits"),
    [
        ({}, Limits()),
        ({"name": "panda"}, Limits.named("panda")),
        ({"height": 0.1, "acceleration": 9.0}, Limits(height=0.1, acceleration=9.0)),
        ({"pan_reach": 0.05, "speed": 1.0, "jerk": 5000.0}, Limits(0.05, speed=1.0, jerk=5_000.0)),
    ],
)
def test_page_plans_within_other_limits_as_python_does(loaded: Any, wanted: dict[str, Any], limits: Limits) -> None:
    friction = Friction(0.6, 0.4)
    asked = {"limits": wanted, "friction": {"static": 0.6, "kinetic": 0.4}}
    text = ask(loaded, "async (planner, way, asked) => (await planner.plan(way(0.02), asked)).text", asked)
    plan = Plan.from_dict(json.loads(text))
    python = Planner().plan(plan.command_position, friction, limits=limits, candidates=1)
    np.testing.assert_allclose(plan.pan_acceleration, python.pan_acceleration, atol=1e-5)
    assert plan.quality.limits == python.quality.limits
    assert plan.quality.status is python.quality.status


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"limits": {"name": "nobody"}}, "there are no limits named nobody"),
        ({"limits": {"acceleration": 0}}, "limit acceleration must be between"),
        ({"limits": {"pan_reach": 200}}, "is it in millimetres"),
        ({"friction": {"static": 0.3, "kinetic": 0.4}}, "must not exceed static friction"),
        ({"start": {"pan": [0.19, 0, 0, 3, 0, 0, 0, 0, 0], "object": [0, 0, 0, 0]}}, "cannot come to rest"),
    ],
)
def test_what_cannot_be_planned_is_said_in_a_line(loaded: Any, asked: dict[str, Any], said: str) -> None:
    script = "async (planner, way, asked) => planner.plan(way(0.02), asked).then(() => '', (error) => error.message)"
    assert said in ask(loaded, script, asked)


def test_closed_loop_brings_a_pushed_object_back(loaded: Any) -> None:
    script = """async (planner, way) => {
        const positions = way(0.02), mark = positions.at(-1);
        const follower = await planner.follow(positions, { limits: { name: "panda" } });
        let given = await follower.next(), count = 0;
        for (; count < 200 && !(given.ends && given.u.every((each) => each === 0)); count++) {
            const object = given.object.slice(-4), executed = Math.min(25, given.u.length / 3);
            const seen = given.object.slice(4 * executed, 4 * executed + 4);
            if (count === 8) seen[0] += 0.01;
            given = await follower.next({ executed, object: seen });
        }
        follower.end();
        return [count, Math.hypot(given.object[0] - mark[0], given.object[1] - mark[1])];
    }"""
    count, off = ask(loaded, script)
    assert count < 200
    assert off < 0.01


def test_page_reads_command_files(loaded: Any) -> None:
    script = """async (planner, _, content) => planner.read(new Blob([content]))
        .then(({ positions, notes }) => [positions, notes], (error) => error.message)"""
    content = "t,x_mm,y_mm\n0,0,0\n0.5,40,0\n1,40,30\n"
    positions, notes = ask(loaded, script, content)
    command = Command.from_waypoints([0.0, 0.5, 1.0], [[0.0, 0.0], [0.04, 0.0], [0.04, 0.03]])
    np.testing.assert_allclose(positions, command.position, atol=1e-12)
    assert notes == ["scaled by 0.001"]
    assert ask(loaded, script, "dear diary").startswith("This file cannot be read: there are no rows")


def test_closed_loop_is_steered_by_the_page_itself(loaded: Any) -> None:
    loaded.click("#plan")
    loaded.wait_for_selector("#quality:not([hidden])", timeout=PATIENCE)
    loaded.locator(".toggle:has(#closed)").click()
    loaded.wait_for_function("/^Push the object: [0-9.]+ mm off/.test(document.getElementById('hint').textContent)")
    loaded.click("#push")
    loaded.wait_for_function(
        "parseFloat(document.getElementById('hint').textContent.split(': ')[1]) > 2", timeout=PATIENCE
    )
    assert "Nobody steers" not in loaded.inner_text("body")


def test_file_is_opened_and_planned_without_a_server(loaded: Any) -> None:
    table = "t,x,y\n" + "".join(f"{k / 50:.2f},{0.03 * np.sin(k / 10):.5f},0\n" for k in range(60))
    loaded.set_input_files("#file", {"name": "way.csv", "mimeType": "text/csv", "buffer": table.encode()})
    loaded.wait_for_selector("#quality:not([hidden])", timeout=PATIENCE)
    loaded.set_input_files("#file", {"name": "diary.txt", "mimeType": "text/plain", "buffer": b"dear diary"})
    loaded.wait_for_selector("#message:not([hidden])", timeout=PATIENCE)
    assert loaded.inner_text("#message").startswith("This file cannot be read: there are no rows")


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        ("model/encoder.onnx.packed", "The planner could not be loaded: model/encoder.onnx.packed is not there"),
        ("kernel.wasm", "The planner could not be loaded: kernel.wasm is not there"),
        ("files.json", "The planner could not be loaded. Load the page again when there is a network."),
    ],
)
def test_interrupted_download_is_said_in_a_line(
    server: ThreadingHTTPServer, page: Any, missing: str, said: str
) -> None:
    page.route(f"**/{missing}", lambda route: route.fulfill(status=404, body=""))
    page.goto(f"http://127.0.0.1:{server.server_port}/")
    page.wait_for_function("!document.getElementById('message').hidden && !/Loading/.test(document.body.innerText)")
    assert page.inner_text("#message").startswith(said)
    page.click("#plan")
    page.wait_for_function("document.getElementById('plan').textContent === 'Plan'")
    assert page.inner_text("#message").startswith(said)


def test_download_that_ends_early_is_said_in_a_line(site: Path, server: ThreadingHTTPServer, page: Any) -> None:
    half = (site / "model" / "decoder_step.onnx.packed").read_bytes()[:1_000_000]
    page.route("**/model/decoder_step.onnx.packed", lambda route: route.fulfill(status=200, body=half))
    page.goto(f"http://127.0.0.1:{server.server_port}/")
    page.wait_for_function("!document.getElementById('message').hidden && !/Loading/.test(document.body.innerText)")
    assert "model/decoder_step.onnx.packed did not come whole" in page.inner_text("#message")


def test_site_is_small_and_carries_licences(site: Path) -> None:
    sent = sum(len(gzip.compress(file.read_bytes())) for file in site.rglob("*") if file.is_file())
    assert sent < 4_500_000
    licences = (site / "licences.txt").read_text(encoding="utf-8")
    packages = json.loads((BROWSER / "package.json").read_text(encoding="utf-8")).get("dependencies", {})
    assert all(name in licences for name in ("slide-planner", *packages))


def test_browser_without_webassembly_is_told_so(server: ThreadingHTTPServer, page: Any) -> None:
    page.add_init_script("delete globalThis.WebAssembly")
    page.goto(f"http://127.0.0.1:{server.server_port}/")
    page.wait_for_selector("#message:not([hidden])")
    assert "it has no WebAssembly" in page.inner_text("#message")


def test_three_js_of_the_page_is_what_its_source_builds(tmp_path: Path) -> None:
    script = json.loads((BROWSER / "package.json").read_text(encoding="utf-8"))["scripts"]["three"]
    *build, _ = script.split()
    run("npx", *build, f"--outfile={tmp_path / 'three.js'}")
    assert (tmp_path / "three.js").read_bytes() == (ROOT / "server/static/three/three.js").read_bytes()
