"""The report: one HTML file that stands alone, holds the plan's numbers, and draws them in a browser."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import runtime.report
from runtime.assess.assess import assess
from runtime.documents.checks import FloatArray
from runtime.errors import InputError, OutputError
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.law import DT, GRAVITY, slide_one
from runtime.physics.motion import Motion
from runtime.physics.pan import integrate_pan
from runtime.plan import Plan
from runtime.quality import OffPan, Status
from runtime.report.report import MAX_SAMPLES, Track, render_report, slip_phases, write_report
from runtime.safety.governor import govern
from runtime.safety.pan import Pan
from runtime.safety.rest import stop_after
from runtime.sizes import Sizes
from runtime.start import Start

if TYPE_CHECKING:
    from playwright.sync_api import Page

LIMITS = Limits(jerk=50_000.0)
STOP = np.zeros((1, 3))
HOSTILE = "</script><script>document.title='taken'</script><!-- <b>&amp;\u2028@@REPORT@@"
VIEWER = Path(runtime.report.__file__).parent / "viewer"
RESOLUTION = 0.5e-6 * (1 + 1e-9)
"""Half of the last decimal kept (m, m/s, m/s^2)."""


def shaken_plan(samples: int = 700, friction: Friction | None = None) -> Plan:
    """Return a plan whose pan carries the object gently, then jerks away from under it, again and again."""
    friction = friction or Friction()
    k = np.arange(samples)
    carries = k % 200 < 130
    size = np.where(carries, 2.0, 12.0)  # m/s^2: at rest friction holds 9.8, sliding it brakes by 4.9
    angle = np.where(carries, 0.4, 0.4 + np.pi) + 0.8 * (k // 200)
    u = size[:, None] * np.stack([np.cos(angle), np.sin(angle), np.zeros(samples)], axis=1)
    rest = np.zeros((1, 6))
    sliding = np.concatenate([rest[:, :4], slide_one(rest[0, :4], u, friction)])
    pan = np.concatenate([rest, integrate_pan(rest[0], u)])
    command = np.stack([0.05 * np.sin(k / 150), 0.03 * np.cos(k / 120) - 0.03], axis=1)
    motion = Motion(u, u, pan, sliding)
    quality = assess(motion, STOP, command, friction, LIMITS, Sizes(), u[0])
    return Plan.of(motion, STOP, command, friction, quality, "shaken", "ab" * 32)


def lifting_plan(samples: int = 600) -> Plan:
    """Return a plan whose pan rises and sinks as it is shaken, within the limits of a Panda."""
    limits, friction, start = Limits.named("panda"), Friction(0.5, 0.3), np.zeros((1, 4))
    t = np.arange(samples) * 1e-3
    asked = np.stack([6.0 * np.sin(14.0 * t), 6.0 * np.cos(13.0 * t), 6.0 * np.sin(18.0 * t)], axis=1)
    u, states, (ahead,) = govern([Pan.at_start(Start(), limits)], asked[None])
    sliding = np.concatenate([start, slide_one(start[0], u[0], friction)])
    motion = Motion(u[0], asked, np.concatenate([np.zeros((1, 6)), states[0]]), sliding)
    command = sliding[:-1, :2]
    stop = stop_after(motion, samples, ahead, command[-1], friction)
    quality = assess(motion, stop, command, friction, limits, Sizes(), np.zeros(3))
    return Plan.of(motion, stop, command, friction, quality, "lifting", "cd" * 32)


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
        "object velocity": (data["object"]["velocity"], plan.object_velocity),
    }
    for name, (values, expected) in shown.items():
        np.testing.assert_allclose(values, expected, rtol=0, atol=RESOLUTION, err_msg=name)
    assert data["quality"] == plan.quality.to_dict()
    assert data["friction"] == {"static": 1.0, "kinetic": 0.5}
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
    pan_position = plan.pan_position + np.array([0.003, -0.004, 0.0])
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
        ({"pan_position": np.zeros((5, 3))}, "pan_position has 5 rows, object_position has 4"),
        ({"name": "two\nlines"}, "name"),
    ],
)
def test_a_track_that_cannot_be_drawn_is_refused(changes: dict[str, Any], message: str) -> None:
    arrays = dict.fromkeys(("object_position", "object_velocity"), np.zeros((4, 2))) | {
        "pan_position": np.zeros((4, 3))
    }
    with pytest.raises(InputError, match=message):
        Track(**{"name": "bad", **arrays, **changes})


def test_a_track_of_another_length_is_refused(plan: Plan) -> None:
    short = Track("short", *[np.zeros((4, 2))] * 2, np.zeros((4, 3)))
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


def test_the_script_is_the_modules_in_order_without_imports(plan: Plan) -> None:
    script = Scripts(render_report(plan)).scripts[1]
    assert not re.search(r"^(import|export)\b", script, re.MULTILINE)
    sources = {path.name: path.read_text() for path in VIEWER.glob("*.js")}
    sources["report.js"] = (VIEWER.parent / "report.js").read_text()
    positions = {name: script.index(f"// {name}\n") for name in sources}
    for name, source in sources.items():
        for imported in re.findall(r'from "\./(?:viewer/)?([^"]+)"', source):
            assert positions[imported] < positions[name], (imported, name)
    declared = re.findall(r"^(?:const|let|class|function) (\w+)", script, re.MULTILINE)
    assert sorted(declared) == sorted(set(declared)), "one script takes no name twice"


def test_the_viewer_knows_the_same_constants_and_statuses() -> None:
    motion, quality = ((VIEWER / name).read_text() for name in ("motion.js", "quality.js"))
    assert f"GRAVITY = {GRAVITY:g};" in motion
    assert f"RADIUS = {{ pan: {Sizes().pan_radius:g}, object: {Sizes().object_radius:g} }};" in motion
    assert f"DRAWN = {MAX_SAMPLES};" in motion
    assert set(re.findall(r'^  (\w+): \["(?:good|mixed|bad)"', quality, re.MULTILINE)) == set(Status)


@pytest.fixture
def open_report(open_page: Callable[..., Page], tmp_path: Path) -> Callable[..., Page]:
    """Write a report and open it from its file."""

    def open_it(plan: Plan, tracks: Sequence[Track] = (), fragment: str = "", **options: Any) -> Page:
        path = tmp_path / "report.html"
        write_report(path, plan, tracks)
        return open_page(f"{path.as_uri()}{fragment}", **options)

    return open_it


def wait_for(condition: Callable[[], bool]) -> None:
    """Wait until a condition holds: the page's policy allows no waiting inside it."""
    until = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)


