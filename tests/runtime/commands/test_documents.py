"""Commands in documents and arrays: other keys, GeoJSON, records in records, and kinds of files that are not read."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import Command, FormatError, Reading

T = (np.arange(60) * 0.01).round(2)
POSITION = np.stack([0.02 * (1 - np.cos(5 * T)), 0.02 * np.sin(5 * T) ** 3], axis=1)
RECORDED = Command.from_waypoints(T, POSITION)
PAIRS = POSITION.tolist()
ROWS = list(zip(T.tolist(), *POSITION.T.tolist(), strict=True))
DATES = [f"2026-01-01T10:00:{t:06.3f}Z" for t in T]
LOCAL = [f"2026-01-01T10:00:{t:06.3f}+01:00" for t in T]

READ: dict[str, Any] = {
    "other keys": {"time": T.tolist(), "pos": PAIRS},
    "position and another key of time": {"timestamp": T.tolist(), "position": PAIRS},
    "points with their times": {"t": T.tolist(), "points": PAIRS},
    "points among other things": {"name": "loop", "points": [dict(zip("txy", row, strict=True)) for row in ROWS]},
    "dates": {"time": DATES, "x": POSITION[:, 0].tolist(), "y": POSITION[:, 1].tolist()},
    "dates of a time zone": {"time": LOCAL, "x": POSITION[:, 0].tolist(), "y": POSITION[:, 1].tolist()},
    "positions in records": [{"t": t, "position": [x, y]} for t, x, y in ROWS],
    "poses in records": [{"t": t, "pose": {"position": {"x": x, "y": y, "z": 0}}} for t, x, y in ROWS],
    "an event in one record": [{"t": t, "x": x, "y": y, **({"event": 1} if t == 0.3 else {})} for t, x, y in ROWS],
}
LINE = {"type": "LineString", "coordinates": [[x, y, 0.0] for x, y in PAIRS]}
GEOJSON = {
    "line": LINE,
    "feature": {"type": "Feature", "properties": {}, "geometry": LINE},
    "collection": {"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": LINE}]},
    "lines": {"type": "MultiLineString", "coordinates": [PAIRS]},
}


@pytest.mark.parametrize("name", READ)
def test_documents_of_other_programs_are_read(name: str) -> None:
    assert Command.from_dict(READ[name]).position == pytest.approx(RECORDED.position, abs=1e-9)


@pytest.mark.parametrize("name", GEOJSON)
def test_a_line_of_geojson_is_read(name: str) -> None:
    command = Command.from_dict(GEOJSON[name], reading=Reading(rate=100))
    assert command.position == pytest.approx(RECORDED.position, abs=1e-9)


def test_options_stand_beside_a_line_of_geojson() -> None:
    assert Command.from_dict(LINE | {"rate": 100}).position == pytest.approx(RECORDED.position, abs=1e-9)


def test_geojson_nested_as_deep_as_json_goes_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"type": "Feature", "geometry": ' * 900 + "{}" + "}" * 900)
    with pytest.raises(FormatError, match="GeoJSON must have one LineString"):
        Command.load(tmp_path / "a.json")


def test_geojson_without_one_line_is_refused() -> None:
    with pytest.raises(FormatError, match="GeoJSON must have one LineString, got 'Point'"):
        Command.from_dict({"type": "Point", "coordinates": [0, 0]})


def test_what_was_passed_by_is_said() -> None:
    assert Command.from_dict(READ["points among other things"]).notes[0] == "passed 'name' by"


def test_an_npz_of_one_array_without_a_name_is_that_array(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", POSITION)
    assert Command.load(tmp_path / "a.npz", Reading(rate=100)).position == pytest.approx(RECORDED.position)


def test_an_array_the_wrong_way_round_is_said(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", POSITION.T)
    for given in (tmp_path / "a.npy", tmp_path / "a.json"):
        (tmp_path / "a.json").write_text(json.dumps(np.column_stack([T, POSITION]).T.tolist()))
        with pytest.raises(FormatError, match=r"a row for each sample, got the shape .*: transpose it"):
            Command.load(given)


def archive(name: str) -> bytes:
    with zipfile.ZipFile(content := io.BytesIO(), "w") as file:
        file.writestr(name, "t,x,y\n0,0,0\n1,0.1,0\n")
    return content.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x1f\x8b\x08\0\0", "a gzip file is packed: unpack it first"),
        (archive("a.csv"), "not an npz file: 'a.csv' in it is no array of numpy"),
        (archive("[Content_Types].xml"), "an Office document is not read: export it as CSV"),
        (b"\x89HDF\r\n\x1a\n" + bytes(200), "an HDF5 or MATLAB file is not read: export it as CSV"),
        (b"\x89PNG\r\n\x1a\n" + bytes(200), "a picture is not read: draw the path as SVG"),
        (b"anything else" + bytes(200), "not text"),
        (b"t,x,y\n0,0,0\n1,0.1,0\n\0\0\0", "not text: line 4 holds zero bytes"),
    ],
)
def test_what_is_no_command_is_named(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(FormatError, match=message) as caught:
        Command.load(tmp_path / "a")
    assert len(str(caught.value)) < 200 + len(str(tmp_path))


def test_a_scale_beyond_all_numbers_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", [[0.0, 0.0], [1e300, 0.0]])
    with pytest.raises(FormatError, match="a coordinate is no finite number"):
        Command.load(tmp_path / "a.npy", Reading(scale=1e12))


def test_a_broken_archive_is_said_in_one_short_line(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", t=T, position=POSITION)
    data = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(data[:30] + b"\0" + data[30:])
    with pytest.raises(FormatError, match="not a readable npz file") as caught:
        Command.load(tmp_path / "a.npz")
    assert len(str(caught.value)) < 200 + len(str(tmp_path))
