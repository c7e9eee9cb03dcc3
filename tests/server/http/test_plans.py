"""`POST /plan` and `POST /plans`: the runtime's plans, over HTTP, together or alone."""

from __future__ import annotations

import asyncio
import io
import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from runtime import Command, Friction, Limits, Plan, Planner, Reading, ServerError, Sizes, Start
from runtime.client import Client


@pytest.fixture(scope="module")
def planner() -> Planner:
    return Planner()


def assert_same(plan: Plan, own: Plan) -> None:
    """Check that two plans are the same, up to the last digits of figures that a compiled law adds up otherwise."""
    documents = plan.to_dict(), own.to_dict()
    quality, own_quality = (document.pop("quality") for document in documents)
    assert documents[0] == documents[1]
    for name, value in own_quality.items():
        assert quality[name] == (pytest.approx(value, rel=1e-9) if isinstance(value, float) else value)


def test_plan_is_the_runtimes_plan_and_a_file_of_it_is_read(
    server: Any, planner: Planner, make_request: Callable[..., Any], tmp_path: Path
) -> None:
    request = make_request(345)
    response = server.post("/plan", json=request)
    assert response.status_code == 200
    assert response.headers["content-type"] == "application/json"
    (tmp_path / "plan.json").write_bytes(response.content)
    plan, own = Plan.load(tmp_path / "plan.json"), planner.plan(request["command"]["position"])
    assert_same(plan, own)


def test_plan_comes_as_npz_if_that_is_accepted(server: Any, make_request: Callable[..., Any], tmp_path: Path) -> None:
    response = server.post("/plan", json=make_request(), headers={"Accept": "application/x-npz"})
    assert response.headers["content-type"] == "application/x-npz"
    assert np.load(io.BytesIO(response.content), allow_pickle=False)["pan.acceleration"].shape == (300, 3)
    (tmp_path / "plan.npz").write_bytes(response.content)
    assert Plan.load(tmp_path / "plan.npz").to_dict() == server.post("/plan", json=make_request()).json()
    preferring = {"Accept": "application/x-npz;q=0.5, application/json"}
    response = server.post("/plan", json=make_request(), headers=preferring)
    assert response.headers["content-type"] == "application/json"


def test_options_are_those_of_the_runtime(server: Any, planner: Planner, make_curve: Callable[..., Any]) -> None:
    position = make_curve(400, 3)
    friction, limits = Friction(0.8, 0.4), Limits(0.15, acceleration=25.0, jerk=5000.0)
    start = Start(pan_position=(0.02, 0.0), object_position=(0.01, 0.0), object_velocity=(0.0, 0.1))
    options: dict[str, Any] = {"limits": limits, "start": start, "sizes": Sizes(0.2, 0.01), "tolerance": 0.001}
    options |= {"candidates": 4, "robust": 0.1}
    own = planner.plan(position, friction, **options)
    with Client(server.url) as client:
        plan = client.plan(Command(position), friction, **options)
        assert_same(plan, own)
        assert plan.sizes == Sizes(0.2, 0.01)
        (one,) = client.plans([position], friction, sizes=Sizes(0.2, 0.01))
        assert one.sizes == Sizes(0.2, 0.01)
        # What refinement makes better is the error under friction that may be off.
        better, lone = client.plan(position, refine_ms=50.0).quality, planner.plan(position, candidates=1).quality
        assert better.friction_off_rmse < lone.friction_off_rmse
        assert client.info()["model"]["sha256"] == planner.bundle.sha256


def test_limits_have_a_height_a_speed_and_names(server: Any, make_request: Callable[..., Any]) -> None:
    for asked, limits in (
        ({"height": 0.05, "speed": 1.2}, Limits(height=0.05, speed=1.2)),
        ({"name": "panda"}, Limits.named("panda")),
        ({"name": "fr3", "height": 0.0, "jerk": 4000.0}, replace(Limits.named("fr3"), height=0.0, jerk=4000.0)),
        ({"name": "panda", "speed": None}, replace(Limits.named("panda"), speed=math.inf)),
    ):
        plan = server.post(
            "/plan", json=make_request() | {"limits": asked, "friction": {"static": 0.5, "kinetic": 0.3}}
        )
        assert plan.json()["quality"]["limits"] == limits.to_dict()
        assert bool(np.any(np.array(plan.json()["pan"]["position"])[:, 2])) is not limits.level
    with Client(server.url) as client:
        for limits in (Limits(), Limits.named("panda")):
            quality = client.plan([[0.0, 0.0]] * 300, Friction(0.5, 0.3), limits=limits).quality
            assert quality.limits == limits.to_dict()
    refused = server.post("/plan", json=make_request() | {"limits": {"name": "pandas"}})
    assert refused.status_code == 422
    assert refused.json()["place"] == "limits.name"


