from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from runtime import Command, FormatError, InputError, Reading
from runtime.command import command_velocity
from runtime.commands.bounds import MAX_JUMP

EXAMPLE = Path(__file__).parents[2] / "examples" / "figure_eight.csv"

positions = npst.arrays(
    np.float64, st.tuples(st.integers(2, 40), st.just(2)), elements=st.floats(-MAX_JUMP / 3, MAX_JUMP / 3)
)


def test_velocity_is_gradient_over_leading_axes() -> None:
    position = np.random.default_rng(0).normal(size=(3, 4, 50, 2))
    velocity = command_velocity(position, 0.001)
    assert velocity.shape == position.shape
    np.testing.assert_array_equal(velocity[2, 1], np.gradient(position[2, 1], 0.001, axis=0))
    np.testing.assert_array_equal(
        Command(position[0, 0] * 1e-3).velocity, np.gradient(position[0, 0] * 1e-3, 1e-3, axis=0)
    )


def test_command_keeps_its_own_copy() -> None:
    given_position = np.zeros((5, 2))
    command = Command(given_position)
    given_position[0] = 1.0
    assert not command.position.any()
    with pytest.raises(ValueError, match="read-only"):
        command.position[0, 0] = 1.0


def test_reach_and_speed() -> None:
    command = Command(np.linspace([0.5, 0.5], [0.53, 0.54], 101))
    assert command.reach == pytest.approx(0.05)
    assert command.speed == pytest.approx(0.5)


def test_samples_at_1_khz_are_taken_as_they_are() -> None:
    position = np.random.default_rng(0).uniform(-0.01, 0.01, (300, 2))
    t = 17.0 + np.round(np.arange(300) * 0.001, 3)
    np.testing.assert_array_equal(Command.from_samples(position).position, position)
    np.testing.assert_array_equal(Command.from_waypoints(t, position).position, position)


def test_duration_that_floats_cannot_hit_keeps_its_last_sample() -> None:
    for samples in range(3, 1500, 7):
        t = np.linspace(0.0, (samples - 1) * 0.001, 3)
        assert len(Command.from_waypoints(t, np.zeros((3, 2)))) == samples


def test_example_is_a_figure_eight_from_rest_to_rest() -> None:
    command = Command.load(EXAMPLE)
    assert len(command) == 1200
    assert 0.04 < command.reach < 0.06
    assert command.speed < 0.7
    assert np.abs(command.velocity[[0, -1]]).max() < 1e-3
    np.testing.assert_allclose(command.position[-1], command.position[0], atol=1e-6)
    crossings = np.count_nonzero(np.diff(np.sign(command.position[200:1000, 1])))
    assert crossings == 3  # up, down, up, down


@settings(deadline=None)
@given(positions)
def test_every_format_gives_the_same_command(tmp_path_factory: pytest.TempPathFactory, position: Any) -> None:
    folder = tmp_path_factory.mktemp("formats")
    t = np.arange(len(position)) * 0.001
    rows = "".join(f"{x!r},{y!r}\n" for x, y in position.tolist())
    (folder / "a.csv").write_text("x,y\n" + rows)
    rows = "".join(f"{y!r},{t!r},{x!r}\r\n" for t, (x, y) in zip(t.tolist(), position.tolist(), strict=True))
    (folder / "b.csv").write_bytes(b"\xef\xbb\xbf" + f" y, t, x\r\n{rows}\r\n".encode())
    (folder / "c.json").write_text(json.dumps({"dt": 0.001, "position": position.tolist()}))
    (folder / "d.json").write_text(json.dumps({"t": t.tolist(), "position": position.tolist()}))
    np.savez(folder / "e.npz", dt=0.001, position=position)
    np.savez_compressed(folder / "f.NPZ.npz", t=t, position=position)
    for path in sorted(folder.iterdir()):
        reading = Reading(rate=1000) if path.name == "a.csv" else Reading()
        np.testing.assert_array_equal(Command.load(path, reading).position, position, err_msg=path.name)


@settings(deadline=None)
@given(st.binary(max_size=200), st.sampled_from([b"", b"PK\3\4", b"\x93NUMPY", b"{", b"[", b"<svg", b"\xff\xfe"]))
def test_any_bytes_are_a_command_or_a_format_error(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, begin: bytes
) -> None:
    path = tmp_path_factory.mktemp("any") / "command"
    path.write_bytes(begin + data)
    try:
        assert len(Command.load(path)) >= 2
    except FormatError as error:
        assert str(error).startswith(str(path))  # noqa: PT017 - most bytes raise, a few might be a command


