"""What planning takes and gives can be copied, and handed to other processes."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import BundleError, Command, FormatError, Friction, InputError, Limits, Plan, Planner, Sizes, Start

COPIES: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}


def assert_same(one: Any, other: Any) -> None:
    assert type(one) is type(other)
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        assert np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b, field.name


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize(
    "value",
    [Friction(0.7, 0.4), Limits(0.1, acceleration=20.0, jerk=5_000.0), Start((0.01, 0.0)), Sizes()],
    ids=lambda value: type(value).__name__,
)
def test_parameters_are_copied(value: Any, way: str) -> None:
    assert COPIES[way](value) == value


@pytest.mark.parametrize("way", COPIES)
def test_a_plan_is_copied(plan: Plan, way: str) -> None:
    assert_same(COPIES[way](plan), plan)


@pytest.mark.parametrize("way", COPIES)
def test_a_command_is_copied_and_stays_read_only(way: str) -> None:
    command = Command.from_waypoints([0.0, 0.3, 0.8], [(0.0, 0.0), (0.05, 0.0), (0.05, 0.05)])
    assert command.velocity.shape == command.position.shape
    copied = COPIES[way](command)
    assert_same(copied, command)
    assert not copied.position.flags.writeable


@pytest.mark.parametrize("way", COPIES)
def test_a_copied_planner_plans_the_same(planner: Planner, plan: Plan, way: str) -> None:
    again = COPIES[way](planner).plan(plan.command_position)
    assert np.array_equal(again.pan_acceleration, plan.pan_acceleration)


def test_a_planner_is_pickled_by_its_path_and_not_by_its_weights(planner: Planner) -> None:
    pickled = pickle.dumps(planner)
    assert len(pickled) < 1000
    assert str(planner.bundle.path).encode() in pickled


def test_a_planner_of_a_relative_path_is_found_from_another_folder(
    make_bundle: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_bundle(tmp_path / "mine")
    monkeypatch.chdir(tmp_path)
    pickled = pickle.dumps(Planner("mine"))
    monkeypatch.chdir("/")
    assert pickle.loads(pickled).bundle.manifest.name == "tiny"


def test_a_bundle_that_changed_since_is_refused(make_bundle: Callable[..., Path], tmp_path: Path) -> None:
    folder = make_bundle(tmp_path / "bundle")
    pickled = pickle.dumps(Planner(folder))
    make_bundle(folder, training={"seed": 1})
    with pytest.raises(BundleError, match=r"manifest.json: sha256 is \w+, it must be \w+"):
        pickle.loads(pickled)


def test_errors_keep_message_and_place_in_other_processes() -> None:
    for kind in (InputError, FormatError):
        error = pickle.loads(pickle.dumps(kind("friction static must be finite", "friction.static")))
        assert (type(error), str(error), error.place) == (
            kind,
            "friction static must be finite",
            ("friction", "static"),
        )


def test_a_pool_of_fresh_processes_plans(planner: Planner, plan: Plan) -> None:
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        made = pool.submit(planner.plan, Command(plan.command_position), Friction(0.9, 0.5)).result(timeout=60)
        with pytest.raises(InputError, match="kinetic friction 2 must not exceed static friction 1"):
            pool.submit(Friction, 1.0, 2.0).result(timeout=60)
    assert_same(made, planner.plan(plan.command_position, Friction(0.9, 0.5)))


def test_joblib_plans(planner: Planner, plan: Plan) -> None:
    joblib = pytest.importorskip("joblib")
    jobs = [joblib.delayed(planner.plan)(plan.command_position, Friction(static, 0.5)) for static in (0.8, 1.0)]
    made = joblib.Parallel(n_jobs=2, timeout=60)(jobs)
    assert_same(made[1], plan)
