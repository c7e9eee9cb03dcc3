"""`WS /stream`: a controller's closed loop over the wire, bounded in rate, size and silence.

A step takes a third of a millisecond: in the event loop answers come sooner than by way of a thread.

The first message opens the stream, as JSON: {"format": "slide-stream/1", "command": ..., "packed": false} and the
options of a plan. The answer says what decodes. From then on each message is a step, numbered from 0, and each answer
the chunk of that number; see `runtime.client.messages`. A JSON step may carry another "command" to follow from then
on, or a "start" to begin again from after a stop. What is wrong is said in a problem document before the socket is
closed.
"""

from __future__ import annotations

import asyncio
import logging
import time
from typing import Annotated, Literal, NamedTuple
from urllib.parse import urlsplit

import numpy as np
import orjson
from fastapi import APIRouter, WebSocket
from pydantic import FailFast, Field
from starlette.websockets import WebSocketDisconnect

from runtime import Command, InputError, Planner, Start, Stream
from runtime.client.messages import STREAM_FORMAT, Chunk, Step, pack_chunk, unpack_step
from runtime.documents.checks import FloatArray
from server.http.guard import carries_token
from server.http.schemas import (
    CommandRequest,
    Finite,
    Options,
    StartRequest,
    Strict,
    read,
    to_commands,
    to_job,
    to_start,
)
from server.http.websocket import POLICY_VIOLATION
from server.problems import Problem, for_input
from server.service import Service

log = logging.getLogger("slide-serve")

INTERNAL_ERROR = 1011
"""Close code after a failure (RFC 6455, section 7.4.1)."""

BURST = 20.0
"""Steps that may come at once, beyond the rate."""

Row = tuple[Finite, Finite, Finite, Finite]
Rows = Annotated[list[Row], FailFast()]

router = APIRouter()


class StreamRequest(Options):
    """What opens a stream."""

    format: Literal["slide-stream/1"]
    command: CommandRequest
    packed: bool = False


class StepRequest(Strict):
    """A step as JSON: states [x, y, vx, vy] (m, m/s), the last C of them or the last one; none where one is missing."""

    sequence: int = Field(ge=0)
    age: Finite = 0.0
    pan: Rows = Field([])
    object: Rows = Field([])
    command: CommandRequest | None = None
    start: StartRequest | None = None


class StreamInput(NamedTuple):
    """What a client sends for one step: the states, and maybe another start and another command.

    Attributes:
        step: the number of the step, and the states.
        start: where to begin again from.
        command: what to follow from now on.
    """

    step: Step
    start: Start | None = None
    command: Command | None = None

    def advance(self, stream: Stream) -> Chunk:
        """Advance a stream by a chunk.

        Raises:
            InputError: a state has another shape, or the pan cannot come to rest from the start.
        """
        if self.start is not None:
            stream.reset(self.start)
        if self.command is not None:
            stream.retarget(self.command)
        sequence, pan, sliding, age = self.step
        acceleration = stream.step(_last(pan), _last(sliding), age)
        return Chunk(sequence, acceleration, stream.brake(len(acceleration)), stream.status)


def _last(states: FloatArray | None) -> FloatArray | None:
    return states[0] if states is not None and len(states) == 1 else states


class RateLimit:
    """Counts steps against a rate (1/s), with some allowed at once."""

    def __init__(self, rate: float) -> None:
        self._rate, self._left, self._last = rate, BURST, time.monotonic()

    def check(self) -> None:
        """Count one.

        Raises:
            Problem: `too-fast`.
        """
        now = time.monotonic()
        self._left = min(BURST, self._left + (now - self._last) * self._rate) - 1.0
        self._last = now
        if self._left < 0.0:
            raise Problem("too-fast", f"at most {self._rate:g} steps a second are taken")


@router.websocket("/stream")
async def stream(socket: WebSocket) -> None:
    """Follow a command with a controller that measures."""
    service: Service = socket.app.state.service
    try:
        _check_handshake(socket, service)
        planner = service.planner
        if service.streams >= service.settings.max_streams:
            raise Problem("overloaded", "too many streams are open", headers={"Retry-After": "1"})
    except Problem as refusal:
        await socket.send_denial_response(refusal.response())
        return
    with service.streaming():
        await socket.accept()
        try:
            await _follow(socket, service, planner)
        except (Problem, InputError) as error:
            problem = for_input(error) if isinstance(error, InputError) else error
            await socket.send_text(orjson.dumps(problem.to_dict()).decode())
            await socket.close(POLICY_VIOLATION, problem.name)
        except WebSocketDisconnect:
            pass
        except Exception:
            log.exception("a stream failed")
            await socket.close(INTERNAL_ERROR)


