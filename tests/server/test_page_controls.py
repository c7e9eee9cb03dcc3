"""Beside the pan: limits and frictions that are set or chosen, what is drawn true, links, and what axe finds."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Page, expect

from benchmarks.pictures.browser import PATIENCE
from benchmarks.pictures.page import draw, plan, seek, settle
from runtime import Limits

expect.set_options(timeout=PATIENCE)

AXE = Path(__file__).parents[2] / "browser/node_modules/axe-core/axe.min.js"

NAMES = "async () => (await import('/examples.js')).ARMS.map(({ name, arm, limits }) => [name, arm ?? null, limits])"


def open_limits(page: Page) -> None:
    page.locator("#limits-row summary").click()
    expect(page.locator("#jerk")).to_be_visible()


def test_limits_of_an_arm_are_chosen_and_the_height_is_shown(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    draw(page)
    settle(page)
    open_limits(page)
    page.select_option("#arm", label="Franka Panda, lifting")
    page.fill("#static", "0.5")
    page.fill("#kinetic", "0.3")
    asked = plan(page)["limits"]
    assert asked == Limits.named("panda").to_dict()
    figures = page.locator("#figures tbody tr").all_inner_texts()
    assert any(re.fullmatch(r"Pan speed m/s\t[\d.]+\t1\.70\t[\d.]+", row) for row in figures), figures
    assert any(row.startswith("Pan height mm\t") and "\t100\t" in row for row in figures)


def test_a_limit_is_set_by_its_slider_and_planned_within(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    draw(page)
    assert "limits" not in plan(page)  # the model's own
    open_limits(page)
    for name, value in (("pan_reach", "0.12"), ("top_speed", "1.2"), ("acceleration", "20"), ("jerk", "8000")):
        page.fill(f"#{name}", value)
    assert page.inner_text("#limits-now") == "as set below"
    assert page.inner_text("#top_speed-value") == "1.2 m/s"
    asked = plan(page)["limits"]
    assert asked == {"pan_reach": 0.12, "height": 0, "speed": 1.2, "acceleration": 20, "jerk": 8000}
    page.fill("#top_speed", page.get_attribute("#top_speed", "max") or "")
    assert page.inner_text("#top_speed-value") == "none"
    assert plan(page)["limits"]["speed"] is None


def test_limits_travel_in_the_link(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    open_limits(page)
    for name, value in (("pan_reach", "0.15"), ("height", "0.05"), ("top_speed", "1.5"), ("jerk", "6000")):
        page.fill(f"#{name}", value)
    draw(page)
    settle(page)
    other = open_page(page.url)
    settle(other)
    texts = (
        "['pan_reach', 'height', 'top_speed', 'acceleration', 'jerk'].map((id) => document.getElementById(id).value)"
    )
    assert other.evaluate(texts) == page.evaluate(texts) == ["0.15", "0.05", "1.5", "30", "6000"]


@pytest.mark.parametrize("limits", ["", ",,,,", "NaN,0,1,2,3", "1e9,-1,1e400,x,", '{"name":"panda"}', "0,0,0,0,0"])
def test_limits_of_a_link_that_are_none_are_passed_over_or_brought_into_range(
    page_server: Any, open_page: Callable[..., Page], limits: str
) -> None:
    page = open_page(page_server.url)
    draw(page)
    settle(page)
    other = open_page(f"{page.url}&limits={limits}", complains=True)
    settle(other)
    expect(other.get_by_role("alert")).to_be_hidden()


def test_limits_of_arms_are_those_that_python_knows(page_server: Any, open_page: Callable[..., Page]) -> None:
    pytest.importorskip("mujoco")
    from runtime.arms.fit import pan_limits
    from runtime.arms.load import load_arm
    from runtime.arms.model import ArmModel
    from runtime.arms.place import find_place

    for name, arm, document in open_page(page_server.url).evaluate(NAMES):
        own = Limits.from_dict(document)
        if arm is None or arm in ("panda", "fr3"):
            known = Limits.named(arm or "default").to_dict()
            assert own.to_dict() == {**known, "height": own.height}, name
            continue
        model = ArmModel(load_arm(arm))
        can = pan_limits(model, find_place(model), Limits())
        for limit in ("speed", "acceleration", "jerk"):
            assert 0.88 * getattr(can, limit) <= getattr(own, limit) <= getattr(can, limit) * 1.001, (name, limit)


def test_every_pan_that_is_offered_is_planned_for(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    expect(page.locator("#footer")).to_contain_text("Model")
    pans = page.evaluate("async () => (await import('/examples.js')).PANS")
    offered = page.evaluate("() => [...document.querySelectorAll('#pan option:enabled')].map((each) => each.value)")
    assert len(offered) > 5
    draw(page)
    for index in offered[1:]:
        page.select_option("#pan", value=index)
        chosen = pans[int(index)]
        assert plan(page)["friction"] == {"static": chosen["static"], "kinetic": chosen["kinetic"]}


def test_a_path_over_the_rim_is_seen_whole_and_said(
    page_server: Any, open_page: Callable[..., Page], tmp_path: Path
) -> None:
    page = open_page(page_server.url)
    far = tmp_path / "far.csv"
    far.write_text("t,x,y\n0,0,0\n0.5,0.06,0.02\n1,0.13,-0.02\n1.5,0.19,0\n")
    page.set_input_files("#file", far)
    settle(page)
    expect(page.locator("#badge")).to_have_text("Off the pan")
    seek(page, 1.4)
    expect(page.locator("#chip")).to_have_text("off the pan")
    page.click("#redraw")
    right = page.evaluate(
        "async () => { const { Stage } = await import('/viewer/stage.js'); const { RADIUS } = await import("
        "'/viewer/motion.js'); const stage = new Stage(document.getElementById('stage'));"
        " stage.drawDraft({ drawn: [], positions: [[0, 0], [0.4, 0]], pen: null });"
        " const box = stage.canvas.getBoundingClientRect();"
        " return stage.toMetres({ clientX: box.right, clientY: box.top + box.height / 2 })[0] - RADIUS.object; }"
    )
    assert right > 0.4  # an object there is seen whole


def test_links_lead_where_the_package_says(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url)
    paper = page.get_by_role("link", name="The paper").get_attribute("href")
    assert paper == httpx.get(f"{page_server.url}/info").json()["links"]["paper"]
    assert page.get_by_role("link", name="interface").is_visible()
    assert page.locator("#source").is_hidden()  # nobody says where it is
    info = httpx.get(f"{page_server.url}/info").json()
    info["links"] = {"documents": "https://docs.example.com/", "source": "javascript:alert(1)"}
    other = page.context.new_page()
    other.route("**/info", lambda route: route.fulfill(body=json.dumps(info)))
    other.goto(page_server.url)
    expect(other.get_by_role("link", name="Documents")).to_have_attribute("href", "https://docs.example.com/")
    assert other.locator("#source").is_hidden()


def test_a_server_that_starts_is_waited_for(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url, complains=True)
    asked = []

    def start(route: Any) -> None:
        asked.append(route.request.url)
        if len(asked) < 3:
            route.fulfill(status=503, body="")
        else:
            route.continue_()

    page.route("**/info", start)
    page.reload()
    expect(page.locator("#footer")).to_contain_text("Model")
    assert len(asked) == 3


def test_a_plan_that_is_there_is_kept_quietly_where_the_better_one_comes_too_late(
    page_server: Any, open_page: Callable[..., Page]
) -> None:
    page = open_page(page_server.url, complains=True)
    info = httpx.get(f"{page_server.url}/info").json()
    info["settings"]["max_refine_ms"] = 200.0

    def answer(route: Any) -> None:
        if "tolerance" in route.request.post_data_json:  # of the better one alone
            route.fulfill(status=504, body="")
        else:
            route.continue_()

    page.route("**/info", lambda route: route.fulfill(body=json.dumps(info)))
    page.route("**/plan", answer)
    page.reload()
    expect(page.locator("#footer")).to_contain_text("Model")
    draw(page)
    settle(page)
    expect(page.get_by_role("alert")).to_be_hidden()
    assert "Planned in" in page.inner_text("#summary")


@pytest.mark.skipif(not AXE.is_file(), reason="axe-core is not installed: npm ci --prefix browser")
@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 1280), ("light", 360)])
def test_axe_finds_nothing(page_server: Any, open_page: Callable[..., Page], scheme: str, width: int) -> None:
    page = open_page(page_server.url, width=width, color_scheme=scheme, bypass_csp=True)

    def find() -> list[str]:
        page.add_script_tag(path=AXE)
        found = page.evaluate("async () => (await axe.run()).violations")
        return [f"{each['id']}: {node['html']}" for each in found for node in each["nodes"]]

    open_limits(page)
    assert find() == []
    draw(page)
    settle(page)
    page.locator("#quality summary").click()
    page.locator(".toggle:has(#closed)").click()
    expect(page.locator("#push")).to_be_visible()
    page.click("#play")
    assert find() == []


def test_a_page_that_shows_a_plan_is_scrolled_by_its_reader_alone(
    page_server: Any, open_page: Callable[..., Page]
) -> None:
    page = open_page(page_server.url)
    draw(page)
    settle(page)
    page.evaluate("scrollTo(0, 500)")
    page.wait_for_timeout(500)
    assert page.evaluate("scrollY") == 500
