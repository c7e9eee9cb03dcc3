"""`slide-run PLAN --simulator`: checks what was asked for, executes the plan on the simulated arm, says how it went."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arm.controller import FULL_CONTROL, PAPER_CONTROL
from runtime.arm.events import Event
from runtime.arm.eyes import Camera, Eyes, LateArm, watching
from runtime.arm.film import check_ffmpeg, check_film, filming
from runtime.arm.geometry import OBJECT_RADIUS, PAN_RADIUS
from runtime.arm.interface import Measured
from runtime.arm.options import ArmOptions
from runtime.arm.results import Results, measured_track
from runtime.arm.run import Hook, Recording, Source, check_plan, closed_loop, execute, open_loop
from runtime.arm.simulated import Simulated, Simulator
from runtime.arm.simulation import SimulatedArm
from runtime.arms.check import JointCheck
from runtime.arms.description import ArmDescription
from runtime.arms.model import ArmModel
from runtime.arms.motion import follow_pan, passed
from runtime.arms.options import ArmChoice, choose
from runtime.arms.place import Place
from runtime.client import RemoteStream
from runtime.documents.checks import FloatArray
from runtime.documents.files import reading
from runtime.documents.writing import check_writable
from runtime.errors import InputError
from runtime.identify.log import write_log
from runtime.limits import Limits
from runtime.physics.law import DT
from runtime.plan import Plan
from runtime.planner import Planner
from runtime.report.report import write_report
from runtime.sizes import Sizes
from runtime.stream import Stream

LEAST_NOISE = 2e-4
"""Noise that a stream is told if its camera has less (m): the simulators' bodies rock by as much."""

Joints = tuple[ArmModel, Place]
"""An arm that was named, and where it holds the pan."""

SIMULATED_SIZES = Sizes(PAN_RADIUS, OBJECT_RADIUS)
"""Radii of the simulated pan and object."""


@dataclass(frozen=True)
class Outcome:
    """What a run gave.

    Attributes:
        plan: what was executed.
        results: its figures; None if it was interrupted before the first sample.
        notes: one line for each thing that was missed.
        remarks: one line for each thing worth knowing.
        rows: what else is to be shown, names and values.
        interrupted: whether it was stopped from the keyboard.
        document: the figures as a JSON document.
    """

    plan: Plan
    results: Results | None
    notes: list[str]
    remarks: list[str]
    rows: list[tuple[str, str]]
    interrupted: bool
    document: dict[str, Any]


def run_on_arm(
    plan_file: Path,
    options: ArmOptions,
    report: Path | None = None,
    choice: ArmChoice = ArmChoice(),
    hooks: Sequence[Hook] = (),
) -> Outcome:
    """Execute a plan on a simulated arm.

    Args:
        plan_file: the plan.
        options: what was asked for.
        report: page to write, or None.
        choice: which arm, and where it holds the pan; the paper's if none is named.
        hooks: called before each sample, after the events.

    Raises:
        InputError, FormatError: the plan cannot be executed, or an option is not usable.
        MissingExtraError: the simulator, or for a film ffmpeg or what renders, is not installed.
        OutputError: a result cannot be written.
    """
    _check_outputs(options, report)
    events = [Event.parse(text) for text in options.disturb]
    settings = _simulated(options)
    plan = Plan.load(plan_file)
    with reading(str(plan_file)):
        check_plan(plan)
    if options.friction is None:
        settings = replace(settings, friction=plan.friction.kinetic)
    joints = None if choice.arm is None else choose(choice)
    arm, loop = _arm(settings, joints), _Loop(options)
    hooks = [*(event.hook(arm.engine) for event in events), *hooks]
    with ExitStack() as stack:
        source, remarks = _source(plan, options, loop, joints, stack)
        remarks += _other_sizes(plan.sizes)
        recording = _execute(plan, arm, source, hooks, options)
    if options.log is not None and len(recording):
        write_log(options.log, recording.pan, loop.seen(recording))

    shares, passed_limits = _commanded(recording, joints)
    friction = None if events else arm.settings.friction
    results = Results.of(plan, recording, friction) if len(recording) else None
    if report is not None and len(recording):
        shown, track = measured_track(plan, recording, f"arm, {_loop(options)}")
        write_report(report, shown, [track])
    document = {
        "plan": str(plan_file),
        "simulator": arm.settings.simulator.value,
        "arm": arm.arm.name,
        "loop": _loop(options),
        "control": "paper" if options.paper_control else "feed-forward",
        "friction": arm.settings.friction,
        "eyes": None if loop.camera is None else asdict(loop.camera.eyes),
        "found": loop.found,
        "interrupted": recording.interrupted,
        "results": None if results is None else results.to_dict(),
        "limits": {} if results is None else _shares(results, arm.arm) | shares,
        "video": None if options.video is None else str(options.video),
        "report": None if report is None else str(report),
        "log": None if options.log is None else str(options.log),
    }
    notes = passed_limits if results is None else [*results.notes, *passed_limits]
    return Outcome(plan, results, notes, remarks, loop.rows, recording.interrupted, document)