def pixels(page: Page) -> str:
    data: str = page.evaluate("document.getElementById('stage').toDataURL()")
    return data


@pytest.mark.parametrize("sliding", [True, False])
def test_a_browser_draws_the_page_at_the_time_asked_for(
    plan: Plan, open_report: Callable[..., Page], sliding: bool
) -> None:
    k = int(np.flatnonzero(plan.object_velocity.any(axis=1) == sliding)[50])
    page = open_report(plan, [replayed(plan, "slippery", Friction(0.7, 0.3))], f"#t={k * DT + DT / 2:.4f}")
    assert page.inner_text("#chip") == ("slides" if sliding else "sticks")
    assert float(page.inner_text("#now")) == pytest.approx(k * DT, abs=1.1e-3)
    rows = [row.split("\t") for row in page.locator("#figures tbody tr").all_inner_texts()]
    figures = {row[0].rpartition(" ")[0]: row[-3] for row in rows}
    assert figures["Tracking error, RMS"] == f"{plan.quality.tracking_rmse * 1e3:.1f}"
    assert figures["Pan reach"] == f"{plan.quality.pan_reach * 1e3:.0f}".replace(",", "\u202f")
    assert {"RMS if friction is 10 % off", "Object to its mark, at rest", "Stop after the end"} <= set(figures)
    assert page.locator("#plots svg[role=img]").count() == 6
    assert page.locator("#paths svg[role=img]").count() == 2
    assert "NaN" not in page.content()