def test_server_timing_tells_where_the_time_went(server: Any, make_request: Callable[..., Any]) -> None:
    answer = server.post("/plan", json=make_request())
    *parts, last = answer.headers["server-timing"].split(", ")
    assert last == f'request;desc="{answer.headers["x-request-id"]}"'
    found = dict(part.split(";dur=") for part in parts)
    assert list(found) == ["read", "queue", "encode", "decode", "write"]
    assert float(found.pop("queue")) >= 0.0
    assert all(float(part) > 0.0 for part in found.values())


def test_waypoints_are_resampled(server: Any) -> None:
    command = {"t": [5.0, 5.4, 6.0], "position": [[0, 0], [0.03, 0.02], [0.05, 0]]}
    plan = server.post("/plan", json={"command": command}).json()
    assert len(plan["command"]["position"]) == 1001


def test_options_of_reading_are_those_of_python(server: Any) -> None:
    t, position = (
        np.arange(30) * 20.0,
        20.0 * np.stack([1 - np.cos(np.arange(30) / 5), np.sin(np.arange(30) / 5)], axis=1),
    )
    options: dict[str, Any] = {"scale": 0.001, "origin": "first", "smooth": 10.0}
    path = [[0, 0], [400, 0], [400, 200]]
    for command, own in (
        (
            {"t": t.tolist(), "time_scale": 0.001, **options},
            Command.from_waypoints(t, position, Reading(time_scale=0.001, **options)),
        ),
        ({"rate": 50.0, **options}, Command.from_samples(position, reading=Reading(rate=50.0, **options))),
        (
            {"speed": 0.3, "path_acceleration": 2.0, "size": 0.1, "origin": [0.01, 0.0], "position": path},
            Command.from_path(path, 0.3, 2.0, Reading(size=0.1, origin=(0.01, 0.0))),
        ),
    ):
        response = server.post("/plan", json={"command": {"position": position.tolist(), **command}})
        assert response.status_code == 200, response.text
        assert np.array_equal(response.json()["command"]["position"], own.position)
        assert response.json()["quality"]["notes"][-1:] == list(own.remarks)[-1:] or not own.remarks


def test_plans_come_in_order_a_line_each(server: Any, planner: Planner, make_curve: Callable[..., Any]) -> None:
    curves = [make_curve(samples, seed) for seed, samples in enumerate((300, 777, 250, 300, 120))]
    with Client(server.url) as client:
        plans = list(client.plans(curves, Friction(0.9, 0.5)))
    for curve, plan in zip(curves, plans, strict=True):
        assert np.array_equal(plan.command_position, curve)
        own = planner.plan(curve, Friction(0.9, 0.5), candidates=1)
        assert np.abs(plan.object_position - own.object_position).max() <= 1e-6


TIGHT = {"pan_reach": 0.06, "acceleration": 20.0, "jerk": 3000.0}


def loops(samples: int = 1000) -> list[list[float]]:
    """Return a command that no pan with these limits follows well."""
    t = np.linspace(0.0, 3.0 * np.pi, samples)
    return (0.05 * np.stack([1.0 - np.cos(t), np.sin(t) ** 3], axis=1)).tolist()


def test_a_bad_plan_is_made_several_ways_by_plan_and_not_by_plans(server: Any, planner: Planner) -> None:
    limits, command = Limits(**TIGHT), {"dt": 0.001, "position": loops()}
    lone, best = (planner.plan(loops(), limits=limits, candidates=count) for count in (1, None))
    assert best.quality.tracking_rmse < lone.quality.tracking_rmse
    answer = server.post("/plan", json={"command": command, "limits": TIGHT})
    assert_same(Plan.from_dict(answer.json()), best)
    parts = [part.split(";dur=") for part in answer.headers["server-timing"].split(", ")[:-1]]
    assert dict(parts).keys() == {"read", "queue", "encode", "decode", "write"}
    one = server.post("/plan", json={"command": command, "limits": TIGHT, "candidates": 1})
    assert_same(Plan.from_dict(one.json()), lone)
    (line,) = server.post("/plans", json={"commands": [command], "limits": TIGHT}).text.splitlines()
    assert_same(Plan.from_dict(json.loads(line)), lone)
    npz = server.post("/plan", json={"command": command, "limits": TIGHT}, headers={"Accept": "application/x-npz"})
    with np.load(io.BytesIO(npz.content)) as arrays:
        assert np.array_equal(arrays["pan.acceleration"], best.pan_acceleration)


