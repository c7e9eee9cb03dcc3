"""`POST /command`: a command file read as the programs read it."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import fields
from typing import Any

from fastapi import APIRouter, Request
from starlette.responses import Response

from runtime import Reading
from server.http.body import read_body
from server.http.doors import CLIENT
from server.http.openapi import REFERENCE, problems
from server.http.plans import JSON, LeasedResponse, accepted, holding, pieces
from server.planning.messages import FILE, PIECE
from server.problems import Problem
from server.service import Service

BINARY = "application/octet-stream"

NUMBERS = tuple(each.name for each in fields(Reading) if each.name not in ("columns", "origin"))
"""Options of `Reading` that are numbers; the others are texts."""

router = APIRouter()


def _parameter(name: str) -> dict[str, Any]:
    return {"name": name, "in": "query", "schema": {"type": "number" if name in NUMBERS else "string"}}


@router.post(
    "/command",
    openapi_extra={
        "requestBody": {"required": True, "content": {BINARY: {"schema": {"type": "string", "format": "binary"}}}},
        "parameters": [_parameter(each.name) for each in fields(Reading)],
    },
    response_class=Response,
    responses={
        200: {
            "description": "The command, every millisecond, and what was made of the file",
            "content": {JSON: {"schema": {"$ref": f"{REFERENCE}ReadCommand"}}},
        },
        **problems(400, 401, 406, 408, 413, 415, 421, 422, 429, 500, 503, 504),
    },
)
async def command(request: Request) -> Response:
    """Read a file: a table, JSON, npy, npz, Parquet or a drawing as SVG; the options are those of the programs."""
    service: Service = request.app.state.service
    accepted(request, (JSON,))
    client: str = request.scope[CLIENT]
    options = _options(request)
    with ExitStack() as stack:
        stack.callback(service.admit(client).release)
        held = stack.enter_context(holding(request, service))
        body = await read_body(request, service.settings, BINARY)
        document: bytes = await service.reader.read(client, FILE, body, **options)
        held.resize(len(document))
        headers = {"Content-Length": str(len(document))}
        cut = (document[begin : begin + PIECE] for begin in range(0, len(document), PIECE))
        return LeasedResponse(pieces(cut, service), headers, JSON, stack.pop_all())


def _options(request: Request) -> dict[str, Any]:
    """Return the options of reading that the address gives.

    Raises:
        Problem: `invalid`.
    """
    options: dict[str, Any] = {}
    for name, text in request.query_params.items():
        if name not in {each.name for each in fields(Reading)}:
            raise Problem("invalid", "there is an option that is not known here")
        try:
            options[name] = float(text) if name in NUMBERS else text
        except ValueError:
            raise Problem("invalid", "this option is a number", name) from None
    return options
