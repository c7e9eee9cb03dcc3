"""Files as people have them, in `tests/data/commands`: each is one loop, in another spelling."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import Command, FormatError, InputError, Reading

DATA = Path(__file__).parents[2] / "data" / "commands"

READ: list[tuple[str, dict[str, Any], str]] = [
    ("plain.csv", {}, ""),
    ("order.csv", {}, ""),
    ("names.csv", {}, "'Time', 'Position_X', 'Position_Y'"),
    ("units_in_names.csv", {}, "scaled by 0.001; scaled times by 0.001"),
    ("brackets.csv", {}, "scaled by 0.01"),
    ("quoted.csv", {}, "'t', 'x', 'y'"),
    ("velocities.csv", {}, "'sec', 'px', 'py'"),
    ("velocities.csv", {"columns": "sec,px,py"}, "'sec', 'px', 'py'"),
    ("pandas_dates.csv", {}, "'stamp', 'x', 'y'"),
    ("excel_german.csv", {}, ""),
    ("utf8_bom.csv", {}, ""),
    ("tabs.tsv", {}, ""),
    ("spaces.txt", {}, ""),
    ("bars.csv", {}, ""),
    ("comments.csv", {}, ""),
    ("savetxt.dat", {}, ""),
    ("trailing.csv", {}, ""),
    ("trailing_rows.csv", {}, ""),
    ("tum_bare.tum", {}, "'timestamp', 'tx', 'ty'"),
    ("rostopic.csv", {}, "'time', 'field.pose.position.x', 'field.pose.position.y'; scaled times by 1e-09"),
    ("rosbag.csv", {}, "'header.stamp.secs' and 'header.stamp.nsecs', 'pose.position.x', 'pose.position.y'"),
    ("units_row.csv", {}, "scaled by 0.001; scaled times by 0.001"),
    ("euroc.csv", {}, "'timestamp [ns]', 'p_RS_R_x [m]', 'p_RS_R_y [m]'; scaled times by 1e-09"),
    ("clock.csv", {}, "'Time', 'x_m', 'y_m'"),
    ("seconds_and_nanoseconds.csv", {}, "'sec' and 'nanosec', 'x', 'y'"),
    ("waypoints.json", {}, ""),
    ("dt_and_columns.json", {}, ""),
    ("pandas.json", {}, ""),
    ("pandas_split.json", {}, ""),
    ("two_pairs.csv", {"columns": ("t", "right_x", "right_y")}, "'t', 'right_x', 'right_y'"),
    ("bare.csv", {"columns": "t,x,y"}, "'1', '2', '3'"),
    ("bare_order.csv", {"columns": "x,y,label,t"}, "'4', '1', '2'"),
    ("positions.csv", {"rate": 40}, ""),
    ("inches.csv", {"scale": 0.0254}, "scaled by 0.0254"),
    ("milliseconds.csv", {"time_scale": 0.001}, "scaled times by 0.001"),
    ("counted.csv", {"rate": 40}, "passed its times by"),
    ("counted.csv", {"time_scale": 0.025}, "scaled times by 0.025"),
    ("world.csv", {"origin": "first"}, "laid its first position (0.4, -0.3) m"),
    ("world.csv", {"origin": "0.4,-0.3"}, ""),
    ("world.csv", {"origin": (0.4, -0.3)}, ""),
    ("columns.json", {}, "'time', 'x', 'y'"),
    ("options.json", {}, "scaled by 0.001"),
    ("records.json", {}, ""),
    ("records.ndjson", {}, ""),
    ("points.json", {"rate": 40}, ""),
    ("positions.npy", {"rate": 40}, ""),
    ("table.npy", {"columns": "t,x,y"}, "'1', '2', '3'"),
    ("columns.npz", {}, ""),
]

ASKED: list[tuple[str, dict[str, Any], str]] = [
    ("bare.csv", {}, "there is no header: say what the 3 columns hold, as in --columns t,x,y"),
    ("bare.csv", {"columns": "time,x,y,z"}, "names 4 columns, there are 3"),
    ("bare.csv", {"columns": "a,b,c"}, "must name 'x' once"),
    ("plain.csv", {"columns": "t,left,y"}, "line 1: there is no column 'left', the columns are 't', 'x', 'y'"),
    ("plain.csv", {"columns": "t,x,y,z"}, "columns must name t, x and y, or x and y"),
    ("two_pairs.csv", {}, "x and y may be left_x, left_y or right_x, right_y: say which are meant by --columns T,X,Y"),
    ("positions.csv", {}, "at 1 kHz the command moves at 5.52 m/s, above the usual 1.1: what is its rate? --rate 125 "),
    ("positions.npy", {}, "what is its rate? --rate 125 makes it"),
    ("points.json", {}, "what is its rate? --rate 125 makes it"),
    ("table.npy", {}, "say what the 3 columns hold, as in --columns t,x,y"),
    ("millimetres.csv", {}, "goes 150 m from its first position, .* millimetres (--scale 0.001)?"),
    ("inches.csv", {}, "goes 2.362 m .* are these centimetres (--scale 0.01) or inches (--scale 0.0254)?"),
    ("pixels.csv", {}, "goes 600 m .* pixels (--size 0.1, the reach in metres)?"),
    ("pixels_in_names.csv", {}, "goes 600 m .* pixels (--size 0.1, the reach in metres)?"),
    ("milliseconds.csv", {}, "t spans 1000 s, at most 600 s .* are these milliseconds? --time-scale 0.001"),
    ("twice.csv", {}, "t[5] = 1700000000.225 s (line 7) does not come after t[4] = 1700000000.225 s (line 6)"),
    (
        "gap.csv",
        {},
        "jumps by 0.3 m from waypoint 1 (line 4) at 1700000000.126 s to waypoint 2 (line 5) at 1700000000.127 s: ",
    ),
    ("missing.csv", {}, "line 3, column x: '' is not a number"),
    ("strokes.json", {}, "a drawing has no times: --speed 0.3 runs along it at 0.3 m/s, and --size 0.1 says its reach"),
    (
        "strokes.json",
        {"speed": 0.3},
        "a drawing has no unit of length, and goes 111.8 from its first point: --size ",
    ),
    ("drawing.svg", {}, "a drawing has no times: --speed 0.3 runs along it at 0.3 m/s, and --size 0.1 says its reach"),
    ("millimetres.svg", {}, "a drawing has no times: --speed 0.3 runs along it at 0.3 m/s"),
]

RUN_ALONG: list[tuple[str, dict[str, Any], str]] = [
    ("corners.csv", {}, ""),
    ("strokes.json", {"size": 0.05 * 5**0.5}, "took 2 strokes, joined by straight lines; scaled by 0.001"),
    ("quickdraw.ndjson", {"size": 0.1}, "took the first of 2 drawings"),
    ("raw_quickdraw.ndjson", {"size": 0.1}, "took 2 strokes"),
    ("drawing.svg", {"scale": 0.001}, "laid its middle on the pan's centre"),
    ("drawing.svg", {"size": 0.05 * 5**0.5}, "scaled by 0.001"),
    ("millimetres.svg", {}, "scaled by 0.0001"),
    ("positions.npy", {"path_acceleration": 2.0}, ""),
    ("plain.csv", {}, "passed its times by, for the speed"),
]


def loop() -> Any:
    """Return the 1 kHz loop that the files sample, (1001, 2) (m)."""
    s = np.linspace(0.0, 1.0, 1001)
    angle = 2 * np.pi * (10 * s**3 - 15 * s**4 + 6 * s**5)
    return np.stack([0.03 * (1 - np.cos(angle)), 0.02 * np.sin(angle)], axis=1)


@pytest.mark.parametrize(("name", "options", "said"), READ)
def test_a_file_is_the_loop_however_it_is_written(name: str, options: dict[str, Any], said: str) -> None:
    command = Command.load(DATA / name, Reading(**options))
    assert len(command) == 1001
    assert np.abs(command.position - loop()).max() < 1e-4
    notes = "; ".join(command.notes)
    assert said in notes if said else not notes


@pytest.mark.parametrize(("name", "options", "question"), ASKED)
def test_a_file_that_may_mean_several_things_is_asked_about_in_one_line(
    name: str, options: dict[str, Any], question: str
) -> None:
    with pytest.raises(FormatError) as caught:
        Command.load(DATA / name, Reading(**options))
    said = str(caught.value)
    assert said.startswith(f"{DATA / name}: ")
    assert "\n" not in said
    for part in question.split(" .* "):
        assert part in said


@pytest.mark.parametrize(("name", "options", "said"), RUN_ALONG)
def test_a_path_is_run_along_from_rest_to_rest(name: str, options: dict[str, Any], said: str) -> None:
    command = Command.load(DATA / name, Reading(speed=0.2, **options))
    assert command.speed <= 0.2 * 1.01
    assert np.abs(command.velocity[[0, -1]]).max() < 0.01
    assert command.deviation < 0.002
    assert said in "; ".join(command.notes)
    if "size" in options:
        assert command.reach == pytest.approx(options["size"], abs=0.002)


def test_every_file_of_the_folder_is_in_a_table() -> None:
    named = {name for name, *_ in (*READ, *ASKED, *RUN_ALONG)}
    assert {path.name for path in DATA.iterdir()} - named == {"columns.parquet"}


def test_parquet_is_the_loop_where_pyarrow_is_installed() -> None:
    pytest.importorskip("pyarrow")
    assert np.abs(Command.load(DATA / "columns.parquet").position - loop()).max() < 1e-4


def test_standard_input_is_read_as_a_file_is(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, options in (("names.csv", {}), ("options.json", {}), ("positions.npy", {"rate": 40.0})):
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO((DATA / name).read_bytes())))
        command = Command.load("-", Reading(**options))
        assert np.array_equal(command.position, Command.load(DATA / name, Reading(**options)).position)
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"")))
    with pytest.raises(FormatError, match="standard input: the input is empty"):
        Command.load("-")


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "  "])
def test_a_long_table_is_what_its_rows_are_one_by_one(tmp_path: Path, delimiter: str) -> None:
    position = np.random.default_rng(1).normal(0.0, 1e-3, (6000, 2)).round(7)
    rows = [delimiter.join(map(repr, (k / 1e3, *row))) for k, row in enumerate(position.tolist())]
    (tmp_path / "a.csv").write_text("\n".join([delimiter.join("txy"), *rows, ""]))
    assert np.array_equal(Command.load(tmp_path / "a.csv").position, position)
    for row, message in (("5.4,0", "has 2 cells, the header has 3"), ("5.4,nan,0", "column x: nan is not a finite")):
        rows[5400] = row.replace(",", delimiter)
        (tmp_path / "b.csv").write_text("\n".join([delimiter.join("txy"), *rows]))
        with pytest.raises(FormatError, match=f"line 5402(:|,) {message}"):
            Command.load(tmp_path / "b.csv")


def test_options_of_the_caller_count_before_those_of_the_document() -> None:
    document = json.loads((DATA / "options.json").read_text())
    assert len(Command.from_dict(document, reading=Reading(rate=20.0))) == 2001
    with pytest.raises(FormatError, match="command: scale must be greater than 0, got -1"):
        Command.from_dict(document | {"scale": -1.0})


def test_a_counter_or_a_clock_in_the_place_of_seconds_is_asked_about() -> None:
    for t, question in (
        (np.arange(1001), "does t count samples? Give their rate, as in --rate 100"),
        (np.arange(0, 500, 10), "are these milliseconds? --time-scale 0.001 makes them seconds"),
        (np.arange(0, 1_000_001, 1000), "are these microseconds? --time-scale 1e-06 makes them seconds"),
    ):
        position = loop()[np.linspace(0, 1000, len(t)).astype(int)]
        with pytest.raises(InputError) as caught:
            Command.from_waypoints(t, 0.3 * position)
        assert question in str(caught.value)
    slow = Command.from_waypoints(np.arange(0, 510, 10), 0.3 * loop()[::20], Reading(time_scale=1.0))
    assert len(slow) == 500_001


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0.0}, "rate must be greater than 0 Hz, got 0"),
        ({"scale": float("nan")}, "scale: nan is not a finite number"),
        ({"smooth": 1000.0}, "smooth must be between 0.1 and 200 ms, got 1000 ms"),
        ({"rate": 100.0, "speed": 0.3}, "give rate or speed, not both"),
        ({"scale": 0.1, "size": 0.1}, "give scale or size, not both"),
        ({"path_acceleration": 1.0}, "path_acceleration goes with speed"),
        ({"columns": "t"}, "columns must name t, x and y"),
        ({"columns": 3}, "columns must be names like t,x,y"),
        ({"origin": "middle"}, "origin must be pan, first or X,Y in metres, got 'middle'"),
        ({"origin": "0.1,nan"}, "origin, column y: nan is not a finite number"),
    ],
)
def test_bad_options_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Reading(**options)
