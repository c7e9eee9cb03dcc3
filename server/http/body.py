"""A request's body, bounded in bytes and in time before anything of it is parsed."""

from __future__ import annotations

import asyncio

from starlette.requests import Request

from server.planning.bounds import BRACKET, check_positions
from server.problems import Problem
from server.settings import Settings


async def read_body(
    request: Request, settings: Settings, wanted: str = "application/json", one_command: bool = False
) -> bytes:
    """Read the body of a request of a media type.

    Args:
        request: whose body has not been read.
        settings: the largest body and command, and the longest time.
        wanted: the media type.
        one_command: whether it holds one command, whose positions can be counted as they come.

    Raises:
        Problem: `unsupported-media-type`, `too-large`, `too-slow`, or `invalid`: there are too many positions.
        ClientDisconnect: the client left.
    """
    media_type, _, parameters = request.headers.get("content-type", "").partition(";")
    charset = parameters.strip().lower().replace('"', "")
    if media_type.strip().lower() != wanted or charset not in ("", "charset=utf-8"):
        raise Problem("unsupported-media-type", f"send {wanted}", headers={"Accept": wanted})
    if request.headers.get("content-encoding", "identity").lower() != "identity":
        raise Problem("unsupported-media-type", "send the body as it is, without a content encoding")
    declared = request.headers.get("content-length", "0")
    if declared.isdecimal() and int(declared[:20]) > settings.max_body:
        raise too_large(settings)
    parts, size, brackets = [], 0, 0
    try:
        async with asyncio.timeout(settings.body_timeout):
            async for part in request.stream():
                size += len(part)
                if size > settings.max_body:
                    raise too_large(settings)
                if one_command:
                    brackets += part.count(BRACKET)
                    check_positions(brackets, settings.max_samples)
                parts.append(part)
    except TimeoutError:
        raise Problem("too-slow", f"the body must arrive within {settings.body_timeout:g} s") from None
    return b"".join(parts)


def too_large(settings: Settings) -> Problem:
    """Return what a client is told that sends too much; the rest of it is not read."""
    return Problem("too-large", f"at most {settings.max_body} bytes are read")
