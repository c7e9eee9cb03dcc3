"""A configuration that cannot work is refused before the first step, and the key is named."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from runtime.errors import InputError
from train.config import CONFIGURATIONS, load_config


def test_named_configurations_are_the_ones_promised():
    assert set(CONFIGURATIONS) == {"default", "smoke", "paper"}
    paper = CONFIGURATIONS["paper"]
    assert (paper.units, paper.layers, paper.chunk) == (1024, 2, 100)
    assert (paper.epochs, paper.trajectories, paper.batch) == (50, 8192, 64)
    assert (paper.alpha, paper.beta, paper.gamma, paper.pan_limit) == (1.0, 10.0, 1.0, 0.2)
    assert (paper.learning_rate, paper.final_learning_rate, paper.optimizer) == (1e-3, 1e-3, "adam")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("gama", 1.0),
        ("gamma", -1.0),
        ("units", 0),
        ("learning_rate", float("nan")),
        ("reach", [0.2, 0.1]),
        ("reach", [0.0, 0.1]),
        ("samples", [100, 384]),
        ("kinetic", [0.4, 1.2]),
        ("acceleration", [40.0, 2.0]),
        ("told", 1.5),
        ("chunk", 100),
        ("network", "general"),
        ("batch", 20),
        ("families", {"zigzag": 1.0}),
        ("families", {"moves": 0.0}),
        ("batch", 100_000),
        ("precision", "float8"),
        ("average", 1.0),
        ("workers", 0),
        ("workers", 500),
        ("restarts", [{"after": share, "learning_rate": 1e-3, "gamma": 0.1, "robust": 0.1} for share in (0.6, 0.5)]),
    ],
)
def test_bad_value_is_refused_by_name(tmp_path, key, value):
    values = CONFIGURATIONS["smoke"].model_dump(mode="json") | {key: value}
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(values))
    with pytest.raises(InputError, match=key):
        load_config(str(path))


@pytest.mark.parametrize(
    ("key", "value"), [("samples", [50, 400]), ("kinetic", 2.0), ("model", "D"), ("reach", [0.2, 0.1]), ("told", 0.5)]
)
def test_bad_value_of_the_papers_network_is_refused_by_name(key, value):
    with pytest.raises(InputError, match=key):
        load_config("paper", **{key: value})


def test_file_configuration_is_read_and_changed(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text(CONFIGURATIONS["smoke"].model_copy(update={"name": "mine"}).model_dump_json())
    config = load_config(str(path), seed=3, epochs=None)
    assert (config.name, config.seed, config.epochs) == ("mine", 3, CONFIGURATIONS["smoke"].epochs)


@pytest.mark.parametrize("source", ["defualt", "absent.json"])
def test_unknown_configuration_is_refused(source):
    with pytest.raises(InputError, match=source):
        load_config(source)


def test_truncated_file_is_refused(tmp_path):
    path = tmp_path / "cut.json"
    path.write_text(CONFIGURATIONS["smoke"].model_dump_json()[:50])
    with pytest.raises(InputError, match=r"cut\.json"):
        load_config(str(path))


def test_configuration_is_judged_without_loading_torch():
    code = "import sys, train.config; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
