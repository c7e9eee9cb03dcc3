"""The examples for real arms, against stand-ins that have their drivers' signatures and timing.

The signatures were read off pylibfranka 0.21.3, ur-rtde 1.6.5 and roslibpy 2.1.0.
"""

from __future__ import annotations

import runpy
import sys
from collections import UserDict
from collections.abc import Callable, Sequence
from datetime import timedelta
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

pytest.importorskip("mujoco")

from runtime import Friction, InputError, Plan
from runtime.arm.joint_arm import check_joints, way
from runtime.arm.run import execute, open_loop
from runtime.arms.load import load_arm
from runtime.arms.options import ArmChoice, choose
from runtime.interrupt import INTERRUPTED

from .conftest import EXAMPLES

SAMPLES = 400
Example = Callable[[str], ModuleType]


def gentle(peak: float = 1.5) -> Plan:
    """A plan that moves the pan to and fro and ends at rest; its jerk is small."""
    t = np.arange(SAMPLES) / SAMPLES
    u = peak * (np.sin(2.0 * np.pi * t) * np.sin(np.pi * t) ** 2)[:, None] * (1.0, 0.5)
    return Plan.of_accelerations(u, Friction(0.5, 0.5), "gentle")


@pytest.fixture(autouse=True)
def pressed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Somebody who puts the object onto the pan and presses Enter; gives what was asked of them."""
    asked: list[str] = []
    monkeypatch.setattr("builtins.input", lambda text="": asked.append(text) or "")
    return asked


class Franka:
    """The robot behind pylibfranka: it refuses what the real one refuses of a motion, and follows one cycle late."""

    TORQUES, FORCES = 7, 6
    LIMITS: ClassVar = [load_arm("fr3").limit(name) for name in ("speed", "acceleration", "jerk")]

    def __init__(self, robot_ip_address: str, realtime_config: object = None) -> None:
        home = load_arm("fr3").home
        assert home is not None
        self.q = np.array(home) + 0.05
        self.commands = [self.q] * 4
        self.to_write, self.running, self.finished, self.stopped = False, False, 0, False
        self.thresholds: list[Sequence[float]] = []

    def set_collision_behavior(
        self,
        lower_torque_thresholds: Sequence[float],
        upper_torque_thresholds: Sequence[float],
        lower_force_thresholds: Sequence[float],
        upper_force_thresholds: Sequence[float],
    ) -> None:
        assert [len(lower_torque_thresholds), len(upper_torque_thresholds)] == [7, 7]
        assert [len(lower_force_thresholds), len(upper_force_thresholds)] == [6, 6]

    def read_once(self) -> SimpleNamespace:
        assert not self.running, "libfranka refuses to read beside a control loop"
        return self.state()

    def state(self) -> SimpleNamespace:
        speed = (self.commands[-2] - self.commands[-3]) / 1e-3
        q, q_d = self.commands[-2].tolist(), self.commands[-1].tolist()
        return SimpleNamespace(q=q, q_d=q_d, dq=speed.tolist(), tau_J=[0.0] * 7)

    def start_joint_position_control(self, control_type: object) -> Franka:
        assert control_type == "joint impedance"
        assert not self.running
        self.running = True
        return self

    def readOnce(self) -> tuple[SimpleNamespace, SimpleNamespace]:
        assert self.running
        assert not self.to_write, "each cycle is read once and written once"
        self.to_write = True
        return self.state(), SimpleNamespace(to_sec=lambda: 1e-3)

    def writeOnce(self, command: JointPositions) -> None:
        assert self.to_write
        self.to_write = False
        self.commands.append(np.array(command.q))
        for order, limit in enumerate(self.LIMITS, 1):
            change = np.diff(self.commands[-5:], order, axis=0)[-1] / 1e-3**order
            assert (np.abs(change) <= limit + 1e-9).all(), f"reflex: derivative {order} of joint positions"
        if command.motion_finished:
            assert np.abs(self.commands[-1] - self.commands[-2]).max() < 1e-9, "finished while it moved"
            self.running, self.finished = False, self.finished + 1

    def stop(self) -> None:
        self.running, self.stopped = False, True


class JointPositions:
    """As pylibfranka's."""

    def __init__(self, q: Sequence[float]) -> None:
        assert len(q) == 7
        self.q, self.motion_finished = list(q), False