class _Loop:
    """What closes the loop, and what it found.

    Attributes:
        camera: what sees the object; None if states are measured every sample, or the loop is open.
        stream: what follows, in closed loop without a server.
    """

    def __init__(self, options: ArmOptions) -> None:
        self.camera: Camera | None = None
        self.stream: Stream | None = None
        self._identifies = options.identify
        if options.sees:
            given = {
                name: value
                for name in ("camera_rate", "latency", "noise", "dropout", "command_delay", "seed")
                if (value := getattr(options, name)) is not None
            }
            self.camera = Camera(Eyes(**given))

    def seen(self, recording: Recording) -> FloatArray:
        """Return (n, 2) where the object was seen at each sample (m), NaN where it was not."""
        if self.camera is None:
            return recording.sliding[:, :2]
        seen = np.full((len(recording), 2), np.nan)
        for frame in self.camera.frames:
            if frame.taken < len(seen):
                seen[frame.taken] = frame.position
        return seen

    @property
    def found(self) -> dict[str, Any] | None:
        """Friction and delay that were found, as a JSON document; None if that was not asked for."""
        if not self._identifies or self.stream is None:
            return None
        friction, kinetic, static = self.stream.friction
        return {
            "friction": friction.to_dict(),
            "kinetic_interval": list(kinetic),
            "static_interval": list(static),
            "delay": self.stream.delay,
        }

    @property
    def rows(self) -> list[tuple[str, str]]:
        """The same as names and values."""
        if not self._identifies or self.stream is None:
            return []
        friction, kinetic, static = self.stream.friction
        delay = self.stream.delay
        return [
            ("kinetic friction found", f"{friction.kinetic:.3f}, from {kinetic[0]:.3f} to {kinetic[1]:.3f}"),
            ("static friction found", f"from {static[0]:.2f} to {static[1]:.2f}"),
            ("delay of the arm found", "not known" if delay is None else f"{delay * 1e3:.1f} ms"),
        ]


def _arm(settings: Simulated, joints: Joints | None) -> SimulatedArm:
    if joints is None:
        return SimulatedArm(settings)
    model, place = joints
    return SimulatedArm(settings, model.arm, place.home)


def _commanded(recording: Recording, joints: Joints | None) -> tuple[dict[str, float], list[str]]:
    """Return what the worst joint was commanded of its limits on acceleration and jerk, and a line for what was passed.

    A real arm stops where that is too much; a simulated one does not. Of a run cut short nothing is said.
    """
    if joints is None or recording.interrupted:
        return {}, []
    try:
        motion = follow_pan(*joints, recording.pan_command)
    except InputError as error:
        return {}, [str(error)]
    shares = {
        name: max(known)
        for name in ("acceleration", "jerk")
        if (known := [each.share for each in motion.peaks if each.quantity == name and each.share is not None])
    }
    return shares, [passed(motion.exceeded)] if motion.exceeded else []


def _shares(results: Results, arm: ArmDescription) -> dict[str, float]:
    """Return what the worst joint came to of its limits, by what they limit; those that are not known are left out."""
    shares = {}
    for name, peaks in (("torque", results.torque_peaks), ("speed", results.speed_peaks)):
        limit = arm.limit(name)
        if np.isfinite(limit).any():
            shares[name] = float((np.array(peaks) / limit).max())
    return shares


def _check_outputs(options: ArmOptions, report: Path | None) -> None:
    if report is not None:
        check_writable(report)
    if options.video is not None:
        check_film(options.video)
        check_writable(options.video)
        check_ffmpeg(options.simulator or Simulator.PYBULLET)
    if options.gui:
        _check_display()
    if options.model is not None and options.server is not None:
        raise InputError("--model and --server: the server has a model of its own")
    if options.log is not None:
        check_writable(options.log)
    if options.sees and (options.server is not None or not options.closed_loop):
        raise InputError("--camera-rate, --latency, --dropout and --identify need --closed-loop without --server")
    if options.model is not None and not options.closed_loop:
        raise InputError("--model needs --closed-loop: open loop, the plan alone moves the pan")


