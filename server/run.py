"""`slide-serve`: reads what it is told, listens, and stops without dropping anything."""

from __future__ import annotations

import asyncio
import inspect
import logging
import signal
import socket
import time
from contextvars import Context
from functools import partial
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer
import uvicorn
from fastapi import FastAPI
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from runtime.cli.console import BAD_INPUT
from runtime.errors import InputError, MissingExtraError
from runtime.interrupt import INTERRUPTED
from server import logs
from server.app import create_app
from server.http.connections import give_up, keep_deadlines, most_connections
from server.http.protocol import GuardedProtocol
from server.http.websocket import GuardedWebSocket
from server.settings import SECRETS, Settings, variable
from server.traces import provider_from_variables, send_the_rest

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider

log = logging.getLogger("slide-serve")

BACKLOG = 1024
"""Connections that the system lets wait until they are accepted."""

ACCEPTED = 16
"""Connections that are accepted before everything else has its turn: a thousand take a tenth of a second."""

FAREWELL = 0.4
"""How long connections have to close when the server ends (s)."""

KEEP_ALIVE = 75
"""How long a connection may be idle (s): longer than the 60 s of common proxies, so that it is they who close it and
no request meets a connection that is just being closed."""


def slide_serve(**given: Any) -> None:
    """Serve plans over HTTP.

    Each option is a variable of the environment too, and goes before it. Bearer tokens are variables only, SLIDE_TOKEN
    for one and SLIDE_TOKENS for several with names: everyone on the machine can read a command line.
    """
    try:
        settings = Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        raise InputError(_first_of(error)) from None
    logs.set_up(settings.log)
    sockets = [_listen(settings.host, settings.port)]
    tracing = _tracing()
    app = create_app(settings, tracing=tracing)
    if settings.metrics_port is not None:
        sockets.append(_listen(settings.host, settings.metrics_port))
        app.state.service.metrics_port = sockets[1].getsockname()[1]
    server = Server(app, settings)
    for listening, what in zip(sockets, ("", ", for figures"), strict=False):
        host, port = listening.getsockname()[:2]
        log.info("listening on http://%s:%d%s", f"[{host}]" if ":" in str(host) else host, port, what)
    server.run(sockets=sockets)
    if tracing is not None:
        send_the_rest(tracing)
    if app.state.service.failure is not None:
        raise typer.Exit(BAD_INPUT)
    if server.interrupted:
        raise typer.Exit(INTERRUPTED)


def _tracing() -> TracerProvider | None:
    """Return what sends traces; None, and a line says why, where the variables ask for it and the extra is missing."""
    try:
        return provider_from_variables()
    except MissingExtraError as error:
        log.warning("traces are not sent: %s", error)
        return None


def _option(name: str, field: FieldInfo) -> inspect.Parameter:
    """Return the option of a setting."""
    default = (
        "" if field.default is None or field.default is False else f"; default: {field.default}".removesuffix(".0")
    )
    help_text = f"{field.description} [{variable(name)}{default}]"
    option = typer.Option(f"--{name.replace('_', '-')}", help=help_text)
    hint: Any = field.annotation
    hint = Annotated[hint | None, option]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=hint)


OPTIONS = [_option(name, field) for name, field in Settings.model_fields.items() if name not in SECRETS]
slide_serve.__signature__ = inspect.Signature(OPTIONS)  # type: ignore[attr-defined]
slide_serve.__annotations__ = {option.name: option.annotation for option in OPTIONS}


class Server(uvicorn.Server):
    """A server that finishes what it has begun when it is told to stop.

    Attributes:
        interrupted: whether it was Ctrl-C that told it to.
    """

    def __init__(self, app: FastAPI, settings: Settings) -> None:
        most = most_connections(settings.max_connections)
        config = uvicorn.Config(
            app,
            http=cast(type[asyncio.Protocol], partial(GuardedProtocol, settings=settings, most=most)),
            ws=cast(type[asyncio.Protocol], partial(GuardedWebSocket, settings=settings)),
            ws_max_size=settings.max_body,
            ws_per_message_deflate=False,
            access_log=False,
            log_config=None,
            server_header=False,
            proxy_headers=bool(settings.proxies),
            forwarded_allow_ips=settings.proxies,
            timeout_graceful_shutdown=1,
            timeout_keep_alive=KEEP_ALIVE,
            backlog=ACCEPTED,  # asyncio takes as many in one go, and would let no more wait
        )
        super().__init__(config)
        self._service = app.state.service
        self._service.on_failure = self._give_up
        self._draining: asyncio.Task[None] | None = None
        self._seldom = logs.Seldom()
        self.interrupted = False

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen; where the system has no descriptor left for a connection, a line says so now and then."""
        asyncio.get_running_loop().set_exception_handler(self._loop_failed)
        await super().startup(sockets)
        for listening in sockets or ():
            listening.listen(BACKLOG)

    def _loop_failed(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if isinstance(error, OSError):
            self._seldom.error(log, f"error: {context.get('message', '')}: {error.strerror}")
        else:
            loop.default_exception_handler(context)

    async def on_tick(self, counter: int) -> bool:
        """Close the connections whose time is over; called ten times a second."""
        keep_deadlines(cast(set[Any], self.server_state.connections), asyncio.get_running_loop().time())
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Say goodbye to all connections, and give up those that are still there a moment later."""
        connections = cast(set[Any], self.server_state.connections)
        asyncio.get_running_loop().call_later(FAREWELL, give_up, connections)
        await super().shutdown(sockets)

    def _give_up(self) -> None:
        self.should_exit = True

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to stop at the first signal; stop at once at the second."""
        self.interrupted = self.interrupted or sig == signal.SIGINT
        if self._service.stopping:
            self.should_exit = self.force_exit = True
            return
        self._service.stopping = True
        # The signal may come while a request is answered, whose name is then in the context.
        asyncio.get_running_loop().call_soon_threadsafe(self._drain, context=Context())

    def _drain(self) -> None:
        self._draining = asyncio.ensure_future(self._finish())

    async def _finish(self) -> None:
        log.info("stopping: %d requests in flight", self._service.in_flight)
        until = time.monotonic() + self._service.settings.drain_timeout
        while self._service.in_flight and time.monotonic() < until:
            await asyncio.sleep(0.01)
        self.should_exit = True


def _listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens.

    Raises:
        OSError: the port is taken, or the address is none of this machine.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(family, kind, protocol)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen(BACKLOG)
    except OSError as error:
        raise InputError(f"cannot listen on {host}:{port}: {error.strerror}") from error
    return listening


def _first_of(error: ValidationError) -> str:
    """Return what is wrong with the first setting that is not usable, and its value unless that is secret."""
    first = error.errors(include_url=False)[0]
    name = ".".join(map(str, first["loc"]))
    if not name:
        return first["msg"].removeprefix("Value error, ")
    value = "" if name in SECRETS else f", got {first['input']!r}"
    return f"{name}: {first['msg']}{value}"
