"""What a command file is, by its content: its name says little, and standard input has none."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np

from runtime.commands import arrays
from runtime.commands.json_documents import from_document, parse_documents
from runtime.commands.parquet import parse_parquet
from runtime.commands.points import Points
from runtime.commands.reading import Reading
from runtime.commands.svg import parse_svg
from runtime.commands.text import parse_table, text_of
from runtime.documents.files import MAX_FILE_BYTES, parse_npz, read_bytes
from runtime.errors import InputError

STANDARD_INPUT = "-"
"""The path that stands for standard input."""


PACKED = "is packed: unpack it first"
EXPORT = "is not read: export it as CSV"
OTHERS = {
    b"\x1f\x8b": f"a gzip file {PACKED}, as in gunzip -c FILE | slide-plan -",
    b"BZh": f"a bzip2 file {PACKED}",
    b"\xfd7zXZ": f"an xz file {PACKED}",
    b"\x28\xb5\x2f\xfd": f"a zstd file {PACKED}",
    b"\xd0\xcf\x11\xe0": f"an Office document {EXPORT}",
    b"\x89HDF": f"an HDF5 or MATLAB file {EXPORT}",
    b"MATLAB 5.0": f"a MATLAB file {EXPORT}",
    b"#ROSBAG": f"a ROS bag {EXPORT}",
    b"\x89MCAP": f"an MCAP file {EXPORT}",
    b"SQLite format 3": f"an SQLite file {EXPORT}",
    b"ARROW1": f"a Feather file {EXPORT}, or as Parquet",
    b"\x80\x04": f"a pickle {EXPORT}, or by numpy.save",
    b"\x80\x05": f"a pickle {EXPORT}, or by numpy.save",
    b"\x89PNG": "a picture is not read: draw the path as SVG",
    b"\xff\xd8\xff": "a picture is not read: draw the path as SVG",
    b"%PDF": "a PDF is not read: save the drawing as SVG",
}
"""How files begin that are not read, and what to do with them."""


def read_source(path: Path) -> bytes:
    """Read a file whole, or standard input if the path is "-".

    Raises:
        InputError: see `read_bytes`.
    """
    if str(path) != STANDARD_INPUT:
        return read_bytes(path)
    data = sys.stdin.buffer.read(MAX_FILE_BYTES + 1)
    if not data:
        raise InputError("the input is empty")
    if len(data) > MAX_FILE_BYTES:
        raise InputError(f"the input is larger than {MAX_FILE_BYTES >> 20} MiB")
    return data


def parse(data: bytes, reading: Reading) -> tuple[Points, Reading]:
    """Read positions from a file's bytes, and the options it names.

    Raises:
        InputError: it is of no kind that is known, or not what it seems to be.
        MissingExtraError: it is Parquet, and pyarrow is not installed.
    """
    if data.startswith(b"\x93NUMPY"):
        return arrays.from_array(_parse_npy(data), reading), reading
    for begin, message in OTHERS.items():
        if data.startswith(begin):
            raise InputError(message)
    if data.startswith(b"PK\x03\x04"):
        if b"[Content_Types].xml" in data:
            raise InputError(f"an Office document {EXPORT}")
        content = {name: array.item() if array.ndim == 0 else array for name, array in parse_npz(data).items()}
        if list(content) == ["arr_0"]:  # numpy.savez of one array that has no name
            return arrays.from_array(content["arr_0"], reading), reading
        return from_document(content, reading)
    if data.startswith(b"PAR1"):
        return arrays.from_columns(parse_parquet(data), reading), reading
    text = text_of(data)
    first = text.lstrip()[:1]
    if first == "<":
        return parse_svg(text), reading
    if first in ("{", "["):
        return from_document(parse_documents(text), reading)
    return parse_table(text, reading), reading


def _parse_npy(data: bytes) -> np.ndarray:
    try:
        with io.BytesIO(data) as file:
            array: np.ndarray = np.lib.format.read_array(file, allow_pickle=False)
    except Exception as error:  # a broken header makes numpy raise nearly anything
        raise InputError(f"not a readable npy file: {error}") from error
    return array
