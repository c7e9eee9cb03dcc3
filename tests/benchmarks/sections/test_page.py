"""The page's figures, of two drawings."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pytest

from benchmarks.harness.section import Subject
from benchmarks.harness.targets import judge
from benchmarks.pictures.browser import chromium
from benchmarks.sections.page import SECTION, PageSettings
from runtime.errors import InputError


def test_the_time_from_pen_to_pan_is_measured(tiny_bundle: Path) -> None:
    if chromium() is None:
        pytest.skip("no Chromium here: install it, or name it in SLIDE_CHROMIUM")
    figures, notes = SECTION.measure(Subject.load(tiny_bundle), PageSettings(drawings=2))
    assert {verdict.target.figure for verdict in judge(SECTION.targets, asdict(figures))} == {"pen_up.median"}
    assert not notes
    assert figures.pen_up.count == 2
    assert 0.0 < figures.pen_up.median < 60.0


def test_no_drawings_are_refused() -> None:
    with pytest.raises(InputError, match="--drawings must be at least 1"):
        PageSettings(drawings=0)
