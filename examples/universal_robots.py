"""Executes a plan on a UR5e, by `servoJ` at 500 Hz.

    pip install ur-rtde './[mujoco]'
    python examples/universal_robots.py plan.json 192.168.0.10

UNTESTED ON HARDWARE: it was run against a stand-in with ur-rtde 1.6's signatures and timing. Keep the stop button at
hand, and begin with a slow, small plan. `servoJ` smooths over LOOKAHEAD, so the pan comes late and its strokes are
blunter than planned: look at how the pan followed, and expect the object to follow worse than in simulation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.arm.joint_arm import HOMING_SPEED, JointArm, Joints, See, driver, execute_plan
from runtime.arms.model import ArmModel
from runtime.arms.place import Place
from runtime.cli.console import run

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
        control, receive = driver("rtde_control", "ur-rtde"), driver("rtde_receive", "ur-rtde")
        self._control = control.RTDEControlInterface(address, 1.0 / PERIOD)
        self._receive = receive.RTDEReceiveInterface(address, 1.0 / PERIOD)
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
    """Execute a plan on the UR5e at an address, in open loop, and print how the pan followed."""
    execute_plan(plan_file, "ur5e", lambda model, place: UniversalRobot(address, model, place))


if __name__ == "__main__":
    run("universal_robots.py", main)
