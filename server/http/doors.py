"""Who may come in: by the name the server is called by, the site a page is of, and the token."""

from __future__ import annotations

import base64
import hmac
import ipaddress

from starlette.datastructures import Headers
from starlette.types import Scope

from server.problems import Problem
from server.settings import Settings

CLIENT = "slide.client"
"""Key of a request's scope: the name of who asks, see `client_of`."""


SUBPROTOCOL = "slide-stream"
"""Subprotocol of a stream, for those that name one: a page, which can send no header, names its token as another."""

BEARER = "bearer."
"""What the name of a token's subprotocol begins with; base64url of the token follows, without padding."""


def check_host(scope: Scope, settings: Settings) -> None:
    """Check that the server is called by an address or a name of its own.

    A page may give its own name this machine's address, and would then be let in by the browser as if it were ours; an
    address it cannot.

    Raises:
        Problem: `misdirected`; `malformed` where there is no name or several.
    """
    given = Headers(scope=scope).getlist("host")
    if len(given) != 1:
        if not given and scope.get("http_version") == "1.0":
            return
        raise Problem("malformed", "a request has one header Host")
    name = name_of(given[0])
    if name not in settings.names and not is_address(name):
        raise Problem("misdirected", "the name must be one of SLIDE_HOSTS, localhost or an address")


def name_of(host: str) -> str:
    """Return the name of a header Host, without the port, in lower case."""
    host = host.strip().lower()
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.rpartition(":")[0] if host.count(":") == 1 else host


def is_address(name: str) -> bool:
    """Whether a name is an address."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def check_origin(scope: Scope) -> None:
    """Check that no other site's page asks: browsers let any page try to open a websocket.

    Raises:
        Problem: `forbidden`.
    """
    headers = Headers(scope=scope)
    for origin in headers.getlist("origin"):
        if origin.lower().partition("://")[2] != headers.get("host", "").lower():
            raise Problem("forbidden", "the page that asks is of another site")


def client_of(scope: Scope, settings: Settings) -> str:
    """Return the name of who asks: that of the token where tokens have names, and the address otherwise.

    Tokens are compared in a time that does not tell where they differ.

    Raises:
        Problem: `unauthorized`: there are tokens, and it carries none of them.
    """
    address = scope["client"][0] if scope.get("client") else ""
    if not settings.needs_token:
        return network_of(address)
    data, found = _given_token(scope), ""
    if data is not None:
        for name, token in settings.clients.items():
            if hmac.compare_digest(data, token.encode()):
                found = name
        if settings.token is not None and hmac.compare_digest(data, settings.token.get_secret_value().encode()):
            found = network_of(address)
    if not found:
        raise Problem("unauthorized", headers={"WWW-Authenticate": "Bearer"})
    return found


def _given_token(scope: Scope) -> bytes | None:
    """Return the token that a request carries: in its header, or, of a websocket, as a subprotocol."""
    scheme, _, given = Headers(scope=scope).get("authorization", "").partition(" ")
    if scheme.lower() == "bearer":
        return given.strip(" ").encode()
    for each in scope.get("subprotocols", ()):
        if each.startswith(BEARER):
            coded = each.removeprefix(BEARER)
            try:
                return base64.b64decode(coded + "=" * (-len(coded) % 4), altchars=b"-_", validate=True)
            except ValueError:
                return None
    return None


def network_of(address: str) -> str:
    """Return the address that a client counts by: of IPv6 the half that says where it is, of which it has plenty."""
    try:
        ip = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address or "nobody"
    if isinstance(ip, ipaddress.IPv6Address):
        return str(ip.ipv4_mapped or ipaddress.ip_network((ip, 64), strict=False))
    return str(ip)
