"""The network beside two sampling optimizers, on the same commands in the same run."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from benchmarks.harness.section import NAME, Measured, Section, Subject, at_least
from benchmarks.harness.tables import table, targets_table
from benchmarks.harness.targets import TIMES, Target, Verdict
from benchmarks.harness.timing import one_torch_thread
from benchmarks.suite import pans
from benchmarks.suite.families import spline
from benchmarks.suite.outcome import PAN_REACH, Outcome, PlanFunction, one_by_one, plan_family
from benchmarks.suite.pans import WAYS, Task, cannot_slide, tasks
from benchmarks.suite.suite import FAMILIES, suite
from runtime.cli.console import MM, say
from runtime.documents.checks import FloatArray
from runtime.documents.options import option
from runtime.errors import MissingExtraError, extra
from runtime.friction import Friction
from runtime.planner import Planner

if TYPE_CHECKING:  # numba compiles it
    from benchmarks.peers.objective import SamplingPlanner

PROBE = 400
"""Samples of the command by which a planner's speed is estimated; the first ones, nearly at rest, cost less."""

SOFT = PAN_REACH / 0.2
"""Times its limit up to which a pan counts as within its reach: the optimizers' limit is a price."""

FEW = 3
"""Commands of a task within the limits of a pan, unless said: an optimizer takes seconds for each."""

DEFAULT_FAMILIES = tuple(name for name in FAMILIES if name != "friction")


MOST_OF_OPTIMIZER = {("panda_100_50_shapes", "level"): 0.8, ("panda_100_50_stops", "level"): 0.8}
"""Share of the optimizer's error that the network's should come to at most, by tasks and ways."""


@dataclass(frozen=True)
class PeersSettings:
    """What is planned, and how much effort the optimizers spend.

    Attributes:
        family: names of the families.
        commands: the first ones of each family; all if None. Within limits so many, spread over each family; FEW if
            None.
        candidates: drawn in an iteration.
        iterations: in a planning.
        no_mppi: leave path integral control out.
        limits: names of pans, whose tasks (`benchmarks.suite.pans`) are planned in the place of the suite.
    """

    family: tuple[str, ...] = option("Family of the suite, or letters; may be repeated.", DEFAULT_FAMILIES, "NAME")
    commands: int | None = option("Only the first commands of each family.", metavar="N")
    candidates: int = option("The optimizers' candidates in an iteration.", 512, "N")
    iterations: int = option("The optimizers' iterations in a planning.", 20, "N")
    no_mppi: bool = option("Leave out path integral control (pytorch-mppi).", False)
    limits: tuple[str, ...] = option("Only within the limits of this pan; may be repeated.", (), "NAME|all")

    def __post_init__(self) -> None:
        at_least(1, commands=self.commands, iterations=self.iterations)
        at_least(8, candidates=self.candidates)


@dataclass(frozen=True)
class Row:
    """One planner on one family.

    Lengths are in metres, `cpu` in seconds of processor time per plan, `times` that over the network's on the same
    commands, `speed` in samples per second of processor time.
    """

    family: str
    planner: str
    commands: int
    tracking_mean: float
    tracking_max: float
    pan_reach_max: float
    within: float
    change_mean: float
    cpu: float
    times: float
    speed: float


@dataclass(frozen=True)
class Peers:
    """Everything this section measures.

    Attributes:
        rows: family by family; of each, the network comes first.
        ratios: the network's mean tracking RMSE over that of the cross-entropy optimizer, by the names of tasks, for
            level pans and those that lift; empty where no limits are named.
    """

    rows: tuple[Row, ...]
    ratios: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


TARGETS = tuple(
    Target(f"ratios.{task.name}.{way}", f"{task.title}, {way}, over CEM", TIMES, comparison, limit)
    for task in pans.TASKS
    for way in WAYS
    for limit in (MOST_OF_OPTIMIZER.get((task.name, way)),)
    for comparison in ("" if limit is None else "<=",)
)
"""What is only shown is judged by the tracking error itself: see `accuracy`."""


