"""The network beside two sampling optimizers, on the same commands in the same run."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from benchmarks.harness.section import NAME, Measured, Section, Subject, at_least
from benchmarks.harness.tables import table
from benchmarks.harness.targets import Verdict
from benchmarks.harness.timing import one_torch_thread
from benchmarks.suite.families import spline
from benchmarks.suite.outcome import PAN_REACH, Outcome, PlanFunction, one_by_one, plan_family
from benchmarks.suite.suite import FAMILIES, suite
from runtime.cli.console import MM, say
from runtime.documents.checks import FloatArray
from runtime.documents.options import option
from runtime.errors import MissingExtraError, extra
from runtime.friction import Friction

PROBE = 400
"""Samples of the command by which a planner's speed is estimated; the first ones, nearly at rest, cost less."""

DEFAULT_FAMILIES = tuple(name for name in FAMILIES if name != "friction")


@dataclass(frozen=True)
class PeersSettings:
    """What is planned, and how much effort the optimizers spend.

    Attributes:
        family: names of the families.
        commands: the first ones of each family; all if None.
        candidates: drawn in an iteration.
        iterations: in a planning.
        no_mppi: leave path integral control out.
    """

    family: tuple[str, ...] = option("Family of the suite, or letters; may be repeated.", DEFAULT_FAMILIES, "NAME")
    commands: int | None = option("Only the first commands of each family.", metavar="N")
    candidates: int = option("The optimizers' candidates in an iteration.", 512, "N")
    iterations: int = option("The optimizers' iterations in a planning.", 20, "N")
    no_mppi: bool = option("Leave out path integral control (pytorch-mppi).", False)

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
    """Everything this section measures, family by family; of each, the network comes first."""

    rows: tuple[Row, ...]


def measure_peers(subject: Subject, settings: PeersSettings) -> Measured:
    """Plan the same commands with the network, which is not told the friction, and with optimizers, which are.

    Raises:
        InputError: there is no family of that name.
        MissingExtraError: numba is not installed.
    """
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
    return [table(title, header, lines)]


SECTION = Section(
    "peers",
    "the network beside two optimizers that are told the friction; some minutes",
    PeersSettings(),
    measure_peers,
    (),
    peers_tables,
    timed=True,
    usual=False,
)
