"""Executes a plan on whatever arm a ROS 2 joint trajectory controller moves, through rosbridge.

    pip install roslibpy './[mujoco]'
    ros2 launch rosbridge_server rosbridge_websocket_launch.xml
    python examples/ros2.py plan.json localhost ur5e

UNTESTED ON HARDWARE: it was run against a stand-in with roslibpy 2.1's signatures and timing. Keep the stop button at
hand, and begin with a slow, small plan. Every 10 ms the controller gets the point it is to be at 10 ms later, which
replaces the one before; its parameter `allow_nonzero_velocity_at_trajectory_end` must be true. Where open loop is
enough, the whole motion as one message is better: `slide-joints plan.json --arm ur5e -o joints.json`.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arm.joint_arm import JointArm, Joints, See, driver, execute_plan, way
from runtime.arms.model import ArmModel
from runtime.arms.place import Place
from runtime.cli.console import run

Array = NDArray[np.float64]

CONTROLLER = "/joint_trajectory_controller/joint_trajectory"
STATES = "/joint_states"
WAITING = 5.0
"""Longest time for the first joint states to come (s)."""

READY = "Put the object onto the pan where the command begins, then press Enter: "


class TrajectoryController(JointArm):
    """A joint trajectory controller through roslibpy; this computer's clock paces the loop."""

    period = 10

    def __init__(self, host: str, model: ArmModel, place: Place, see: See | None = None, port: int = 9090) -> None:
        super().__init__(model, place, see)
        self._roslibpy = driver("roslibpy", "roslibpy")
        self.connection = self._roslibpy.Ros(host, port)
        self.connection.run(WAITING)
        self._points = self._roslibpy.Topic(self.connection, CONTROLLER, "trajectory_msgs/msg/JointTrajectory")
        self._states = self._roslibpy.Topic(self.connection, STATES, "sensor_msgs/msg/JointState")
        self._heard: Joints | None = None
        self._next = 0.0
        self._states.subscribe(self._hear)

    def go_home(self, angle: Array) -> None:
        seconds = 1e-3 * sum(1 for _ in way(self.read().angle, angle))
        self._publish(angle, np.zeros(len(angle)), seconds)
        time.sleep(seconds)
        input(READY)
        self._next = time.monotonic()

    def send(self, angle: Array, speed: Array) -> None:
        self._publish(angle, speed, 1e-3 * self.period)
        self._next += 1e-3 * self.period
        time.sleep(max(0.0, self._next - time.monotonic()))

    def read(self) -> Joints:
        end = time.monotonic() + WAITING
        while self._heard is None:
            if time.monotonic() > end:
                raise TimeoutError(f"no message on {STATES} for {WAITING:g} s")
            time.sleep(0.01)
        return self._heard

    def close(self) -> None:
        if self.connection.is_connected:
            self._states.unsubscribe()
            self.connection.terminate()

    def _hear(self, message: Any) -> None:
        order = [message["name"].index(name) for name in self.model.arm.joint_names]
        parts = (message.get(part) or [0.0] * len(message["name"]) for part in ("position", "velocity", "effort"))
        self._heard = Joints(*(np.array(part)[order] for part in parts))

    def _publish(self, angle: Array, speed: Array, seconds: float) -> None:
        whole = int(seconds)
        point = {
            "positions": angle.tolist(),
            "velocities": speed.tolist(),
            "time_from_start": {"sec": whole, "nanosec": round(1e9 * (seconds - whole))},
        }
        names = list(self.model.arm.joint_names)
        self._points.publish(self._roslibpy.Message({"joint_names": names, "points": [point]}))


def main(plan_file: str, host: str, arm: str) -> None:
    """Execute a plan on an arm (a name, or a file) behind the rosbridge of a host, and print how the pan followed."""
    execute_plan(plan_file, arm, lambda model, place: TrajectoryController(host, model, place))


if __name__ == "__main__":
    run("ros2.py", main)
