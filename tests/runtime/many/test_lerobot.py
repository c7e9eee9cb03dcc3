"""Plans as a LeRobotDataset: what LeRobot's loader looks for."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import OutputError
from runtime.cli.plan_many import plan_many_main
from runtime.many.lerobot import check_new

pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")


@pytest.fixture(scope="module")
def made(bundle_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `plans` and `dataset`, of commands of several lengths, one of which is none."""
    folder = tmp_path_factory.mktemp("lerobot")
    lines = []
    for n in range(9):
        t = np.linspace(0.0, 2.0, 210 + 30 * n)
        position = 0.02 * np.stack([1.0 - np.cos(t), 0.1 * n * np.sin(t)], axis=1)
        lines.append(json.dumps({"dt": 0.001, "position": position.tolist()}))
    lines[4] = "{}"
    (folder / "a.ndjson").write_text("\n".join(lines))
    arguments = [folder / "a.ndjson", "-o", folder / "plans", "--lerobot", folder / "dataset", "--model", bundle_path]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["slide-plan-many", *map(str, arguments), "--shard", "4"])
        with pytest.raises(SystemExit):
            plan_many_main()
    return folder


def rows(folder: Path) -> list[dict[str, Any]]:
    return [row for file in sorted(folder.rglob("*.parquet")) for row in parquet.read_table(file).to_pylist()]


def test_every_plan_is_an_episode_and_every_sample_a_frame(made: Path) -> None:
    plans, dataset = rows(made / "plans"), made / "dataset"
    plans = [row for row in plans if "pan_acceleration" in row]
    info = json.loads((dataset / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_episodes"]) == ("v3.0", 1000, 8)
    frames, episodes = rows(dataset / "data"), rows(dataset / "meta" / "episodes")
    assert info["total_frames"] == len(frames) == sum(row["samples"] for row in plans)
    assert [frame["index"] for frame in frames] == list(range(len(frames)))
    assert [episode["place"] for episode in episodes] == [row["place"] for row in plans]
    for number, (episode, plan) in enumerate(zip(episodes, plans, strict=True)):
        own = frames[episode["dataset_from_index"] : episode["dataset_to_index"]]
        assert {frame["episode_index"] for frame in own} == {episode["episode_index"]} == {number}
        assert [frame["frame_index"] for frame in own] == list(range(episode["length"]))
        np.testing.assert_allclose([frame["action"] for frame in own], plan["pan_acceleration"], rtol=1e-6)
        state = np.concatenate(
            [plan[name] for name in ("pan_position", "pan_velocity", "object_position", "object_velocity")], axis=1
        )
        np.testing.assert_allclose([frame["observation.state"] for frame in own], state, rtol=1e-6, atol=1e-9)
        assert own[7]["timestamp"] == pytest.approx(0.007)
        file = dataset / info["data_path"].format(
            chunk_index=episode["data/chunk_index"], file_index=episode["data/file_index"]
        )
        assert number in parquet.read_table(file)["episode_index"].to_pylist()


def test_features_and_statistics_are_those_of_the_frames(made: Path) -> None:
    info, stats = (json.loads((made / "dataset" / "meta" / f"{name}.json").read_text()) for name in ("info", "stats"))
    frames = rows(made / "dataset" / "data")
    assert set(info["features"]) == set(frames[0])
    for name, found in stats.items():
        values = np.array([frame[name] for frame in frames])
        assert info["features"][name]["shape"] == [values.shape[1]] == [len(info["features"][name]["names"])]
        for what in ("min", "max", "mean", "std"):
            np.testing.assert_allclose(found[what], getattr(values, what)(axis=0), rtol=1e-5, atol=1e-6)
        assert found["count"] == [len(frames)]


def test_task_is_the_index_of_its_table(made: Path) -> None:
    pandas = pytest.importorskip("pandas")
    tasks = pandas.read_parquet(made / "dataset" / "meta" / "tasks.parquet")
    assert tasks.to_dict() == {"task_index": {"Slide the object along the command.": 0}}


def test_what_is_there_is_not_written_over(made: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="is there already"):
        check_new(made / "dataset")
    with pytest.raises(OutputError, match="there is no folder"):
        check_new(tmp_path / "no" / "dataset")


def test_lerobots_own_loader_reads_it(made: Path) -> None:
    loader = pytest.importorskip("lerobot.datasets.lerobot_dataset")
    ahead = {"action": [0.0, 0.001], "observation.state": [-0.001, 0.0]}
    dataset = loader.LeRobotDataset("local/plans", root=made / "dataset", delta_timestamps=ahead)
    frames = rows(made / "dataset" / "data")
    assert (dataset.num_episodes, len(dataset), dataset.fps) == (8, len(frames), 1000)
    np.testing.assert_array_equal(dataset[300]["action"], [frames[300]["action"], frames[301]["action"]])
    assert dataset[300]["task"] == "Slide the object along the command."
