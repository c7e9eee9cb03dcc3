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
from server.planning.dispatcher import Planned, Ticket
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
        wanted = read(PlanRequest, body)
        (command,) = to_commands({"command": wanted.command}, service.settings.max_samples)
        one = to_job(wanted, command, dispatcher.manifest, service.settings)
        reading = time.perf_counter() - begin
        (ticket,) = dispatcher.submit([one._replace(npz=media_type == NPZ)])
        planned = await settled(request, ticket, service.settings)
    return Response(planned.body, media_type=media_type, headers={"Server-Timing": timing(planned, reading)})


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
        wanted = read(PlansRequest, await read_body(request, service.settings))
        if len(wanted.commands) > service.settings.max_commands:
            raise Problem("invalid", f"at most {service.settings.max_commands} commands are taken", "commands")
        places = {f"commands[{index}]": command for index, command in enumerate(wanted.commands)}
        found = to_commands(places, service.settings.max_samples)
        many = [to_job(wanted, command, dispatcher.manifest, service.settings) for command in found]
        tickets = dispatcher.submit(many)
    return StreamingResponse(_lines(service, tickets), media_type=NDJSON)


async def _lines(service: Service, tickets: list[Ticket]) -> AsyncIterator[bytes]:
    service.in_flight += 1
    try:
        for ticket in tickets:
            try:
                async with asyncio.timeout(service.settings.deadline):
                    planned = await ticket.ready
                yield planned.body + b"\n"
            except TimeoutError:
                yield orjson.dumps(Problem("deadline").to_dict()) + b"\n"
            except Problem as problem:
                yield orjson.dumps(problem.to_dict()) + b"\n"
    finally:
        service.in_flight -= 1
        for ticket in tickets:
            ticket.ready.cancel()


async def settled(request: Request, ticket: Ticket, settings: Settings) -> Planned:
    """Wait until a command is planned, has waited too long for its turn, its deadline passes, or its client hangs up.

    Raises:
        Problem: `overloaded`, `deadline`, or what became of the planning.
        ClientDisconnect: the client left.
    """
    loop = asyncio.get_running_loop()
    late = Problem("deadline", f"the plan was not ready within {settings.deadline:g} s")
    turn = min(settings.max_wait, settings.deadline)
    timers = (
        loop.call_later(turn, ticket.turn_over),
        loop.call_later(settings.deadline, ticket.settle, late),
    )
    gone = asyncio.ensure_future(_gone(request))
    gone.add_done_callback(lambda _: ticket.ready.cancel())
    try:
        return await ticket.ready
    except asyncio.CancelledError:
        if gone.done():
            raise ClientDisconnect from None
        raise
    finally:
        gone.cancel()
        for timer in timers:
            timer.cancel()


async def _gone(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


def timing(planned: Planned, reading: float) -> str:
    """Return the value of the header `Server-Timing` (ms): reading the request, waiting, planning, writing the plan."""
    _, queue, encode, decode, write = planned
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
