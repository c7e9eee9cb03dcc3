"""The page that plans by itself: what is sent until its first plan, how soon that is there, how long a plan takes."""

from __future__ import annotations

import functools
import gzip
import shutil
import statistics
import subprocess
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit

from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject, at_least
from benchmarks.harness.tables import targets_table
from benchmarks.harness.targets import MEGABYTES, MILLISECONDS, SECONDS, Target, Verdict
from benchmarks.pictures.browser import ARGUMENTS, PATIENCE, chromium
from runtime.errors import SlideError, extra

BROWSER = Path(__file__).parents[2] / "browser"

PLANNED = "!document.getElementById('quality').hidden"
"""Holds in the page once there is a plan."""

EIGHT = """async (rounds) => {
    const { start } = await import("./local.js");
    const planner = await start(() => {});
    const positions = Array.from({ length: 1200 }, (_, k) => {
        const angle = 2 * Math.PI * k / 1199;
        return [0.04 * (1 - Math.cos(angle)), 0.03 * Math.sin(2 * angle)];
    });
    const took = [];
    for (let round = 0; round < rounds; round++) took.push((await planner.plan(positions)).took);
    return took;
}"""
"""Plans an eight of 1.2 s again and again: the times that each took (ms)."""


@dataclass(frozen=True)
class SiteSettings:
    """How often.

    Attributes:
        rounds: plans that are made, and openings of the page.
    """

    rounds: int = 9


@dataclass(frozen=True)
class Site:
    """Everything this section measures.

    Attributes:
        sent: bytes of all that the page fetches until its first plan, compressed.
        opened: from opening the page, which the browser has kept, to its first plan (s).
        first: the first plan of 1.2 s in a page that was just opened (s).
        plan: the median of the following ones (s).
    """

    sent: float
    opened: float
    first: float
    plan: float


TARGETS = (
    Target("sent", "sent until the first plan, compressed", MEGABYTES, "<=", 4e6),
    Target("opened", "page opened (kept) to first plan", SECONDS, "<=", 1.5),
    Target("plan", "a plan of 1.2 s, one thread", MILLISECONDS, "<=", 0.04),
    Target("first", "  the first one", MILLISECONDS),
)


def measure_site(_: Subject, settings: SiteSettings) -> Measured:
    """Build the page, and measure it in Chromium.

    Raises:
        InputError: there are no rounds.
        MissingExtraError: playwright is not installed.
        SlideError: there is no Chromium, no Node, or the page is not built.
    """
    at_least(1, rounds=settings.rounds)
    with extra("dev"):
        from playwright.sync_api import sync_playwright
    executable = chromium()
    if executable is None:
        raise SlideError("there is no Chromium: SLIDE_CHROMIUM names one")
    with (
        tempfile.TemporaryDirectory() as name,
        served(build(Path(name) / "plan")) as address,
        sync_playwright() as running,
    ):
        browser = running.chromium.launch(executable_path=executable, args=ARGUMENTS)
        page = browser.new_page()
        page.set_default_timeout(PATIENCE)
        fetched: set[str] = set()
        page.on("request", lambda request: fetched.add(urlsplit(request.url).path.lstrip("/") or "index.html"))
        page.goto(address)
        page.click("#examples button")
        page.wait_for_function(PLANNED)
        sent = sum(
            len(gzip.compress(file.read_bytes())) for each in fetched if (file := Path(name) / "plan" / each).exists()
        )
        page.evaluate("navigator.serviceWorker.ready.then(() => null)")
        opened = []
        for _round in range(settings.rounds):
            page.reload(wait_until="commit")
            page.wait_for_function(PLANNED, polling=10)  # the drawing is in the address, and planned
            opened.append(page.evaluate("performance.now()") * 1e-3)
        first, *others = page.evaluate(EIGHT, settings.rounds + 1)
        browser.close()
    figures = Site(sent, statistics.median(opened), first * 1e-3, statistics.median(others) * 1e-3)
    return Measured(figures)


def build(folder: Path) -> Path:
    """Build the page.

    Raises:
        SlideError: there is no Node, or its packages are not installed.
    """
    if shutil.which("node") is None or not (BROWSER / "node_modules").is_dir():
        raise SlideError("the packages of browser/ are not installed: npm ci --prefix browser")
    done = subprocess.run(["node", BROWSER / "build.mjs", folder], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SlideError(f"the page is not built: {(done.stderr or done.stdout).strip()[-500:]}")
    return folder


class Quiet(SimpleHTTPRequestHandler):
    """What any static host does."""

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve a folder, and give its address."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()


def site_tables(_: Site, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the figures, beside their targets."""
    return targets_table("The page that plans by itself", verdicts, {})


SECTION = Section(
    "site",
    "the page that plans by itself: bytes sent, time to the first plan, time of a plan",
    SiteSettings(),
    measure_site,
    TARGETS,
    site_tables,
    timed=True,
    usual=False,
)
