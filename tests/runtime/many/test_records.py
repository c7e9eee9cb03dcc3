"""Many commands as they are found: what an input is, whether it fits, and how it is cut."""

from __future__ import annotations

import gzip
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import Friction, InputError, Limits, Reading
from runtime.many.records import Source, open_source, read, reason

pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

LINE = [[0.001 * n, 0.0] for n in range(50)]


def write_rows(path: Path, **columns: Any) -> Path:
    parquet.write_table(pyarrow.table(columns), path)
    return path


def write_lines(path: Path, *documents: Any) -> Path:
    path.write_text("".join(f"{each if isinstance(each, str) else json.dumps(each)}\n" for each in documents))
    return path


def places(source: Source) -> list[str]:
    return [record.place for record in source.records()]


def test_folder_of_files_is_taken_by_name_and_hidden_files_are_not(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    for name in ("b/2.csv", "b/10.csv", "a.csv", ".hidden.csv"):
        (tmp_path / name).write_text("t,x,y\n0,0,0\n0.1,0.01,0\n")
    source = open_source(tmp_path)
    assert (source.kind, source.count) == ("command files", 3)
    assert places(source) == ["a.csv", "b/10.csv", "b/2.csv"]


def test_folder_of_parquet_files_is_one_data_set(tmp_path: Path) -> None:
    for name, count in (("1.parquet", 2), ("0.parquet", 1)):
        write_rows(tmp_path / name, position=[LINE] * count, camera=["front"] * count)
    source = open_source(tmp_path)
    assert (source.count, source.passed) == (3, ("camera",))
    assert places(source) == ["0.parquet, row 0", "1.parquet, row 0", "1.parquet, row 1"]


def test_parquet_file_with_a_row_for_each_sample_is_one_command(tmp_path: Path) -> None:
    write_rows(tmp_path / "a.parquet", t=[0.0, 0.1], x=[0.0, 0.01], y=[0.0, 0.0])
    source = open_source(tmp_path)
    assert source.kind == "command files"
    assert len(read(next(source.records()), Reading()).command) == 101


@pytest.mark.parametrize("fixed", [False, True])
def test_rows_bring_times_friction_and_limits(tmp_path: Path, fixed: bool) -> None:
    limits = Limits().to_dict()
    kind = pyarrow.list_(pyarrow.list_(pyarrow.float32(), 2) if fixed else pyarrow.list_(pyarrow.float64()))
    path = write_rows(
        tmp_path / "a.parquet",
        position=pyarrow.array([[[0.0, 0.0], [0.05, 0.025]], LINE], kind),
        t=[[0.0, 1.0], None],
        friction=[{"static": 0.5, "kinetic": 0.25}, None],
        limits=pyarrow.array([None, list(limits.values())], pyarrow.list_(pyarrow.float64())),
    )
    first, second = (read(record, Reading()) for record in open_source(path).records())
    assert (len(first.command), first.friction, first.limits) == (1001, Friction(0.5, 0.25), None)
    assert (len(second.command), second.friction, second.limits) == (50, None, Limits())
    np.testing.assert_allclose(second.command.position, LINE, atol=1e-8)


def test_lines_bring_friction_and_options_of_reading(tmp_path: Path) -> None:
    path = write_lines(
        tmp_path / "a.ndjson",
        {"dt": 0.001, "position": LINE, "friction": {"static": 0.5, "kinetic": 0.25}},
        "",
        {"t": [0, 1], "position": [[0, 0], [50, 0]], "scale": 0.001},
    )
    source = open_source(path)
    assert (source.count, places(source)) == (2, ["a.ndjson, line 1", "a.ndjson, line 3"])
    first, second = (read(record, Reading()) for record in source.records())
    assert first.friction == Friction(0.5, 0.25)
    assert second.command.reach == pytest.approx(0.05)


def test_lines_may_be_packed_have_a_mark_carriage_returns_and_labels(tmp_path: Path) -> None:
    line = {"dt": 0.001, "position": LINE}
    text = "\r\n".join(json.dumps(each) for each in (line, line | {"id": 7, "name": "a"}))
    data = text.encode("utf-8-sig")
    for name, content in (("plain.jsonl", data), ("packed.ndjson.gz", gzip.compress(data))):
        (tmp_path / name).write_bytes(content)
        source = open_source(tmp_path / name)
        assert [len(read(record, Reading()).command) for record in source.records()] == [50, 50]
    (tmp_path / "torn.ndjson.gz").write_bytes(gzip.compress(data)[:-20])
    with pytest.raises(InputError, match="cannot be read: Compressed file ended"):
        open_source(tmp_path / "torn.ndjson.gz")


def test_columns_as_other_programs_write_them(tmp_path: Path) -> None:
    large = pyarrow.large_list(pyarrow.large_list(pyarrow.float32()))
    nothing = {"pan_reach": 0.1, "height": None, "speed": None, "acceleration": 20.0, "jerk": 8000.0}
    for name, column, limits in (
        ("categories", pyarrow.array(["panda", None]).dictionary_encode(), [Limits.named("panda"), None]),
        ("texts", pyarrow.array(["fr3", "fr3"], pyarrow.large_string()), [Limits.named("fr3")] * 2),
        (
            "structs",
            pyarrow.array([nothing, dict.fromkeys(nothing)]),
            [Limits(0.1, acceleration=20.0, jerk=8000.0), None],
        ),
    ):
        path = tmp_path / f"{name}.parquet"
        write_rows(path, position=pyarrow.array([LINE, LINE], large), limits=column, id=[1, 1])
        source = open_source(path)
        assert source.passed == ("id",)
        assert [read(record, Reading()).limits for record in source.records()] == limits


def test_names_of_files_that_are_no_text_and_broken_links_are_places(tmp_path: Path) -> None:
    csv = "t,x,y\n0,0,0\n0.1,0.01,0\n"
    for name in (b"a\xff.csv", b"b\n.csv"):
        with open(os.fsencode(tmp_path) + b"/" + name, "w") as file:
            file.write(csv)
    (tmp_path / "c.csv").symlink_to("gone.csv")
    os.mkfifo(tmp_path / "d.csv")
    (tmp_path / "e").symlink_to(tmp_path)
    source = open_source(tmp_path)
    assert places(source) == ["a\\udcff.csv", "b\\n.csv", "c.csv"]
    assert source.fingerprint() == open_source(tmp_path).fingerprint()
    first, second, broken = source.records()
    assert len(read(first, Reading()).command) == len(read(second, Reading()).command) == 101
    with pytest.raises(InputError, match="No such file"):
        read(broken, Reading())


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads what nobody may read")
def test_folder_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x,y\n0,0,0\n0.1,0.01,0\n")
    (tmp_path / "shut").mkdir(mode=0)
    with pytest.raises(InputError, match="shut: cannot be read"):
        open_source(tmp_path)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"way": [LINE]}, "there is no column 'position'"),
        ({"position": [[1.0, 2.0]]}, "column 'position' must be a list of pairs"),
        ({"position": ["[[0, 0]]"]}, "column 'position' must be a list of pairs"),
        ({"position": [LINE], "t": [0.5]}, "column 't' must be a list of times"),
        ({"position": [LINE], "friction": [0.5]}, "column 'friction' must be a struct of static, kinetic"),
        ({"position": [LINE], "limits": [{"reach": 0.1}]}, "column 'limits' must be a struct of pan_reach"),
    ],
)
def test_schema_that_does_not_fit_is_refused_with_its_column(tmp_path: Path, columns: Any, said: str) -> None:
    write_rows(tmp_path / "0.parquet", position=[LINE])
    path = write_rows(tmp_path / "1.parquet", **columns)
    with pytest.raises(InputError) as refused:
        open_source(tmp_path)
    assert str(refused.value).startswith(f"{path}: {said}")


