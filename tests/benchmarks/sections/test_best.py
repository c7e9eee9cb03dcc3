"""The network beside the best plans that were found: these are what they are said to be, and a search adds to them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.peers.search import search
from benchmarks.sections.best import LEVEL, SECTION, BestSettings, compare
from benchmarks.suite.best_found import read_best, ten_commands
from benchmarks.suite.families import NOMINAL
from benchmarks.suite.pans import summary, tracking
from runtime.errors import InputError
from runtime.planner import Planner


def test_every_recorded_plan_keeps_the_limits_and_follows_its_command() -> None:
    commands, plans = ten_commands(), read_best()
    assert len(set(commands.labels)) == 10
    assert set(plans) <= set(commands.labels)
    positions = dict(zip(commands.labels, commands.positions, strict=True))
    for label, position in ((label, positions[label]) for label in plans):
        found = summary([position], [plans[label]], NOMINAL)
        assert found.pan_reach <= LEVEL.pan_reach * (1 + 1e-5)
        assert found.acceleration <= LEVEL.acceleration * (1 + 1e-5)
        assert found.jerk <= LEVEL.jerk * (1 + 1e-3)  # what is recorded is rounded
        assert found.tracking_mean < 2.5e-3


def test_ratios_are_those_of_the_errors(tiny_bundle: Path) -> None:
    planner, commands = Planner(tiny_bundle), ten_commands().first(2)
    others = {label: np.zeros((1200, 2)) for label in commands.labels}
    figures = compare(planner, commands, others)
    ratios = [row.network / row.best for row in figures.rows]
    assert figures.network_ratio == pytest.approx(np.sqrt(ratios[0] * ratios[1]))
    assert figures.refined_mean <= figures.network_mean
    assert [row.command for row in figures.rows] == list(commands.labels)
    still = [np.sqrt((position**2).sum(axis=1).mean()) for position in commands.positions]
    assert [row.best for row in figures.rows] == pytest.approx(still)
    assert SECTION.tables(figures, [])


def test_a_search_finds_no_worse_than_what_it_begins_from(tiny_bundle: Path) -> None:
    position = ten_commands().positions[1][:400]
    still = np.zeros((400, 2))
    first = search(Planner(tiny_bundle), position, NOMINAL, LEVEL, 300, [still])
    again = search(Planner(tiny_bundle), position, NOMINAL, LEVEL, 300, [first])
    errors = tracking([position] * 3, [still, first, again], NOMINAL)
    assert errors[2] <= errors[1] < 0.5 * errors[0]
    assert summary([position], [again], NOMINAL).pan_reach <= LEVEL.pan_reach


def test_a_command_without_a_plan_is_named(tiny_bundle: Path) -> None:
    commands = ten_commands().first(1)
    with pytest.raises(InputError, match=f"no plan is recorded for {commands.labels[0]}: slide-bench best --search"):
        compare(Planner(tiny_bundle), commands, {})


def test_settings_are_checked() -> None:
    with pytest.raises(InputError, match="--search must be at least 1, got 0"):
        BestSettings(search=0)