def _check_handshake(socket: WebSocket, service: Service) -> None:
    """Check the token, and that no other site's page has opened the socket: browsers let any page try.

    Raises:
        Problem: `unauthorized` or `forbidden`.
    """
    if not carries_token(socket.scope, service.settings):
        raise Problem("unauthorized", headers={"WWW-Authenticate": "Bearer"})
    origin = socket.headers.get("origin")
    if origin is not None and urlsplit(origin).netloc != socket.headers.get("host"):
        raise Problem("forbidden", "the page that asks is of another site")


async def _follow(socket: WebSocket, service: Service, planner: Planner) -> None:
    """Open a stream and answer its steps until the client leaves.

    Raises:
        Problem: a message is not what it must be, comes too soon or too late.
        InputError: what it asks for cannot be followed.
        WebSocketDisconnect: the client left.
    """
    settings, manifest = service.settings, planner.bundle.manifest
    opening = await _receive(socket, settings.stream_idle)
    request = read(StreamRequest, opening if isinstance(opening, bytes) else opening.encode("utf-8", "replace"))
    (command,) = to_commands({"command": request.command}, settings.max_samples)
    job = to_job(request, command, manifest, settings)
    following = planner.stream(job.command, job.friction, limits=job.limits, start=job.start)
    model = {"name": manifest.name, "sha256": planner.bundle.sha256}
    chunk = manifest.one_pan.chunk
    opened = {"format": STREAM_FORMAT, "chunk": chunk, "dt": manifest.dt, "model": model}
    await socket.send_text(orjson.dumps(opened).decode())

    limit, expected = RateLimit(settings.stream_rate), 0
    while True:
        received = _read_input(
            await _receive(socket, settings.stream_idle), settings.max_samples, manifest.one_pan.chunk
        )
        limit.check()
        if received.step.sequence != expected:
            raise Problem("invalid", f"step {expected} is expected", "sequence")
        answer = received.advance(following)
        service.metrics.chunks.inc()
        expected = (expected + 1) % (1 << 32)
        if request.packed:
            await socket.send_bytes(pack_chunk(answer))
        else:
            await socket.send_text(orjson.dumps(answer._asdict(), option=orjson.OPT_SERIALIZE_NUMPY).decode())


async def _receive(socket: WebSocket, idle: float) -> str | bytes:
    """Return the next message.

    Raises:
        Problem: `idle`: none came in time.
        WebSocketDisconnect: the client left.
    """
    try:
        async with asyncio.timeout(idle):
            message = await socket.receive()
    except TimeoutError:
        raise Problem("idle", f"a message must come within {idle:g} s") from None
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1005))
    data: str | bytes | None = message.get("text")
    return data if data is not None else message["bytes"]


def _read_input(message: str | bytes, most: int, chunk: int) -> StreamInput:
    """Read a step.

    Raises:
        Problem: `malformed` or `invalid`, with the place.
        InputError: a command or a start cannot be followed.
    """
    if isinstance(message, bytes):
        try:
            step = unpack_step(message)
        except InputError as error:
            raise Problem("malformed", str(error)) from None
        _check_rows(chunk, pan=step.pan, object=step.object)
        return StreamInput(step)
    request = read(StepRequest, message.encode("utf-8", "replace"))
    pan, sliding = (np.array(rows) if rows else None for rows in (request.pan, request.object))
    _check_rows(chunk, pan=pan, object=sliding)
    start = None if request.start is None else to_start(request.start)
    command = None if request.command is None else to_commands({"command": request.command}, most)[0]
    return StreamInput(Step(request.sequence, pan, sliding, request.age), start, command)


def _check_rows(chunk: int, **states: FloatArray | None) -> None:
    for name, rows in states.items():
        if rows is not None and len(rows) not in (1, chunk):
            raise Problem("invalid", f"there must be no rows, 1 or {chunk}, got {len(rows)}", name)
