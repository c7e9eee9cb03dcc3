from __future__ import annotations

import pytest

pytest.importorskip("pybullet", reason="pybullet is not installed: it has wheels for Python 3.11 and older only")

from benchmarks.sections.arm import Figure, network_plans
from runtime import Planner


def test_figures_say_what_was_asked_for() -> None:
    assert str(Figure("error", 1.234, 5.0)) == "1.23 mm (<= 5)"
    assert str(Figure("error", 6.0, 5.0)) == "6 mm (<= 5), MISSED"
    assert str(Figure("speed", 1.0, 1.5, "x", at_least=True)) == "1 x (>= 1.5), MISSED"
    assert Figure("beside", 100.0, None).met


def test_network_plans_are_measured_in_every_way() -> None:
    figures = {figure.what: figure for figure in network_plans(Planner(), 1)}
    assert figures["object to command, closed loop: mean"].met
    assert figures["closed loop, object lost"].value == 0
    assert len([name for name in figures if "paper control" in name]) == 3
