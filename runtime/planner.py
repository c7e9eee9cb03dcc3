"""The planner: what a bundle is used through, for one command, many, or one that is followed as it is measured."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from os import PathLike
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from runtime.assess.assess import assess
from runtime.assess.several import SEVERAL, follows_badly
from runtime.assess.sureness import friction_off_errors, friction_range
from runtime.assess.training_range import beyond_training
from runtime.command import Command
from runtime.documents.checks import number
from runtime.errors import InputError
from runtime.following.tighten import Check
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.network.bundle import SHIPPED, Bundle
from runtime.network.decode import decode_all
from runtime.network.job import Job
from runtime.network.reach import with_reach
from runtime.network.reader import chunk_samples
from runtime.physics.compiled import check_compiler
from runtime.physics.motion import Motion, tracking_error
from runtime.plan import Plan
from runtime.refine.candidates import best_candidate, better_candidate
from runtime.refine.refine import ROBUST, Effort, kernels, refine
from runtime.safety.pan import Pan
from runtime.safety.rest import stop_after
from runtime.sizes import Sizes
from runtime.start import Start
from runtime.stream import OBJECT_NOISE, REST_TOLERANCE, Stream

DEFAULT_BUNDLE = SHIPPED / "default"
"""The bundle that plans where none is named."""

MOST_CANDIDATES = 256

MOST_EFFORT = {"refine_ms": 600_000.0, "refine_iterations": 100_000.0}
"""Most that a plan is refined: ten minutes, far beyond what gains anything."""

WARM_UP = 200
"""Samples of a plan that is made when a planner is built: so the first plan is as fast as the tenth."""

AT_REST = Start()

Value = TypeVar("Value", Friction, Limits, Start, Sizes)


class Planner:
    """Plans with one bundle; may be used from several threads, and handed to other processes: see `Bundle`.

    Args:
        path: the bundle's folder, the name of a shipped one, or hf://user/name for one on the Hugging Face hub;
            `default` if None.
        sha256: what the sha256 of its manifest must be; any if None.

    Attributes:
        bundle: the loaded bundle.

    Raises:
        BundleError: the bundle cannot be trusted or understood.
    """

    def __init__(self, path: str | PathLike[str] | None = None, *, sha256: str | None = None) -> None:
        self.bundle = Bundle.load(DEFAULT_BUNDLE if path is None else path, sha256)
        self.plan(np.zeros((WARM_UP, 2)))

    def __repr__(self) -> str:
        return f"<Planner with {self.bundle.manifest.name} from {self.bundle.path}>"

    def plan(
        self,
        position: Command | ArrayLike,
        friction: Friction | None = None,
        *,
        limits: Limits | None = None,
        start: Start | None = None,
        sizes: Sizes | None = None,
        tolerance: float | None = None,
        candidates: int | None = None,
        robust: float | None = None,
        refine_ms: float | None = None,
        refine_iterations: int | None = None,
    ) -> Plan:
        """Plan the pan's motion for one command.

        Args:
            position: a Command, or (K, 2) positions of the object relative to the pan (m) at 1 kHz.
            friction: coefficients; the manifest's if None.
            limits: what holds at every sample, all of it finite but the speed; the manifest's if None.
            start: where pan and object are; at rest, the pan in the middle, the object on its mark, if None.
            sizes: radii of pan and object, for what is off the pan; the manifest's if None.
            tolerance: tracking RMSE (m) that the plan is held against, also under other friction; see `FrictionRange`.
            candidates: how many plans to make, of the command turned and mirrored, and to keep the best of, by the law.
                If None, SEVERAL of `runtime.assess.several` where the one plan of a command of up to about 4 s is bad
                (`follows_badly`) or the plan is refined, 1 elsewhere; `quality.notes` says so if another plan was kept.
            robust: share by which the friction may be off, to judge candidates and refinement by: by the mean over
                the friction planned for and the four with each coefficient lower or higher by as much. 0 judges by
                the friction planned for alone. If None, 0 for candidates, and ROBUST of `runtime.refine.refine` where
                a plan is refined: what is made better under one friction alone is worse under any other.
            refine_ms: time (ms) to spend on making the plan better, the candidates not counted; see `runtime.refine`.
                The first call compiles, which takes seconds and does not count.
            refine_iterations: steps to take instead, which gives the same plan each time. Without numba a step takes
                a tenth of a second or more instead of a millisecond.

        Returns:
            The plan, K rows, by the time line of `runtime.plan`.

        Raises:
            InputError: the command, the friction, the limits or the tolerance is not usable, or the pan cannot come
                to rest within its limits from the start.
            MissingExtraError: refine_ms without numba.
            BundleError: the network gave a value that is no finite number.
        """
        job = Job(_command(position), *self._defaults(friction, limits, start, sizes))
        share = _share(robust)
        effort = _effort(refine_ms, refine_iterations, ROBUST if share is None else share)
        count = _candidates(candidates, 1 if effort is None else SEVERAL)
        held = _tolerance(tolerance)
        job = with_reach(job)
        judged = effort.robust if effort is not None else share or 0.0
        motion, ahead = best_candidate(self.bundle, job, count, judged)
        remarks: tuple[str, ...] = ()
        if effort is not None:
            motion, ahead = self._refined(job, motion, effort) or (motion, ahead)
        elif candidates is None:
            motion, ahead, remarks = self._better_if_bad(job, motion, ahead, judged)
        return self._plan(job, motion, ahead, held, remarks=remarks)

    def plan_batch(
        self,
        positions: Iterable[Command | ArrayLike],
        friction: Friction | Sequence[Friction] | None = None,
        *,
        limits: Limits | Sequence[Limits] | None = None,
        start: Start | Sequence[Start] | None = None,
        sizes: Sizes | Sequence[Sizes] | None = None,
        tolerance: float | None = None,
    ) -> list[Plan]:
        """Plan for many commands at once, each once: those with equally many chunks share the network's batch axis.

        Args:
            positions: commands or position arrays, as for `plan`; lengths may differ.
            friction, limits, start, sizes: as for `plan`, one for all or one for each.
            tolerance: as for `plan`.

        Returns:
            The plans, in the order of the commands. A bad one is not made better: `plan(candidates=None)` does that.

        Raises:
            InputError: as for `plan`; a command is named by its index.
            BundleError: the network gave a value that is no finite number.
        """
        commands = []
        for index, position in enumerate(positions):
            try:
                commands.append(_command(position))
            except InputError as error:
                raise InputError(f"command {index}: {error}", ("positions", index, *error.place[1:])) from error
        each = zip(
            _one_for_each(friction, "friction", len(commands)),
            _one_for_each(limits, "limits", len(commands)),
            _one_for_each(start, "start", len(commands)),
            _one_for_each(sizes, "sizes", len(commands)),
            strict=True,
        )
        jobs = [Job(command, *self._defaults(*one)) for command, one in zip(commands, each, strict=True)]
        held = _tolerance(tolerance)
        jobs = [with_reach(job) for job in jobs]
        decoded = decode_all(self.bundle, jobs)
        errors = friction_off_errors(
            [motion for motion, _ in decoded], [job.command.position for job in jobs], [job.friction for job in jobs]
        )
        return [self._plan(job, *one, held, error) for job, one, error in zip(jobs, decoded, errors, strict=True)]

    def stream(
        self,
        position: Command | ArrayLike,
        friction: Friction | None = None,
        *,
        limits: Limits | None = None,
        start: Start | None = None,
        sizes: Sizes | None = None,
        tolerance: float | None = None,
        command_delay: float | None = 0.0,
        noise: float = OBJECT_NOISE,
        every: int | None = None,
        check: Check | None = None,
        search: bool = True,
    ) -> Stream:
        """Start to follow a command with a controller that measures; see `Stream`.

        Args:
            position, friction, limits, start, sizes: as for `plan`; the friction is what motion is predicted with.
            tolerance: distance of the object from its mark (m) up to which the pan rests past the end of the command;
                REST_TOLERANCE of `runtime.stream` if None.
            command_delay: time from a command to its execution (s); None to use what the encoders tell of it.
            noise: standard deviation of the positions that `Stream.see_object` is told (m).
            every: samples after which `Stream.due` asks for the next chunk; the whole chunk if None.
            check: tells what the arm comes to along a motion, so that its joints hold too; see `Stream`.
            search: search for the kinetic friction by a particle filter, which takes 5 % of a core.

        Raises:
            InputError: as for `plan`.
        """
        job = Job(_command(position), *self._defaults(friction, limits, start, sizes))
        mark = _tolerance(tolerance) or REST_TOLERANCE
        return Stream(self.bundle, job, mark, command_delay, noise, every, check, search)

    def _defaults(
        self, friction: Friction | None, limits: Limits | None, start: Start | None, sizes: Sizes | None
    ) -> tuple[Friction, Limits, Start, Sizes]:
        """Put the manifest's values in the place of None.

        Raises:
            InputError: a value is of another type, or there are no limits.
        """
        manifest = self.bundle.manifest
        within = _value(limits, manifest.limits, "limits")
        if not within.finite:
            raise InputError(f"{manifest.name} plans within finite limits, and there are none", "limits")
        return (
            _value(friction, manifest.friction, "friction"),
            within,
            _value(start, AT_REST, "start"),
            _value(sizes, manifest.sizes, "sizes"),
        )

    def _better_if_bad(
        self, job: Job, motion: Motion, ahead: Pan, robust: float
    ) -> tuple[Motion, Pan, tuple[str, ...]]:
        """Return the best of SEVERAL plans where the one plan is bad, with a remark; that one elsewhere."""
        command = job.command.position
        rmse, _ = tracking_error(motion.sliding[: len(command), :2], command)
        if not follows_badly(rmse, motion.sliding[0], command, job.friction, job.limits):
            return motion, ahead, ()
        better = better_candidate(self.bundle, job, (motion, ahead), SEVERAL, robust)
        if better is None:
            return motion, ahead, ()
        remark = f"the best of {SEVERAL} plans: that of the command as it is has a tracking RMSE of {rmse:.4g} m"
        return *better, (remark,)

    def _refined(self, job: Job, motion: Motion, effort: Effort) -> tuple[Motion, Pan] | None:
        """Return one command's motion refined and the pan at its end, None if that makes it no better."""
        return refine(
            motion.acceleration[: len(job.command)],
            Pan.at_start(job.start, job.limits),
            motion.sliding[0],
            job.command.position,
            job.friction,
            chunk_samples(job.limits),
            effort,
        )

    def _plan(
        self,
        job: Job,
        motion: Motion,
        ahead: Pan,
        tolerance: float | None,
        friction_off_rmse: float | None = None,
        remarks: tuple[str, ...] = (),
    ) -> Plan:
        """Cut a motion back to the command's K samples, bring it to rest, and judge it.

        Args:
            job: what was planned.
            motion: K samples, or more.
            ahead: the pan at its end.
            tolerance: as for `plan`.
            friction_off_rmse: as for `assess`.
            remarks: what else is to be said of it.
        """
        manifest, command, samples = self.bundle.manifest, job.command.position, len(job.command)
        stop = stop_after(motion, samples, ahead, command[-1], job.friction)
        motion = motion.first(samples)
        quality = assess(
            motion,
            stop,
            command,
            job.friction,
            job.limits,
            job.sizes,
            np.array(job.start.pan_acceleration),
            None
            if tolerance is None
            else friction_range(motion, command, job.friction, tolerance, manifest.trained_on),
            beyond_training(manifest, job),
            remarks=(*remarks, *job.command.remarks, *job.command.notes),
            friction_off_rmse=friction_off_rmse,
        )
        return Plan.of(motion, stop, command, job.friction, quality, manifest.name, self.bundle.sha256, job.sizes)


