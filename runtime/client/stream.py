"""A stream that is decoded by a server, for a controller that does not: as `runtime.Stream`, over `WS /stream`."""

from __future__ import annotations

import json
import math
from collections import deque
from contextlib import AbstractContextManager, ExitStack
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from runtime.client.messages import (
    AXES,
    MOST_READINGS,
    STREAM_FORMAT,
    Chunk,
    Reading,
    Step,
    pack_step,
    unpack_chunk,
)
from runtime.client.request import command_document, options_document
from runtime.command import Command
from runtime.documents.checks import FloatArray, fields, number, table
from runtime.documents.files import parse_json
from runtime.errors import InputError, ServerError, extra
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.measured import check_age, check_state
from runtime.physics.law import DT
from runtime.start import Start
from runtime.stream import OBJECT_NOISE, StreamStatus

MAX_MESSAGE = 1 << 24
"""Largest message taken from a server (bytes): a chunk and its stop are far below."""


class RemoteStream(AbstractContextManager["RemoteStream"]):
    """One command followed chunk by chunk with a server's network; a context manager, for one thread.

        with RemoteStream("http://127.0.0.1:8000", position) as stream:
            acceleration = stream.step(pan_state, object_state)  # (C, 3) m/s^2, for the next C samples
            stream.see_object(position, age=0.050)  # in the place of states: what a camera and encoders saw
            stream.see_pan(pan_state)
            acceleration = stream.step()

    Args:
        url: of the server, as in http://127.0.0.1:8000.
        position: a Command, or (K, 2) where the object should be, relative to the pan (m), at 1 kHz.
        friction, limits, start: as for `Planner.stream`; the server's if None.
        command_delay, noise: as for `Stream`.
        token: the server's bearer token, if it wants one.
        packed: send float32, which is less and rounded, instead of JSON.
        timeout: longest wait for an answer (s).

    Attributes:
        chunk: samples in a chunk, C.
        model: name and sha256 of the server's bundle.
        last: the chunk given last, with the stop from its end; None before the first.
        refused: why the server kept the old command, if the last step told it another one that it does not take.

    Raises:
        InputError: a position, the delay or the noise is no finite number, or the limits are not finite.
        ServerError: the server cannot be reached, or refuses; what it says is passed on.
        MissingExtraError: websockets is not installed.
    """

    def __init__(
        self,
        url: str,
        position: Command | ArrayLike,
        friction: Friction | None = None,
        *,
        limits: Limits | None = None,
        start: Start | None = None,
        command_delay: float | None = 0.0,
        noise: float = OBJECT_NOISE,
        token: str | None = None,
        packed: bool = False,
        timeout: float = 5.0,
    ) -> None:
        self._url, self._packed, self._timeout = url, packed, timeout
        self._sequence = 0
        self._frames: deque[Reading] = deque(maxlen=MOST_READINGS)
        self._encoders: deque[Reading] = deque(maxlen=MOST_READINGS)
        self._next: dict[str, Any] = {}
        self.last: Chunk | None = None
        self.refused: str | None = None
        opening: dict[str, Any] = {
            "format": STREAM_FORMAT,
            "command": command_document(position),
            "packed": packed,
            "command_delay": None if command_delay is None else number(command_delay, "command_delay"),
            "noise": number(noise, "noise"),
            **options_document(friction=friction, limits=limits, start=start),
        }
        self._stack = ExitStack()
        self._socket = _connect(url, token, timeout, self._stack)
        try:
            opened = fields(self._ask(json.dumps(opening)), "", ("format", "chunk", "dt", "model"))
        except InputError as error:
            self.close()
            raise ServerError(f"{url}: not a stream of ours: {error}") from error
        except ServerError:
            self.close()
            raise
        self.chunk: int = opened["chunk"]
        self.model: dict[str, str] = opened["model"]

    def see_object(self, position: ArrayLike | None, age: float = 0.0, executed: int | None = None) -> None:
        """Tell with the next step where the object was seen; see `Stream.see_object`.

        Of more than MOST_READINGS between two steps the last ones are told.

        Raises:
            InputError: another shape or type, or there is no such sample.
        """
        seen = check_state(position, "position", (2,))
        self._tell(self._frames, seen, age, executed)

    def see_pan(self, state: ArrayLike | None, age: float = 0.0, executed: int | None = None) -> None:
        """Tell with the next step where the encoders say that the pan was; see `Stream.see_pan` and `see_object`."""
        self._tell(self._encoders, check_state(state, "state", (4, 6)), age, executed)

    def retarget(self, position: Command | ArrayLike) -> None:
        """Follow another command from the next step on; see `Stream.retarget`, and `refused`.

        Raises:
            InputError: the command is not usable; the old one is kept.
        """
        command = position if isinstance(position, Command) else Command.from_samples(position)
        self._next["command"] = command_document(command)

    def reset(self, start: Start) -> None:
        """Begin again with the next step from where pan and object are, with what is left of the command.

        That step is refused with a ServerError, and the connection closed, if the pan cannot come to rest from there.
        """
        self._next.update(options_document(start=start))

    def step(
        self,
        pan_state: FloatArray | None = None,
        object_state: FloatArray | None = None,
        age: float = 0.0,
        executed: int | None = None,
    ) -> FloatArray:
        """Give the pan accelerations (C, 3) (m/s^2) for the next C samples; see `Stream.step`.

        Raises:
            InputError: there is no such sample.
            ServerError: the server refuses, is gone, or answers something else.
        """
        done = self._sample(executed)
        step = Step(self._sequence, pan_state, object_state, age, tuple(self._frames), tuple(self._encoders), done)
        try:
            message = pack_step(step) if self._packed and not self._next else _step_json(step, self._next)
            answer = self._ask(message)
            chunk, refused = (answer, None) if isinstance(answer, Chunk) else _chunk(answer)
        except InputError as error:
            raise ServerError(f"{self._url}: not an answer of ours: {error}") from error
        if chunk.sequence != step.sequence or len(chunk.acceleration) != self.chunk:
            raise ServerError(f"{self._url}: the answer is not to step {step.sequence}")
        self._sequence += 1
        self._frames.clear()
        self._encoders.clear()
        self._next = {}
        self.last, self.refused = chunk, refused
        return chunk.acceleration

    def close(self) -> None:
        """Hang up."""
        self._stack.close()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _tell(self, readings: deque[Reading], seen: FloatArray | None, age: float, executed: int | None) -> None:
        """Keep a reading for the next step, if it is one."""
        late, done = check_age(age), self._sample(executed)
        if seen is not None and late is not None:
            readings.append(Reading(seen, late * DT, done))

    def _sample(self, executed: int | None) -> int | None:
        """Return a number of samples of a chunk.

        Raises:
            InputError: it is none.
        """
        whole = isinstance(executed, (int, np.integer)) and not isinstance(executed, bool)
        if executed is None or (whole and 0 <= executed <= self.chunk):
            return executed
        raise InputError(f"executed must be a whole number from 0 to {self.chunk}, got {executed!r}", "executed")

    def _ask(self, message: str | bytes) -> Any:
        """Send a message and return what comes back: a Chunk, or a JSON document.

        Raises:
            ServerError: a problem comes back, or nothing.
            InputError: what comes back is neither.
        """
        from websockets.exceptions import ConnectionClosed

        try:
            self._socket.send(message)
            answer = self._socket.recv(timeout=self._timeout)
        except TimeoutError:
            raise ServerError(f"{self._url}: no answer within {self._timeout:g} s") from None
        except (ConnectionClosed, OSError) as error:
            raise ServerError(f"{self._url}: the connection is lost: {error}") from None
        if isinstance(answer, bytes):
            return unpack_chunk(answer)
        document = parse_json(answer)
        if isinstance(document, dict) and "type" in document:
            raise ServerError(f"{self._url}: {problem_text(document)}")
        return document


