"""What a client is told when something is wrong: RFC 9457 problem documents, small, with stable types.

A problem says the place of the fault and the limit that was passed. It never carries what was sent, a path of this
machine, or a traceback.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

import orjson
from starlette.responses import Response

from runtime.errors import InputError, place_text
from server.logs import request_id

MEDIA_TYPE = "application/problem+json"
TYPE_PREFIX = "urn:slide-planner:problem:"

MAX_TEXT = 500
"""Longest detail or place (characters), so that a problem stays small whatever it is about."""

TITLES = {
    "malformed": (400, "The request cannot be read"),
    "unauthorized": (401, "A bearer token is needed"),
    "forbidden": (403, "The request is not allowed"),
    "not-found": (404, "There is nothing at this path"),
    "method-not-allowed": (405, "The path does not take this method"),
    "not-acceptable": (406, "None of the accepted media types can be given"),
    "too-slow": (408, "The request took too long to arrive"),
    "idle": (408, "The stream has been silent for too long"),
    "too-large": (413, "The body is too large"),
    "unsupported-media-type": (415, "The body is not of a media type that is read"),
    "misdirected": (421, "This server does not go by that name"),
    "invalid": (422, "The request asks for what cannot be planned"),
    "too-fast": (429, "Too many steps come in a short time"),
    "too-many": (429, "This client has its share"),
    "header-too-large": (431, "The header is too large"),
    "failed": (500, "The server failed"),
    "overloaded": (503, "Too much is waiting to be planned"),
    "stopping": (503, "The server is stopping"),
    "not-ready": (503, "The server is not ready"),
    "deadline": (504, "The plan was not ready in time"),
}
"""Status and title of each problem; the type is TYPE_PREFIX and the name."""


@dataclass
class Problem(Exception):
    """A problem, raised where it is found.

    Attributes:
        name: key of TITLES.
        detail: what is wrong this time, in one line.
        place: where in the request, as in `command.position[3][0]`; None if nowhere.
        headers: of the response, besides the usual ones.
    """

    name: str
    detail: str = ""
    place: str | None = None
    headers: Mapping[str, str] = field(default_factory=dict)

    @property
    def status(self) -> int:
        """HTTP status."""
        return TITLES[self.name][0]

    def to_dict(self) -> dict[str, Any]:
        """Return the problem document."""
        status, title = TITLES[self.name]
        document = {"type": TYPE_PREFIX + self.name, "title": title, "status": status}
        if self.detail:
            document["detail"] = _short(self.detail)
        if self.place:
            document["place"] = _short(self.place)
        if request := request_id.get():
            document["request"] = request
        return document

    def response(self) -> Response:
        """Return it as a response."""
        return Response(orjson.dumps(self.to_dict()), self.status, dict(self.headers), MEDIA_TYPE)


def for_input(error: InputError) -> Problem:
    """Return the problem that an error about what was sent says, with its place."""
    return Problem("invalid", str(error), place_text(error.place) or None)


def for_status(status: int, headers: Mapping[str, str] | None = None) -> Problem:
    """Return the problem that an HTTP status alone says."""
    name = next((name for name, (its, _) in TITLES.items() if its == status), "failed")
    return Problem(name, HTTPStatus(status).phrase if name == "failed" else "", headers=headers or {})


def _short(text: str) -> str:
    plain = "".join(letter if letter.isprintable() else "?" for letter in text[: MAX_TEXT + 1])
    return plain if len(plain) <= MAX_TEXT else plain[: MAX_TEXT - 3] + "..."
