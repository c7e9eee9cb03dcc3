"""The figures of the arm, on one of the network's plans."""

from __future__ import annotations

from dataclasses import asdict

import pytest

pytest.importorskip("pybullet", reason="pybullet is not installed: it has wheels for Python 3.11 and older only")

from benchmarks.harness.targets import judge
from benchmarks.sections.arm import TARGETS, ArmSettings, network_plans
from runtime import InputError, Planner


def test_network_plans_are_measured_in_every_way() -> None:
    figures = network_plans(Planner(), 1)
    verdicts = {verdict.target.figure: verdict for verdict in judge(TARGETS, {"network": asdict(figures)})}
    assert len(verdicts) == len(asdict(figures))
    assert verdicts["network.closed_mean"].met
    assert verdicts["network.closed_lost"].value == 0
    assert verdicts["network.open_mean"].met is None


def test_more_plans_than_there_are_commands_are_refused() -> None:
    with pytest.raises(InputError, match="--plans must be at most 64, got 65"):
        ArmSettings(plans=65)
