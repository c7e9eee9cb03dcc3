"""Tables as programs write them: what stands before and after the numbers, names of times, columns by number."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import Command, FormatError, Reading

T = [round(0.01 * k, 2) for k in range(60)]
POSITION = [(round(0.02 * (1 - np.cos(5 * t)), 6), round(0.02 * np.sin(5 * t) ** 3, 6)) for t in T]
RECORDED = Command.from_waypoints(T, POSITION)


def table(header: str, row: str, end: str = "") -> str:
    """Return a table of the recording: `row` is a format of k, t, x, y, and ms, mm and mm2."""
    lines = [
        row.format(k=k, t=t, x=x, y=y, ms=round(1e3 * t), mm=f"{1e3 * x:.3f}", mm2=f"{1e3 * y:.3f}")
        for k, (t, (x, y)) in enumerate(zip(T, POSITION, strict=True))
    ]
    return "\n".join([header, *lines]) + "\n" + end


READ: dict[str, tuple[str, dict[str, Any]]] = {
    "delimiter named in quotes": (table('"sep=;"\nt;x;y', "{t};{x};{y}"), {}),
    "delimiter named in capitals": (table("SEP=;\nt;x;y", "{t};{x};{y}"), {}),
    "rows without a value at the end": (table("t;x;y", "{t};{x};{y}", ";;\n;;\n"), {}),
    "German names": (table("Zeit [s];Position X [mm];Position Y [mm]", "{t};{mm};{mm2}"), {}),
    "titles before the header": (table("Run 12,,\nOperator: A. B.,,\nt,x,y", "{t},{x},{y}"), {}),
    "figures before the header": (table("FREQUENCY\t100\nMARKERS\t1\nt\tx\ty", "{t}\t{x}\t{y}"), {}),
    "motion capture": (
        table("Trajectories\n100\n,,puck,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm", "{k},0,{mm},{mm2},1"),
        {"rate": 100},
    ),
    "rotation and position alike": (table("Frame,Time,X,Y,X,Y,", "{k},{t},9,9,{x},{y},0.1"), {"columns": "2,5,6"}),
    "comments of a recorder": (table("# t x y\n# recorded on Monday", "{t} {x} {y}"), {}),
    "two objects of ROS": (
        table("%time,field.a.x,field.a.y,field.b.x,field.b.y", "{t},0,0,{x},{y}"),
        {"columns": "%time,field.b.x,field.b.y"},
    ),
    "dates without a name": (table(",x,y", "2026-01-01 10:00:0{t:.3f},{x},{y}"), {}),
    "durations of pandas": (table(",x,y", "0 days 00:00:0{t:.3f},{x},{y}"), {}),
    "seconds and the rest, without a header": (
        "".join(f"17,{round(1e9 * t)},map,{x},{y},0\n" for t, (x, y) in zip(T, POSITION, strict=True)),
        {"columns": "sec,nanosec,frame,x,y"},
    ),
    "columns by number, without a header": (
        "".join(f"1 0 {x} 0 1 {y} {t}\n" for t, (x, y) in zip(T, POSITION, strict=True)),
        {"columns": "7,3,6"},
    ),
}

ASKED = {
    "time of another name": (
        table("Durata,x,y", "{t},{x},{y}"),
        "is 'Durata' the time? Say so by --columns Durata,x,y",
    ),
    "time without a name": (table(",x,y", "{t},{x},{y}"), "is column 1 the time? Say so by --columns 1,x,y"),
    "frames": (table("frame,x,y", "{k},{x},{y}"), "there are no times, and 'frame' counts: give its rate"),
    "t counts": (table("t,x,y", "{k},{x},{y}"), "does t count samples? Give their rate, as in --rate 100"),
    "derivatives": (table("t,x_dot,y_dot", "{t},{x},{y}"), "missing column 'x' among 't', 'x_dot', 'y_dot'"),
    "one name for two": (
        table("t,x,y,x,y", "{t},{x},{y},0,0"),
        "may be columns 2, 3 or columns 4, 5: .* --columns 1,2,3",
    ),
    "two clocks": (
        table("t,t,x,y", "{t},{t},{x},{y}"),
        "t may be column 1 or column 2: say which is meant by --columns",
    ),
    "two objects of ROS": (
        table("%time,field.a.x,field.a.y,field.b.x,field.b.y", "{t},0,0,{x},{y}"),
        "x and y may be field.a.x, field.a.y or field.b.x, field.b.y",
    ),
}


@pytest.mark.parametrize("name", READ)
def test_a_table_is_found_among_what_programs_write_around_it(tmp_path: Path, name: str) -> None:
    content, options = READ[name]
    (tmp_path / "a.csv").write_text(content)
    command = Command.load(tmp_path / "a.csv", Reading(**options))
    assert command.position == pytest.approx(RECORDED.position, abs=2e-6)


@pytest.mark.parametrize("name", ASKED)
def test_what_a_column_holds_is_asked_where_its_name_does_not_say_it(tmp_path: Path, name: str) -> None:
    content, question = ASKED[name]
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(FormatError) as caught:
        Command.load(tmp_path / "a.csv")
    for part in question.split(" .* "):
        assert part in str(caught.value)


def test_feet_are_known_by_name(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x_ft,y_ft\n0,0,0\n1,0.1,0\n")
    assert Command.load(tmp_path / "a.csv").position[-1, 0] == pytest.approx(0.03048)
