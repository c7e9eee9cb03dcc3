"""`WS /stream`: a controller's closed loop over the wire, bounded in rate, size and silence.

A step takes a third of a millisecond: in the event loop answers come sooner than by way of a thread. One step is made
at a time, and between two of them everything else has its turn; next is the stream that has had the least.

The first message opens the stream, as JSON: {"format": "slide-stream/2", "command": ..., "packed": false} and the
options of a plan, and maybe "command_delay" and "noise". The answer says what decodes. From then on each message is a
step, numbered from 0, and each answer the chunk of that number; see `runtime.client.messages`. A JSON step may carry
another "command" to follow from then on, or a "start" to begin again from after a stop. A command that cannot be
followed is "refused" in the answer, which is JSON then, and the old one is kept. What else is wrong is said in a
problem document before the socket is closed. A stream that is opened as "slide-stream/1" moves a level pan, and has x
and y alone.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np
import orjson
from fastapi import APIRouter, WebSocket
from starlette.websockets import WebSocketDisconnect

from runtime import Command, InputError, Planner, Start, Stream
from runtime.client.messages import (
    AXES,
    LEVEL_STREAM_FORMAT,
    MOST_READINGS,
    STREAM_FORMAT,
    Chunk,
    Reading,
    Step,
    pack_chunk,
    unpack_step,
)
from runtime.documents.checks import FloatArray
from server.http.doors import SUBPROTOCOL, check_host, check_origin, client_of
from server.http.guard import REQUEST_HEADER, name_request
from server.http.schemas import StepRequest, read, to_start
from server.http.websocket import POLICY_VIOLATION
from server.logs import request_id
from server.planning.bounds import fastest, stop_samples
from server.planning.reader import Reader
from server.problems import Problem, for_input
from server.service import Service

log = logging.getLogger("slide-serve")

INTERNAL_ERROR = 1011
"""Close code after a failure (RFC 6455, section 7.4.1)."""

SHORT = 1 << 15
"""Longest step (bytes) that is read in the event loop: of two full chunks with all their digits, and half as much."""

COMMAND = b'"command"'
"""Stands in a step that carries a command, which is read elsewhere whatever its length."""

BURST = 20.0
"""Steps that may come at once, beyond the rate."""

router = APIRouter()


class StreamInput(NamedTuple):
    """What a client sends for one step: the states, and maybe another start and another command.

    Attributes:
        step: the number of the step, and what was measured.
        start: where to begin again from.
        command: what to follow from now on, or what is wrong with it: then the old one is kept.
    """

    step: Step
    start: Start | None = None
    command: Command | Problem | None = None

    def advance(self, stream: Stream) -> Chunk:
        """Advance a stream by a chunk.

        Raises:
            InputError: a state has another shape, or the pan cannot come to rest from the start.
        """
        if self.start is not None:
            stream.reset(self.start)
        if isinstance(self.command, Command):
            stream.retarget(self.command)
        step = self.step
        for frame in step.frames:
            stream.see_object(*frame)
        for encoder in step.encoders:
            stream.see_pan(*encoder)
        acceleration = stream.step(_last(step.pan), _last(step.object), step.age, step.executed)
        return Chunk(step.sequence, acceleration, stream.brake(len(acceleration)), stream.status)


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
    with ExitStack() as stack:
        try:
            request_id.set(name_request(socket.scope))
            check_host(socket.scope, service.settings)
            check_origin(socket.scope)
            client = client_of(socket.scope, service.settings)
            planner, reader = service.planner, service.reader
            stack.enter_context(service.streaming(client))
        except Problem as refusal:
            response = refusal.response()
            response.headers[REQUEST_HEADER] = request_id.get()
            await socket.send_denial_response(response)
            return
        subprotocol = SUBPROTOCOL if SUBPROTOCOL in socket.scope["subprotocols"] else None
        await socket.accept(subprotocol, [(REQUEST_HEADER.lower().encode(), request_id.get().encode())])
        try:
            await Follower(socket, service, planner, reader, client).follow()
        except (Problem, InputError) as error:
            problem = for_input(error) if isinstance(error, InputError) else error
            await socket.send_text(orjson.dumps(problem.to_dict()).decode())
            await socket.close(POLICY_VIOLATION, problem.name)
        except WebSocketDisconnect:
            pass
        except Exception:
            log.exception("a stream failed")
            await socket.close(INTERNAL_ERROR)


class Follower:
    """One stream: what is received, and what is answered.

    Args:
        socket: accepted.
        service: its settings and counters.
        planner: what the command is followed with.
        reader: what reads commands.
        client: who asks.
    """

    def __init__(self, socket: WebSocket, service: Service, planner: Planner, reader: Reader, client: str) -> None:
        self._socket, self._service, self._planner, self._reader, self._client = (
            socket,
            service,
            planner,
            reader,
            client,
        )
        self._settings, self._chunk, self._most = service.settings, 0, 0.0

    async def follow(self) -> None:
        """Open the stream and answer its steps until the client leaves.

        Raises:
            Problem: a message is not what it must be, comes too soon or too late.
            InputError: what it asks for cannot be followed.
            WebSocketDisconnect: the client left.
        """
        command, job, told, packed, axes = await self._read("stream", _data(await self._receive()))
        following = self._planner.stream(
            command, job.friction, limits=job.limits, start=job.start, search=False, **told
        )  # a search would take from the other streams
        self._chunk = following.chunk
        manifest = self._planner.bundle.manifest
        model = {"name": manifest.name, "sha256": self._planner.bundle.sha256}
        opened = {
            "format": STREAM_FORMAT if axes == AXES else LEVEL_STREAM_FORMAT,
            "chunk": self._chunk,
            "dt": manifest.dt,
            "model": model,
        }
        await self._socket.send_text(orjson.dumps(opened).decode())

        limit, expected = RateLimit(self._settings.stream_rate), 0
        self._most = fastest(job.limits, job.friction)
        while True:
            received = await self._read_input(await self._receive(), limit, axes)
            if received.step.sequence != expected:
                raise Problem("invalid", f"step {expected} is expected", "sequence")
            _check_speed(received, self._most)
            if received.start is not None:
                stop_samples(job.limits, received.start, job.friction)
            async with self._service.steps.turn(f"{self._client} {id(self)}"):
                chunk = along(received.advance(following), axes)
            self._service.metrics.chunks.inc()
            expected = (expected + 1) % (1 << 32)
            if packed and not isinstance(received.command, Problem):
                await self._socket.send_bytes(pack_chunk(chunk))
            else:
                document = chunk._asdict()
                if isinstance(received.command, Problem):
                    document["refused"] = received.command.to_dict()
                text = orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY).decode()
                await self._socket.send_text(text)

    async def _receive(self) -> str | bytes:
        """Return the next message.

        Raises:
            Problem: `idle`: none came in time.
            WebSocketDisconnect: the client left.
        """
        idle = self._settings.stream_idle
        try:
            async with asyncio.timeout(idle):
                message = await self._socket.receive()
        except TimeoutError:
            raise Problem("idle", f"a message must come within {idle:g} s") from None
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message.get("code", 1005))
        data: str | bytes | None = message.get("text")
        return data if data is not None else message["bytes"]

    async def _read(self, kind: str, message: bytes) -> Any:
        """Return what a message that may be long asks for.

        Raises:
            Problem: what is wrong with it, or there is no room for it.
        """
        held = self._service.held.take(self._client, len(message))
        try:
            return await self._reader.read(self._client, kind, message)
        finally:
            held.release()

    async def _read_input(self, message: str | bytes, limit: RateLimit, axes: int) -> StreamInput:
        """Read a step, of a pan that moves along so many axes.

        Raises:
            Problem: `malformed` or `invalid`, with the place; `too-fast`.
            InputError: a command or a start cannot be followed.
        """
        if isinstance(message, bytes):
            try:
                step = unpack_step(message, axes)
            except InputError as error:
                raise Problem("malformed", str(error)) from None
            limit.check()
            _check_rows(self._chunk, pan=step.pan, object=step.object)
            for name, count in (("frames", len(step.frames)), ("encoders", len(step.encoders))):
                if count > MOST_READINGS:
                    raise Problem("invalid", f"at most {MOST_READINGS} are told with one step, got {count}", name)
            return StreamInput(step._replace(encoders=self._believable(step.encoders)))
        data = _data(message)
        limit.check()
        command: Command | Problem | None = None
        start: Start | None = None
        if len(data) > SHORT or COMMAND in data:
            request, command, start = await self._read("step", data)
        else:
            request = read(StepRequest, data)
            if request.command is not None:  # its name was written in another way
                raise Problem("malformed", "the name command is written with escapes")
            start = None if request.start is None else to_start(request.start)
        if {len(row) for row in request.pan} not in ({4}, {6}, set()):
            raise Problem("invalid", "the rows must have 6 numbers each, of a level pan also 4 each", "pan")
        pan, sliding = (_readings(rows) if rows else None for rows in (request.pan, request.object))
        _check_rows(self._chunk, pan=pan, object=sliding)
        frames = tuple(Reading(_readings(each.position), _reading(each.age), each.executed) for each in request.frames)
        encoders = [Reading(_readings(each.state), _reading(each.age), each.executed) for each in request.encoders]
        told = frames, self._believable(encoders), request.executed
        return StreamInput(Step(request.sequence, pan, sliding, _reading(request.age), *told), start, command)

    def _believable(self, encoders: Sequence[Reading]) -> tuple[Reading, ...]:
        """Return encoder readings without those that no stop is looked for from: faster than any pan, or no number."""
        return tuple(each for each in encoders if _speed(each.value) <= self._most)


def _readings(rows: object) -> FloatArray:
    """Return what was measured; null is missing, which is no number."""
    return np.array(rows, dtype=np.float64)


def _reading(value: float | None) -> float:
    return math.nan if value is None else value


def along(chunk: Chunk, axes: int) -> Chunk:
    """Return a chunk with the accelerations along so many axes."""
    return chunk._replace(acceleration=chunk.acceleration[:, :axes].copy(), brake=chunk.brake[:, :axes].copy())


def _data(message: str | bytes) -> bytes:
    return message if isinstance(message, bytes) else message.encode("utf-8", "replace")


def _check_speed(received: StreamInput, most: float) -> None:
    """Check that a stop from what was measured is not too long.

    Raises:
        Problem: `invalid`.
    """
    pan = received.step.pan
    if pan is None or not np.isfinite(pan[-1:]).all():
        return
    speed = _speed(pan[-1])
    if speed > most:
        raise Problem(
            "invalid", f"a pan of {speed:.3g} m/s needs too long to stop: at most {most:.3g} m/s are taken", "pan"
        )


def _speed(state: FloatArray) -> float:
    return math.hypot(*state[len(state) // 2 :])


def _check_rows(chunk: int, **states: FloatArray | None) -> None:
    for name, rows in states.items():
        if rows is not None and len(rows) not in (1, chunk):
            raise Problem("invalid", f"there must be no rows, 1 or {chunk}, got {len(rows)}", name)
