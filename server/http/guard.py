"""What every request passes on its way in and out: the token, the counters, and the headers of the answer."""

from __future__ import annotations

import hmac
import ipaddress
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


CLIENT = "slide.client"
"""Key of a request's scope: the name of who asks, see `client_of`."""

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
            if scope["path"] in PROTECTED:
                scope[CLIENT] = client_of(scope, self._service.settings)
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
            metrics.total_time.observe(time.perf_counter() - begin)


def client_of(scope: Scope, settings: Settings) -> str:
    """Return the name of who asks: that of the token where tokens have names, and the address otherwise.

    Tokens are compared in a time that does not tell where they differ.

    Raises:
        Problem: `unauthorized`: there are tokens, and it carries none of them.
    """
    address = scope["client"][0] if scope.get("client") else ""
    if not settings.needs_token:
        return network_of(address)
    scheme, _, given = Headers(scope=scope).get("authorization", "").partition(" ")
    found = ""
    if scheme.lower() == "bearer":
        data = given.strip(" ").encode()
        for name, token in settings.clients.items():
            if hmac.compare_digest(data, token.encode()):
                found = name
        if settings.token is not None and hmac.compare_digest(data, settings.token.get_secret_value().encode()):
            found = network_of(address)
    if not found:
        raise Problem("unauthorized", headers={"WWW-Authenticate": "Bearer"})
    return found


def network_of(address: str) -> str:
    """Return the address that a client counts by: of IPv6 the half that says where it is, of which it has plenty."""
    try:
        ip = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address or "nobody"
    if isinstance(ip, ipaddress.IPv6Address):
        return str(ip.ipv4_mapped or ipaddress.ip_network((ip, 64), strict=False))
    return str(ip)
