"""A work done item by item by several processes."""

from __future__ import annotations

import operator
import os
import sys
from functools import partial

import pytest

from runtime import Friction, InputError
from runtime.errors import MissingExtraError, SlideError
from runtime.many.workers import check_ray, work_through


@pytest.mark.parametrize("count", [1, 2])
def test_everything_is_done_once(count: int) -> None:
    assert sorted(work_through(range(1, 6), operator.neg, count)) == [-5, -4, -3, -2, -1]


@pytest.mark.parametrize("count", [1, 2])
def test_error_of_ours_ends_the_work_and_keeps_its_place(count: int) -> None:
    good, bad = {"static": 1.0, "kinetic": 0.5}, {"static": "1", "kinetic": 0.5}
    with pytest.raises(InputError, match=r"friction.static must be a number") as refused:
        list(work_through([good, bad], Friction.from_dict, count))
    assert refused.value.place == ("friction", "static")


def test_processes_that_end_again_and_again_are_not_started_for_ever() -> None:
    with pytest.raises(SlideError, match="processes ended 3 times before any of 1, 2 was done: is there enough memory"):
        list(work_through([1, 2], os._exit, 2))


def test_ray_does_the_same_work() -> None:
    pytest.importorskip("ray")
    assert sorted(work_through(range(5), partial(operator.add, 1), ray="local")) == [1, 2, 3, 4, 5]


def test_ray_that_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingExtraError, match="ray is not installed"):
        check_ray()
