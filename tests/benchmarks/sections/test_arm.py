"""The figures of the arm, of a few runs."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

pytest.importorskip("pybullet")
pytest.importorskip("mujoco")

from benchmarks.harness.section import Subject
from benchmarks.harness.targets import judge
from benchmarks.sections.arm import SECTION, ArmSettings
from runtime import InputError


def test_every_figure_of_the_arm_is_measured() -> None:
    figures, notes = SECTION.measure(Subject.load(), ArmSettings(plans=1, motions=1, repeated=1, pictures=1))
    document = asdict(figures)
    json.dumps(document, allow_nan=False)
    verdicts = {verdict.target.figure: verdict for verdict in judge(SECTION.targets, document)}
    assert list(verdicts) == [target.figure for target in SECTION.targets]
    assert not notes
    for simulator in ("pybullet", "mujoco"):
        assert verdicts[f"{simulator}.network.closed_lost"].met
        assert verdicts[f"{simulator}.network.pan_rms_worst"].met
        assert verdicts[f"{simulator}.network.open_worst"].met is None
        assert document[simulator]["network"]["closed_mean"] < 0.003
    assert 0.0 < document["apart_motions"] < 0.005


def test_more_plans_than_there_are_commands_are_refused() -> None:
    with pytest.raises(InputError, match="--plans must be at most 64, got 65"):
        ArmSettings(plans=65)