def test_column_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    line = pyarrow.array([LINE])
    parquet.write_table(pyarrow.table([line, line], names=["position", "position"]), tmp_path / "a.parquet")
    with pytest.raises(InputError, match="there are 2 columns 'position'"):
        open_source(tmp_path / "a.parquet")


def test_limits_may_be_told_by_their_name(tmp_path: Path) -> None:
    rows = write_rows(tmp_path / "a.parquet", position=[LINE, LINE], limits=["panda", None])
    lines = write_lines(tmp_path / "b.ndjson", {"dt": 0.001, "position": LINE, "limits": "panda"})
    found = [read(record, Reading()).limits for path in (rows, lines) for record in open_source(path).records()]
    assert found == [Limits.named("panda"), None, Limits.named("panda")]
    wrong = next(open_source(write_rows(tmp_path / "c.parquet", position=[LINE], limits=["robot"])).records())
    with pytest.raises(InputError, match="there are no limits named 'robot'"):
        read(wrong, Reading())


def test_what_is_no_input_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "mixed").mkdir()
    write_rows(tmp_path / "mixed" / "a.parquet", position=[LINE])
    (tmp_path / "mixed" / "b.csv").write_text("t,x,y\n0,0,0\n")
    (tmp_path / "torn.parquet").write_bytes(b"PAR1")
    write_lines(tmp_path / "list.ndjson", [1, 2])
    (tmp_path / "wide.ndjson").write_text('{"t": [0, 1]}', encoding="utf-16")
    (tmp_path / "indented.ndjson").write_text(json.dumps({"t": [0, 1]}, indent=1))
    write_lines(tmp_path / "none.ndjson")
    (tmp_path / "one.csv").write_text("t,x,y\n0,0,0\n")
    write_rows(
        tmp_path / "rowless.parquet", position=pyarrow.array([], pyarrow.list_(pyarrow.list_(pyarrow.float64())))
    )
    for name, said in {
        "empty": "there are no files",
        "mixed": "is no Parquet file",
        "torn.parquet": "not a readable Parquet file",
        "list.ndjson": "a line must be a JSON object",
        "wide.ndjson": "is not UTF-8 text; a line must be a JSON object",
        "indented.ndjson": "the first line is truncated or not JSON",
        "none.ndjson": "there are no lines",
        "one.csv": "a single command is planned by slide-plan",
        "rowless.parquet": "there are no rows",
        "absent": "there is no such file",
    }.items():
        with pytest.raises(InputError, match=said):
            open_source(tmp_path / name)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ({"position": None}, "missing key 'position'"),
        ({"position": [[0.0, 0.0], [0.1]]}, "position[1] must be a pair of numbers [x, y], got [0.1]"),
        ({"position": [[0.0, None], [0.1, 0.0]]}, "position[0], column y must be a number, got None"),
        ({"position": [[0.0, float("nan")], [0.1, 0.0]]}, "position[0], column y: nan is not a finite number"),
        ({"position": [[0.0, 0.0], [0.1, 0.0]], "t": [0.0]}, "t has 1 rows, position has 2"),
        ({"position": LINE, "friction": {"static": 0.2, "kinetic": 0.5}}, "kinetic friction 0.5 must not exceed"),
    ],
)
def test_row_that_is_no_command_says_why_and_not_where(tmp_path: Path, row: dict[str, Any], said: str) -> None:
    rows = pyarrow.list_(pyarrow.list_(pyarrow.float64()))
    columns = {name: pyarrow.array([value], rows) if name == "position" else [value] for name, value in row.items()}
    record = next(open_source(write_rows(tmp_path / "a.parquet", **columns)).records())
    with pytest.raises(InputError) as refused:
        read(record, Reading())
    assert said in reason(record, refused.value)
    assert "a.parquet" not in reason(record, refused.value)


def test_shards_are_cut_by_number_and_by_size(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "a.ndjson", *[{"dt": 0.001, "position": LINE}] * 7)
    assert [len(shard.records) for shard in open_source(path).shards(3)] == [3, 3, 1]
    for n in range(3):
        with (tmp_path / f"{n}.csv").open("wb") as file:
            file.truncate(1 << 26)
    path.unlink()
    assert [len(shard.records) for shard in open_source(tmp_path).shards()] == [1, 1, 1]


def test_what_was_read_of_a_file_is_not_kept(tmp_path: Path) -> None:
    """Random numbers, which do not get smaller, in row groups of a few megabytes each."""
    path = tmp_path / "many.parquet"
    rng = np.random.default_rng(0)
    table = pyarrow.table({"position": [list(rng.random((1200, 2))) for _ in range(64)]})
    with parquet.ParquetWriter(path, table.schema) as writer:
        for _ in range(16):
            writer.write_table(table)
    before = pyarrow.total_allocated_bytes()
    held = max(pyarrow.total_allocated_bytes() - before for _ in open_source(path).records())
    assert held < 0.5 * path.stat().st_size
