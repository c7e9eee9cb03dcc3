"""The arm on the page: its joints hold the pan where the plan has it, and nothing of it is loaded unasked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from benchmarks.pictures.browser import PATIENCE
from benchmarks.pictures.page import draw, plan, seek, settle

expect.set_options(timeout=PATIENCE)

ARMS = ["fr3", "iiwa14", "panda", "ur10e", "ur5e", "xarm6"]

FOLLOW = """async ([name, points]) => {
  const { Arm, parseArm } = await import("/arm.js");
  const arm = new Arm(parseArm(await (await fetch(`/arms/${name}.toml`)).text()));
  const rows = points.map((point) => arm.moveTo(point) && arm.angles);
  return { home: arm.home, place: arm.place, rows };
}"""


def circle() -> list[list[float]]:
    s = np.linspace(0.0, 2.0 * np.pi, 60)
    rows: list[list[float]] = np.stack([0.1 * np.sin(s), 0.1 - 0.1 * np.cos(s), 0.03 * np.sin(2 * s)], axis=1).tolist()
    return rows


@pytest.mark.parametrize("name", ARMS)
def test_joints_hold_the_pan_where_python_has_it(page_server: Any, open_page: Callable[..., Page], name: str) -> None:
    pytest.importorskip("mujoco")
    from runtime.arms.load import load_arm
    from runtime.arms.model import ArmModel
    from runtime.arms.place import find_place

    model = ArmModel(load_arm(name))
    place = find_place(model)
    followed = open_page(page_server.url).evaluate(FOLLOW, [name, circle()])
    np.testing.assert_allclose(followed["place"]["position"], place.position, atol=1e-3)
    np.testing.assert_allclose(followed["place"]["rotation"], place.rotation, atol=1e-3)
    begin, rotation = np.array(followed["place"]["position"]), np.array(followed["place"]["rotation"])
    for point, angles in zip(circle(), followed["rows"], strict=True):
        assert angles, "not reached"
        position, attitude, _ = model.pan(np.array(angles))
        np.testing.assert_allclose(position, begin + rotation @ point, atol=1e-6)
        np.testing.assert_allclose(attitude, rotation, atol=1e-6)
    steps = np.diff(np.array(followed["rows"]), axis=0)
    assert np.abs(steps).max() < 0.3  # no joint jumps


def test_a_place_out_of_reach_is_told_and_the_arm_stays(page_server: Any, open_page: Callable[..., Page]) -> None:
    far = open_page(page_server.url).evaluate(FOLLOW, ["ur5e", [[3.0, 0.0, 0.0], [0.01, 0.0, 0.0]]])
    assert far["rows"][0] is False
    assert np.abs(np.array(far["rows"][1]) - far["home"]).max() < 0.1


def pixels(page: Page) -> bytes:
    return page.locator("#arm-stage").screenshot()


def test_the_arm_is_loaded_when_it_is_opened_and_moves_with_the_pan(
    page_server: Any, open_page: Callable[..., Page]
) -> None:
    page = open_page(page_server.url, complains=True)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    draw(page)
    settle(page)
    assert not [url for url in asked if "three" in url or "/arms/" in url]
    page.locator("#arm-card summary").click()
    expect(page.locator("#arm-note")).to_be_hidden()
    page.wait_for_selector("#arm-card[data-shows=ur5e]")
    seek(page, 0.0)
    first = pixels(page)
    seek(page, 0.6)
    second = pixels(page)
    assert first != second
    page.locator("#arm-stage").focus()
    page.keyboard.press("ArrowLeft")
    assert pixels(page) != second
    assert page.inner_text("#now") == "0.600"  # the keys turned the view, not the clock
    page.select_option("#robot", label="Franka FR3")
    page.wait_for_selector("#arm-card[data-shows=fr3]")
    expect(page.locator("#arm-note")).to_be_hidden()


def test_the_arm_whose_limits_are_taken_is_shown_unless_one_was_chosen(
    page_server: Any, open_page: Callable[..., Page]
) -> None:
    page = open_page(page_server.url)
    page.locator("#limits-row summary").click()
    page.select_option("#arm", label="UR10e, level")
    assert page.locator("#robot").input_value() == "ur10e"
    page.locator("#arm-card summary").click()
    page.select_option("#robot", label="xArm 6")
    page.select_option("#arm", label="Franka Panda, level")
    assert page.locator("#robot").input_value() == "xarm6"


@pytest.mark.parametrize(("lost", "words"), [("**/three.js", "cannot be loaded"), ("**/*.toml", "description cannot")])
def test_what_does_not_come_is_told(page_server: Any, open_page: Callable[..., Page], lost: str, words: str) -> None:
    page = open_page(page_server.url, complains=True)
    page.route(lost, lambda route: route.abort())
    page.locator("#arm-card summary").click()
    expect(page.locator("#arm-note")).to_contain_text(words)
    plan(page)  # all else works


def test_a_browser_without_webgl_is_told(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url, complains=True)
    page.evaluate("() => { HTMLCanvasElement.prototype.getContext = () => null; }")
    page.locator("#arm-card summary").click()
    expect(page.locator("#arm-note")).to_contain_text("it has no WebGL")