@pytest.mark.parametrize("bound", [{"max_candidates": 4}, {"max_chunks": 64}])
def test_a_bad_plan_stays_where_the_server_allows_no_several(
    run_server: Callable[..., Any], planner: Planner, bound: dict[str, int]
) -> None:
    lone = planner.plan(loops(), limits=Limits(**TIGHT), candidates=1)
    with run_server(**bound) as server:
        answer = server.post("/plan", json={"command": {"dt": 0.001, "position": loops()}, "limits": TIGHT})
    assert_same(Plan.from_dict(answer.json()), lone)


def test_command_of_many_that_cannot_be_planned_is_a_problem_in_its_line(server: Any) -> None:
    moving = {"pan_position": [5.0, 0.0]}
    commands = [{"dt": 0.001, "position": [[0, 0], [0, 0]]}] * 2
    response = server.post("/plans", json={"commands": commands, "start": moving})
    assert response.status_code == 200
    lines = [json.loads(line) for line in response.text.splitlines()]
    assert [line["status"] for line in lines] == [422, 422]
    with Client(server.url) as client, pytest.raises(ServerError, match="the pan is 5 m from its centre"):
        list(client.plans([np.zeros((5, 2))], start=Start(pan_position=(5.0, 0.0))))


def test_concurrent_requests_are_planned_together_and_each_gets_its_own(
    run_server: Callable[..., Any], planner: Planner, make_curve: Callable[..., Any]
) -> None:
    """The command itself is the nonce: it comes back in the plan."""
    curves = [make_curve(300 + 10 * (seed % 3), seed) for seed in range(48)]

    async def ask(server: Any) -> list[Plan]:
        limits = httpx.Limits(max_connections=48)
        async with httpx.AsyncClient(base_url=server.url, timeout=60.0, verify=False, limits=limits) as client:

            async def one(curve: Any) -> Plan:
                command = {"dt": 0.001, "position": curve.tolist()}
                return Plan.from_dict((await client.post("/plan", json={"command": command, "candidates": 1})).json())

            return await asyncio.gather(*map(one, curves))

    with run_server(max_wait=60.0, deadline=60.0) as server:
        plans = asyncio.run(ask(server))
        metrics = server.get("/metrics").text
    for curve, plan in zip(curves, plans, strict=True):
        assert np.array_equal(plan.command_position, curve)
        own = planner.plan(curve, candidates=1)
        for name in ("pan_position", "object_position"):
            assert np.abs(getattr(plan, name) - getattr(own, name)).max() <= 1e-6
    batches = float(re.search(r"^slide_batch_size_count (\S+)$", metrics, re.M)[1])  # type: ignore[index]
    assert batches < len(curves)
    assert re.search(rf"^slide_batch_size_sum {len(curves)}\.0$", metrics, re.M)
    assert re.search(rf'^slide_requests_total{{path="/plan",status="200"}} {len(curves)}\.0$', metrics, re.M)
    assert f"slide_samples_planned_total {float(sum(map(len, curves)))}" in metrics


def test_bad_start_in_a_batch_fails_alone(run_server: Callable[..., Any], make_request: Callable[..., Any]) -> None:
    async def ask(server: Any) -> list[int]:
        async with httpx.AsyncClient(base_url=server.url, timeout=60.0, verify=False) as client:
            bad = {"start": {"pan_position": [5.0, 0.0]}}
            requests = [make_request(300, seed, **(bad if seed % 4 == 0 else {})) for seed in range(16)]
            answers = await asyncio.gather(*(client.post("/plan", json=request) for request in requests))
            return [answer.status_code for answer in answers]

    with run_server(max_wait=60.0, deadline=60.0) as server:
        assert asyncio.run(ask(server)) == [422, 200, 200, 200] * 4
