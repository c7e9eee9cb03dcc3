"""The guide to arms: its tables are those of the arms that are shipped, its programs and its Python run."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.sections.joints import HEADER, STRONG, WEAK, JointsSettings
from runtime.arms.description import HAND_LIMITS, LIMITS, ArmDescription
from runtime.arms.load import arm_names, load_arm

ROOT = Path(__file__).parents[2]
GUIDE = (ROOT / "docs" / "guide" / "arms.md").read_text(encoding="utf-8")


HALF = 1e-9
"""Added to a limit, so that halves are rounded up."""


def rows(text: str) -> list[list[str]]:
    """The cells of a table's rows, its header and the line below it included."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]


def test_measured_table_has_the_form_in_which_the_benchmark_writes_it() -> None:
    (written,) = re.findall(r"<!-- slide-bench: joints -->\n(.*?)<!-- end -->", GUIDE, re.DOTALL)
    header, _, *arms = rows(written)
    assert header == list(HEADER)
    assert [row[0] for row in arms] == [f"`{name}`" for name in (*STRONG, *WEAK)]
    commands = 1 + JointsSettings().splines
    for row in arms:
        friction, hold, *numbers = row[1:]
        assert re.fullmatch(r"0\.\d+/0\.\d+", friction)
        assert hold.endswith(f" of {commands}")
        assert np.array(numbers, dtype=float).min() >= 0.0
    assert "`slide-bench joints --page docs/guide/arms.md`" in GUIDE


def spread(arm: ArmDescription, name: str) -> str:
    """The least and the largest limit of an arm's joints."""
    limits = arm.limit(name)
    if not np.isfinite(limits).all():
        return "unknown"
    ends = np.round([limits.min() + HALF, limits.max() + HALF], 2).tolist()
    least, most = (f"{end:,.0f}" if end > 1000.0 else f"{end:g}" for end in ends)
    return least if least == most else f"{least}-{most}"


@pytest.mark.parametrize("name", [name for name in arm_names() if name != "paper"])
def test_limits_in_the_table_are_those_of_the_arm(name: str) -> None:
    arm = load_arm(name)
    table = GUIDE[GUIDE.index("| arm | joints | speed (rad/s) |") : GUIDE.index("By file:")]
    (row,) = [row for row in rows(table) if row[0] == f"`{name}`"]
    assert row[1:6] == [str(len(arm)), *(spread(arm, quantity) for quantity in LIMITS)]
    hand = {quantity: getattr(arm.hand, quantity) for quantity in HAND_LIMITS}
    told = ", ".join(
        f"{value:,.0f} {HAND_LIMITS[quantity]}" if value > 100.0 else f"{value:g} {HAND_LIMITS[quantity]}"
        for quantity, value in hand.items()
        if value is not None
    )
    assert row[6] == (told or "unknown")
    assert row[7], "where they are published"


def test_every_arm_is_named_in_the_guide() -> None:
    assert ", ".join(f"`{name}`" for name in arm_names() if name != "paper") in GUIDE.replace(
        "`paper` (the simulated arm of the paper), ", ""
    ).replace("\n", " ")


def test_python_of_the_guide_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.chdir(ROOT)
    known: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", GUIDE, flags=re.DOTALL):
        exec(block, known)
    assert "stream" in known
    assert "1.0 True" in capsys.readouterr().out