def measure_peers(subject: Subject, settings: PeersSettings) -> Measured:
    """Plan the same commands with the network, which is not told the friction, and with optimizers, which are.

    Raises:
        InputError: there is no family of that name.
        MissingExtraError: numba is not installed.
    """
    if settings.limits:
        return within_limits(subject.planner, settings)
    families = list(suite(settings.family, settings.commands).values())
    effort = settings.candidates, settings.iterations
    planners: dict[str, PlanFunction] = {subject.planner.bundle.manifest.name: one_by_one(subject.planner)}
    notes = []
    with extra("refine"):
        from benchmarks.peers.cross_entropy import CrossEntropy
    planners[CrossEntropy(*effort).name] = CrossEntropy(*effort)
    with ExitStack() as stack:
        try:
            if not settings.no_mppi:
                with extra("dev"):
                    from benchmarks.peers.mppi import PathIntegral
                stack.enter_context(one_torch_thread())
                planners[PathIntegral(*effort).name] = PathIntegral(*effort)
        except MissingExtraError as error:
            notes.append(f"path integral control is left out: {error}")
        samples = sum(len(position) for each in families for position in each.positions)
        cost = {name: samples * seconds_per_sample(plan) for name, plan in planners.items()}
        say(NAME, f"peers: about {sum(cost.values()) / 60.0:.1f} minutes of one core: {_shares(cost)}")
        rows: list[Row] = []
        for each in families:
            network = 0.0
            for name, plan in planners.items():
                say(NAME, f"peers: {each.name}, {len(each)} commands: {name}")
                timed = Timed(plan)
                outcome = plan_family(timed, each)
                network = network or timed.cpu  # the network is the first
                rows.append(summary(name, outcome, timed.cpu, network))
    return Measured(Peers(tuple(rows)), notes)


def within_limits(planner: Planner, settings: PeersSettings) -> Measured:
    """Plan the tasks of pans with the network and with optimizers, all of them within the same limits.

    Raises:
        InputError: there is no pan of that name.
        MissingExtraError: numba, or for path integral control its library, is not installed.
    """
    effort = {"candidates": settings.candidates, "iterations": settings.iterations}
    with extra("refine"):
        from benchmarks.peers.cross_entropy import CrossEntropy
    kinds: list[type[SamplingPlanner]] = [CrossEntropy]
    if not settings.no_mppi:
        with extra("dev"):
            from benchmarks.peers.mppi import PathIntegral
        kinds.append(PathIntegral)
    rows: list[Row] = []
    ratios: dict[str, dict[str, float]] = {}
    with one_torch_thread():
        for level in tasks(settings.limits, settings.family):
            ratios[level.name] = {}
            for way, task in zip(WAYS, (level, level.lifting()), strict=True):
                if cannot_slide(task):
                    continue
                first = len(rows)
                network = network_within(planner, task)
                planners = {planner.bundle.manifest.name: network}
                peers = [kind(limits=task.limits, **effort) for kind in kinds]
                planners |= {peer.name: peer for peer in peers}
                own = 0.0
                for name, plan in planners.items():
                    say(NAME, f"peers: {title_of(task)}: {name}")
                    rows.append(row_within(task, name, plan, settings.commands or FEW, own))
                    own = own or rows[-1].cpu
                ratios[level.name][way] = rows[first].tracking_mean / rows[first + 1].tracking_mean
    return Measured(Peers(tuple(rows), ratios))


def title_of(task: Task) -> str:
    """Return what a task is called for a person, and whether its pan lifts."""
    return task.title if task.limits.level else f"{task.title}, lifting"


def network_within(planner: Planner, task: Task) -> PlanFunction:
    """Return the network as a plan function within a task's limits, one command at a time."""

    def plan(positions: Sequence[FloatArray], frictions: Sequence[Friction]) -> list[FloatArray]:
        return [
            planner.plan(position, friction, limits=task.limits).pan_acceleration
            for position, friction in zip(positions, frictions, strict=True)
        ]

    return plan


