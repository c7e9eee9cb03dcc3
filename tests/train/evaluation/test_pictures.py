"""The pictures of the commands that training draws: every family has its panel, and something is in it."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from train.commands.families import FAMILIES
from train.config import load_config
from train.evaluation.pictures import PICTURE, SHOWN, draw_families

pytest.importorskip("matplotlib")


def pictures(*arguments, folder):
    """Run the command in `folder`."""
    command = [sys.executable, "-m", "train.evaluation.pictures", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)


def test_every_family_has_a_panel_of_different_commands_that_move():
    from matplotlib.figure import Figure

    config = load_config("default")
    figure = draw_families(Figure, config)
    panels = {axes.get_title().split(",")[0]: axes for axes in figure.axes if axes.get_title()}
    assert set(panels) == set(FAMILIES)
    for name, axes in panels.items():
        paths = [np.concatenate(lines.get_segments()) for lines in axes.collections]
        assert len(paths) == SHOWN, name
        assert min(np.ptp(path, axis=0).max() for path in paths) > 1.0, name  # mm
        assert len({path.tobytes() for path in paths}) == SHOWN, name
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        inside = [((path > [left, bottom]) & (path < [right, top])).all() for path in paths]
        assert all(inside), name


def test_shares_are_those_of_the_configuration():
    from matplotlib.figure import Figure

    config = load_config("default").model_copy(update={"families": {"loops": 3.0, "moves": 1.0}})
    titles = [axes.get_title() for axes in draw_families(Figure, config).axes]
    assert titles[:2] == ["loops, 75%", "moves, 25%"]


def test_command_writes_a_picture_that_is_not_blank(tmp_path):
    from matplotlib.image import imread

    done = pictures("new/folder", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == f"train.evaluation.pictures: wrote new/folder/{PICTURE}\n"
    picture = imread(tmp_path / "new" / "folder" / PICTURE)
    height, width = picture.shape[:2]
    assert 800 <= width <= 2000
    assert 400 <= height <= 2000
    drawn = (picture[..., :3] < 0.9).any(-1)
    assert 0.01 < drawn.mean() < 0.5


def test_unknown_family_or_configuration_is_one_line_and_exit_code_2(tmp_path):
    (tmp_path / "mine.json").write_text(json.dumps({"name": "mine", "families": {"loops": 1.0, "swirls": 1.0}}))
    for config, words in (("mine.json", "unknown swirls; known are"), ("defualt", "unknown configuration 'defualt'")):
        done = pictures("out", "--config", config, folder=tmp_path)
        assert done.returncode == 2
        assert done.stderr.count("\n") == 1
        assert words in done.stderr
        assert not (tmp_path / "out").exists()


def test_folder_that_cannot_be_made_is_one_line_and_exit_code_2(tmp_path):
    (tmp_path / "file").write_text("")
    done = pictures("file/out", folder=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "cannot write to file/out" in done.stderr