def _command(position: Command | ArrayLike) -> Command:
    return position if isinstance(position, Command) else Command.from_samples(position)


def _value(given: Value | None, default: Value, name: str) -> Value:
    if given is not None and not isinstance(given, type(default)):
        raise InputError(f"{name} must be a {type(default).__name__}, got {given!r}", name)
    return default if given is None else given


def _one_for_each(given: Value | Sequence[Value] | None, name: str, count: int) -> Sequence[Value | None]:
    if not isinstance(given, Sequence):
        return [given] * count
    if len(given) != count:
        raise InputError(f"{name} must be one for all or one for each: {len(given)} for {count}", name)
    return given


def _candidates(given: int | None, default: int) -> int:
    if given is None:
        return default
    count = number(given, "candidates")
    if not 1 <= count <= MOST_CANDIDATES or count != int(count):
        raise InputError(f"candidates must be a whole number from 1 to {MOST_CANDIDATES}, got {count:g}", "candidates")
    return int(count)


def _share(robust: float | None) -> float | None:
    if robust is None:
        return None
    share = number(robust, "robust")
    if not 0.0 <= share < 1.0:
        raise InputError(f"robust must be a share of the friction from 0 to less than 1, got {share:g}", "robust")
    return share


def _effort(milliseconds: float | None, iterations: int | None, robust: float) -> Effort | None:
    """Return how long to refine, None for not at all; loads what it takes, so that the time begins to count after.

    Raises:
        InputError: both are given, or one is negative, too large, no number or not whole.
        MissingExtraError: a time is given, and numba is not installed: without it nothing would come of it.
    """
    if milliseconds is None and iterations is None:
        return None
    if milliseconds is not None and iterations is not None:
        raise InputError("give refine_ms or refine_iterations, not both")
    name, value = ("refine_ms", milliseconds) if iterations is None else ("refine_iterations", iterations)
    amount = number(value, name)
    if not 0.0 <= amount <= MOST_EFFORT[name]:
        raise InputError(f"{name} must be between 0 and {MOST_EFFORT[name]:g}, got {amount:g}", name)
    if iterations is not None and amount != int(amount):
        raise InputError(f"refine_iterations must be a whole number, got {amount:g}", name)
    if iterations is None:
        check_compiler()
    kernels()
    return Effort(amount * 1e-3, None, robust) if iterations is None else Effort(0.0, int(amount), robust)


def _tolerance(tolerance: float | None) -> float | None:
    if tolerance is None:
        return None
    value = number(tolerance, "tolerance")
    if value <= 0.0:
        raise InputError(f"tolerance must be greater than 0 m, got {value:g} m", "tolerance")
    return value
