"""Plans for an arm: the joints' limits give the pan's, are kept by tightening these, and commands are slowed down."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from runtime import Command, Friction, Limits, Plan
from runtime.arms.fit import STRETCHES, fit, pan_limits, slowed
from runtime.arms.load import load_arm
from runtime.arms.model import ArmModel
from runtime.arms.motion import follow_plan
from runtime.arms.place import Place, find_place
from runtime.cli.plan import plan_main

pytest.importorskip("mujoco")

EIGHT = Path(__file__).parents[3] / "examples" / "figure_eight.csv"
SLIPPERY = Friction(0.15, 0.1)

SlidePlan = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def fr3() -> tuple[ArmModel, Place]:
    model = ArmModel(load_arm("fr3"))
    return model, find_place(model)


@pytest.fixture(scope="module")
def command() -> Command:
    t = np.arange(400) / 399.0
    along = 0.05 * (10 * t**3 - 15 * t**4 + 6 * t**5)
    return Command.from_samples(np.stack([along, -along], axis=1))


def shaking(needed: float, friction: Friction = SLIPPERY, direction: tuple[float, float] = (1.0, 0.0)) -> Plans:
    return Plans(needed, friction, direction)


class Plans:
    """Plans that swing the pan as hard as its limits allow, up to what a command needs: less, the longer it lasts.

    They track their command exactly where they may do what it needs, and are off by 10 mm else.
    """

    def __init__(self, needed: float, friction: Friction, direction: tuple[float, float]) -> None:
        self.needed, self.friction, self.direction = needed, friction, np.array(direction)
        self.limits: list[Limits] = []

    def __call__(self, command: Command, limits: Limits) -> Plan:
        self.limits.append(limits)
        needed = self.needed * (400 / len(command)) ** 2
        peak = min(limits.acceleration, needed)
        t = np.arange(300) / 300
        shape = 1.6 * np.sin(2.0 * np.pi * t) * np.sin(np.pi * t) ** 2
        u = peak * np.outer(shape - shape.mean(), self.direction)
        plan = Plan.of_accelerations(u, self.friction, "shaking")
        off = 0.0 if peak >= needed else 0.01
        return replace(plan, quality=replace(plan.quality, tracking_rmse=off))


def test_the_pans_limits_are_what_the_joints_allow_in_every_direction(fr3: tuple[ArmModel, Place]) -> None:
    model, place = fr3
    limits = pan_limits(model, place, Limits())
    assert limits.pan_reach == 0.2
    assert limits.acceleration < 9.0
    for angle in np.linspace(0.0, np.pi, 7):
        direction = (math.cos(angle), math.sin(angle))
        plan = shaking(limits.acceleration, direction=direction)(Command.load(EIGHT), limits)
        joints = follow_plan(model, place, plan)
        assert not [peak for peak in joints.exceeded if peak.share is not None and peak.share > 1.05]


def test_the_pans_limits_are_no_more_than_was_asked_for(fr3: tuple[ArmModel, Place]) -> None:
    asked = Limits(pan_reach=0.1, acceleration=1.0, jerk=100.0)
    limits = pan_limits(*fr3, asked)
    assert (limits.pan_reach, limits.acceleration, limits.jerk) == (0.1, 1.0, 100.0)


def test_limits_are_tightened_until_the_joints_hold(fr3: tuple[ArmModel, Place], command: Command) -> None:
    make = shaking(100.0)
    fitted = fit(make, command, *fr3, Limits(), tolerance=0.02)
    assert fitted.holds
    assert fitted.plans == len(make.limits) > 1
    accelerations = [limits.acceleration for limits in make.limits]
    assert accelerations == sorted(accelerations, reverse=True)
    assert fitted.stretch == 1.0
    assert fitted.joints.worst is not None
    assert fitted.joints.worst.share is not None
    assert 0.85 < fitted.joints.worst.share <= 1.0


def test_limits_that_were_tightened_too_far_are_loosened_again(fr3: tuple[ArmModel, Place], command: Command) -> None:
    make = shaking(100.0)
    fitted = fit(make, command, *fr3, Limits())  # which misses the tolerance, whatever the limits
    assert fitted.holds
    accelerations = [limits.acceleration for limits in make.limits]
    assert any(later > earlier for earlier, later in pairwise(accelerations))


def test_a_command_is_slowed_down_no_more_than_it_must(fr3: tuple[ArmModel, Place], command: Command) -> None:
    within = pan_limits(*fr3, Limits()).acceleration
    fitted = fit(shaking(4.0 * within), command, *fr3, Limits(), stretch=True)
    assert fitted.holds
    assert fitted.plan.quality.tracking_rmse <= 2e-3
    # Twice the time is a fourth of the acceleration; what holds in this direction is somewhat more than in every one.
    assert 1.4 < fitted.stretch < 2.2
    assert len(fitted.command) == pytest.approx(len(command) * fitted.stretch, abs=2)
    assert any("slowed down" in note for note in fitted.command.notes)


def test_a_command_that_fits_is_left_as_it_is(fr3: tuple[ArmModel, Place], command: Command) -> None:
    fitted = fit(shaking(1.0), command, *fr3, Limits(), stretch=True)
    assert (fitted.stretch, fitted.plans, fitted.notes) == (1.0, 1, ())
    assert fitted.command is command


def test_what_no_stretch_makes_hold_is_told(fr3: tuple[ArmModel, Place], command: Command) -> None:
    fitted = fit(shaking(1e4), command, *fr3, Limits(), stretch=True, tolerance=1e-3)
    assert fitted.stretch in (1.0, *STRETCHES)
    assert fitted.notes == ("slowing the command down up to 8 times was not enough",)


def test_friction_that_holds_the_object_fast_is_told_with_the_friction_that_would_not(
    fr3: tuple[ArmModel, Place], command: Command
) -> None:
    fitted = fit(shaking(100.0, Friction(1.0, 0.5)), command, *fr3, Limits())
    assert len(fitted.notes) == 1
    assert "could slide it there at a static friction below 0." in fitted.notes[0]
    assert "not at 1" in fitted.notes[0]


def test_a_slowed_command_goes_the_same_way() -> None:
    command = Command.load(EIGHT)
    slow = slowed(command, 2.0)
    np.testing.assert_allclose(slow.position[::2][:1200], command.position, atol=1e-9)


@pytest.fixture
def slide_plan(program: Callable[..., SlidePlan]) -> SlidePlan:
    return program(plan_main, "slide-plan", 100)


def test_slide_plan_plans_for_an_arm(slide_plan: SlidePlan, tmp_path: Path) -> None:
    out = tmp_path / "plan.json"
    code, shown, _ = slide_plan(
        EIGHT, "-o", out, "--arm", "ur5e", "--static", 0.3, "--kinetic", 0.25, "--stretch", "--json"
    )
    assert code == 0
    told = json.loads(shown)["arm"]
    assert (told["name"], told["holds"], told["stretch"]) == ("ur5e", True, 1.0)
    model = ArmModel(load_arm("ur5e"))
    assert not follow_plan(model, find_place(model), Plan.load(out)).exceeded


@pytest.mark.parametrize("option", [["--at", "0.5,0,0.3"], ["--stretch"], ["--tip", "tool0"]])
def test_options_of_an_arm_need_one(option: list[str], slide_plan: SlidePlan, tmp_path: Path) -> None:
    code, shown, said = slide_plan(EIGHT, "-o", tmp_path / "plan.json", *option)
    assert (code, shown, said) == (2, "", f"slide-plan: error: {option[0]} needs --arm\n")
    assert not list(tmp_path.iterdir())


def test_python_of_the_guide_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(EIGHT.parents[1])
    guide = Path("docs/guide/arms.md").read_text(encoding="utf-8")
    exec(guide.partition("```python\n")[2].partition("```")[0], {})
    assert capsys.readouterr().out.startswith("1.0 True ")
