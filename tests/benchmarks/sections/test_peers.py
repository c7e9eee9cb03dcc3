"""The network beside the optimizers, on the same commands."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.harness.section import Subject
from benchmarks.sections.peers import SECTION, PeersSettings


def test_network_and_optimizers_plan_the_same_commands(tiny_bundle: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = PeersSettings(family=("spline",), commands=2, candidates=32, iterations=1)
    figures, notes = SECTION.measure(Subject.load(tiny_bundle), settings)
    rows = figures.rows
    assert not notes
    assert [(row.planner, row.commands) for row in rows] == [("tiny", 2), ("CEM 32 x 1", 2), ("MPPI 32 x 1", 2)]
    assert all(row.cpu > 0 and row.speed > 0 for row in rows)
    assert [row.times for row in rows] == pytest.approx([row.cpu / rows[0].cpu for row in rows])
    progress = capsys.readouterr().err.splitlines()
    assert "minutes of one core: tiny " in progress[0]
    assert progress[1:] == [f"slide-bench: peers: spline, 2 commands: {row.planner}" for row in rows]


def test_path_integral_control_can_be_left_out(tiny_bundle: Path) -> None:
    settings = PeersSettings(family=("short",), commands=1, candidates=8, iterations=1, no_mppi=True)
    figures, _ = SECTION.measure(Subject.load(tiny_bundle), settings)
    assert [row.planner for row in figures.rows] == ["tiny", "CEM 8 x 1"]


def test_planners_are_measured_within_the_limits_of_a_pan(tiny_bundle: Path) -> None:
    settings = PeersSettings(family=("spline",), commands=1, candidates=8, iterations=1, limits=("small",))
    figures, _ = SECTION.measure(Subject.load(tiny_bundle), settings)
    assert [row.family for row in figures.rows[::3]] == ["small 1/0.5 spline", "small 1/0.5 spline, lifting"]
    assert [row.planner.split()[0] for row in figures.rows[:3]] == ["tiny", "CEM", "MPPI"]
    assert all(row.tracking_mean > 0.0 and row.cpu > 0.0 for row in figures.rows)
    network, optimizer, *_ = figures.rows
    ratio = figures.ratios["small_100_50_spline"]["level"]
    assert ratio == pytest.approx(network.tracking_mean / optimizer.tracking_mean)
