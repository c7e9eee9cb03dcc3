"""Executes a plan on a UR5e, by `servoJ` at 500 Hz.

    pip install ur-rtde './[mujoco]'
    python examples/universal_robots.py plan.json 192.168.0.10

UNTESTED ON HARDWARE: it was run against a stand-in with ur-rtde 1.6's signatures and timing. Keep the stop button at
hand, and begin with a slow, small plan. `servoJ` smooths over LOOKAHEAD, so the pan comes late and its strokes are
blunter than planned: look at how the pan followed, and expect the object to follow worse than in simulation.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from runtime import Plan
from runtime.arm.joint_arm import HOMING_SPEED, JointArm, Joints, See, check_joints
from runtime.arm.results import Results
from runtime.arm.run import check_plan, execute, open_loop
from runtime.arms.model import ArmModel
from runtime.arms.options import ArmChoice, choose
from runtime.arms.place import Place

Array = NDArray[np.float64]

PERIOD = 0.002
"""Time from one command to the next (s)."""

LOOKAHEAD, GAIN = 0.03, 2000.0
"""The least time that servoJ smooths over (s), and its largest gain."""

HOMING_ACCELERATION = 0.5
"""Joint acceleration on the way home (rad/s^2)."""

READY = "Put the object onto the pan where the command begins, then press Enter: "


class UniversalRobot(JointArm):
    """A UR arm through ur-rtde; `waitPeriod` waits for the end of each 2 ms, and so paces the loop."""

    period = 2

    def __init__(self, address: str, model: ArmModel, place: Place, see: See | None = None) -> None:
        super().__init__(model, place, see)
        import rtde_control
        import rtde_receive

        self._control = rtde_control.RTDEControlInterface(address, 1.0 / PERIOD)
        self._receive = rtde_receive.RTDEReceiveInterface(address, 1.0 / PERIOD)
        self._open = True

    def go_home(self, angle: Array) -> None:
        self._control.moveJ(angle.tolist(), HOMING_SPEED, HOMING_ACCELERATION)
        input(READY)

    def send(self, angle: Array, speed: Array) -> None:
        begin = self._control.initPeriod()
        self._control.servoJ(angle.tolist(), 0.0, 0.0, PERIOD, LOOKAHEAD, GAIN)
        self._control.waitPeriod(begin)

    def read(self) -> Joints:
        receive = self._receive
        return Joints(*map(np.array, (receive.getActualQ(), receive.getActualQd(), receive.getTargetMoment())))

    def close(self) -> None:
        if self._open:
            self._open = False
            self._control.servoStop()
            self._control.stopScript()
            self._control.disconnect()
            self._receive.disconnect()


def main(plan_file: str, address: str) -> None:
    """Check the plan against the arm's limits, execute it in open loop, and print how the pan followed."""
    plan = Plan.load(plan_file)
    check_plan(plan)
    model, place = choose(ArmChoice(arm="ur5e"))
    check_joints(model, place, plan)
    recording = execute(plan, UniversalRobot(address, model, place), open_loop(plan))
    for name, value in Results.of(plan, recording, None).rows[:2]:
        print(f"{name}: {value}")


if __name__ == "__main__":
    main(*sys.argv[1:])
