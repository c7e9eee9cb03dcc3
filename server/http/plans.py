"""`POST /plan` and `POST /plans`."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import AsyncGenerator, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import orjson
from fastapi import APIRouter, Request
from starlette.requests import ClientDisconnect
from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from server.http.body import read_body
from server.http.doors import CLIENT
from server.http.openapi import REFERENCE, problems
from server.logs import request_id
from server.planning.bounds import ROW_BYTES
from server.planning.dispatcher import QueuedJob, WrittenPlan
from server.planning.messages import ReadJob
from server.problems import MEDIA_TYPE, Problem
from server.service import Service
from server.settings import Settings
from server.shares import Lease

BYTES_AHEAD = 1 << 23
"""Bytes of plans that are queued or made before a client reads them, of one request of /plans."""

JSON, NPZ, NDJSON = "application/json", "application/x-npz", "application/x-ndjson"

router = APIRouter()


def _body(model: str) -> dict[str, Any]:
    return {"requestBody": {"required": True, "content": {JSON: {"schema": {"$ref": f"#/components/schemas/{model}"}}}}}


REFUSALS = problems(400, 401, 406, 408, 413, 415, 421, 422, 429, 500, 503, 504)


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
    """Plan the pan's motion for one command: a `slide-plan/2` document, or as npz."""
    service: Service = request.app.state.service
    npz = accepted(request, (JSON, NPZ)) == NPZ
    client: str = request.scope[CLIENT]
    with ExitStack() as stack:
        stack.callback(service.admit(client).release)
        dispatcher, reader = service.dispatcher, service.reader
        with holding(request, service) as held:
            body = await read_body(request, service.settings, one_command=True)
            begin = time.perf_counter()
            (job,) = await reader.read(client, "plan", body, npz=npz)
            held.resize(len(job.data))
            del body
            reading = time.perf_counter() - begin
            queued = dispatcher.submit(client, job, npz)
            stack.callback(queued.drop)
            written = await result_of(queued, request, service.settings)
        headers = {"Server-Timing": timing(written, reading), "Content-Length": str(written.size)}
        sent = pieces(written.body, service)
        return LeasedResponse(sent, headers, NPZ if npz else JSON, stack.pop_all())


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
    client: str = request.scope[CLIENT]
    with ExitStack() as stack:
        stack.callback(service.admit(client).release)
        reader = service.reader
        held = stack.enter_context(holding(request, service))
        body = await read_body(request, service.settings)
        jobs: list[ReadJob] = await reader.read(client, "plans", body)
        held.resize(sum(len(job.data) for job in jobs))
        del body
        lines = _lines(service, client, jobs)
        return LeasedResponse(lines, {}, NDJSON, stack.pop_all())


async def _lines(service: Service, client: str, jobs: list[ReadJob]) -> AsyncGenerator[bytes, None]:
    """Yield the lines, in pieces; few of the jobs are queued or planned before their turn."""
    ahead: deque[QueuedJob] = deque()
    left = deque(jobs)
    try:
        while left or ahead:
            try:
                while left and len(ahead) < service.settings.max_batch:
                    if ahead and sum(one.size for one in ahead) + left[0].rows * ROW_BYTES > BYTES_AHEAD:
                        break
                    ahead.append(service.dispatcher.submit(client, left[0]))
                    left.popleft()
            except Problem as problem:
                if not ahead:
                    left.popleft()
                    yield orjson.dumps(problem.to_dict()) + b"\n"
                    continue
            one = ahead.popleft()
            try:
                async with asyncio.timeout(service.settings.deadline):
                    written = await one.result
                async for piece in pieces(written.body, service):
                    yield piece
                yield b"\n"
            except TimeoutError:
                yield orjson.dumps(Problem("deadline").to_dict()) + b"\n"
            except Problem as problem:
                yield orjson.dumps(problem.to_dict()) + b"\n"
            finally:
                one.drop()
    finally:
        for one in ahead:
            one.drop()


async def pieces(body: Iterable[bytes], service: Service) -> AsyncGenerator[bytes, None]:
    """Yield a body piece by piece, so that no more of it waits for the client than the connection holds.

    A few pieces of all answers go together, and then everything else has its turn.

    Raises:
        ClientDisconnect: the client takes too long to read it.
    """
    until = time.monotonic() + service.settings.write_timeout
    for piece in body:
        await service.sending.turn()
        if time.monotonic() > until:
            raise ClientDisconnect
        yield piece


class LeasedResponse(StreamingResponse):
    """A response that gives back what it holds once it has been sent, or cannot be."""

    def __init__(
        self, content: AsyncGenerator[bytes, None], headers: dict[str, str], media_type: str, held: ExitStack
    ) -> None:
        super().__init__(content, headers=headers, media_type=media_type)
        self._content, self._held = content, held

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it."""
        with self._held:
            try:
                await super().__call__(scope, receive, send)
            finally:
                await self._content.aclose()


@contextmanager
def holding(request: Request, service: Service) -> Iterator[Lease]:
    """Hold room for a request's body, as much as it says it needs or the most that is read.

    Raises:
        Problem: `overloaded` or `too-many`: there is none.
    """
    declared = request.headers.get("content-length", "")
    most = service.settings.max_body
    size = min(int(declared[:20]), most) if declared.isdecimal() else most
    lease = service.held.take(request.scope[CLIENT], size)
    try:
        yield lease
    finally:
        lease.release()


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
        loop.call_later(settings.deadline, queued.drop, late),
    )
    gone = asyncio.ensure_future(_client_leaves(request))
    gone.add_done_callback(lambda _: queued.drop())
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
    parts = [f"{name};dur={duration * 1e3:.2f}" for name, duration in times.items()]
    return ", ".join([*parts, f'request;desc="{request_id.get()}"'])


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