def _check_display() -> None:
    """Check that a window can be opened: where it cannot, the simulators would end the process.

    Raises:
        InputError: there is no display.
    """
    if not sys.platform.startswith("linux"):
        return
    name = os.environ.get("DISPLAY")
    if not name:
        raise InputError("--gui needs a display: DISPLAY is not set")
    library = ctypes.util.find_library("X11")
    if library is None:
        return
    x11 = ctypes.CDLL(library)
    x11.XOpenDisplay.restype = ctypes.c_void_p
    display = x11.XOpenDisplay(None)
    if not display:
        raise InputError(f"--gui needs a display: DISPLAY is {name!r}, which does not open")
    x11.XCloseDisplay(ctypes.c_void_p(display))


def _simulated(options: ArmOptions) -> Simulated:
    given = {
        name: value
        for name in ("simulator", "friction", "object_mass", "noise", "seed")
        if (value := getattr(options, name)) is not None and not (name == "noise" and options.sees)
    }
    control = PAPER_CONTROL if options.paper_control else FULL_CONTROL
    return Simulated(control=control, gui=options.gui, **given)


def _other_sizes(sizes: Sizes) -> list[str]:
    """Return a line if the plan was made for another pan or object than the simulated ones."""
    if sizes == SIMULATED_SIZES:
        return []
    return [
        f"the plan is for a pan and an object of radius {sizes.pan_radius:g} and {sizes.object_radius:g} m, the "
        f"simulated ones have {SIMULATED_SIZES.pan_radius:g} and {SIMULATED_SIZES.object_radius:g} m"
    ]


def _loop(options: ArmOptions) -> str:
    if options.server is not None:
        return "closed loop through a server"
    return "closed loop" if options.closed_loop else "open loop"


def _source(
    plan: Plan, options: ArmOptions, loop: _Loop, joints: Joints | None, stack: ExitStack
) -> tuple[Source, list[str]]:
    """Return what moves the pan, and what is to be said of it; what must be closed is left to the stack.

    In closed loop the network keeps to what the plan was made for: its friction, its limits, its sizes, and to what
    the joints can do where they are known.
    """
    held = plan.quality.limits
    limits = None if held["pan_reach"] is None else Limits.from_dict(held)
    if options.server is not None:
        token = os.environ.get("SLIDE_TOKEN")  # a command line is seen by everyone on the machine
        remote = stack.enter_context(
            RemoteStream(options.server, plan.command_position, plan.friction, limits=limits, token=token)
        )
        remarks = _other(plan, remote.model["name"], remote.model["sha256"])
        if joints is not None:
            remarks.append("a server knows no joints: it keeps to the pan's limits alone")
        return closed_loop(remote, remote.chunk, len(plan)), remarks
    if not options.closed_loop:
        return open_loop(plan), []
    planner = Planner(options.model)
    stream = loop.stream = planner.stream(
        plan.command_position,
        plan.friction,
        limits=limits,
        sizes=plan.sizes,
        command_delay=options.command_delay or 0.0,
        noise=max(options.noise or 0.0, LEAST_NOISE),
        check=None if joints is None else JointCheck(*joints),
    )
    remarks = _other(plan, planner.bundle.manifest.name, planner.bundle.sha256)
    if loop.camera is not None:
        return watching(stream, loop.camera, stream.chunk, len(plan)), remarks
    return closed_loop(stream, stream.chunk, len(plan)), remarks


def _other(plan: Plan, name: str, sha256: str) -> list[str]:
    """Return what is to be said if another model decodes than made the plan."""
    if sha256 == plan.model_sha256:
        return []
    return [f"closed loop with model {name!r}, the plan was made by {plan.model_name!r}"]


def _execute(plan: Plan, arm: SimulatedArm, source: Source, hooks: Sequence[Hook], options: ArmOptions) -> Recording:
    with ExitStack() as stack:
        if options.video is not None:
            camera = arm.camera(plan.command_position)
            hooks = [*hooks, stack.enter_context(filming(options.video, camera))]
        if options.gui:
            hooks = [*hooks, _real_time()]
        return execute(plan, LateArm(arm, options.command_delay or 0.0), source, hooks)


def _real_time() -> Hook:
    """Wait, before each sample, until its time has come."""
    begin: list[float] = []

    def hook(k: int, measured: Measured) -> None:
        if not begin:
            begin.append(time.perf_counter())
        time.sleep(max(0.0, begin[0] + k * DT - time.perf_counter()))

    return hook