def row_within(task: Task, name: str, plan: PlanFunction, commands: int | None, network: float) -> Row:
    """Plan a task's commands and sum up what they lead to; `network` is the network's time per plan, 0 for its own."""
    positions = task.positions(commands)
    plan([positions[0][:PROBE]], [task.friction])  # what is compiled is compiled
    timed = Timed(plan)
    planned = timed(positions, [task.friction] * len(positions))
    each = [pans.summary([position], [u], task.friction) for position, u in zip(positions, planned, strict=True)]
    cpu = timed.cpu / len(positions)
    return Row(
        family=title_of(task),
        planner=name,
        commands=len(positions),
        tracking_mean=float(np.mean([found.tracking_mean for found in each])),
        tracking_max=max(found.tracking_max for found in each),
        pan_reach_max=max(found.pan_reach for found in each),
        within=float(np.mean([found.pan_reach <= SOFT * task.limits.pan_reach for found in each])),
        change_mean=float(np.mean([np.linalg.norm(np.diff(u, axis=0), axis=1).mean() for u in planned])),
        cpu=cpu,
        times=cpu / (network or cpu),
        speed=sum(map(len, positions)) / timed.cpu,
    )


def seconds_per_sample(plan: PlanFunction) -> float:
    """Let a planner compile and warm up, and return what planning a sample takes then (s of processor time)."""
    position = spline().positions[0][:PROBE]
    plan([position], [Friction()])
    timed = Timed(plan)
    timed([position], [Friction()])
    return timed.cpu / PROBE


def _shares(cost: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {seconds:.0f} s" for name, seconds in cost.items())


class Timed:
    """A planner whose processor time is counted, in `cpu` (s)."""

    def __init__(self, plan: PlanFunction) -> None:
        self._plan = plan
        self.cpu = 0.0

    def __call__(self, positions: Sequence[FloatArray], frictions: Sequence[Friction]) -> Sequence[FloatArray]:
        """Plan as the planner does."""
        begin = time.process_time()
        plans = self._plan(positions, frictions)
        self.cpu += time.process_time() - begin
        return plans


def summary(planner: str, outcome: Outcome, cpu: float, network: float) -> Row:
    """Sum up a planner's outcome on a family; it took `cpu` (s of processor time), the network `network`."""
    count = len(outcome.tracking)
    return Row(
        family=outcome.family.name,
        planner=planner,
        commands=count,
        tracking_mean=float(outcome.tracking.mean()),
        tracking_max=float(outcome.tracking.max()),
        pan_reach_max=float(outcome.pan_reach.max()),
        within=float(np.mean(outcome.pan_reach <= PAN_REACH)),
        change_mean=float(outcome.change_mean.mean()),
        cpu=cpu / count,
        times=cpu / network,
        speed=sum(map(len, outcome.family.positions)) / cpu,
    )


def peers_tables(peers: Peers, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the planners, family by family."""
    header = ("family", "planner", "n", "RMSE", "worst", "reach", "|du|", "ms", "times", "samples/s")
    lines = [
        (
            row.family,
            row.planner.split()[0],
            f"{row.commands}",
            f"{row.tracking_mean * MM:.2f}",
            f"{row.tracking_max * MM:.2f}",
            f"{row.pan_reach_max * MM:.0f}",
            f"{row.change_mean:.2f}",
            f"{row.cpu * 1e3:.0f}",
            f"{row.times:.0f}",
            f"{row.speed:,.0f}",
        )
        for row in peers.rows
    ]
    # The optimizers' settings, part of their names, would make the table too wide; the command was told them.
    title = "RMSE, worst RMSE, worst pan reach (mm); processor time a plan, times the network's, samples per s of it"
    return [table(title, header, lines), *(targets_table("Peers", verdicts) if verdicts else [])]


SECTION = Section(
    "peers",
    "the network beside two optimizers that are told the friction; some minutes",
    PeersSettings(),
    measure_peers,
    TARGETS,
    peers_tables,
    timed=True,
    usual=False,
)
