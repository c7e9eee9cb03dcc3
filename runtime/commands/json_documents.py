"""Commands in documents: JSON as this project writes it, columns, records, points, strokes; a line each or whole."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from runtime.commands import arrays
from runtime.commands.columns import TIMES, may_be_header
from runtime.commands.points import Points
from runtime.commands.reading import OPTIONS, Reading
from runtime.commands.strokes import from_strokes, is_strokes
from runtime.documents.files import parse_json
from runtime.errors import InputError

POINTS = ("points", "path", "positions", "pos", "xy", "waypoints", "trajectory", "polyline", "coordinates")
"""Names under which a document may have points or records."""


def parse_documents(content: str) -> object:
    """Parse JSON, or JSON a line (ndjson), which makes a list.

    Raises:
        InputError: it is neither; line and column are named.
    """
    first, _, rest = content.lstrip().partition("\n")
    if not rest.strip() or not first.rstrip().endswith(("}", "]")):
        return parse_json(content)
    try:
        json.loads(first)
    except ValueError:
        return parse_json(content)
    return [parse_json(line) for line in content.splitlines() if line.strip()]


def from_document(document: object, reading: Reading) -> tuple[Points, Reading]:
    """Read positions from a parsed document, and the options it names.

    Args:
        document: {"t" or "dt", "position"}, columns by their names, a list of points or of records, strokes, or a line
            in GeoJSON; options of `Reading` beside them.
        reading: options that count before the document's.

    Raises:
        InputError: a key is missing or unknown, or a value is not what it must be.
    """
    if isinstance(document, list) and document and all(isinstance(each, Mapping) for each in document):
        if not is_strokes(document[0]):
            return arrays.from_columns(_transposed(document), reading), reading
        points, reading = from_document(document[0], reading)
        return points._replace(found=(f"took the first of {len(document)} drawings", *points.found)), reading
    if isinstance(document, list) and document and _is_nested(document[0]):
        return from_strokes({"strokes": document}), reading
    if isinstance(document, list):
        return arrays.from_array(document, reading), reading
    if not isinstance(document, Mapping):
        raise InputError('must be an object with the keys "dt" (or "t") and "position"')
    if isinstance(document.get("data"), list) and isinstance(document.get("columns"), list):  # pandas' orient="split"
        return from_document(_records(document["columns"], document["data"]), reading)
    options = {name: document[name] for name in OPTIONS if name in document and document[name] is not None}
    reading = reading.completed(options)
    rest = {name: value for name, value in document.items() if name not in OPTIONS}
    if is_strokes(rest):
        return from_strokes(rest), reading
    if isinstance(rest.get("type"), str) and {"coordinates", "geometry", "features"} & rest.keys():
        return _from_geojson(rest), reading
    listed = [name for name in POINTS if isinstance(rest.get(name), (list, np.ndarray))]
    clocks = [name for name in rest if name.lower() in TIMES]
    if "position" not in rest and len(listed) == 1 and not may_be_header(list(rest)):
        if not clocks and "dt" not in rest:
            passed = [name for name in rest if name != listed[0]]
            points, reading = from_document(rest[listed[0]], reading)
            found = (f"passed {', '.join(map(reprlib.repr, passed))} by",) if passed else ()
            return points._replace(found=(*found, *points.found)), reading
        rest["position"] = rest.pop(listed[0])
    if "position" in rest and len(clocks) == 1:
        rest["t"] = rest.pop(clocks[0])
    if "position" in rest or not rest.keys() - {"t", "dt"}:
        return _positions(rest, reading), reading
    dt = arrays.interval(rest.pop("dt")) if "dt" in rest else None
    points = arrays.from_columns({name: _listed(value) for name, value in rest.items()}, reading)
    return (points if dt is None else points._replace(dt=dt)), reading


def _from_geojson(document: Mapping[str, Any]) -> Points:
    """Read the one line of a GeoJSON document; heights are passed by.

    Raises:
        InputError: it is no line, or it is one of several.
    """
    for _ in range(2):  # a collection of one feature, whose geometry is the line
        features, geometry = document.get("features"), document.get("geometry")
        if isinstance(features, list) and len(features) == 1 and isinstance(features[0], Mapping):
            document = features[0]
        elif isinstance(geometry, Mapping):
            document = geometry
    kind, line = document.get("type"), document.get("coordinates")
    if kind in ("MultiLineString", "Polygon") and isinstance(line, list) and len(line) == 1:
        kind, line = "LineString", line[0]
    if kind != "LineString" or not isinstance(line, list):
        raise InputError(f"GeoJSON must have one LineString, got {reprlib.repr(kind)}", "type")
    return Points(arrays.positions([at[:2] if isinstance(at, list) else at for at in line], "coordinates"))


def _listed(column: Any) -> Any:
    """Return a column as a list, also where its rows are named, as in `DataFrame.to_json`."""
    return list(column.values()) if isinstance(column, Mapping) else column


def _positions(document: Mapping[str, Any], reading: Reading) -> Points:
    for name in document:
        if name not in ("t", "dt", "position"):
            raise InputError(f"unknown key {name!r}, expected t or dt, and position")
    if "position" not in document:
        raise InputError("missing key 'position'")
    given = [name for name in ("t", "dt") if name in document]
    given += [name for name in ("rate", "speed") if getattr(reading, name) is not None]
    if given not in (["t"], ["dt"], ["rate"], ["speed"]):
        raise InputError("exactly one of the keys 't', 'dt', 'rate' and 'speed' is needed")
    position = arrays.positions(document["position"])
    if "dt" in document:
        return Points(position, dt=arrays.interval(document["dt"]))
    if "t" not in document:
        return Points(position)
    return Points(position, arrays.times(document["t"], "t"))


def _is_nested(value: object) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], list)


def _records(names: list[Any], rows: list[Any]) -> list[dict[str, Any]]:
    """Return rows under the names of their columns.

    Raises:
        InputError: a row is no list, or has another length.
    """
    for index, row in enumerate(rows):
        if not isinstance(row, list) or len(row) != len(names):
            raise InputError(f"data[{index}] must have {len(names)} values, as there are columns", f"data[{index}]")
    return [dict(zip(map(str, names), row, strict=True)) for row in rows]


def _transposed(records: list[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the columns of a list of records.

    Raises:
        InputError: a record lacks a key that the first has; it is named.
    """
    flat = [_flat(record) for record in records]
    names = list(flat[0])
    for index, record in enumerate(flat):
        if not record.keys() >= set(names):
            raise InputError(f"record {index} has the keys {', '.join(record)}, the first has {', '.join(names)}")
    return {name: [record[name] for record in flat] for name in names}


def _flat(record: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return a record without records in it: {"position": {"x": 1}} and {"position": [1, 2]} become position.x."""
    flat: dict[str, Any] = {}
    for name, value in record.items():
        key = f"{before}{name}"
        if isinstance(value, list) and len(value) in (2, 3):
            value = dict(zip("xyz", value, strict=False))
        flat |= _flat(value, f"{key}.") if isinstance(value, Mapping) else {key: value}
    return flat
