"""The report: one HTML file that stands alone, holds the plan's numbers, and draws them in a browser."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.documents.checks import FloatArray
from runtime.errors import InputError, OutputError
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.law import DT, GRAVITY, rollout
from runtime.physics.pan import integrate_pan
from runtime.plan import Plan
from runtime.quality import Record, assess
from runtime.report.report import MAX_SAMPLES, Track, render_report, slip_phases, write_report

LIMITS = Limits(jerk=50_000.0)
HOSTILE = "</script><script>document.title='taken'</script><!-- <b>&amp;\u2028@@REPORT@@"
RESOLUTION = 0.5e-6 * (1 + 1e-9)
"""Half of the last decimal kept (m, m/s, m/s^2)."""


def shaken_plan(samples: int = 700, friction: Friction | None = None) -> Plan:
    """Return a plan whose pan carries the object gently, then jerks away from under it, again and again."""
    friction = friction or Friction()
    k = np.arange(samples)
    carries = k % 200 < 130
    size = np.where(carries, 2.0, 12.0)  # m/s^2: at rest friction holds 9.8, sliding it brakes by 4.9
    angle = np.where(carries, 0.4, 0.4 + np.pi) + 0.8 * (k // 200)
    u = size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rest = np.zeros((1, 4))
    sliding = np.concatenate([rest, rollout(rest[0], u[:-1], friction)])
    pan = np.concatenate([rest, integrate_pan(rest[0], u[:-1])])
    command = np.stack([0.05 * np.sin(k / 150), 0.03 * np.cos(k / 120) - 0.03], axis=1)
    p, v = sliding[:, :2], sliding[:, 2:]
    record = Record(command, u, u, pan[:, :2], v, p, u[0], DT)
    quality = assess(record, LIMITS, found={}, trained_on={})
    return Plan(DT, "shaken", "ab" * 32, friction, command, u, pan[:, 2:], pan[:, :2], v, p, quality)


def replayed(plan: Plan, name: str, friction: Friction) -> Track:
    states = plan.replay(friction)
    return Track(name, states[:, :2], states[:, 2:], plan.pan_position)


class Scripts(HTMLParser):
    """Collects the script elements of a page as a browser would find them, and the addresses it would load."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.scripts: list[str] = []
        self.addresses: list[str] = []
        self._inside = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside = tag == "script"
        if self._inside:
            self.scripts.append("")
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]

    def handle_endtag(self, tag: str) -> None:
        self._inside = False

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.scripts[-1] += data


def data_of(page: str) -> Any:
    return json.loads(Scripts(page).scripts[0])


@pytest.fixture(scope="module")
def plan() -> Plan:
    return shaken_plan()


def test_the_synthetic_plan_sticks_and_slides(plan: Plan) -> None:
    assert 0.2 < plan.quality.sliding_share < 0.8
    assert len(slip_phases(plan.object_velocity)) >= 3


def test_the_page_asks_nothing_of_the_network(plan: Plan) -> None:
    page = render_report(plan)
    assert Scripts(page).addresses == []
    assert not re.search(r"https?:|@import|url\(|<link|<iframe|fetch\(|XMLHttpRequest|WebSocket", page)
    assert "default-src 'none'" in page


def test_the_data_block_holds_the_numbers_of_the_plan(plan: Plan) -> None:
    data = data_of(render_report(plan))
    shown = {
        "time": (data["time"], np.arange(len(plan)) * plan.dt),
        "command": (data["command"]["position"], plan.command_position),
        "pan position": (data["pan"]["position"], plan.pan_position),
        "pan acceleration": (data["pan"]["acceleration"], plan.pan_acceleration),
        "object position": (data["object"]["position"], plan.object_position),
        "object speed": (data["object"]["speed"], np.linalg.norm(plan.object_velocity, axis=1)),
    }
    for name, (values, expected) in shown.items():
        np.testing.assert_allclose(values, expected, rtol=0, atol=RESOLUTION, err_msg=name)
    assert data["quality"] == plan.quality.to_dict()
    assert data["friction"] == {"static": 1.0, "kinetic": 0.5, "gravity": GRAVITY}
    assert data["model"] == {"name": "shaken", "sha256": "ab" * 32}
    assert (data["samples"], data["dt"], data["tracks"]) == (700, 0.001, [])


