"""Executes a plan on a Franka Research 3, by its joint positions at 1 kHz.

    pip install pylibfranka './[mujoco]'
    python examples/franka.py plan.json 172.16.0.2

UNTESTED ON HARDWARE: it was run against a stand-in with pylibfranka 0.21's signatures and timing. Keep the stop
button at hand, and begin with a slow, small plan. It needs what libfranka needs: a real-time kernel, and FCI
switched on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arm.joint_arm import JointArm, Joints, See, driver, execute_plan, way
from runtime.arms.model import ArmModel
from runtime.arms.place import Place
from runtime.cli.console import run

Array = NDArray[np.float64]

TORQUES, FORCES = [60.0] * 7, [60.0] * 6
"""Contact thresholds (N m; N and N m): a plan's own accelerations must not count as a collision."""

READY = "Put the object onto the pan where the command begins, then press Enter: "


class FrankaArm(JointArm):
    """A Franka arm through pylibfranka; `readOnce` waits for the robot's next millisecond, and so paces the loop."""

    def __init__(self, address: str, model: ArmModel, place: Place, see: See | None = None) -> None:
        super().__init__(model, place, see)
        self._franka = driver("pylibfranka", "pylibfranka")
        self._robot = self._franka.Robot(address)
        self._robot.set_collision_behavior(TORQUES, TORQUES, FORCES, FORCES)
        self._control: Any = None
        self._last, self._still = np.zeros(7), True

    def go_home(self, angle: Array) -> None:
        self._begin()
        for each in way(np.array(self._state.q_d), angle):
            self.send(each, np.zeros(7))
        self.close()
        input(READY)
        self._begin()

    def send(self, angle: Array, speed: Array) -> None:
        self._state, _ = self._control.readOnce()
        self._control.writeOnce(self._franka.JointPositions(angle.tolist()))
        self._last, self._still = angle, not speed.any()

    def read(self) -> Joints:
        return Joints(*(np.array(part) for part in (self._state.q, self._state.dq, self._state.tau_J)))

    def close(self) -> None:
        if self._control is not None and self._still:
            self._control.readOnce()
            end = self._franka.JointPositions(self._last.tolist())
            end.motion_finished = True
            self._control.writeOnce(end)
        elif self._control is not None:
            self._robot.stop()
        self._control = None

    def _begin(self) -> None:
        self._state = self._robot.read_once()
        self._last = np.array(self._state.q_d)
        self._control = self._robot.start_joint_position_control(self._franka.ControllerMode.JointImpedance)


def main(plan_file: str, address: str) -> None:
    """Execute a plan on the Franka Research 3 at an address, in open loop, and print how the pan followed."""
    execute_plan(plan_file, "fr3", lambda model, place: FrankaArm(address, model, place))


if __name__ == "__main__":
    run("franka.py", main)
