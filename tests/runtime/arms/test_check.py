"""What joints come to along a chunk: as the inverse kinematics of the whole path say it, and in closed loop held."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Friction, Limits, Planner
from runtime.arms.check import EXACT, UNREACHED, JointCheck
from runtime.arms.fit import TORQUE_SHARE
from runtime.arms.load import arm_names, load_arm
from runtime.arms.model import ArmModel
from runtime.arms.motion import follow_plan
from runtime.arms.place import find_place
from runtime.cli.run import run_main
from runtime.safety.stop import PanState

pytest.importorskip("mujoco")

Array = NDArray[np.float64]
Curve = Callable[..., Array]
SlideRun = Callable[..., tuple[int, str, str]]

SLIPPERY, LOOSE = Friction(0.15, 0.1), Limits(acceleration=7.5, jerk=4500.0, speed=3.0)
"""Limits within which an FR3 moves its pan in most directions, not in all."""


@pytest.fixture(scope="module")
def shipped() -> Planner:
    return Planner()


@pytest.fixture
def slide_run(program: Callable[..., SlideRun]) -> SlideRun:
    return program(run_main, "slide-run", 80)


@pytest.mark.parametrize("name", [name for name in arm_names() if name != "paper"])
def test_chunk_by_chunk_it_says_what_the_whole_path_says(shipped: Planner, make_curve: Curve, name: str) -> None:
    model = ArmModel(load_arm(name))
    place = find_place(model)
    plan = shipped.plan(make_curve(500), SLIPPERY, limits=LOOSE)
    whole, motion, check = follow_plan(model, place, plan), plan.with_stop(), JointCheck(model, place)
    told = {"speed": 0.0, "acceleration": 0.0, "jerk": 0.0}
    before = np.concatenate([np.zeros((1, 3)), motion.acceleration])
    for first in range(0, len(motion.acceleration), 90):
        state = PanState(*motion.pan[first].tolist(), *before[first].tolist())
        shares = check(state, motion.acceleration[first : first + 90])
        told = {quantity: max(most, shares[quantity]) for quantity, most in told.items()}

    def share(quantity: str, values: Array) -> float:
        return float((np.abs(values) / model.arm.limit(quantity)).max()) / EXACT

    assert told["speed"] == pytest.approx(share("speed", whole.speed), abs=2e-3)
    assert told["jerk"] == pytest.approx(share("jerk", whole.jerk), abs=2e-3)
    accelerations, torques = share("acceleration", whole.acceleration), share("torque", whole.torque) / TORQUE_SHARE
    if accelerations > torques:
        assert told["acceleration"] == pytest.approx(accelerations, abs=2e-3)
    else:  # torques are looked at every few samples
        assert 0.85 * torques < told["acceleration"] < torques + 2e-3


def test_a_motion_that_the_arm_does_not_reach_takes_too_much() -> None:
    model = ArmModel(load_arm("fr3"))
    check = JointCheck(model, find_place(model))
    away = np.tile([20.0, 0.0, 0.0], (600, 1))
    assert check(PanState(*np.zeros(9)), away)["acceleration"] == UNREACHED
    assert check(PanState(*np.zeros(9)), 0.01 * away[:50])["acceleration"] < 1.0, "and is forgotten"


def test_in_closed_loop_the_joints_hold_where_the_plan_passes_their_limits(
    shipped: Planner, make_curve: Curve, slide_run: SlideRun, tmp_path: Path
) -> None:
    path = tmp_path / "plan.json"
    shipped.plan(make_curve(1000), SLIPPERY, limits=LOOSE).save(path)
    code, out, err = slide_run(path, "--arm", "fr3", "--json")
    assert code == 1
    assert json.loads(out)["limits"]["acceleration"] > 1.0
    assert "limit exceeded: acceleration of fr3_joint" in err
    for more in ((), ("--camera-rate", "60", "--latency", "0.03"), ("--disturb", "push@0.4=0.2,0")):
        code, out, err = slide_run(path, "--arm", "fr3", "--closed-loop", "--json", *more)
        limits = json.loads(out)["limits"]
        assert (code, err) == (0, "")
        assert 0.5 < limits["acceleration"] <= 1.0
        assert limits["jerk"] <= 1.0
