"""Joint motions as files: CSV, JSON in the fields of ROS 2's trajectory_msgs/JointTrajectory, and MCAP.

An MCAP file has that message and the poses of pan and object (extra `ros`).
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arms.motion import JointMotion
from runtime.documents.checks import FloatArray
from runtime.errors import OutputError, extra
from runtime.physics.law import DT

NANOSECONDS = 1_000_000_000
BASE_FRAME = "base"
"""Name of the arm's base frame, in which poses are told."""

TRAJECTORY_TOPIC, PAN_TOPIC, OBJECT_TOPIC = "/joint_trajectory", "/pan", "/object"

_TIME = "int32 sec\nuint32 nanosec"
_HEADER = "builtin_interfaces/Time stamp\nstring frame_id"
_LINE = "=" * 80
TRAJECTORY_DEFINITION = f"""std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint[] points
{_LINE}
MSG: std_msgs/Header
{_HEADER}
{_LINE}
MSG: builtin_interfaces/Time
{_TIME}
{_LINE}
MSG: builtin_interfaces/Duration
{_TIME}
{_LINE}
MSG: trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start"""
"""The message trajectory_msgs/msg/JointTrajectory and those it is made of, as ROS 2 writes definitions."""

POSE_DEFINITION = f"""std_msgs/Header header
geometry_msgs/Pose pose
{_LINE}
MSG: std_msgs/Header
{_HEADER}
{_LINE}
MSG: builtin_interfaces/Time
{_TIME}
{_LINE}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{_LINE}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{_LINE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w"""
"""The message geometry_msgs/msg/PoseStamped and those it is made of."""


def format_of(path: Path) -> Callable[[JointMotion, FloatArray], bytes]:
    """Return what writes a file of this suffix: given the joints and (n, 2) object positions on the pan (m).

    Raises:
        OutputError: no such format.
    """
    try:
        return FORMATS[path.suffix.lower()]
    except KeyError:
        known = ", ".join(FORMATS)
        raise OutputError(f"{path}: joints are written as {known}, got the suffix {path.suffix!r}") from None


def to_csv(motion: JointMotion, sliding: FloatArray) -> bytes:
    """Return a table: t (s), then q1.. (rad), qd1.. (rad/s) and qdd1.. (rad/s^2), a row for each sample of 1 ms."""
    names = [f"{kind}{joint + 1}" for kind in ("q", "qd", "qdd") for joint in range(len(motion.arm))]
    text = io.StringIO()
    text.write(",".join(["t", *names]) + "\n")
    rows = np.column_stack([motion.time, motion.angle, motion.speed, motion.acceleration])
    for row in rows.tolist():
        text.write(",".join([f"{row[0]:.3f}", *map(repr, row[1:])]) + "\n")
    return text.getvalue().encode("ascii")


def to_json(motion: JointMotion, sliding: FloatArray) -> bytes:
    """Return a JointTrajectory as JSON, its keys the fields of the ROS 2 message."""
    return json.dumps(_trajectory(motion), allow_nan=False).encode("ascii")


def to_mcap(motion: JointMotion, sliding: FloatArray) -> bytes:
    """Return an MCAP recording: the JointTrajectory at time 0, and every 1 ms the poses of pan and object.

    Raises:
        MissingExtraError: mcap-ros2-support is not installed.
    """
    with extra("ros"):
        from mcap_ros2.writer import Writer
    file = io.BytesIO()
    with Writer(file) as writer:
        trajectory = writer.register_msgdef("trajectory_msgs/msg/JointTrajectory", TRAJECTORY_DEFINITION)
        stamped = writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE_DEFINITION)
        writer.write_message(TRAJECTORY_TOPIC, trajectory, _trajectory(motion), 0, 0)
        rotation, heading = motion.place.rotation, 0.5 * motion.place.heading
        attitude = {"x": 0.0, "y": 0.0, "z": math.sin(heading), "w": math.cos(heading)}
        on_pan = motion.pan + sliding @ rotation[:, :2].T
        for k in range(len(motion)):
            time = _nanoseconds(k)
            for topic, place in ((PAN_TOPIC, motion.pan[k]), (OBJECT_TOPIC, on_pan[k])):
                pose = {"position": dict(zip("xyz", place.tolist(), strict=True)), "orientation": attitude}
                writer.write_message(topic, stamped, {"header": _header(k), "pose": pose}, time, time)
    return file.getvalue()


FORMATS: Mapping[str, Callable[[JointMotion, FloatArray], bytes]] = {
    ".csv": to_csv,
    ".json": to_json,
    ".mcap": to_mcap,
}


def _trajectory(motion: JointMotion) -> dict[str, Any]:
    rows = zip(motion.angle.tolist(), motion.speed.tolist(), motion.acceleration.tolist(), strict=True)
    return {
        "header": _header(0),
        "joint_names": list(motion.arm.joint_names),
        "points": [
            {
                "positions": angle,
                "velocities": speed,
                "accelerations": acceleration,
                "effort": [],
                "time_from_start": _stamp(k),
            }
            for k, (angle, speed, acceleration) in enumerate(rows)
        ],
    }


def _header(k: int) -> dict[str, Any]:
    return {"stamp": _stamp(k), "frame_id": BASE_FRAME}


def _stamp(k: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(_nanoseconds(k), NANOSECONDS)
    return {"sec": seconds, "nanosec": nanoseconds}


def _nanoseconds(k: int) -> int:
    return k * round(DT * NANOSECONDS)
