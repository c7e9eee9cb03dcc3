"""The page at / in a real browser: draws, plans, plays, downloads, and says in words what goes wrong."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, Route, expect

from benchmarks.pictures.browser import PATIENCE
from benchmarks.pictures.page import draw, plan, seek, settle
from runtime import Command, Friction, Plan
from runtime.commands.path import run_along
from runtime.outputs.csv_file import to_csv
from runtime.physics.law import slide_one
from runtime.report.report import render_report

EXAMPLES = ["Circle", "Eight", "Strokes", "Signature"]

expect.set_options(timeout=PATIENCE)


def pixels(page: Page) -> str:
    data: str = page.evaluate("document.getElementById('stage').toDataURL()")
    return data


def saved(page: Page, button: str = "download", name: str = "plan.json") -> str:
    with page.expect_download() as download:
        page.click(f"#{button}")
    assert download.value.suggested_filename == name
    return Path(download.value.path()).read_text()


def test_a_path_drawn_with_the_mouse_is_planned_and_played(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    before = pixels(page)
    with page.expect_request("**/plan") as request:
        draw(page)
    settle(page)
    assert pixels(page) != before
    assert re.match(r"\d+ cm in \d\.\d\d s, and 0\.2 s at rest\. Planned", page.inner_text("#summary"))
    asked = request.value.post_data_json
    assert Command.from_dict(asked["command"]).reach > 0.05
    assert asked["friction"] == {"static": 1, "kinetic": 0.5}

    end = page.locator("#scrub").evaluate("s => Number(s.max)")
    states = set()
    for share in np.linspace(0.0, 1.0, 21):
        seek(page, share * end)
        states.add(page.inner_text("#chip"))
    assert states == {"sticks", "slides"}
    expect(page.locator("#plots svg[role=img]")).to_have_count(6)

    seek(page, 0.0)
    still = pixels(page)
    page.click("#play")
    expect(page.locator("#now")).not_to_have_text("0.000")
    page.click("#play")
    assert pixels(page) != still
    page.click("#redraw")
    expect(page.locator("#transport")).to_be_hidden()
    plan(page)
    draw(page, 0.7)  # on the moving pan, which lies still at once
    settle(page)


def test_what_is_downloaded_is_the_plan_and_the_curl_line_asks_for_the_same(
    page_server: Any, open_page: Callable[..., Page]
) -> None:
    page = open_page(page_server.url, permissions=["clipboard-read", "clipboard-write"])
    draw(page)
    asked = plan(page)
    downloaded = Plan.from_dict(json.loads(saved(page)))
    assert len(downloaded) == len(Command.from_dict(asked["command"]))
    shown = page.locator("#figures tbody tr").first.inner_text()
    assert f"{downloaded.quality.tracking_rmse * 1e3:.1f}" in shown

    page.click("#copy")
    expect(page.locator("#copied")).to_have_text("Copied.")
    words = shlex.split(page.evaluate("navigator.clipboard.readText()"))
    assert words[:2] == ["curl", f"{page_server.url}/plan"]
    headers = dict(words[index + 1].split(": ") for index, word in enumerate(words) if word == "-H")
    again = httpx.post(words[1], content=words[words.index("-d") + 1], headers=headers)
    assert Plan.from_dict(again.json()).pan_acceleration == pytest.approx(downloaded.pan_acceleration, abs=1e-4)


@pytest.mark.parametrize("name", EXAMPLES)
def test_each_example_is_a_command_the_model_knows_and_follows(
    page_server: Any, open_page: Callable[..., Page], name: str
) -> None:
    page = open_page(page_server.url)
    page.get_by_role("button", name=name).click()
    settle(page)
    quality = Plan.from_dict(json.loads(saved(page))).quality
    assert quality.status in ("ok", "governed")
    assert quality.tracking_rmse < 0.005  # by the tolerance that the page gives, or the badge would be red
    expect(page.locator("#badge")).to_contain_text("Within limits")


def test_wild_scribbles_become_commands_from_rest_to_rest_within_the_ranges(
    page_server: Any, open_page: Callable[..., Page]
) -> None:
    page = open_page(page_server.url)
    random = np.random.default_rng(6)
    for speed in (0.15, 0.4, 0.7):
        corners = random.uniform(-0.15, 0.15, (12, 2))
        command = page.evaluate(
            "async ([points, speed]) => {"
            " const { commandAlong, commandDocument } = await import('/path.js');"
            " return commandDocument(commandAlong(points, { speed, reach: 0.15 }).positions); }",
            [corners.tolist(), speed],
        )
        made = Command.from_dict(command)
        assert made.reach <= 0.15
        assert 0.8 * speed < made.speed <= speed * 1.01
        acceleration = np.diff(made.position, 2, axis=0) / 1e-6
        assert np.hypot(*acceleration.T).max() < 8.0
        assert np.hypot(*made.velocity[[0, -1]].T).max() < 0.01


def test_the_page_runs_along_a_path_as_python_does(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    random = np.random.default_rng(8)
    curve = np.stack([0.05 * np.cos(np.linspace(0, 6, 90)), 0.04 * np.sin(np.linspace(0, 9, 90))], axis=1)
    paths = [random.uniform(-0.1, 0.1, (count, 2)) for count in (2, 3, 12)]
    for points in (*paths, curve, np.array([[0, 0], [0, 0], [0.08, 0], [0, 0]])):
        for speed in (0.15, 0.6):
            drawn = page.evaluate(
                "async ([points, speed]) => {"
                " const { commandAlong } = await import('/path.js');"
                " return commandAlong(points, { speed, reach: 10 }).positions; }",
                [points.tolist(), speed],
            )
            made, _ = run_along(points, speed, corner=0.006)
            assert 0 <= len(drawn) - len(made) - 200 < 10  # the page sends every tenth, and fills up; then it rests
            np.testing.assert_allclose(drawn[: len(made)], made, rtol=0.0, atol=1e-9)
            np.testing.assert_array_equal(drawn[-200:], [drawn[-1]] * 200)


def test_everything_can_be_done_from_the_keyboard_and_the_focus_is_seen(
    page_server: Any, open_page: Callable[..., Page]
) -> None:
    page = open_page(page_server.url)
    outline = "getComputedStyle(document.activeElement).outlineStyle"
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "stage"
    assert page.evaluate(outline) == "solid"
    for key in ["ArrowRight"] * 8 + ["ArrowUp"] * 6 + ["Shift+ArrowLeft"] * 5:
        page.keyboard.press(key)
    expect(page.locator("#summary")).to_contain_text("7 cm in")
    seen = []
    while "plan" not in seen and len(seen) < 30:
        page.keyboard.press("Tab")
        seen.append(page.evaluate("document.activeElement.id || document.activeElement.textContent"))
        assert page.evaluate(outline) == "solid", seen
        if seen[-1] == "speed":
            page.keyboard.press("ArrowRight")
    arm, limits = (
        " ".join(page.locator(f"#{name} summary").inner_text().split()) for name in ("arm-card", "limits-row")
    )
    controls = ["file", "share", "pan", "speed", "static", "kinetic", limits, "plan"]
    assert [" ".join(each.split()) for each in seen] == [arm, *EXAMPLES, *controls]
    assert page.inner_text("#speed-value") == "0.45 m/s"
    page.keyboard.press("Enter")
    settle(page)
    page.evaluate("document.activeElement.blur()")
    at = page.inner_text("#now")
    page.keyboard.press("ArrowRight")
    assert float(page.inner_text("#now")) == pytest.approx(float(at) + 0.01, abs=0.0011)
    page.keyboard.press(" ")
    expect(page.locator("#play")).to_have_attribute("aria-label", "Pause")


def test_path_drawn_with_the_keys_is_planned_by_enter(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    page.keyboard.press("Tab")
    for key in ["ArrowRight"] * 6 + ["Enter"]:
        page.keyboard.press(key)
    settle(page)
    assert page.inner_text("#summary").startswith("3 cm in")


def test_friction_at_rest_is_never_less_than_while_sliding(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    page.locator("#kinetic").fill("0.8")
    page.locator("#static").fill("0.6")
    assert page.inner_text("#kinetic-value") == "0.60"
    assert plan(page)["friction"] == {"static": 0.6, "kinetic": 0.6}
    page.locator("#kinetic").fill("0.3")
    assert "Not planned yet" in page.inner_text("#summary")
    expect(page.locator("#stage-card")).to_have_class(re.compile("stale"))
    expect(page.locator("#summary")).to_contain_text("Planned")
    expect(page.locator("#stage-card")).not_to_have_class(re.compile("stale"))
    page.select_option("#pan", index=3)
    assert (page.inner_text("#static-value"), page.inner_text("#kinetic-value")) == ("0.80", "0.60")
    page.locator("#static").fill("0.9")
    expect(page.locator("#pan")).to_have_value("-1")


def test_on_a_phone_a_finger_draws_and_nothing_is_wider_than_the_screen(
    page_server: Any, open_page: Callable[..., Page]
) -> None:
    page = open_page(page_server.url, width=360, height=740, has_touch=True, is_mobile=True)
    box = page.locator("#stage").bounding_box()
    assert box is not None
    fingers = page.context.new_cdp_session(page)
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for kind, dx in [("touchStart", 0.0), *(("touchMove", 6.0 * k) for k in range(1, 12)), ("touchEnd", None)]:
        points = [] if dx is None else [{"x": x + dx, "y": y + dx / 2}]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    expect(page.locator("#summary")).to_contain_text(re.compile(r"^\d+ cm in"))
    settle(page)
    page.locator("#quality summary").click()
    widest = "Math.max(...[...document.querySelectorAll('body *')].map(e => e.getBoundingClientRect().right))"
    assert page.evaluate("document.documentElement.scrollWidth") == 360
    assert page.evaluate(widest) <= 360
    small = page.evaluate(
        "[...document.querySelectorAll('button, select, summary, input[type=range], .file, .toggle, .choice')]"
        ".filter((e) => e.offsetParent && e.getBoundingClientRect().height < 44).map((e) => e.id || e.className)"
    )
    assert small == []
    page.evaluate("scrollTo(0, document.body.scrollHeight / 3)")
    stage = page.locator("#stage").bounding_box()
    assert stage is not None
    assert stage["y"] >= 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_what_it_is_written_on(
    page_server: Any, open_page: Callable[..., Page], scheme: str
) -> None:
    page = open_page(page_server.url, color_scheme=scheme)
    pairs = [("ink", "card"), ("soft", "card"), ("soft", "page"), ("on-act", "act"), ("stage-ink", "stage")]
    pairs += [(state, "card") for state in ("ok", "warn", "bad")]
    color = "name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim()"
    for text, ground in pairs:
        bright, dim = sorted((luminance(page.evaluate(color, name)) for name in (text, ground)), reverse=True)
        assert (bright + 0.05) / (dim + 0.05) >= 4.5, (text, ground)


def luminance(color: str) -> float:
    """Return the relative luminance of #rgb or #rrggbb (WCAG 2)."""
    digits = color[1:] if len(color) == 7 else "".join(2 * digit for digit in color[1:])
    parts = [int(digits[at : at + 2], 16) / 255 for at in (0, 2, 4)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_a_server_that_was_stopped_is_told_in_words_and_the_path_is_kept(
    run_server: Callable[..., Any], open_page: Callable[..., Page]
) -> None:
    with run_server() as server:
        page = open_page(server.url, complains=True)
    draw(page)
    expect(page.get_by_role("alert")).to_contain_text("The server cannot be reached: it may have been stopped.")
    assert re.match(r"\d+ cm in \d\.\d\d s", page.inner_text("#summary"))


def test_a_server_with_a_token_asks_for_it(run_server: Callable[..., Any], open_page: Callable[..., Page]) -> None:
    with run_server(token="let me in") as server:
        page = open_page(server.url, complains=True)
        page.click("#plan")
        expect(page.get_by_role("alert")).to_contain_text("only for those who have its token")
        page.get_by_label("Token of this server").fill("let me in")
        plan(page)
        expect(page.get_by_role("alert")).to_be_hidden()
        curl = page.locator("#curl").text_content() or ""
        assert "let me in" not in curl
        assert "$SLIDE_TOKEN" in curl


def test_a_path_beyond_what_the_server_takes_is_refused_in_words(
    run_server: Callable[..., Any], open_page: Callable[..., Page]
) -> None:
    for limit, words in (
        ({"max_samples": 400}, "at most 400 are taken"),
        ({"max_body": 1024}, "too long for the server"),
    ):
        with run_server(**limit) as server:
            page = open_page(server.url, complains=True)
            page.click("#plan")
            expect(page.get_by_role("alert")).to_contain_text(words)


@pytest.mark.parametrize(
    ("status", "headers", "words"),
    [
        (422, {}, "The server cannot plan this path. <img src=x onerror=alert(1)>."),
        (500, {}, "Something broke inside the server."),
        (503, {"Retry-After": "7"}, "The server has its hands full. Try again in 7 s."),
        (504, {}, "Planning took longer than the server allows."),
        (200, {}, "answer is no plan that this page can read"),
        (418, {}, "The server answered with status 418."),
    ],
)
def test_every_refusal_is_told_in_words_and_no_markup_of_it_is_taken(
    page_server: Any, open_page: Callable[..., Page], status: int, headers: dict[str, str], words: str
) -> None:
    page = open_page(page_server.url, complains=True)
    problem = json.dumps({"title": "t", "detail": "<img src=x onerror=alert(1)>"})

    def refuse(route: Route) -> None:
        route.fulfill(status=status, headers=headers, body=problem)

    page.route("**/plan", refuse)
    page.click("#plan")
    expect(page.get_by_role("alert")).to_contain_text(words)
    assert page.locator("#message img").count() == 0
    page.unroute("**/plan")
    plan(page)
    expect(page.get_by_role("alert")).to_be_hidden()


def drawn(page: Page) -> str:
    """Return the part of the address that holds the drawing."""
    found: str = page.evaluate("new URLSearchParams(location.hash.slice(1)).get('d')")
    return found


def test_drawings_are_undone_and_done_again(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    expect(page.locator("#undo")).to_be_disabled()
    draw(page)
    settle(page)
    first = drawn(page)
    draw(page, 0.5)
    settle(page)
    second = drawn(page)
    assert first != second
    page.click("#undo")
    assert drawn(page) == first
    settle(page)
    page.keyboard.press("Control+Shift+Z")
    assert drawn(page) == second
    settle(page)
    expect(page.locator("#redo")).to_be_disabled()
    page.keyboard.press("Control+z")
    draw(page, 0.3)
    expect(page.locator("#redo")).to_be_disabled()


def test_drawing_survives_a_reload_and_is_in_the_link_that_is_shared(
    page_server: Any, open_page: Callable[..., Page]
) -> None:
    page = open_page(page_server.url, permissions=["clipboard-read", "clipboard-write"])
    page.locator("#speed").fill("0.3")
    page.locator("#limits-row summary").click()
    page.select_option("#arm", label="Franka Panda, level")
    draw(page)
    settle(page)
    length = page.inner_text("#summary").partition(".")[0]
    before = drawn(page)
    page.reload()
    settle(page)
    assert page.inner_text("#summary").startswith(length)
    page.click("#share")
    expect(page.locator("#copied")).to_have_text("Copied.")
    link = page.evaluate("navigator.clipboard.readText()")
    assert len(link) < 2000
    other = open_page(link)
    settle(other)
    assert drawn(other) == before
    assert other.inner_text("#speed-value") == "0.30 m/s"
    assert other.inner_text("#limits-now") == "Franka Panda, level"


@pytest.mark.parametrize(
    "fragment",
    ["d=", "d=AA", "d=%00", "d=AAAA", "speed=1", "d=" + "AAAA" * 5000, "d=<img src=x>&speed=NaN", "%", "d=_3__fw"],
)
def test_link_that_holds_no_drawing_opens_the_page_as_usual(
    page_server: Any, open_page: Callable[..., Page], fragment: str
) -> None:
    page = open_page(f"{page_server.url}/#{fragment}")
    draw(page)
    settle(page)


def test_what_is_downloaded_as_csv_is_what_python_writes(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    draw(page)
    settle(page)
    rows = [line.split(",") for line in saved(page, "csv", "plan.csv").splitlines()]
    own = [line.split(",") for line in to_csv(Plan.from_dict(json.loads(saved(page))).document()).decode().splitlines()]
    assert rows[0] == own[0]
    np.testing.assert_allclose(np.array(rows[1:], float), np.array(own[1:], float), rtol=0.0, atol=1e-9)


def test_plots_and_film_are_downloaded(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    page.get_by_role("button", name="Strokes").click()
    settle(page)
    plots = ElementTree.fromstring(saved(page, "drawing", "plots.svg"))
    assert len(plots.findall("{*}svg")) == 6
    assert all(path.get("stroke") or path.get("fill") for path in plots.iter("{*}path"))
    page.locator("#rates label").first.click()
    with page.expect_download() as download:
        page.click("#film")
    assert download.value.suggested_filename == "plan.webm"
    assert Path(download.value.path()).read_bytes().startswith(b"\x1aE\xdf\xa3")


def test_command_file_is_read_by_the_server_and_planned(
    page_server: Any, open_page: Callable[..., Page], tmp_path: Path
) -> None:
    page = open_page(page_server.url, complains=True)
    example = Path(__file__).parents[2] / "examples/figure_eight.csv"
    with page.expect_request("**/plan") as request:
        page.set_input_files("#file", example)
    settle(page)
    np.testing.assert_allclose(request.value.post_data_json["command"]["position"], Command.load(example).position)
    sketch = tmp_path / "sketch.svg"
    sketch.write_text('<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0C10 20 30 20 40 0"/></svg>')
    page.set_input_files("#file", sketch)
    expect(page.locator("#summary")).to_contain_text("laid its middle on the pan's centre")
    with (tmp_path / "large.csv").open("wb") as large:
        large.truncate(50_000_000)
    page.set_input_files("#file", tmp_path / "large.csv")
    expect(page.get_by_role("alert")).to_have_text("This file has 50.0 MB, and the server takes at most 1.0 MB.")
    (tmp_path / "junk.csv").write_bytes(b"\x00\x1b[2J")
    page.set_input_files("#file", tmp_path / "junk.csv")
    expect(page.get_by_role("alert")).to_contain_text("The server cannot plan this path.")


def test_the_page_slides_an_object_as_python_does(page_server: Any, open_page: Callable[..., Page]) -> None:
    random = np.random.default_rng(3)
    u = random.normal(0.0, 8.0, (300, 3)) * [1.0, 1.0, 0.3]
    u[100:180] = 0.0
    slid = open_page(page_server.url).evaluate(
        "async (rows) => { const { slide } = await import('/law.js'); let state = [0, 0, 0.1, -0.2];"
        " return rows.map((u) => (state = slide(state, u, { static: 0.9, kinetic: 0.4 }, 0.001))); }",
        u.tolist(),
    )
    own = slide_one(np.array([0.0, 0.0, 0.1, -0.2]), u, Friction(0.9, 0.4))
    np.testing.assert_allclose(slid, own, rtol=0.0, atol=1e-12)


def test_the_page_and_the_report_draw_the_same_motion(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    plan(page)
    document = json.loads(saved(page))
    reported = render_report(Plan.from_dict(document)).partition('id="report">')[2].partition("</script>")[0]
    motions = page.evaluate(
        "async (documents) => {"
        " const { motionOf } = await import('/viewer/motion.js');"
        " return documents.map(motionOf); }",
        [document, json.loads(reported)],
    )
    own, other = motions
    assert len(own["rests"]) >= 1
    assert own.keys() == other.keys()
    for name in own:
        if isinstance(own[name], dict) and "x" in own[name]:
            np.testing.assert_allclose(own[name]["x"], other[name]["x"], atol=1e-6, err_msg=name)
            np.testing.assert_allclose(own[name]["y"], other[name]["y"], atol=1e-6, err_msg=name)
        elif name in ("time", "slip", "speed", "farthest", "reach", "end"):
            np.testing.assert_allclose(own[name], other[name], atol=2e-6, err_msg=name)
        else:
            assert own[name] == other[name], name


def test_a_long_plan_is_thinned_for_drawing_and_keeps_both_ends(
    page_server: Any, open_page: Callable[..., Page]
) -> None:
    drawn = open_page(page_server.url).evaluate(
        "async (rows) => { const { locate, motionOf } = await import('/viewer/motion.js');"
        " const moved = Array.from({ length: rows }, (_, k) => [k, 0]);"
        " const still = moved.map((_, k) => [k % 1000 < 500 ? 0 : 1, 0]);"
        " const motion = motionOf({ dt: 0.001, command: { position: moved }, friction: { static: 1, kinetic: 0.5 },"
        "  object: { position: moved, velocity: still }, quality: { limits: {} },"
        "  pan: { position: moved, acceleration: moved } });"
        " return { time: motion.time, x: motion.object.x, slip: motion.slip, at: locate(motion, 12.3456) }; }",
        20_001,
    )
    assert len(drawn["time"]) <= 6000
    assert (drawn["time"][0], drawn["time"][-1]) == (0, 20)
    np.testing.assert_allclose(drawn["x"], np.array(drawn["time"]) * 1000.0)
    np.testing.assert_allclose(drawn["slip"], [[k + 0.5, k + 1.0] for k in range(20)])
    before, share = drawn["time"][drawn["at"]["k"]], drawn["at"]["share"]
    assert before + share * (drawn["time"][drawn["at"]["next"]] - before) == pytest.approx(12.3456)


def test_the_files_are_small_and_name_nothing_outside() -> None:
    root = Path(__file__).parents[2]
    static, report = root / "server/static", root / "runtime/report"
    found = (path for folder in (static, report, report / "viewer") for path in folder.iterdir())
    files = [path for path in found if path.suffix in (".html", ".js", ".css")]
    assert len(files) > 18
    for path in files:
        text = path.read_text()
        assert len(text.splitlines()) <= 400, path.name
        assert max(len(line) for line in text.splitlines()) <= 120, path.name
        text = text.replace("https://doi.org/10.1109/LRA.2018.2854958", "")  # the paper, as a link to be followed
        assert not re.findall(r"https?://|style=\"|\son\w+=", text), path.name
        for name in re.findall(r'from "\./([^"]+)"', text):
            assert (path.parent / name).is_file() or (path.parent == static and (report / name).is_file()), name
