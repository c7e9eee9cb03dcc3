"""Plans as a LeRobotDataset v3: an episode for each plan, a frame for each sample, in float32.

https://huggingface.co/docs/lerobot/lerobot-dataset-v3
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from runtime.documents.checks import FloatArray
from runtime.errors import OutputError
from runtime.many.folder import plan_files
from runtime.physics.law import DT

VERSION = "v3.0"

TASK = "Slide the object along the command."

FILES_IN_CHUNK = 1000

FILE_MEGABYTES = 100
"""Size of a file that LeRobot aims at where it goes on with a dataset."""

FEATURES = {
    "observation.state": ("pan_position", "pan_velocity", "object_position", "object_velocity"),
    "observation.command": ("command_position",),
    "action": ("pan_acceleration",),
}
"""The arrays of a plan that stand beside each other in each feature."""

INDICES = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
"""What each frame has besides."""

AXES = "xyz"

DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"


@dataclass(frozen=True)
class Sums:
    """What is to be known of vectors (n, d) to say their least, largest, mean and standard deviation."""

    count: int
    least: FloatArray
    largest: FloatArray
    sums: FloatArray
    squares: FloatArray

    @classmethod
    def of(cls, values: FloatArray) -> Self:
        """Sum up vectors (n, d)."""
        squares = (values * values).sum(axis=0)
        return cls(len(values), values.min(axis=0), values.max(axis=0), values.sum(axis=0), squares)

    def __add__(self, other: Sums) -> Sums:
        return Sums(
            self.count + other.count,
            np.minimum(self.least, other.least),
            np.maximum(self.largest, other.largest),
            self.sums + other.sums,
            self.squares + other.squares,
        )

    def to_dict(self) -> dict[str, list[float]]:
        """Return the figures by LeRobot's names."""
        mean = self.sums / self.count
        spread = np.sqrt(np.maximum(self.squares / self.count - mean * mean, 0.0))
        found = {"min": self.least, "max": self.largest, "mean": mean, "std": spread}
        return {name: values.tolist() for name, values in found.items()} | {"count": [self.count]}


def check_new(folder: Path) -> None:
    """Check that a dataset can be written.

    Raises:
        OutputError: there is something already, or no folder to make it in.
    """
    if folder.exists():
        raise OutputError(f"{folder}: is there already: give another folder, or remove it")
    if not folder.resolve().parent.is_dir():
        raise OutputError(f"{folder}: cannot be made: there is no folder {folder.resolve().parent}")


def write_dataset(plans: Path, folder: Path) -> int:
    """Write plans, with their states, as a dataset; the folder appears whole or not at all.

    Args:
        plans: the folder of their shards.
        folder: of the dataset.

    Returns:
        The number of episodes.

    Raises:
        OutputError: it cannot be written, or is there already.
    """
    check_new(folder)
    temporary = folder.resolve().with_name(f".{folder.resolve().name}.tmp")
    try:
        shutil.rmtree(temporary, ignore_errors=True)
        (temporary / EPISODES).parent.mkdir(parents=True)
        count = _write(plans, temporary)
        temporary.rename(folder)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return count


def _write(plans: Path, folder: Path) -> int:
    from pyarrow import parquet

    totals: dict[str, Sums] = {}
    names: dict[str, list[str]] = {}
    episode = frame = 0
    with _writer(folder / EPISODES) as write_episodes:
        for number, file in enumerate(plan_files(plans)):
            at = {"chunk_index": number // FILES_IN_CHUNK, "file_index": number % FILES_IN_CHUNK}
            target = folder / DATA.format(**at)
            target.parent.mkdir(parents=True, exist_ok=True)
            with _writer(target) as write_frames, parquet.ParquetFile(file) as opened:
                for group in range(opened.num_row_groups):
                    table = opened.read_row_group(group)
                    if not len(table):
                        continue
                    lengths = table["samples"].to_numpy().astype(np.int64)
                    names, values = _features(table)
                    write_frames(_frames(values, lengths, episode, frame))
                    write_episodes(_episodes(table, values, totals, at, episode, frame))
                    episode, frame = episode + len(lengths), frame + int(lengths.sum())
    if not episode:
        raise OutputError("there is no plan to make a dataset of")
    _write_tasks(folder / "meta" / "tasks.parquet")
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(each)], "names": each} for name, each in names.items()
    }
    features |= {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in INDICES.items()}
    info = {
        "codebase_version": VERSION,
        "robot_type": "pan",
        "total_episodes": episode,
        "total_frames": frame,
        "total_tasks": 1,
        "chunks_size": FILES_IN_CHUNK,
        "data_files_size_in_mb": FILE_MEGABYTES,
        "video_files_size_in_mb": FILE_MEGABYTES,
        "fps": round(1.0 / DT),
        "splits": {"train": f"0:{episode}"},
        "data_path": DATA,
        "video_path": None,
        "features": features,
    }
    _write_json(folder / "meta" / "info.json", info)
    _write_json(folder / "meta" / "stats.json", {name: each.to_dict() for name, each in totals.items()})
    return episode