def problem_text(problem: dict[str, Any]) -> str:
    """Return in one line what a problem document says."""
    place = f"{problem['place']}: " if problem.get("place") else ""
    return f"{problem.get('title')}: {place}{problem.get('detail', '')}".rstrip(": ")


def _step_json(step: Step, more: dict[str, Any]) -> str:
    message: dict[str, Any] = {"sequence": step.sequence, "age": _told(step.age), **more}
    for name, state in (("pan", step.pan), ("object", step.object)):
        if state is not None:
            message[name] = [[_told(value) for value in row] for row in np.atleast_2d(state).tolist()]
    for name, value, readings in (("frames", "position", step.frames), ("encoders", "state", step.encoders)):
        if readings:
            message[name] = [
                {value: each.value.tolist(), "age": each.age, "executed": each.executed} for each in readings
            ]
    if step.executed is not None:
        message["executed"] = int(step.executed)
    return json.dumps(message, allow_nan=False)


def _told(value: float) -> float | None:
    """Return a number as JSON has it: null where it is none."""
    return value if math.isfinite(value) else None


def _chunk(document: Any) -> tuple[Chunk, str | None]:
    """Return the chunk of an answer, and why the command that was told with it is refused."""
    parts = fields(document, "", ("sequence", "status", "acceleration", "brake"), ("refused",))
    if parts["status"] not in tuple(StreamStatus):
        raise InputError("there is no such status")
    rows = table(parts["acceleration"], "acceleration", AXES), table(parts["brake"], "brake", AXES)
    refused = parts.get("refused")
    if not isinstance(refused, dict | None):
        raise InputError("what is refused is no problem document")
    chunk = Chunk(parts["sequence"], *rows, StreamStatus(parts["status"]))
    return chunk, None if refused is None else problem_text(refused)


def _connect(url: str, token: str | None, timeout: float, stack: ExitStack) -> Any:
    """Return a connection, which the stack closes."""
    with extra("client"):
        from websockets.exceptions import InvalidStatus, WebSocketException
        from websockets.sync.client import connect
    scheme, separator, rest = url.rstrip("/").partition("://")
    if not separator or scheme not in ("http", "https"):
        raise ServerError(f"{url}: the address of a server begins with http:// or https://")
    headers = {} if token is None else {"Authorization": f"Bearer {token}"}
    address = f"{'wss' if scheme == 'https' else 'ws'}://{rest}/stream"
    try:
        opening = connect(
            address, additional_headers=headers, open_timeout=timeout, compression=None, max_size=MAX_MESSAGE
        )
        return stack.enter_context(opening)
    except InvalidStatus as error:
        raise ServerError(f"{url}: {_refusal(error.response)}") from None
    except (WebSocketException, OSError, ValueError) as error:
        raise ServerError(f"{url}: cannot be reached: {error}") from None


def _refusal(response: Any) -> str:
    try:
        document = parse_json(bytes(response.body or b"").decode())
    except (InputError, UnicodeDecodeError):
        document = None
    if isinstance(document, dict) and "title" in document:
        return problem_text(document)
    return f"refused with status {response.status_code}"
