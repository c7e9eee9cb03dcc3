"""The decode loop: a command becomes pan accelerations, in closed loop with governor and law (Section II-C)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from runtime.command import Command
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.network.bundle import Bundle
from runtime.network.manifest import DEFAULT_SIZES
from runtime.network.reader import Reader, Window, chunk_count, held_still
from runtime.physics.law import slide
from runtime.physics.motion import Motion
from runtime.safety.governor import govern
from runtime.safety.pan import Pan
from runtime.sizes import Sizes
from runtime.start import Start


class Job(NamedTuple):
    """One command to be planned: where the object should be, on what, within what, from where, and on which pan."""

    command: Command
    friction: Friction
    limits: Limits
    start: Start
    sizes: Sizes = DEFAULT_SIZES


def decode(bundle: Bundle, jobs: Sequence[Job], window: Window | None = None) -> tuple[Motion, list[Pan]]:
    """Decode B commands of equally many chunks, n, into the motions of their nC samples.

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
    commands, frictions = [job.command for job in jobs], [job.friction for job in jobs]
    pans = [Pan.at_start(job.start, job.limits) for job in jobs]
    pan = np.stack([job.start.pan_state() for job in jobs])[:, None]
    sliding = np.stack([job.start.object_state(job.command.position[0]) for job in jobs])[:, None]
    accelerations: list[FloatArray] = []
    askeds: list[FloatArray] = []
    pan_states, slidings = [pan], [sliding]
    pan, sliding = (held_still(state, bundle.manifest) for state in (pan, sliding))

    reader = Reader.at(bundle, commands, window=window)
    for _ in range(chunk_count(commands[0], bundle.manifest)):
        asked, reader = reader.look(pan, sliding)
        u, pan, pans = govern(pans, asked)
        sliding = slide(sliding[:, -1], u, frictions)
        for each, part in zip((accelerations, askeds, pan_states, slidings), (u, asked, pan, sliding), strict=True):
            each.append(part)
    parts = accelerations, askeds, pan_states, slidings
    return Motion(*(np.concatenate(each, axis=1) for each in parts)), pans
