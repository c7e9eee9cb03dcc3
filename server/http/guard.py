"""What every request passes on its way in and out: the token, the counters, and the headers of the answer."""

from __future__ import annotations

import hmac
import logging
import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.problems import Problem
from server.service import Service
from server.settings import Settings

log = logging.getLogger("slide-serve")

PROTECTED = ("/plan", "/plans", "/stream", "/info", "/metrics")
"""What needs the token, where there is one; the page, the description and the health are open."""

PLANNING = ("/plan", "/plans")
"""What is refused when there is too much of it."""

SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
    "object-src 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}


CLIENT_LEFT = 499
"""Status that a request is counted under whose client left before there was an answer."""


class Guard:
    """ASGI middleware around the application.

    Args:
        app: the application.
        service: its settings and counters.
    """

    def __init__(self, app: ASGIApp, service: Service) -> None:
        self._app, self._service = app, service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begin, status = time.perf_counter(), 0

        async def send_with_headers(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
                headers.setdefault("Cache-Control", "no-cache" if "etag" in headers else "no-store")
            await send(message)

        try:
            if scope["path"] in PROTECTED and not carries_token(scope, self._service.settings):
                raise Problem("unauthorized", headers={"WWW-Authenticate": "Bearer"})
            if scope["path"] in PLANNING and scope["method"] == "POST":
                self._service.check_room()  # here it costs least: nothing has been looked at
            await self._app(scope, receive, send_with_headers)
        except Problem as problem:
            await problem.response()(scope, receive, send_with_headers)
        except ClientDisconnect:
            status = status or CLIENT_LEFT
        except Exception:
            log.exception("request failed")
            if status:  # the answer has begun: closing the connection is all that is left
                raise
            await Problem("failed").response()(scope, receive, send_with_headers)
        finally:
            metrics = self._service.metrics
            route = getattr(scope.get("route"), "path", "other")
            metrics.requests.labels(route, str(status)).inc()
            metrics.total_time.observe(time.perf_counter() - begin)


def carries_token(scope: Scope, settings: Settings) -> bool:
    """Whether a request carries the token, if there is one; compared in a time that does not tell where it differs."""
    if settings.token is None:
        return True
    expected = f"Bearer {settings.token.get_secret_value()}".encode()
    return hmac.compare_digest(Headers(scope=scope).get("authorization", "").encode(), expected)
