"""`POST /plan` and `POST /plans`."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from typing import Any

import orjson
from fastapi import APIRouter, Request
from starlette.requests import ClientDisconnect
from starlette.responses import Response, StreamingResponse

from server.http.body import read_body
from server.http.openapi import REFERENCE, problems
from server.http.schemas import PlanRequest, PlansRequest, read, to_commands, to_job
from server.planning.dispatcher import QueuedJob, WrittenPlan
from server.problems import MEDIA_TYPE, Problem
from server.service import Service
from server.settings import Settings

JSON, NPZ, NDJSON = "application/json", "application/x-npz", "application/x-ndjson"

router = APIRouter()


def _body(model: str) -> dict[str, Any]:
    return {"requestBody": {"required": True, "content": {JSON: {"schema": {"$ref": f"#/components/schemas/{model}"}}}}}


REFUSALS = problems(400, 401, 406, 408, 413, 415, 422, 500, 503, 504)


@router.post(
    "/plan",
    openapi_extra=_body("PlanRequest"),
    response_class=Response,
    responses={
        200: {
            "description": "The plan",
            "content": {JSON: {"schema": {"$ref": f"{REFERENCE}Plan"}}, NPZ: {"schema": {"type": "string"}}},
        },
        **REFUSALS,
    },
)
async def plan(request: Request) -> Response:
    """Plan the pan's motion for one command: a `slide-plan/1` document, or as npz."""
    service: Service = request.app.state.service
    media_type = accepted(request, (JSON, NPZ))
    with service.admitted() as dispatcher:
        body = await read_body(request, service.settings)
        begin = time.perf_counter()
        asked = read(PlanRequest, body)
        (command,) = to_commands({"command": asked.command}, service.settings.max_samples)
        job = to_job(asked, command, dispatcher.manifest, service.settings)
        reading = time.perf_counter() - begin
        (queued,) = dispatcher.submit([job._replace(npz=media_type == NPZ)])
        written = await result_of(queued, request, service.settings)
    return Response(written.body, media_type=media_type, headers={"Server-Timing": timing(written, reading)})


@router.post(
    "/plans",
    openapi_extra=_body("PlansRequest"),
    response_class=Response,
    responses={
        200: {"description": "A plan or a problem a line", "content": {NDJSON: {"schema": {"type": "string"}}}},
        **REFUSALS,
    },
)
async def plans(request: Request) -> Response:
    """Plan for many commands: a plan a line, in the order of the commands, each as soon as it is ready.

    A command that could not be planned gives a problem document in its line.
    """
    service: Service = request.app.state.service
    accepted(request, (NDJSON,))
    with service.admitted() as dispatcher:
        asked = read(PlansRequest, await read_body(request, service.settings))
        if len(asked.commands) > service.settings.max_commands:
            raise Problem("invalid", f"at most {service.settings.max_commands} commands are taken", "commands")
        places = {f"commands[{index}]": command for index, command in enumerate(asked.commands)}
        found = to_commands(places, service.settings.max_samples)
        queued = dispatcher.submit([to_job(asked, one, dispatcher.manifest, service.settings) for one in found])
    return StreamingResponse(_lines(service, queued), media_type=NDJSON)


async def _lines(service: Service, queued: list[QueuedJob]) -> AsyncIterator[bytes]:
    service.in_flight += 1
    try:
        for one in queued:
            try:
                async with asyncio.timeout(service.settings.deadline):
                    written = await one.result
                yield written.body + b"\n"
            except TimeoutError:
                yield orjson.dumps(Problem("deadline").to_dict()) + b"\n"
            except Problem as problem:
                yield orjson.dumps(problem.to_dict()) + b"\n"
    finally:
        service.in_flight -= 1
        for one in queued:
            one.result.cancel()


async def result_of(queued: QueuedJob, request: Request, settings: Settings) -> WrittenPlan:
    """Wait until a job is planned, has waited too long for its turn, its deadline passes, or its client hangs up.

    Raises:
        Problem: `overloaded`, `deadline`, or what became of the planning.
        ClientDisconnect: the client left.
    """
    loop = asyncio.get_running_loop()
    late = Problem("deadline", f"the plan was not ready within {settings.deadline:g} s")
    turn = min(settings.max_wait, settings.deadline)
    timers = (
        loop.call_later(turn, queued.refuse_unless_started),
        loop.call_later(settings.deadline, queued.finish, late),
    )
    gone = asyncio.ensure_future(_client_leaves(request))
    gone.add_done_callback(lambda _: queued.result.cancel())
    try:
        return await queued.result
    except asyncio.CancelledError:
        if gone.done():
            raise ClientDisconnect from None
        raise
    finally:
        gone.cancel()
        for timer in timers:
            timer.cancel()


async def _client_leaves(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


def timing(written: WrittenPlan, reading: float) -> str:
    """Return the value of the header `Server-Timing` (ms): reading the request, waiting, planning, writing the plan."""
    _, queue, encode, decode, write = written
    times = {"read": reading, "queue": queue, "encode": encode, "decode": decode, "write": write}
    return ", ".join(f"{name};dur={duration * 1e3:.2f}" for name, duration in times.items())


def accepted(request: Request, offered: tuple[str, ...]) -> str:
    """Return the media type the client likes best of those that can be given.

    Raises:
        Problem: `not-acceptable`.
    """
    best, best_weight = "", 0.0
    for media_type in offered:
        weight = max((_weight(each, media_type) for each in request.headers.get("accept", "*/*").split(",")), default=0)
        if weight > best_weight:
            best, best_weight = media_type, weight
    if not best:
        raise Problem("not-acceptable", f"there is {' and '.join(offered)}")
    return best


def _weight(accept: str, media_type: str) -> float:
    """Return the weight (0 to 1) that one entry of an Accept header gives to a media type."""
    pattern, *parameters = (part.strip().lower() for part in accept.split(";"))
    if pattern not in ("*/*", "application/*", media_type, MEDIA_TYPE):
        return 0.0
    for parameter in parameters:
        if parameter.startswith("q="):
            try:
                return max(0.0, min(float(parameter[2:]), 1.0))
            except ValueError:
                return 0.0
    return 1.0