def test_every_track_has_its_row_and_a_colour_of_its_own(plan: Plan, open_report: Callable[..., Page]) -> None:
    names = ["slippery", "sticky", "same", "measured"]
    frictions = [Friction(0.7, 0.3), Friction(1.5, 0.8), plan.friction, Friction(0.9, 0.4)]
    tracks = [replayed(plan, *each) for each in zip(names, frictions, strict=True)]
    tracks[3] = replace(tracks[3], pan_position=tracks[3].pan_position + np.array([0.01, 0.01, 0.0]))
    page = open_report(plan, tracks)
    rows = [row.split("\t") for row in page.locator("#tracks tbody tr").all_inner_texts()]
    assert [row[0] for row in rows] == ["as planned", *names]
    assert [row[-1] for row in rows] == ["", "0.0", "0.0", "0.0", "14.1"]
    assert rows[3][1] == rows[0][1] == f"{plan.quality.tracking_rmse * 1e3:.1f}"
    colour = "paths => paths.map(path => getComputedStyle(path).stroke + getComputedStyle(path).strokeDasharray)"
    assert len(set(page.locator("#tracks tbody path").evaluate_all(colour))) == 5
    legend = page.locator("#stage-legend").inner_text()
    assert all(name in legend for name in names)
    lines = page.locator("#plots figure").last.locator(".frame path.curve")
    assert lines.count() == 4  # the plan's pan and the one that moved otherwise, along x and y


def test_a_pan_that_lifts_has_its_height_drawn(plan: Plan, open_report: Callable[..., Page]) -> None:
    lifting = lifting_plan()
    assert lifting.quality.height_max > 0.01
    page = open_report(lifting, [], "#t=0.2")
    titles = page.locator("#plots h2").all_inner_texts()
    assert any(title.startswith("Pan height") for title in titles)
    figures = page.locator("#figures tbody tr").all_inner_texts()
    assert f"Pan height mm\t{lifting.quality.height_max * 1e3:.1f}\t100\t" in "\n".join(figures)
    assert any(row.startswith("Pan speed") for row in figures)
    assert "height" in page.inner_text("#stage-legend")
    level = open_report(plan, [], "#t=0.2")
    words = level.inner_text("#plots") + level.inner_text("#figures") + level.inner_text("#stage-legend")
    assert "height" not in words
    assert "Pan speed" not in words


@pytest.mark.parametrize("case", ["one sample", "never moves", "no friction", "no limits", "hostile", "a minute"])
def test_a_browser_draws_the_odd_plans_too(plan: Plan, open_report: Callable[..., Page], case: str) -> None:
    still = np.zeros_like(plan.object_position)
    unmoved = replace(plan, pan_position=np.zeros_like(plan.pan_position), object_position=still, object_velocity=still)
    no_limits = dict.fromkeys(plan.quality.limits)
    odd = {
        "one sample": lambda: shaken_plan(1),
        "never moves": lambda: unmoved,
        "no friction": lambda: shaken_plan(300, Friction(0.0, 0.0)),
        "no limits": lambda: replace(plan, quality=replace(plan.quality, limits=no_limits, margins=no_limits)),
        "hostile": lambda: replace(plan, model_name=HOSTILE),
        "a minute": lambda: shaken_plan(60_000),
    }[case]()
    page = open_report(odd, (), "#t=0.1&frame=pan")
    assert page.locator("#still").is_checked()
    assert page.title() == f"Sliding plan, {odd.model_name}"
    assert "NaN" not in page.locator("main").inner_html()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_an_object_beyond_the_rim_is_shown_where_it_is_and_marked(
    plan: Plan, open_report: Callable[..., Page], scheme: str
) -> None:
    away = np.array([0.6, 0.2])
    moved = replace(
        plan,
        object_position=np.zeros_like(plan.object_position) + away,
        command_position=plan.command_position + away,
        quality=replace(plan.quality, object_off_pan=OffPan(0, 0.48)),
    )
    page = open_report(moved, (), "#t=0.1&frame=pan", color_scheme=scheme)
    assert page.inner_text("#chip") == "off the pan"
    assert "Over the rim, at most mm\t480\t150 from the middle" in page.inner_text("#figures")
    assert "the object off the pan" in (page.locator("#scrub").get_attribute("aria-valuetext") or "")
    x, y = page.evaluate(
        "() => { const canvas = document.getElementById('stage'), { width, height } = canvas;"
        " const { data } = canvas.getContext('2d').getImageData(0, 0, width, height);"
        " let [x, y, found] = [0, 0, 0];"
        " for (let k = 0; k < data.length; k += 4) if (data[k] > 1.6 * data[k + 1] && data[k + 1] < 150) {"
        "  const at = k / 4; x += at % width; y += Math.floor(at / width); found += 1; }"
        " return [x / found - width / 2, height / 2 - y / found]; }"
    )
    assert y / x == pytest.approx(1 / 3, abs=0.03)
    box = page.locator("#stage").bounding_box()
    assert box is not None
    assert 0.2 < x / box["width"] < 0.5