@pytest.fixture
def franka(monkeypatch: pytest.MonkeyPatch) -> list[Franka]:
    """The stand-in for pylibfranka; gives the robots that were connected to."""
    robots: list[Franka] = []

    def robot(*arguments: Any) -> Franka:
        robots.append(Franka(*arguments))
        return robots[-1]

    module = SimpleNamespace(
        Robot=robot, JointPositions=JointPositions, ControllerMode=SimpleNamespace(JointImpedance="joint impedance")
    )
    monkeypatch.setitem(sys.modules, "pylibfranka", module)
    return robots


def test_a_franka_gets_every_millisecond_what_it_accepts(
    example: Example, franka: list[Franka], pressed: list[str]
) -> None:
    plan, (model, place) = gentle(), choose(ArmChoice(arm="fr3"))
    check_joints(model, place, plan)
    recording = execute(plan, example("franka").FrankaArm("172.16.0.2", model, place), open_loop(plan))
    (robot,) = franka
    assert len(pressed) == 1, "the object is put down before the plan begins"
    assert robot.finished == 2, "the way home, and the plan"
    assert robot.commands[-1] == pytest.approx(robot.commands[-2])
    assert recording.pan[3:SAMPLES, :3] == pytest.approx(recording.pan_command[1 : SAMPLES - 2, :3], abs=2e-5)
    assert recording.pan[3:SAMPLES, 3:] == pytest.approx(recording.pan_command[1 : SAMPLES - 2, 3:], abs=5e-3)
    assert max(each.tilt for each in recording.measured) < 1e-6


def test_a_franka_that_is_let_go_while_it_moves_is_stopped(example: Example, franka: list[Franka]) -> None:
    plan, (model, place) = gentle(), choose(ArmChoice(arm="fr3"))

    def press_ctrl_c(k: int, measured: object) -> None:
        if k == 150:
            raise KeyboardInterrupt

    arm = example("franka").FrankaArm("172.16.0.2", model, place)
    assert execute(plan, arm, open_loop(plan), [press_ctrl_c]).interrupted
    assert franka[0].stopped
    arm.close()


def test_a_plan_beyond_an_arms_limits_is_refused_before_anything_moves(
    example: Example, franka: list[Franka], tmp_path: Path
) -> None:
    path = tmp_path / "plan.json"
    gentle(25.0).save(path)
    with pytest.raises(InputError, match=r"of fr3_joint[1-7] comes to .* its limit is .*slide-joints shows them all"):
        example("franka").main(str(path), "172.16.0.2")
    assert not franka


def as_typed(monkeypatch: pytest.MonkeyPatch, script: str, *arguments: str) -> int:
    """Run an example as `python examples/SCRIPT ...` does; return its exit code."""
    monkeypatch.setattr(sys, "argv", [script, *arguments])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(EXAMPLES / script), run_name="__main__")
    return int(ended.value.code or 0)


