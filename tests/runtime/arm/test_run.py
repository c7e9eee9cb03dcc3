"""The runner against an ideal arm: the pan follows exactly, the object obeys the law of friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime import Friction, InputError, Plan, Planner
from runtime.arm.geometry import PAN_RADIUS
from runtime.arm.interface import Measured, ObjectStatus, PanCommand
from runtime.arm.results import PLAN_ARRAYS, Results, measured_track
from runtime.arm.run import check_plan, closed_loop, execute, open_loop
from runtime.arm.tail import REST, SAFE_RADIUS, brake
from runtime.documents.checks import FloatArray
from runtime.physics.law import DT, slide_one
from runtime.physics.pan import integrate_pan
from runtime.report.report import render_report


class IdealArm:
    """What another simulator or a real arm has to be: three methods."""

    def __init__(self, friction: Friction, stop_at: int = -1) -> None:
        self.friction, self.stop_at, self.closed, self.steps = friction, stop_at, 0, 0

    def reset(self, object_position: FloatArray) -> Measured:
        self.pan, self.sliding = np.zeros(6), np.concatenate([object_position, np.zeros(2)])
        return self.measure()

    def step(self, command: PanCommand) -> Measured:
        if self.steps == self.stop_at:
            raise KeyboardInterrupt
        self.steps += 1
        assert np.array_equal(command.position, self.pan[:3])
        u = command.acceleration[None]
        self.pan = integrate_pan(self.pan, u)[0]
        self.sliding = slide_one(self.sliding, u, self.friction)[0]
        return self.measure()

    def close(self) -> None:
        self.closed += 1

    def measure(self) -> Measured:
        on_pan = np.hypot(*self.sliding[:2]) <= PAN_RADIUS
        status = ObjectStatus.ON_PAN if on_pan else ObjectStatus.OFF_PAN
        return Measured(self.pan, 0.0, self.sliding, status, np.zeros(6), np.zeros(6))


def test_open_loop_on_an_ideal_arm_is_the_plan(plan: Plan) -> None:
    arm = IdealArm(plan.friction)
    recording = execute(plan, arm, open_loop(plan))
    samples = len(plan)
    assert np.array_equal(recording.sliding[:samples, :2], plan.object_position)
    assert recording.pan[:samples, :2] == pytest.approx(plan.pan_position[:, :2], abs=1e-12)
    assert arm.closed == 1
    results = Results.of(plan, recording, None)
    assert results.object_rms == plan.quality.tracking_rmse
    assert (results.pan_rms, results.plan_rms, results.law_rms) == (0.0, 0.0, None)


def test_closed_loop_on_an_ideal_arm_is_the_plan(planner: Planner, make_curve: Callable[..., FloatArray]) -> None:
    plan = planner.plan(make_curve(350), candidates=1)
    stream = planner.stream(plan.command_position)
    source = closed_loop(stream, stream.chunk, len(plan))
    recording = execute(plan, IdealArm(plan.friction), source)
    assert recording.pan_acceleration[: len(plan)] == pytest.approx(plan.pan_acceleration, abs=1e-9)
    assert not recording.pan[:, 2].any(), "a level plan stays level"


def test_closed_loop_shows_the_network_what_was_measured() -> None:
    seen: list[tuple[FloatArray, FloatArray]] = []

    class Recorder:
        def step(self, pan_state: FloatArray, object_state: FloatArray) -> FloatArray:
            seen.append((pan_state, object_state))
            return np.full((4, 2), float(len(seen)))

    def measured(k: int) -> Measured:
        status = ObjectStatus.OFF_PAN if k > 9 else ObjectStatus.ON_PAN
        return Measured(np.full(6, float(k)), 0.0, np.full(4, float(k)), status, np.zeros(6), np.zeros(6))

    source, log = closed_loop(Recorder(), 4, 13), [measured(0)]
    for k in range(13):
        assert source(k, log)[0] == k // 4 + 1
        log.append(measured(k + 1))
    rows = [(pan[:, 0].tolist(), sliding[:, 0].tolist()) for pan, sliding in seen]
    assert rows[0] == ([0.0] * 4, [0.0] * 4), "before the first chunk: the start state"
    assert rows[1] == ([1.0, 2.0, 3.0, 4.0],) * 2
    assert rows[3] == ([9.0, 10.0, 11.0, 12.0], [9.0] * 4), "an object that has left is shown where it was last seen"


@given(
    st.tuples(*[st.floats(-0.2, 0.2)] * 3),
    st.tuples(*[st.floats(-1.8, 1.8)] * 2, st.floats(-0.5, 0.5)),
    st.tuples(*[st.floats(-0.08, 0.08)] * 2),
)
def test_the_tail_stops_the_pan_and_keeps_the_object(
    pan: tuple[float, float, float], velocity: tuple[float, float, float], position: tuple[float, float]
) -> None:
    friction, start = Friction(1.0, 0.5), np.array([*pan, *velocity])
    sliding = np.array([*position, 0.0, 0.0])
    tail = brake(start, sliding, friction)
    assert not tail[-round(REST / DT) :].any(), "it ends with a rest"
    assert integrate_pan(start, tail)[-1, 3:] == pytest.approx(np.zeros(3), abs=1e-9)
    assert np.hypot(*slide_one(sliding, tail, friction)[:, :2].T).max() <= SAFE_RADIUS


def test_an_interrupt_keeps_what_was_recorded_and_closes_the_arm(plan: Plan) -> None:
    arm = IdealArm(plan.friction, stop_at=120)
    recording = execute(plan, arm, open_loop(plan))
    assert recording.interrupted
    assert arm.closed == 1
    assert (len(recording), len(recording.pan_command), len(recording.pan_acceleration)) == (120, 120, 120)
    assert Results.of(plan, recording, 0.5).samples == 120
    shown, track = measured_track(plan, recording, "arm")
    assert len(shown) == len(track.object_position) == 120
    assert "arm" in render_report(shown, [track])


def test_the_arm_is_closed_when_something_fails(plan: Plan) -> None:
    def broken(k: int, measured: Sequence[Measured]) -> FloatArray:
        raise InputError("broken")

    arm = IdealArm(plan.friction)
    with pytest.raises(InputError, match="broken"):
        execute(plan, arm, broken)
    assert arm.closed == 1


def test_a_lost_object_is_said_with_its_time(plan: Plan) -> None:
    recording = execute(plan, IdealArm(plan.friction), open_loop(plan))
    gone = [
        each._replace(status=ObjectStatus.OFF_PAN) if k >= 123 else each for k, each in enumerate(recording.measured)
    ]
    results = Results.of(plan, replace(recording, measured=tuple(gone)), 0.5)
    assert results.notes == ["the object left the pan at 0.123 s"]


def test_limits_are_said(plan: Plan) -> None:
    recording = execute(plan, IdealArm(plan.friction), open_loop(plan))
    held = [each._replace(limits=("reach",)) if k < 7 else each for k, each in enumerate(recording.measured)]
    results = Results.of(plan, replace(recording, measured=tuple(held)), 0.5)
    assert results.notes == ["the arm was held back for 7 samples or more by: reach"]
    assert results.to_dict()["limits"] == {"reach": 7}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dt": 0.002}, "dt is 0.002 s, the arm is controlled every 0.001 s"),
        ({"pan_position": "shifted"}, "pan.position differs by 0.01 m from what pan.acceleration leads to"),
        ({"pan_acceleration": "huge"}, r"pan.acceleration has 1e\+05 m/s\^2, at most 10000 m/s\^2"),
    ],
)
def test_plans_that_cannot_be_executed_are_refused(plan: Plan, changes: dict[str, object], message: str) -> None:
    if "pan_position" in changes:
        changes = {"pan_position": plan.pan_position + np.array([0.01, 0.01, 0.0])}
    if "pan_acceleration" in changes:
        changes = {"pan_acceleration": np.full_like(plan.pan_acceleration, 1e5)}
    with pytest.raises(InputError, match=message):
        check_plan(replace(plan, **changes))  # type: ignore[arg-type]


def test_a_plan_longer_than_a_minute_is_refused(plan: Plan) -> None:
    many = 61_000 // len(plan) + 1
    long = replace(plan, **{name: np.tile(getattr(plan, name), (many, 1)) for name in PLAN_ARRAYS})
    with pytest.raises(InputError, match=r"the plan lasts 61\.25 s, at most 60 s are executed"):
        check_plan(long)
