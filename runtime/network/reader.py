"""Networks of either kind, reading commands: what a decode loop or a stream asks them by."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Protocol, Self

from runtime.documents.checks import FloatArray
from runtime.limits import Limits
from runtime.network.bundle import Bundle
from runtime.network.general import GeneralReader, chunk_of, time_of
from runtime.network.job import Job
from runtime.network.manifest import Manifest, OnePan
from runtime.network.one_pan import OnePanReader, Window, chunk_count


class Reader(Protocol):
    """B commands as far as they have been read; a value, which neither `look` nor `after` changes."""

    @property
    def now(self) -> int:
        """The sample of the commands at which the network is asked next."""

    @property
    def chunk(self) -> int:
        """Samples of an answer, C."""

    def look(self, pan: FloatArray, sliding: FloatArray, last: FloatArray) -> tuple[FloatArray, Self]:
        """Ask for the next chunk.

        Args:
            pan: (B, C, 6) the last C pan states relative to the centre of the reach (m, m/s).
            sliding: (B, C, 4) the last C object states relative to the pan (m, m/s).
            last: (B, 3) the pans' accelerations over the sample before (m/s^2).

        Returns:
            (B, C, 3) pan accelerations (m/s^2), and the reader that remembers the question.

        Raises:
            BundleError: an acceleration is no finite number.
        """

    def after(self, samples: int) -> Self:
        """Go on after so many samples of the answer have been executed.

        Raises:
            InputError: the network cannot be asked then.
        """


def read(bundle: Bundle, jobs: Sequence[Job], now: int = 0, window: Window | None = None) -> Reader:
    """Read the commands of jobs that are of one group (`group_of`).

    Args:
        bundle: the network.
        jobs: what is to be planned.
        now: the sample from which to read; a network for one pan begins at the next whole chunk.
        window: how much a network for one pan reads at once.
    """
    network = bundle.manifest.network
    if isinstance(network, OnePan):
        return OnePanReader.at(bundle, [job.command for job in jobs], -(-now // network.chunk), window)
    return GeneralReader.at(bundle, jobs, now)


def group_of(manifest: Manifest, job: Job) -> Hashable:
    """Return what jobs must have in common to be decoded together: as many questions, of equal length."""
    if isinstance(manifest.network, OnePan):
        return chunk_count(job.command, manifest)
    step = time_of(job.limits, job.reach_used)
    return step, -(-len(job.command) // chunk_of(step))


def chunk_samples(manifest: Manifest, limits: Limits) -> int:
    """Return the samples of an answer, C."""
    network = manifest.network
    return network.chunk if isinstance(network, OnePan) else chunk_of(time_of(limits))