def _features(table: Any) -> tuple[dict[str, list[str]], dict[str, FloatArray]]:
    """Return the features' names and values (n, d) of all frames of some plans."""
    names: dict[str, list[str]] = {}
    values: dict[str, FloatArray] = {}
    for feature, arrays in FEATURES.items():
        parts = {name: _stacked(table, name) for name in arrays}
        names[feature] = [f"{name}_{axis}" for name, each in parts.items() for axis in AXES[: each.shape[1]]]
        values[feature] = np.concatenate(list(parts.values()), axis=1)
    return names, values


def _stacked(table: Any, name: str) -> FloatArray:
    """Return the vectors of all rows of a column of lists of vectors, one after the other."""
    vectors = table[name].combine_chunks().flatten()
    values: FloatArray = vectors.flatten().to_numpy()
    return values.reshape(-1, vectors.type.list_size)


def _frames(values: dict[str, FloatArray], lengths: NDArray[np.int64], episode: int, frame: int) -> Any:
    """Return the table of the frames of some plans, of which `episode` and `frame` are the first."""
    import pyarrow

    ends = np.cumsum(lengths)
    within = np.arange(ends[-1]) - np.repeat(ends - lengths, lengths)
    return pyarrow.table(
        {
            **{
                name: pyarrow.FixedSizeListArray.from_arrays(each.astype(np.float32).ravel(), each.shape[1])
                for name, each in values.items()
            },
            "timestamp": (within * DT).astype(np.float32),
            "frame_index": within,
            "episode_index": np.repeat(episode + np.arange(len(lengths)), lengths),
            "index": frame + np.arange(ends[-1]),
            "task_index": np.zeros_like(within),
        }
    )


def _episodes(
    table: Any,
    values: dict[str, FloatArray],
    totals: dict[str, Sums],
    at: dict[str, int],
    episode: int,
    frame: int,
) -> Any:
    """Return the table of the same plans as episodes, and add theirs to the totals.

    Args:
        table: of the plans.
        values: of their frames.
        totals: of each feature.
        at: the file of their frames.
        episode, frame: the first of theirs.
    """
    import pyarrow

    rows, begin = list[dict[str, Any]](), 0
    for place, length in zip(table["place"].to_pylist(), table["samples"].to_pylist(), strict=True):
        own = {name: Sums.of(each[begin : begin + length]) for name, each in values.items()}
        totals.update({name: totals[name] + each if name in totals else each for name, each in own.items()})
        rows.append(
            {
                "episode_index": episode + len(rows),
                "tasks": [TASK],
                "length": length,
                "place": place,
                **{f"data/{name}": number for name, number in at.items()},
                "dataset_from_index": frame + begin,
                "dataset_to_index": frame + begin + length,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                **{
                    f"stats/{name}/{what}": found
                    for name, each in own.items()
                    for what, found in each.to_dict().items()
                },
            }
        )
        begin += length
    return pyarrow.Table.from_pylist(rows)


def _write_tasks(path: Path) -> None:
    """Write the one task, so that pandas takes its text for the index."""
    import pyarrow
    from pyarrow import parquet

    texts = {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object", "metadata": None}
    numbers = {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"}
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [numbers | {"metadata": None}, texts],
        "pandas_version": "2.2.0",
    }
    table = pyarrow.table({"task_index": [0], "task": [TASK]})
    parquet.write_table(table.replace_schema_metadata({"pandas": json.dumps(pandas)}), path)


def _write_json(path: Path, document: Any) -> None:
    path.write_text(json.dumps(document, indent=4) + "\n", encoding="utf-8")


@contextmanager
def _writer(path: Path) -> Iterator[Any]:
    from pyarrow import parquet

    writer: Any = None

    def write(table: Any) -> None:
        nonlocal writer
        writer = writer or parquet.ParquetWriter(path, table.schema, compression="zstd")
        writer.write_table(table)

    try:
        yield write
    finally:
        if writer is not None:
            writer.close()
