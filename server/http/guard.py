"""What every request passes on its way in and out: the token, the counters, and the headers of the answer."""

from __future__ import annotations

import logging
import re
import secrets
import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.http.doors import CLIENT, check_host, client_of
from server.logs import request_id
from server.problems import Problem
from server.service import Service

log = logging.getLogger("slide-serve")

PROTECTED = ("/plan", "/plans", "/command", "/stream", "/info", "/metrics")
"""What needs the token, where there is one; the page, the description and the health are open."""

HEALTH = ("/health/live", "/health/ready")

OPEN_TO_SCRAPES = ("/metrics", *HEALTH)
"""What there is at the port for figures."""

REQUEST_HEADER = "X-Request-ID"

REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
"""What a request's name may be."""

LONGEST_QUERY = 2000
"""Most bytes of a query: all options of a command file with long names of columns take some hundred."""

LONGEST_PATH = 200
"""Most characters of a path in the log."""

PLANNING = ("/plan", "/plans", "/command")
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
        request_id.set(name_request(scope))

        async def send_with_headers(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
                headers[REQUEST_HEADER] = request_id.get()
                headers.setdefault("Cache-Control", "no-cache" if "etag" in headers else "no-store")
            await send(message)

        try:
            if self._is_scrape(scope):
                if scope["path"] not in OPEN_TO_SCRAPES:
                    raise Problem("not-found")
            elif scope["path"] not in HEALTH:  # which a balancer asks for by any name
                check_host(scope, self._service.settings)
            if scope["path"] in PROTECTED and not self._is_scrape(scope):
                scope[CLIENT] = client_of(scope, self._service.settings)
                if len(scope["query_string"]) > LONGEST_QUERY:
                    raise Problem("invalid", f"the query has more than {LONGEST_QUERY} bytes")
            if scope["path"] in PLANNING and scope["method"] == "POST":
                self._service.check_room(scope[CLIENT])  # here it costs least: nothing has been looked at
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
            duration = time.perf_counter() - begin
            metrics.total_time.observe(duration)
            if self._service.settings.log_requests:
                log_request(scope, status, duration)

    def _is_scrape(self, scope: Scope) -> bool:
        """Whether a request came by the port that is for figures only."""
        return bool(scope["server"]) and scope["server"][1] == self._service.metrics_port


def name_request(scope: Scope) -> str:
    """Return the name of a request: the one that a proxy or a client gave it, if it is one, or a new one."""
    given = Headers(scope=scope).get(REQUEST_HEADER, "")
    return given if REQUEST_ID.fullmatch(given) else secrets.token_hex(8)


def log_request(scope: Scope, status: int, duration: float) -> None:
    """Log a line about a request; of its path no more than a page's worth, and nothing of its query."""
    fields = {
        "method": scope["method"],
        "path": scope["path"][:LONGEST_PATH],
        "status": status,
        "milliseconds": round(duration * 1e3, 2),
        "client": scope.get(CLIENT) or (scope["client"] or [""])[0],
    }
    log.info("%(method)s %(path)s %(status)d in %(milliseconds)g ms for %(client)s", fields, extra={"fields": fields})