def test_a_hostile_name_stays_text(plan: Plan) -> None:
    named = replace(plan, model_name=HOSTILE)
    track = replayed(plan, HOSTILE.replace("\u2028", ""), Friction())
    scripts = Scripts(render_report(named, [track])).scripts
    assert len(scripts) == 2
    data = json.loads(scripts[0])
    assert data["model"]["name"] == HOSTILE
    assert data["tracks"][0]["name"] == track.name


def test_tracks_come_with_their_own_figures(plan: Plan) -> None:
    track = replayed(plan, "slippery", Friction(0.7, 0.3))
    pan_position = plan.pan_position + np.array([0.003, -0.004])
    moved = Track("moved", track.object_position, track.object_velocity, pan_position)
    first, second = data_of(render_report(plan, [track, moved]))["tracks"]
    error = np.linalg.norm(track.object_position - plan.command_position, axis=1)
    assert first["name"] == "slippery"
    np.testing.assert_allclose(first["object"]["position"], track.object_position, rtol=0, atol=RESOLUTION)
    assert first["tracking_rmse"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert first["tracking_max"] == pytest.approx(error.max())
    assert first["end_distance"] == pytest.approx(error[-1])
    assert first["pan_deviation_max"] == 0.0
    assert second["pan_deviation_max"] == pytest.approx(0.005)
    np.testing.assert_allclose(second["pan"]["position"], pan_position, rtol=0, atol=RESOLUTION)


def test_the_replay_under_the_plans_own_friction_has_the_plans_figures(plan: Plan) -> None:
    (track,) = data_of(render_report(plan, [replayed(plan, "same", plan.friction)]))["tracks"]
    assert track["tracking_rmse"] == pytest.approx(plan.quality.tracking_rmse, rel=1e-12)
    assert track["tracking_max"] == pytest.approx(plan.quality.tracking_max, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"object_position": np.zeros((3, 3))}, "object_position"),
        ({"object_velocity": np.full((4, 2), np.nan)}, r"object_velocity\[0\], column x"),
        ({"pan_position": np.zeros((5, 2))}, "pan_position has 5 rows, object_position has 4"),
        ({"name": "two\nlines"}, "name"),
    ],
)
def test_a_track_that_cannot_be_drawn_is_refused(changes: dict[str, Any], message: str) -> None:
    arrays = dict.fromkeys(("object_position", "object_velocity", "pan_position"), np.zeros((4, 2)))
    with pytest.raises(InputError, match=message):
        Track(**{"name": "bad", **arrays, **changes})


def test_a_track_of_another_length_is_refused(plan: Plan) -> None:
    short = Track("short", *[np.zeros((4, 2))] * 3)
    with pytest.raises(InputError, match="'short' has 4 samples, the plan has 700"):
        render_report(plan, [short])


@pytest.mark.parametrize(
    ("speeds", "phases"),
    [
        ([0, 0, 0], []),
        ([1, 1, 1], [(0, 3)]),
        ([0, 1, 1, 0, 0, 2], [(1, 3), (5, 6)]),
        ([1, 0, 1e-300, 0], [(0, 1), (2, 3)]),
        ([], []),
    ],
)
def test_slip_phases_are_the_samples_with_any_speed_at_all(speeds: list[float], phases: list[tuple[int, int]]) -> None:
    velocity: FloatArray = np.zeros((len(speeds), 2))
    velocity[:, 1] = speeds
    assert slip_phases(velocity) == phases
    assert slip_phases(-velocity[:, ::-1]) == phases


def test_slip_phases_add_up_to_the_share_of_time_sliding(plan: Plan) -> None:
    phases = slip_phases(plan.object_velocity)
    assert sum(end - first for first, end in phases) / len(plan) == pytest.approx(plan.quality.sliding_share)
    np.testing.assert_allclose(data_of(render_report(plan))["slip"], np.array(phases) * DT, atol=1e-9)


@pytest.mark.parametrize("samples", [1, 2, MAX_SAMPLES - 1, MAX_SAMPLES, MAX_SAMPLES + 1, 60_000])
def test_a_long_plan_is_thinned_evenly_and_keeps_both_ends(samples: int) -> None:
    plan = shaken_plan(samples)
    data = data_of(render_report(plan))
    drawn = np.round(np.array(data["time"]) / DT).astype(int)
    assert len(drawn) == len(data["object"]["position"]) <= MAX_SAMPLES
    assert (drawn[0], drawn[-1]) == (0, samples - 1)
    assert len(set(np.diff(drawn)[:-1])) <= 1
    assert data["quality"] == plan.quality.to_dict()
    np.testing.assert_allclose(data["object"]["position"], plan.object_position[drawn], rtol=0, atol=RESOLUTION)
    if samples < MAX_SAMPLES:
        assert len(drawn) == samples


