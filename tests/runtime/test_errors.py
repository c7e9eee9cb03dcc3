"""An error says what is wrong in one line, and carries where: the path into the document."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import pytest

from runtime import Command, FormatError, Friction, InputError, Limits, Plan, Planner, Start
from runtime.errors import Place, parse_place, place_text, within

POINTS = [[0.0, 0.0], [0.001, 0.0], [0.002, 0.0]]


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ((), ""),
        (("dt",), "dt"),
        (("command", "position", 3), "command.position[3]"),
        (("commands", 0, "t", 12), "commands[0].t[12]"),
        (("position", 3, 1), "position[3][1]"),
    ],
)
def test_place_and_its_text_are_two_forms_of_one_path(place: Place, text: str) -> None:
    assert place_text(place) == text
    assert parse_place(text) == place


@pytest.mark.parametrize(
    ("act", "place"),
    [
        (lambda: Command.from_samples([*POINTS, [0.0, "1"]]), ("position", 3, 1)),
        (lambda: Command.from_samples([*POINTS, [0.0]]), ("position", 3)),
        (lambda: Command.from_samples([*POINTS, [0.0, float("nan")]]), ("position", 3, 1)),
        (lambda: Command.from_samples([*POINTS, [0.0, 1e3]]), ("position", 3, 1)),
        (lambda: Command.from_samples([*POINTS, [0.3, 0.0]]), ("position", 3)),
        (lambda: Command.from_samples(POINTS, 0.0), ("dt",)),
        (lambda: Command.from_waypoints([0.0, 0.2, 0.1], POINTS), ("t", 2)),
        (lambda: Command.from_waypoints([0.0, 0.2], POINTS), ("t",)),
        (lambda: Command.from_dict({"dt": 0.001, "position": 1}), ("position",)),
        (lambda: Friction(-1.0), ("static",)),
        (lambda: Friction(0.3, 0.5), ()),
        (lambda: Friction.from_dict({"static": 1.0}), ("friction",)),
        (lambda: Friction.from_dict({"static": 1.0, "kinetic": "a"}), ("friction", "kinetic")),
        (lambda: Limits(jerk=-1.0), ("jerk",)),
        (lambda: Limits.from_dict({**Limits().to_dict(), "jerk": None}), ("limits", "jerk")),
        (lambda: Limits.from_dict({**Limits().to_dict(), "jerk": 0.0}), ("limits", "jerk")),
        (lambda: Start(pan_velocity=(0.0, float("inf"))), ("pan_velocity", 1)),
        (lambda: Plan.from_dict({"format": "slide-plan/0"}), ("format",)),
    ],
)
def test_error_carries_its_place(act: Callable[[], Any], place: Place) -> None:
    with pytest.raises(InputError) as caught:
        act()
    assert caught.value.place == place


def test_error_of_the_planner_names_the_argument() -> None:
    planner = Planner()
    for act, place in (
        (lambda: planner.plan(POINTS, tolerance=-1.0), ("tolerance",)),
        (lambda: planner.plan(POINTS, refine_ms=-1.0), ("refine_ms",)),
        (lambda: planner.plan(POINTS, start=Start(pan_position=(9.0, 0.0))), ("start",)),
        (lambda: planner.plan_batch([POINTS, [*POINTS, [0.0, 1e3]]]), ("positions", 1, 3, 1)),
    ):
        with pytest.raises(InputError) as caught:
            act()  # type: ignore[no-untyped-call]
        assert caught.value.place == place


def test_place_grows_from_the_inside_and_the_message_stays() -> None:
    with pytest.raises(InputError) as caught, within("commands[3]"), within("friction"):
        Friction(kinetic=-1.0)
    assert place_text(caught.value.place) == "commands[3].friction.kinetic"
    assert str(caught.value) == "friction kinetic must be between 0 and 10, got -1"


def test_error_keeps_its_place_from_process_to_process() -> None:
    for kind in (InputError, FormatError):
        error = pickle.loads(pickle.dumps(kind("a message", "position[3]")))
        assert (type(error), str(error), error.place) == (kind, "a message", ("position", 3))