@pytest.mark.parametrize("script", ["franka.py", "universal_robots.py", "ros2.py"])
def test_a_script_executes_a_plan_and_says_how_the_pan_followed(
    script: str,
    franka: list[Franka],
    urs: list[Ur],
    slept: list[float],
    pressed: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    path = tmp_path / "plan.json"
    gentle().save(path)
    more = ("ur5e",) if script == "ros2.py" else ()
    assert as_typed(monkeypatch, script, str(path), "192.168.0.10", *more) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert [line.partition(":")[0] for line in out.splitlines()] == ["pan tracking", "pan height, attitude"]
    assert len(pressed) == 1


@pytest.mark.parametrize("script", ["franka.py", "universal_robots.py", "ros2.py"])
def test_a_script_tells_what_is_wrong_in_a_line(
    script: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "plan.json"
    gentle().save(path)
    more = ("ur5e",) if script == "ros2.py" else ()
    for driver in ("pylibfranka", "rtde_control", "rtde_receive", "roslibpy"):
        monkeypatch.setitem(sys.modules, driver, None)
    for plan, message in (
        (str(path), "is not installed: pip install"),
        (str(tmp_path / "none.json"), "cannot be read: No such file or directory"),
    ):
        assert as_typed(monkeypatch, script, plan, "192.168.0.10", *more) == 2
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        assert err.startswith(f"{script}: error: ")
        assert message in err


def test_a_script_that_is_stopped_before_the_plan_begins_says_nothing_of_it(
    franka: list[Franka], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def press_ctrl_c(text: str = "") -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr("builtins.input", press_ctrl_c)
    path = tmp_path / "plan.json"
    gentle().save(path)
    assert as_typed(monkeypatch, "franka.py", str(path), "192.168.0.10") == INTERRUPTED
    assert capsys.readouterr() == ("", "")
    assert franka[0].finished == 1, "the way home"


class Ur:
    """Both interfaces of ur-rtde, and the robot behind them."""

    def __init__(self, hostname: str, frequency: float = -1.0) -> None:
        assert frequency == 500.0
        self.log: list[str] = []
        self.q = [np.zeros(6)]

    def moveJ(self, q: list[float], speed: float = 1.05, acceleration: float = 1.4, asynchronous: bool = False) -> bool:
        self.log.append("moveJ")
        self.q = [np.array(q)] * 2
        return True

    def servoJ(
        self, q: list[float], speed: float, acceleration: float, time: float, lookahead_time: float, gain: float
    ) -> bool:
        assert (len(q), time) == (6, 0.002)
        assert 0.03 <= lookahead_time <= 0.2
        assert 100 <= gain <= 2000
        self.log.append("servoJ")
        self.q.append(np.array(q))
        return True

    def initPeriod(self) -> timedelta:
        self.log.append("initPeriod")
        return timedelta(seconds=0.002 * len(self.log))

    def waitPeriod(self, t_cycle_start: timedelta) -> None:
        assert isinstance(t_cycle_start, timedelta)
        self.log.append("waitPeriod")

    def servoStop(self, a: float = 10.0) -> bool:
        self.log.append("servoStop")
        return True

    def stopScript(self) -> None:
        self.log.append("stopScript")

    def disconnect(self) -> None:
        self.log.append("disconnect")

    def getActualQ(self) -> list[float]:
        return list(self.q[-1].tolist())

    def getActualQd(self) -> list[float]:
        return list(((self.q[-1] - self.q[-2]) / 0.002).tolist())

    def getTargetMoment(self) -> list[float]:
        return [0.0] * 6


@pytest.fixture
def urs(monkeypatch: pytest.MonkeyPatch) -> list[Ur]:
    """The stand-in for ur-rtde; gives the robots that were connected to."""
    robots: list[Ur] = []

    def connect(*arguments: Any) -> Ur:
        robots.extend([] if robots else [Ur(*arguments)])
        return robots[0]

    monkeypatch.setitem(sys.modules, "rtde_control", SimpleNamespace(RTDEControlInterface=connect))
    monkeypatch.setitem(sys.modules, "rtde_receive", SimpleNamespace(RTDEReceiveInterface=connect))
    return robots


def test_a_ur_gets_a_point_every_two_milliseconds(example: Example, urs: list[Ur], pressed: list[str]) -> None:
    plan, (model, place) = gentle(), choose(ArmChoice(arm="ur5e"))
    recording = execute(plan, example("universal_robots").UniversalRobot("ur", model, place), open_loop(plan))
    (robot,) = urs
    assert (robot.log[0], robot.log[-4:]) == ("moveJ", ["servoStop", "stopScript", "disconnect", "disconnect"])
    points = robot.log[1:-4]
    assert points == ["initPeriod", "servoJ", "waitPeriod"] * (len(points) // 3)
    assert len(points) // 3 == -(-len(recording) // 2)
    assert len(pressed) == 1
    # After an even number of steps the robot is where it was told to be at the end of its 2 ms.
    assert recording.pan[2:SAMPLES:2, :3] == pytest.approx(recording.pan_command[2:SAMPLES:2, :3], abs=2e-5)


class Ros:
    """roslibpy's connection, topics and messages, and a controller that is at each point at its time."""

    def __init__(self, host: str, port: int | None = None) -> None:
        self.topics: dict[str, Topic] = {}
        self.points: list[Any] = []
        self.is_connected = False

    def run(self, timeout: float = 10.0) -> None:
        self.is_connected = True

    def terminate(self) -> None:
        self.is_connected = False


class Topic:
    """As roslibpy's; the joint states come in another order than the arm's joints, and beside a gripper's."""

    def __init__(self, ros: Ros, name: str, message_type: str) -> None:
        self.ros, self.callback = ros, print
        ros.topics[name] = self
        assert message_type in ("trajectory_msgs/msg/JointTrajectory", "sensor_msgs/msg/JointState")

    def subscribe(self, callback: Callable[[Any], None]) -> None:
        self.callback = callback
        names = load_arm("ur5e").joint_names
        self.tell(names, np.zeros(6), np.zeros(6))

    def unsubscribe(self) -> None:
        self.callback = print

    def publish(self, message: UserDict[str, Any]) -> None:
        (point,) = message["points"]
        assert set(point["time_from_start"]) == {"sec", "nanosec"}
        assert 0 <= point["time_from_start"]["nanosec"] < 10**9
        self.ros.points.append(point)
        self.ros.topics["/joint_states"].tell(message["joint_names"], point["positions"], point["velocities"])

    def tell(self, names: Sequence[str], position: Any, velocity: Any) -> None:
        order = [*range(len(names))][::-1]
        rows = {"position": position, "velocity": velocity}
        message = {key: [9.0, *(float(value[index]) for index in order)] for key, value in rows.items()}
        self.callback(UserDict({"name": ["finger", *(names[index] for index in order)], **message, "effort": []}))


@pytest.fixture
def slept(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The stand-in for roslibpy; gives how long was slept (s)."""
    monkeypatch.setitem(sys.modules, "roslibpy", SimpleNamespace(Ros=Ros, Topic=Topic, Message=UserDict))
    times: list[float] = []
    monkeypatch.setattr("time.sleep", times.append)
    return times


def test_a_trajectory_controller_gets_a_point_every_ten_milliseconds(
    example: Example, slept: list[float], pressed: list[str]
) -> None:
    plan, (model, place) = gentle(), choose(ArmChoice(arm="ur5e"))
    arm = example("ros2").TrajectoryController("localhost", model, place)
    ros = arm.connection
    recording = execute(plan, arm, open_loop(plan))
    home, *points = ros.points
    assert home["positions"] == pytest.approx(place.home)
    assert home["time_from_start"]["sec"] >= 5, "slowly"
    assert len(points) == -(-len(recording) // 10)
    assert {(each["time_from_start"]["sec"], each["time_from_start"]["nanosec"]) for each in points} == {(0, 10**7)}
    assert max(slept[1:]) <= 0.01 * len(points)
    assert not ros.is_connected
    assert len(pressed) == 1
    # After 10 steps the arm is where it was told to be, to what the acceleration changes meanwhile.
    assert recording.pan[10:SAMPLES:10, :3] == pytest.approx(recording.pan_command[10:SAMPLES:10, :3], abs=2e-5)
    assert recording.pan[10:SAMPLES:10, 3:] == pytest.approx(recording.pan_command[10:SAMPLES:10, 3:], abs=5e-3)


def test_the_way_home_is_slow_and_begins_and_ends_at_rest() -> None:
    begin, end = np.zeros(7), np.array([0.5, -1.0, 0.0, 0.2, 0.0, 0.0, 0.0])
    path = np.array([begin, *way(begin, end)])
    assert path[-1] == pytest.approx(end)
    speed = np.diff(path, axis=0) / 1e-3
    assert np.abs(speed).max() == pytest.approx(0.3, rel=0.01)
    assert np.abs(speed[[0, -1]]).max() < 1e-4
