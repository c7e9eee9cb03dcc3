"""The description of the server, /openapi.json: what each path takes, and every answer it may give."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic.json_schema import models_json_schema

from runtime.limits import UNITS
from runtime.plan import PLAN_FORMAT
from runtime.quality import Quality, Status
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


def _object(**properties: Any) -> dict[str, Any]:
    """Return the schema of an object that has these names and no others."""
    return {"type": "object", "required": [*properties], "properties": properties, "additionalProperties": False}


def _vectors(size: int, unit: str) -> dict[str, Any]:
    """Return the schema of a row of so many numbers for each sample."""
    row = {"type": "array", "items": NUMBER, "minItems": size, "maxItems": size}
    return {"type": "array", "items": row, "description": f"[{', '.join('xyz'[:size])}] of each sample ({unit})"}


def _maybe(schema: dict[str, Any]) -> dict[str, Any]:
    return {"anyOf": [schema, {"type": "null"}]}


NUMBER: dict[str, Any] = {"type": "number"}
WHOLE: dict[str, Any] = {"type": "integer"}
TEXT: dict[str, Any] = {"type": "string"}
OFF_PAN = _object(first=WHOLE, farthest=NUMBER)

SCHEMAS: dict[str, dict[str, Any]] = {
    "Problem": PROBLEM,
    "Quality": _object(
        **{each.name: NUMBER for each in fields(Quality) if each.type == "float"},
        limits=_object(**{name: _maybe(NUMBER) for name in UNITS}),
        margins=_object(**{name: _maybe(NUMBER) for name in UNITS}),
        worst=_object(**{name: _maybe(WHOLE) for name in UNITS}),
        governed=_maybe(_object(samples=WHOLE, mean=NUMBER, largest=NUMBER)),
        friction=_maybe(
            _object(
                tolerance=NUMBER,
                **{f"{which}_{end}": _maybe(NUMBER) for which in ("static", "kinetic") for end in ("low", "high")},
            )
        ),
        friction_off_rmse=_maybe(NUMBER),
        rest_error=_maybe(NUMBER),
        command_off_pan=_maybe(OFF_PAN),
        object_off_pan=_maybe(OFF_PAN),
        status={"type": "string", "enum": [status.value for status in Status]},
        notes={"type": "array", "items": TEXT},
    ),
    "Plan": _object(
        format={"type": "string", "enum": [PLAN_FORMAT]},
        dt=NUMBER,
        model=_object(name=TEXT, sha256=TEXT),
        friction=_object(static=NUMBER, kinetic=NUMBER),
        command=_object(position=_vectors(2, "m")),
        pan=_object(acceleration=_vectors(3, "m/s^2"), velocity=_vectors(3, "m/s"), position=_vectors(3, "m")),
        stop=_object(acceleration=_vectors(3, "m/s^2")),
        object=_object(velocity=_vectors(2, "m/s"), position=_vectors(2, "m")),
        sizes=_object(pan_radius=NUMBER, object_radius=NUMBER),
        quality={"$ref": f"{REFERENCE}Quality"},
    ),
    "ReadCommand": _object(
        command=_object(dt=NUMBER, position=_vectors(2, "m")), notes={"type": "array", "items": TEXT}
    ),
}
"""What answers are made of."""


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
        schemas |= {**models["$defs"], **SCHEMAS}
        app.openapi_schema = document
    return app.openapi_schema
