"""The closed loop on the page: the server steers, the page is pan and object, and somebody pushes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from benchmarks.pictures.browser import PATIENCE
from benchmarks.pictures.page import plan, seek
from runtime import Friction, Limits
from runtime.physics.law import slide_one

expect.set_options(timeout=PATIENCE)


def close_loop(page: Page) -> None:
    plan(page)
    page.locator("#rates label").first.click()
    page.locator(".toggle:has(#closed)").click()
    expect(page.locator("#push")).to_be_visible()


def error_of(page: Page) -> float:
    """Return how far the object is off (mm), as the page says it."""
    found = re.search(r"([\d.]+) mm off", page.inner_text("#hint"))
    assert found is not None
    return float(found[1])


def wait_until(page: Page, t: float) -> None:
    page.wait_for_function("t => Number(document.getElementById('now').textContent) >= t", arg=t)


def test_an_object_that_is_pushed_is_brought_back(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url, calm=False)
    close_loop(page)
    wait_until(page, 0.9)
    assert error_of(page) < 5.0
    page.click("#push")
    worst = page.evaluate(
        "() => new Promise((resolve) => { let worst = 0; const end = performance.now() + 4000; const look = () => {"
        " worst = Math.max(worst, parseFloat(document.getElementById('hint').textContent.split(': ')[1]));"
        " performance.now() > end ? resolve(worst) : requestAnimationFrame(look); }; look(); })"
    )
    assert worst > 5.0
    wait_until(page, 3.0)
    assert error_of(page) < 10.0
    page.locator(".toggle:has(#closed)").click()
    expect(page.locator("#push")).to_be_hidden()
    expect(page.locator("#end")).to_have_text("1.800 s")


def test_a_pointer_pulls_the_object(page_server: Any, open_page: Callable[..., Page]) -> None:
    page = open_page(page_server.url, calm=False)
    close_loop(page)
    box = page.locator("#stage").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 0.4 * box["height"])
    page.mouse.down()
    page.wait_for_function("() => parseFloat(document.getElementById('hint').textContent.split(': ')[1]) > 12")
    page.mouse.up()
    assert page.locator("#stage-card").get_attribute("data-mode") == "play"  # nothing was drawn


def test_what_the_page_executes_keeps_the_limits_and_the_law(page_server: Any, open_page: Callable[..., Page]) -> None:
    """Drive the loop without a picture, faster than the clock, with a pull in the middle."""
    page = open_page(page_server.url)
    friction, limits = Friction(0.6, 0.4), Limits(0.15, speed=1.5, acceleration=20.0, jerk=8000.0)
    ran = page.evaluate(
        """async ([friction, limits]) => {
          const { Loop } = await import('/loop.js'), { Stream } = await import('/stream.js');
          const dt = 0.001, positions = Array.from({ length: 800 }, (_, k) => [0.05 * (1 - Math.cos(k / 130)), 0]);
          const planned = { dt, radius: { pan: 0.18, object: 0.03 }, quality: { limits: {} } };
          const loop = new Loop(planned, positions, { friction, limits }, (opening) => new Stream(opening), () => {});
          for (let tries = 0; loop.count < 1500 && !loop.lost && tries < 5000; tries++) {
            loop.pointer = () => loop.count > 300 && loop.count < 316 ? [0.05, 0.04] : null;
            loop.goOn(loop.made + 0.008, 10);
            await new Promise((resolve) => setTimeout(resolve, 1));
          }
          loop.close();
          const rows = ({ x, y, z }) => x.slice(0, 1500).map((value, k) => [value, y[k], z[k]]);
          const { lost, count, acceleration, pan, object } = loop;
          return { lost, count, u: rows(acceleration), pan: rows(pan), object: rows(object) };
        }""",
        [{"static": friction.static, "kinetic": friction.kinetic}, limits.to_dict()],
    )
    assert ran["lost"] == ""
    assert ran["count"] >= 1500
    u, pan, sliding = (np.array(ran[name]) for name in ("u", "pan", "object"))
    assert np.linalg.norm(u, axis=1).max() <= limits.acceleration * (1 + 1e-9)
    assert np.linalg.norm(np.diff(u, axis=0, prepend=0.0), axis=1).max() <= limits.jerk * 1e-3 * (1 + 1e-9)
    assert np.linalg.norm(pan[:, :2], axis=1).max() <= limits.pan_reach * (1 + 1e-9)
    assert np.abs(u[:, 2]).max() == 0.0
    slid = slide_one(np.array([*sliding[0, :2], 0.0, 0.0]), u[:250], friction)
    np.testing.assert_allclose(sliding[1:251, :2], slid[:, :2], atol=1e-9)
    assert sliding[300:420, 1].max() > 0.005  # pulled
    assert np.hypot(sliding[-1, 0] - 0.05 * (1 - np.cos(799 / 130)), sliding[-1, 1]) < 0.02  # and brought back


def test_a_server_that_is_lost_while_playing_is_said_and_the_pan_comes_to_rest(
    run_server: Callable[..., Any], open_page: Callable[..., Page]
) -> None:
    with run_server() as server:
        page = open_page(server.url, complains=True, calm=False)
        close_loop(page)
        wait_until(page, 0.3)
    expect(page.get_by_role("alert")).to_contain_text("Nobody steers the pan, which comes to rest.")
    expect(page.locator("#hint")).to_have_text("Nobody steers the pan")


def test_a_loop_that_paused_longer_than_the_server_waits_goes_on(
    run_server: Callable[..., Any], open_page: Callable[..., Page]
) -> None:
    with run_server(stream_idle=0.5) as server:
        page = open_page(server.url, calm=False)
        close_loop(page)
        wait_until(page, 0.3)
        page.click("#play")
        page.wait_for_timeout(1500)
        at = float(page.inner_text("#now"))
        page.click("#play")
        wait_until(page, at + 0.4)
        expect(page.get_by_role("alert")).to_be_hidden()
        seek(page, 10.0)  # no farther than it was made
        assert float(page.inner_text("#now")) < 3.6


@pytest.mark.parametrize(
    "answer",
    [
        {"type": "about:blank", "title": "Too many", "detail": "at most 64 streams are open"},
        "no JSON",
        {"chunk": 100, "dt": 0.001},
    ],
)
def test_what_is_no_answer_of_a_stream_is_said(
    page_server: Any, open_page: Callable[..., Page], answer: object
) -> None:
    page = open_page(page_server.url, complains=True, calm=False)
    text = answer if isinstance(answer, str) else json.dumps(answer)

    def connect(route: Any) -> None:
        route.on_message(lambda _: route.send(text))

    page.route_web_socket("**/stream", connect)
    close_loop(page)
    expect(page.get_by_role("alert")).to_contain_text("Nobody steers the pan")


def test_with_a_token_the_loop_is_closed_once_it_is_given(
    run_server: Callable[..., Any], open_page: Callable[..., Page]
) -> None:
    with run_server(tokens="page=let me in; \u00b5+/?", max_wait=20.0, deadline=20.0) as server:
        page = open_page(server.url, calm=False, complains=True)
        token = page.get_by_label("Token of this server")
        expect(token).to_be_visible()
        assert page.locator("#closed").is_hidden()
        token.fill("let me in; \u00b5+/?")
        token.blur()
        close_loop(page)
        assert error_of(page) < 10.0
