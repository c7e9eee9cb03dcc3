"""The description of the server, /openapi.json: what each path takes, and every answer it may give."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic.json_schema import models_json_schema

from server.http.schemas import PlanRequest, PlansRequest
from server.problems import MEDIA_TYPE, TITLES

REFERENCE = "#/components/schemas/"

PROBLEM = {
    "type": "object",
    "required": ["type", "title", "status"],
    "properties": {
        "type": {"type": "string"},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "detail": {"type": "string"},
        "place": {"type": "string"},
        "request": {"type": "string"},
    },
}
PLAN = {
    "type": "object",
    "required": ["format", "dt", "model", "friction", "command", "pan", "object", "quality"],
    "properties": {"format": {"const": "slide-plan/2"}},
}


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the description of answers that are problem documents."""
    schema = {"schema": {"$ref": f"{REFERENCE}Problem"}}
    titles = dict(reversed(TITLES.values()))
    return {status: {"description": titles[status], "content": {MEDIA_TYPE: schema}} for status in statuses}


def describe(app: FastAPI) -> dict[str, Any]:
    """Return the description; made once."""
    if app.openapi_schema is None:
        document = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
        models = models_json_schema(
            [(PlanRequest, "validation"), (PlansRequest, "validation")], ref_template=REFERENCE + "{model}"
        )[1]
        schemas = document.setdefault("components", {}).setdefault("schemas", {})
        schemas |= {**models["$defs"], "Problem": PROBLEM, "Plan": PLAN}
        app.openapi_schema = document
    return app.openapi_schema