def test_the_file_is_the_rendered_page(plan: Plan, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text("older")
    write_report(path, plan)
    assert path.read_text(encoding="utf-8") == render_report(plan)
    assert os.listdir(tmp_path) == ["report.html"]


def test_a_failed_write_leaves_what_was_there(plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.html"
    path.write_text("older")

    def refuse(source: object, target: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(OutputError, match=r"report\.html.*Permission denied"):
        write_report(path, plan)
    assert path.read_text() == "older"
    assert os.listdir(tmp_path) == ["report.html"]


def test_a_path_that_cannot_be_written_is_named(plan: Plan, tmp_path: Path) -> None:
    missing = tmp_path / "nowhere" / "report.html"
    with pytest.raises(OutputError, match=re.escape(str(missing))):
        write_report(missing, plan)
    with pytest.raises(OutputError, match=re.escape(str(tmp_path))):
        write_report(tmp_path, plan)
    assert os.listdir(tmp_path) == []


BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine to load the page in")


def loaded(page: Path, fragment: str, profile: Path) -> tuple[str, str]:
    """Return the document after a headless browser has run its scripts, and what it logged to its console."""
    assert BROWSER is not None
    result = subprocess.run(
        [
            *(BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
            *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
            *("--disable-dev-shm-usage", "--enable-logging=stderr", f"--user-data-dir={profile}"),
            *("--window-size=1000,900", "--virtual-time-budget=300", "--dump-dom", f"{page.as_uri()}{fragment}"),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    console = "\n".join(line for line in result.stderr.splitlines() if "CONSOLE" in line)
    return result.stdout, console


def shown(document: str, identifier: str) -> str:
    """Return the text of a simple element."""
    found = re.search(rf'id="{identifier}"[^>]*>([^<]*)<', document)
    assert found, identifier
    return found[1]


@needs_browser
@pytest.mark.parametrize("sliding", [True, False])
def test_a_browser_draws_the_page_at_the_time_asked_for(plan: Plan, tmp_path: Path, sliding: bool) -> None:
    k = int(np.flatnonzero(plan.object_velocity.any(axis=1) == sliding)[50])
    page = tmp_path / "report.html"
    write_report(page, plan, [replayed(plan, "slippery", Friction(0.7, 0.3))])
    document, console = loaded(page, f"#t={k * DT + DT / 2:.4f}", tmp_path / "profile")
    assert 'data-ready="true"' in document
    assert "data-error" not in document
    assert console == ""
    assert shown(document, "chip") == ("slides" if sliding else "sticks")
    assert float(shown(document, "now")) == pytest.approx(k * DT, abs=1.1e-3)
    assert f"{plan.quality.tracking_rmse * 1e3:.1f}<small>mm" in document
    assert f"{plan.quality.pan_reach * 1e3:.0f}<small>mm" in document
    assert document.count('<figure class="plot">') == 6
    assert "NaN" not in document


@needs_browser
@pytest.mark.parametrize("case", ["one sample", "never moves", "no friction", "no limits", "hostile", "a minute"])
def test_a_browser_draws_the_odd_plans_too(plan: Plan, tmp_path: Path, case: str) -> None:
    still = np.zeros_like(plan.object_position)
    unmoved = replace(plan, pan_position=still, object_position=still, object_velocity=still)
    no_limits = {"pan_reach": None, "acceleration": None, "jerk": None}
    odd = {
        "one sample": lambda: shaken_plan(1),
        "never moves": lambda: unmoved,
        "no friction": lambda: shaken_plan(300, Friction(0.0, 0.0)),
        "no limits": lambda: replace(plan, quality=replace(plan.quality, limits=no_limits, margins=no_limits)),
        "hostile": lambda: replace(plan, model_name=HOSTILE),
        "a minute": lambda: shaken_plan(60_000),
    }[case]()
    page = tmp_path / "report.html"
    write_report(page, odd)
    document, console = loaded(page, "#t=0.1&frame=pan", tmp_path / "profile")
    assert 'data-ready="true"' in document
    assert "data-error" not in document
    assert console == ""
    assert "<title>taken" not in document
