"""The decode loop: a command becomes pan accelerations, in closed loop with governor and law (Section II-C)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.network.bundle import Bundle
from runtime.network.job import Job
from runtime.network.lockstep import Lockstep
from runtime.network.reader import Reader, groups_of
from runtime.network.taps import compiled_taps
from runtime.physics.compiled import compiler
from runtime.physics.law import compiled_law, slide
from runtime.physics.motion import Motion
from runtime.safety.governor import compiled_governor, govern
from runtime.safety.pan import Pan


def decode(bundle: Bundle, jobs: Sequence[Job]) -> tuple[Motion, Sequence[Pan]]:
    """Decode B commands of one group (`group_of`), of n chunks, into the motions of their nC samples.

    The encoder reads a window of the commands, all of it unless they are long. Then, chunk by chunk, the decoder
    sees the C states its last C accelerations led to and asks for the next C accelerations; the governor makes them
    keep the limits, and they move the pan and, by the law of friction, the object. The network is float32, what
    moves is float64.

    Returns:
        The motions of the B jobs, and the pans at their ends.

    Raises:
        InputError: a pan cannot come to rest in its reach from its start.
        BundleError: an acceleration is no finite number.
    """
    frictions = [job.friction for job in jobs]
    samples = max(len(job.command) for job in jobs)
    pans: Sequence[Pan] = [Pan.at_start(job.start, job.limits) for job in jobs]
    pan = np.stack([job.start.pan_state() for job in jobs])[:, None]
    sliding = np.stack([job.start.object_state(job.command.position[0]) for job in jobs])[:, None]
    last = np.array([job.start.pan_acceleration for job in jobs])
    accelerations: list[FloatArray] = []
    askeds: list[FloatArray] = []
    pan_states, slidings = [pan], [sliding]
    reader = Reader.at(bundle, jobs)
    pan, sliding = (np.repeat(state, reader.chunk, axis=1) for state in (pan, sliding))  # it has been there

    while reader.now < samples:
        asked, reader = reader.look(pan, sliding, last)
        u, pan, pans = govern(pans, asked)
        sliding = slide(sliding[:, -1], u, frictions)
        reader, last = reader.after(reader.chunk), u[:, -1]
        for each, part in zip((accelerations, askeds, pan_states, slidings), (u, asked, pan, sliding), strict=True):
            each.append(part)
    parts = accelerations, askeds, pan_states, slidings
    return Motion(*(np.concatenate(each, axis=1) for each in parts)), pans


def decode_all(bundle: Bundle, jobs: Sequence[Job]) -> list[tuple[Motion, Pan]]:
    """Decode commands of any lengths: those of a group share the network's batch axis.

    Returns:
        Of each job, in their order, the motion and the pan at its end.

    Raises:
        InputError, BundleError: as `decode`.
    """
    lockstep = _lockstep  # which another thread may replace
    if lockstep is not None:
        return lockstep.decode(bundle, jobs)
    found: dict[int, tuple[Motion, Pan]] = {}
    for indices in groups_of(jobs):
        motions, pans = decode(bundle, [jobs[index] for index in indices])
        for row, index in enumerate(indices):
            found[index] = motions.one(row), pans[row]
    return [found[index] for index in range(len(jobs))]


def run_compiled(use: bool) -> None:
    """Let numba run the loop of `decode_all` from now on, in all of this process, or no longer.

    It does where it runs law, governor and taps already.
    """
    global _lockstep
    compile_one, parts = compiler() if use else None, (compiled_law(), compiled_governor(), compiled_taps())
    if compile_one is None or None in parts:
        _lockstep = None
        return
    _lockstep = Lockstep(compile_one, {name: each for part in parts if part for name, each in part.functions.items()})


_lockstep: Lockstep | None = None