@given(st.text("0123456789.,-txy\n e_", max_size=60))
def test_any_csv_like_text_is_a_command_or_a_format_error(
    tmp_path_factory: pytest.TempPathFactory, content: str
) -> None:
    path = tmp_path_factory.mktemp("any") / "command.csv"
    path.write_text("x,y\n" + content)
    try:
        assert np.isfinite(Command.load(path).position).all()
    except FormatError as error:
        assert str(error).startswith(str(path))  # noqa: PT017


NAMES = ("t", "dt", "position", "x", "y", "drawing", "strokes", "columns", "data", "rate", "origin", "speed", "size")
scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from(["", "0", "t,x,y", "first"])
points = st.lists(st.lists(st.floats(-0.1, 0.1), min_size=1, max_size=4), max_size=5)
documents = st.recursive(
    scalars | points,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(NAMES), inner, max_size=5),
    max_leaves=12,
)


@settings(deadline=None)
@given(documents)
def test_any_document_is_a_command_or_a_format_error(document: Any) -> None:
    try:
        assert np.isfinite(Command.from_dict(document).position).all()
    except FormatError as error:
        assert str(error).startswith("command: ")  # noqa: PT017


def npz(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


STEADY = "0,0\n" * 3
ZEROS = np.zeros((4, 2))

BAD_FILES: list[tuple[str, str, bytes | str, str]] = [
    ("empty csv", "a.csv", "", "the file is empty"),
    ("empty json", "a.json", "", "the file is empty"),
    ("empty npz", "a.npz", "", "the file is empty"),
    ("missing column", "a.csv", "t,x\n0,0\n", "line 1: missing column 'y'"),
    ("no columns", "a.csv", "a,b\n0,0\n", "line 1: missing column 'x' among 'a', 'b': .* --columns T,X,Y"),
    ("no header", "a.csv", "0.0,0.1\n0.1,0.1\n", "there is no header: say what the 2 columns hold, .* --columns x,y"),
    (
        "column twice",
        "a.csv",
        "x,y,x\n0,0,0\n",
        "line 1: x and y may be columns 1, 2 or columns 3, 2: .* --columns 1,2,3",
    ),
    ("time twice", "a.csv", "t,x,y,t\n0,0,0,0\n", "line 1: t may be column 1 or column 4: .* --columns T,X,Y"),
    ("header only", "a.csv", "x,y\n", "0 samples, at least 2"),
    ("one sample", "a.csv", "x,y\n0,0\n", "1 sample, at least 2"),
    ("csv nan", "a.csv", f"x,y\n{STEADY}0,nan\n", "line 5, column y: nan is not a finite number"),
    ("csv inf", "a.csv", "t,x,y\n0,0,0\n0.001,-inf,0\n", "line 3, column x: -inf is not a finite number"),
    ("csv overflow", "a.csv", "x,y\n0,0\n0,1e999\n", "line 3, column y: inf is not a finite number"),
    ("csv after blank lines", "a.csv", "x,y\n0,0\n\n\n0,?\n", "line 5, column y: '\\?' is not a number"),
    ("csv empty cell", "a.csv", "x,y\n0,\n", "line 2, column y: '' is not a number"),
    ("csv underscore", "a.csv", "x,y\n0,1_0\n", "line 2, column y"),
    ("csv ragged", "a.csv", "x,y\n0,0\n0,0,0\n", "line 3: has 3 cells, the header has 2"),
    ("csv nul", "a.csv", b"x,y\n0,0\0\n", "line 2"),
    ("csv not utf-8", "a.csv", b"x,y\n0,\xff\n", "not UTF-8"),
    (
        "jump",
        "a.csv",
        "t,x,y\n0,0,0\n# a gap\n0.001,0,0\n0.002,0.03,0.05\n",
        r"jumps by 0.05831 m from waypoint 1 \(line 4\) at 0.001 s to waypoint 2 \(line 5\) at 0.002 s: 58.31 m/s",
    ),
    (
        "millimetres",
        "a.csv",
        "x,y\n0,0\n0,101\n",
        r"goes 101 m from .* millimetres \(--scale 0.001\)",
    ),
    ("beyond", "a.csv", "t,x,y\n0,0,0\n1,0.1,101\n0,0,0\n", "goes 101 m"),
    (
        "time back",
        "a.csv",
        "t,x,y\n0,0,0\n0.002,0,0\n0.001,0,0\n",
        r"t must increase: t\[2\] = 0.001 s .* t\[1\] = 0.002 s",
    ),
    ("time stands", "a.csv", "t,x,y\n1,0,0\n1,0,0\n", "t must increase"),
    ("milliseconds", "a.csv", "t,x,y\n0,0,0\n700,0,0\n", "spans 700 s, at most 600 s .*seconds"),
    ("too short", "a.csv", "t,x,y\n0,0,0\n0.0005,0,0\n", "spans 0.0005 s, at least 0.001 s"),
    ("json truncated", "a.json", '{"dt": 0.001, "position": [[0, 0], [0', "truncated or not JSON"),
    ("json wrong", "a.json", '{"dt": 0.001; }', "not JSON: .*line 1, column 13"),
    ("json deep", "a.json", "[" * 100_000, "nested too deeply"),
    ("json number", "a.json", "[3]", r"position\[0\] must be a pair"),
    ("json table ragged", "a.json", "[[0, 0, 0], [0, 1]]", r"position\[1\] must have 3 numbers"),
    ("json table null", "a.json", "[[0, 0, 0], [0, 1, null]]", r"position\[1\]\[2\] must be a number, got None"),
    ("json split", "a.json", '{"columns": ["x", "y"], "data": [[0, 0], [1]]}', r"data\[1\] must have 2 values"),
    ("json records", "a.json", '[{"x": 0, "y": 0}, {"x": 1}]', "record 1 has the keys x, the first has x, y"),
    ("json bare strokes", "a.json", "[[[0, 0], [1, 1]]]", "a drawing has no times: --speed"),
    ("json lines cut", "a.json", '{"x": 0, "y": 0}\n{"x": 0,', "truncated or not JSON"),
    ("json no position", "a.json", '{"dt": 0.001}', "missing key 'position'"),
    ("json no dt", "a.json", '{"position": [[0, 0], [0, 0]]}', "exactly one of the keys 't', 'dt', 'rate' and 'speed'"),
    ("json both", "a.json", '{"t": [0, 1], "dt": 1, "position": [[0, 0], [0, 0]]}', "exactly one"),
    ("json unknown", "a.json", '{"dt": 1, "position": [], "unit": "m"}', "unknown key 'unit'"),
    ("json twice", "a.json", '{"dt": 1, "dt": 2, "position": []}', "key 'dt' is given twice"),
    ("json nan", "a.json", '{"dt": 0.001, "position": [[0, 0], [0, NaN]]}', "NaN is not a finite number"),
    ("json infinity", "a.json", '{"dt": Infinity, "position": []}', "Infinity is not a finite number"),
    (
        "json overflow",
        "a.json",
        '{"dt": 0.001, "position": [[0, 0], [0, 1e999]]}',
        r"position\[1\], column y: inf is not",
    ),
    ("json big", "a.json", '{"dt": 0.001, "position": [[0, 0], [1' + "0" * 400 + ", 0]]}", r"position\[1\], column x"),
    ("json bigger", "a.json", '{"dt": 1' + "0" * 5000 + "}", "not JSON"),
    ("json ragged", "a.json", '{"dt": 0.001, "position": [[0, 0], [0]]}', r"position\[1\] must be a pair"),
    ("json flat", "a.json", '{"dt": 0.001, "position": [0, 0]}', r"position\[0\] must be a pair"),
    ("json deeper", "a.json", '{"dt": 0.001, "position": [[[0], [0]]]}', r"position\[0\], column x must be a number"),
    (
        "json string",
        "a.json",
        '{"dt": 0.001, "position": [[0, "0"]]}',
        r"position\[0\], column y must be a number, got '0'",
    ),
    (
        "json boolean",
        "a.json",
        '{"dt": 0.001, "position": [[true, 0]]}',
        r"position\[0\], column x must be a number, got True",
    ),
    ("json null", "a.json", '{"dt": 0.001, "position": [[0, null]]}', "must be a number, got None"),
    ("json text position", "a.json", '{"dt": 0.001, "position": "00"}', "position must be a list of pairs"),
    ("json dt text", "a.json", '{"dt": "1", "position": [[0, 0], [0, 0]]}', "dt must be a number, got '1'"),
    ("json dt zero", "a.json", '{"dt": 0, "position": [[0, 0], [0, 0]]}', "dt must be greater than 0 s, got 0 s"),
    ("json dt negative", "a.json", '{"dt": -0.001, "position": [[0, 0], [0, 0]]}', "dt must be greater than 0 s"),
    ("json dt milliseconds", "a.json", '{"dt": 1000, "position": [[0, 0], [0, 0]]}', "at most 600 s"),
    ("json t text", "a.json", '{"t": [0, "1"], "position": [[0, 0], [0, 0]]}', r"t\[1\] must be a number"),
    ("json t scalar", "a.json", '{"t": 1, "position": [[0, 0], [0, 0]]}', "t must be a list of numbers"),
    ("json t length", "a.json", '{"t": [0, 1, 2], "position": [[0, 0], [0, 0]]}', "t has 3 rows, position has 2"),
    ("npz truncated", "a.npz", npz(dt=0.001, position=ZEROS)[:200], "not a readable npz"),
    ("nothing", "a.npz", "{}", "missing key 'position'"),
    ("npz pickled", "a.npz", npz(dt=0.001, position=np.array([[0, None]] * 4, dtype=object)), "not a readable npz"),
    ("npz shape", "a.npz", npz(dt=0.001, position=np.zeros((4, 3))), r"shape \(K, 2\), got \(4, 3\)"),
    ("npz dimensions", "a.npz", npz(dt=0.001, position=np.zeros(4)), r"shape \(K, 2\), got \(4,\)"),
    ("npz boolean", "a.npz", npz(dt=0.001, position=np.zeros((4, 2), dtype=bool)), "array of bool"),
    ("npz complex", "a.npz", npz(dt=0.001, position=np.zeros((4, 2), dtype=complex)), "array of complex128"),
    ("npz nan", "a.npz", npz(dt=0.001, position=np.array([[0, 0], [np.nan, 0]])), r"position\[1\], column x: nan"),
    ("npz dt array", "a.npz", npz(dt=np.array([0.001]), position=ZEROS), "dt must be a number"),
    ("npz t nan", "a.npz", npz(t=np.array([0, 1, np.nan, 3]), position=ZEROS), r"t\[2\]: nan is not a finite"),
    ("npz t shape", "a.npz", npz(t=ZEROS, position=ZEROS), r"t must have the shape \(K,\)"),
    ("npz unknown", "a.npz", npz(dt=0.001, position=ZEROS, velocity=ZEROS), "unknown key 'velocity'"),
]


@pytest.mark.parametrize(
    ("name", "content", "message"), [row[1:] for row in BAD_FILES], ids=[row[0] for row in BAD_FILES]
)
def test_bad_file_is_one_clear_error(tmp_path: Path, name: str, content: bytes | str, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(FormatError, match=message) as caught:
        Command.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_unreadable_path_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    for path, message in [
        (tmp_path / "folder.csv", "cannot be read: Is a directory"),
        (tmp_path / "absent.csv", "cannot be read: No such file"),
        (tmp_path / "a\0b.csv", "cannot be read: embedded null"),
    ]:
        with pytest.raises(FormatError, match=message):
            Command.load(path)


def test_packed_npz_that_unpacks_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savez_compressed(tmp_path / "bomb.npz", dt=0.001, position=np.zeros((200_000, 2)))
    monkeypatch.setattr("runtime.documents.files.MAX_FILE_BYTES", 1 << 20)
    with pytest.raises(FormatError, match="unpack to more than 1 MiB"):
        Command.load(tmp_path / "bomb.npz")
    (tmp_path / "large.csv").write_bytes(b"x" * ((1 << 20) + 1))
    with pytest.raises(FormatError, match="larger than 1 MiB"):
        Command.load(tmp_path / "large.csv")


@pytest.mark.parametrize(
    ("position", "message"),
    [
        (np.zeros((5, 3)), r"shape \(K, 2\), got \(5, 3\)"),
        (np.zeros((1, 5, 2)), r"shape \(K, 2\)"),
        (np.zeros((5, 2), dtype=object), "array of object"),
        (np.full((5, 2), "1"), "array of <U1"),
        (np.zeros((1, 2)), "1 sample, at least 2"),
        (np.zeros((0, 2)), "0 samples, at least 2"),
        (np.zeros((600_002, 2)), "600002 samples at 1 kHz, at most 600001"),
        ([], "0 samples"),
        ([[0.0, 0.0], [0.0]], r"position\[1\] must be a pair"),
        ([[0.0, 0.0], [True, 0.0]], r"position\[1\], column x must be a number"),
        ([[0.0, 0.0], [0.0, float("nan")]], r"position\[1\], column y: nan"),
        ("circle", "must be a list of pairs"),
        (None, "must be a list of pairs"),
        (3.0, "must be a list of pairs"),
    ],
)
def test_bad_array_is_an_input_error(position: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Command(position)
    with pytest.raises(InputError, match=message):
        Command.from_samples(position)


def test_what_numbers_may_look_like_in_python() -> None:
    expected = np.array([[0.0, 0.0], [0.0, 0.0625]])[:, ::-1] / 2
    for position in (expected.astype(np.float32), expected.tolist(), list(expected), [tuple(p) for p in expected]):
        np.testing.assert_array_equal(Command(position).position, expected)
    np.testing.assert_array_equal(Command([[1, 2], [1, 2]]).position, [[1.0, 2.0], [1.0, 2.0]])


def test_a_command_is_told_in_one_line() -> None:
    command = Command.from_waypoints([0.0, 1.0], [[0.0, 0.0], [0.1, 0.0]])
    assert repr(command).startswith("<Command of 1 s (1001 samples) from (0.0000, 0.0000) m: reach 0.1 m, speed 0.1")
