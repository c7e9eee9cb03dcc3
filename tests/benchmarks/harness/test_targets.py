"""A figure is compared with its target where it was measured, and shown in its unit."""

from __future__ import annotations

import pytest

from benchmarks.harness.targets import COUNT, MILLIMETRES, PERCENT, TIMES, Target, judge

TARGETS = (
    Target("spline.mean", "spline, mean RMSE", MILLIMETRES, "<=", 1.3e-3),
    Target("share", "share of it", PERCENT, "<", 0.1),
    Target("windows.1.ratio", "second window", TIMES, ">=", 2.0),
    Target("refused", "refused", COUNT),
)


def test_a_figure_is_judged_only_where_it_was_measured() -> None:
    figures = {"spline": {"mean": 1.3e-3}, "share": 0.1, "windows": [{"ratio": 3.0}], "other": None}
    assert [(verdict.target.figure, verdict.met) for verdict in judge(TARGETS, figures)] == [
        ("spline.mean", True),
        ("share", False),
    ]


@pytest.mark.parametrize(
    ("target", "value", "text"),
    [
        (TARGETS[0], 1.234e-3, "spline, mean RMSE 1.23 (target <= 1.30 mm)"),
        (TARGETS[2], 1.0, "second window 1.00 (target >= 2.00 x)"),
        (TARGETS[3], 1234, "refused 1,234"),
    ],
)
def test_a_verdict_is_one_line_in_the_target_s_unit(target: Target, value: float, text: str) -> None:
    *path, last = target.figure.split(".")
    figures: dict[str, object] = {last: value}
    for name in reversed(path):
        figures = {name: figures}
    if "windows" in target.figure:
        figures = {"windows": [{}, {"ratio": value}]}
    (verdict,) = judge([target], figures)
    assert str(verdict) == text


def test_a_figure_without_a_target_is_shown_only() -> None:
    (verdict,) = judge(TARGETS, {"refused": 7})
    assert verdict.met is None
    assert verdict.to_dict() == {"figure": "refused", "value": 7.0, "target": None, "met": None}
