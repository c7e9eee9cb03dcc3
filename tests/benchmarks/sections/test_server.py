"""The server's figures, of a few requests."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from benchmarks.harness.section import Subject
from benchmarks.harness.targets import judge
from benchmarks.sections.server import SECTION, ServerSettings


def test_every_figure_of_the_server_is_measured(tiny_bundle: Path) -> None:
    settings = ServerSettings(
        lone=3, python=2, clients=2, rounds=1, nonces=4, flood_seconds=0.5, steps=3, attack_seconds=1.0, kills=4
    )
    figures, notes = SECTION.measure(Subject.load(tiny_bundle), settings)
    document = asdict(figures)
    json.dumps(document, allow_nan=False)
    measured = {verdict.target.figure for verdict in judge(SECTION.targets, document)}
    assert measured == {each.figure for each in SECTION.targets if not each.figure.startswith("soak.")}
    assert not notes
    assert 0 < figures.looked_through <= 4
    assert (figures.wrong, figures.flood.other, figures.flood.unanswered) == (0, 0, 0)
    assert (figures.killed.times, figures.killed.ends) == (4, 0)
    assert figures.soak is None
