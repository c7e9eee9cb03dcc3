"""The page that plans by itself: its planner is that of Python, and it needs no server and then no network."""

from __future__ import annotations

import functools
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

from runtime import Friction, Plan, Planner

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


def test_planner_does_what_pythons_does(tmp_path: Path) -> None:
    run(sys.executable, "test/record.py", tmp_path / "recorded.json", 16, PYTHONPATH=str(ROOT))
    run("npm", "test", SLIDE_RECORDED=str(tmp_path / "recorded.json"), SLIDE_ROOT=str(ROOT))


def test_lock_file_names_no_registry() -> None:
    lock = (BROWSER / "package-lock.json").read_text(encoding="utf-8")
    assert not re.search(r'"resolved"', lock)
    exact = json.loads((BROWSER / "package.json").read_text(encoding="utf-8"))
    for packages in ("dependencies", "devDependencies"):
        assert all(re.fullmatch(r"[0-9.]+", version) for version in exact[packages].values())


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
    python = Planner().plan(plan.command_position, Friction(1.0, 0.5))
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


def test_questions_put_at_once_get_each_its_own_answer(server: ThreadingHTTPServer, page: Any) -> None:
    page.goto(f"http://127.0.0.1:{server.server_port}/")
    page.wait_for_function(LOADED, timeout=PATIENCE)
    asked = """async () => {
        const { start } = await import("./local.js");
        const planner = await start(() => {});
        const way = (size) => Array.from({ length: 400 }, (_, k) => [size * (1 - Math.cos(k / 100)), 0]);
        const friction = { static: 1, kinetic: 0.5 };
        const plans = await Promise.all([0.01, 0.02, 0.03].map((size) => planner.plan(way(size), friction)));
        return plans.map(({ plan }) => Math.max(...plan.command.position.map(([x]) => x)));
    }"""
    assert page.evaluate(asked) == pytest.approx([0.02, 0.04, 0.06], rel=1e-3)


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        ("model/encoder.onnx", "The planner could not be loaded: model/encoder.onnx is not there"),
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


def test_browser_without_webassembly_is_told_so(server: ThreadingHTTPServer, page: Any) -> None:
    page.add_init_script("delete globalThis.WebAssembly")
    page.goto(f"http://127.0.0.1:{server.server_port}/")
    page.wait_for_selector("#message:not([hidden])")
    assert "it has no WebAssembly" in page.inner_text("#message")