def test_keys_and_the_address_move_the_time_and_hold_the_pan(plan: Plan, open_report: Callable[..., Page]) -> None:
    page = open_report(plan, (), "#t=0.3")
    shown = pixels(page)
    for key, at in [("ArrowRight", 0.31), ("ArrowLeft", 0.3), ("Shift+ArrowRight", 0.4), ("Shift+ArrowLeft", 0.3)]:
        page.keyboard.press(key)
        assert float(page.inner_text("#now")) == pytest.approx(at, abs=1e-9)
    page.keyboard.press("p")
    assert page.locator("#still").is_checked()
    assert pixels(page) != shown
    page.locator("#still").focus()
    page.keyboard.press("p")
    assert pixels(page) == shown
    page.evaluate("location.hash = '#t=0.5&frame=pan'")
    wait_for(lambda: page.inner_text("#now") == "0.500")
    assert page.locator("#still").is_checked()
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press(" ")
    wait_for(lambda: page.inner_text("#now") != "0.500")
    assert page.locator("#play").get_attribute("aria-label") == "Pause"
    page.keyboard.press(" ")
    assert page.locator("#play").get_attribute("aria-label") == "Play"


def test_a_plot_is_read_under_the_pointer_and_seeks_where_it_is_pressed(
    plan: Plan, open_report: Callable[..., Page]
) -> None:
    page = open_report(plan, (), "#t=0.1", height=1600)
    frame, reading = page.locator("#plots .frame").nth(4), page.locator("#plots .legend").nth(4).locator("b").first
    box = frame.bounding_box()
    assert box is not None
    before = reading.inner_text()
    page.mouse.move(box["x"] + box["width"] * 0.6, box["y"] + 40)
    t = float((frame.locator(".pointer").get_attribute("data-time") or "").split()[0])
    assert 0.3 < t < 0.5
    speed = float(np.linalg.norm(plan.object_velocity, axis=1)[round(t / DT)])
    assert float(reading.inner_text()) == pytest.approx(speed, abs=0.03)
    assert page.inner_text("#now") == "0.100"
    page.mouse.down()
    page.mouse.up()
    assert float(page.inner_text("#now")) == pytest.approx(t, abs=2e-3)
    page.mouse.move(0, 0)
    page.evaluate("location.hash = '#t=0.1000'")
    wait_for(lambda: page.inner_text("#now") == "0.100")
    assert reading.inner_text() == before


def test_it_plays_by_itself_but_not_to_those_who_want_no_motion(plan: Plan, open_report: Callable[..., Page]) -> None:
    page = open_report(plan)
    assert page.locator("#play").get_attribute("aria-label") == "Play"
    assert float(page.inner_text("#now")) == pytest.approx(0.6 * (len(plan) - 1) * DT, abs=1e-3)
    page = open_report(plan, calm=False)
    assert page.locator("#play").get_attribute("aria-label") == "Pause"


def test_on_a_phone_nothing_is_wider_than_the_screen(plan: Plan, open_report: Callable[..., Page]) -> None:
    tracks = [replayed(plan, "a-name-without-a-place-to-break-" * 3, Friction(0.7, 0.3))]
    page = open_report(plan, tracks, width=360, height=740, has_touch=True, is_mobile=True)
    assert page.evaluate("document.documentElement.scrollWidth") == 360


def test_the_colours_follow_the_scheme(plan: Plan, open_report: Callable[..., Page]) -> None:
    page = open_report(plan, (), "#t=0.3")
    light = pixels(page)
    page.emulate_media(color_scheme="dark")
    wait_for(lambda: pixels(page) != light)
    page.emulate_media(color_scheme="light")
    wait_for(lambda: pixels(page) == light)
