"""What is to be said of a run: how well pan and object followed, and what was missed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

import numpy as np

from runtime.arm.interface import ObjectStatus
from runtime.arm.run import Recording
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import DT, GRAVITY, slide_one
from runtime.physics.motion import tracking_error
from runtime.plan import Plan
from runtime.report.report import Track

MM = 1e3
"""Millimetres in a metre."""

LEAST_LIFT = -0.99 * GRAVITY
"""Vertical acceleration (m/s^2) from which on the law is asked: below, the object has no weight on the pan."""

LOST = {ObjectStatus.TOPPLED: "toppled", ObjectStatus.OFF_PAN: "left the pan"}
"""What the object did that is on the pan no more."""

PLAN_ARRAYS = (
    "command_position",
    "pan_acceleration",
    "pan_velocity",
    "pan_position",
    "object_velocity",
    "object_position",
)


@dataclass(frozen=True)
class Results:
    """Figures of one run over the plan's K samples; what became of the object, peaks and limits over the tail too.

    Attributes:
        samples: K, or fewer if the run was interrupted.
        pan_rms, pan_max: distance between the pan's centre and its command (m).
        height_max: its largest vertical part (m).
        tilt_max: largest deviation of the pan's attitude (rad).
        object_rms, object_max: distance between object and command (m).
        plan_rms: distance between object and the plan's prediction, root mean square (m).
        law_rms: distance between object and the law of friction under the simulator's friction, driven by the
            measured pan acceleration, root mean square (m); None if the friction is not known.
        lost: what became of an object that did not stay upright on the pan; None if it did.
        lost_at: when (s).
        torque_peaks: (n,) largest torque of each joint (N m).
        speed_peaks: (n,) largest speed of each joint (rad/s).
        limits: what held the arm back, and over how many samples.
        real_time_factor: simulated time over the time it took.
    """

    samples: int
    pan_rms: float
    pan_max: float
    height_max: float
    tilt_max: float
    object_rms: float
    object_max: float
    plan_rms: float
    law_rms: float | None
    lost: ObjectStatus | None
    lost_at: float | None
    torque_peaks: tuple[float, ...]
    speed_peaks: tuple[float, ...]
    limits: Mapping[str, int]
    real_time_factor: float

    @classmethod
    def of(cls, plan: Plan, recording: Recording, friction: float | None) -> Self:
        """Work out a run's figures.

        Args:
            plan: what was executed.
            recording: what was measured; at least one sample.
            friction: coefficient in the simulator, static and kinetic alike; None if it changed or something pushed.
        """
        samples = min(len(plan), len(recording))
        pan, sliding = recording.pan[:samples], recording.sliding[:samples]
        off = pan[:, :3] - recording.pan_command[:samples, :3]
        distance = np.linalg.norm(off, axis=1)
        object_rms, object_max = tracking_error(sliding[:, :2], plan.command_position[:samples])
        measured = recording.measured
        lost = next((k for k, each in enumerate(measured) if each.status is not ObjectStatus.ON_PAN), None)
        return cls(
            samples=samples,
            pan_rms=float(np.sqrt(np.mean(distance * distance))),
            pan_max=float(distance.max()),
            height_max=float(np.abs(off[:, 2]).max()),
            tilt_max=max(each.tilt for each in measured[:samples]),
            object_rms=object_rms,
            object_max=object_max,
            plan_rms=tracking_error(sliding[:, :2], plan.object_position[:samples])[0],
            law_rms=None if friction is None else _law_rms(pan, sliding, friction),
            lost=None if lost is None else measured[lost].status,
            lost_at=None if lost is None else lost * DT,
            torque_peaks=_peaks([each.torque for each in measured]),
            speed_peaks=_peaks([each.joint_velocity for each in measured]),
            limits=dict(Counter(name for each in measured for name in each.limits)),
            real_time_factor=len(recording) * DT / recording.duration,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as a JSON document, SI units throughout."""
        return {**asdict(self), "lost": None if self.lost is None else self.lost.value, "limits": dict(self.limits)}

    @property
    def notes(self) -> list[str]:
        """One line for each thing that was missed."""
        notes = [] if self.lost is None else [f"the object {LOST[self.lost]} at {self.lost_at:.3f} s"]
        if self.limits:
            longest = max(self.limits.values())
            names = ", ".join(sorted(self.limits))
            notes.append(f"the arm was held back for {longest} sample{'s'[: longest != 1]} or more by: {names}")
        return notes

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Return the figures as a table of names and values."""
        law = "not known" if self.law_rms is None else f"{self.law_rms * MM:.2f} mm RMS"
        kept = "yes" if self.lost is None else f"no, it {LOST[self.lost]} at {self.lost_at:.3f} s"
        return [
            ("pan tracking", f"{self.pan_rms * MM:.3f} mm RMS, {self.pan_max * MM:.3f} mm at most"),
            ("pan height, attitude", f"{self.height_max * MM:.3f} mm, {np.degrees(self.tilt_max):.3f} deg at most"),
            ("object to command", f"{self.object_rms * MM:.2f} mm RMS, {self.object_max * MM:.2f} mm at most"),
            ("object to the plan's prediction", f"{self.plan_rms * MM:.2f} mm RMS"),
            ("object to the law of friction", law),
            ("object stayed on the pan", kept),
            ("peak torques", f"{', '.join(f'{peak:.0f}' for peak in self.torque_peaks)} N m"),
            ("peak joint speeds", f"{', '.join(f'{peak:.1f}' for peak in self.speed_peaks)} rad/s"),
            ("real-time factor", f"{self.real_time_factor:.2f}"),
        ]


def _law_rms(pan: FloatArray, sliding: FloatArray, friction: float) -> float:
    acceleration = np.diff(pan[:, 3:], axis=0) / DT
    acceleration[:, 2] = np.maximum(acceleration[:, 2], LEAST_LIFT)
    law = slide_one(sliding[0], acceleration, Friction(friction, friction))
    return tracking_error(sliding[1:, :2], law[:, :2])[0] if len(law) else 0.0


def _peaks(values: list[FloatArray]) -> tuple[float, ...]:
    return tuple(float(peak) for peak in np.abs(values).max(axis=0))


def measured_track(plan: Plan, recording: Recording, name: str) -> tuple[Plan, Track]:
    """Return what a report shows of a run; of a run cut short, the plan is cut to what was recorded.

    Args:
        plan: what was executed.
        recording: what was measured.
        name: what the legend calls it.
    """
    samples = min(len(plan), len(recording))
    pan, sliding = recording.pan[:samples], recording.sliding[:samples]
    if samples < len(plan):
        plan = replace(plan, **{array: getattr(plan, array)[:samples] for array in PLAN_ARRAYS})
    return plan, Track(name, sliding[:, :2], sliding[:, 2:], pan[:, :3])
