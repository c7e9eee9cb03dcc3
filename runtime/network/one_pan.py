"""The network for one pan, reading commands window by window: what it sees of a command, and when."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from runtime.command import Command
from runtime.documents.checks import FloatArray
from runtime.errors import BundleError, InputError
from runtime.network.bundle import Bundle, Float32Array, LstmState
from runtime.network.manifest import Manifest
from runtime.physics.pan import IN_PLANE


class Window(NamedTuple):
    """How much of a long command is read at once.

    A command as long as those trained on, or shorter, is one window. Of a longer one the encoder reads as much, and
    the next window begins `unread` chunks before the end of that, with the pan and the object where they are by then:
    the memory needed does not grow with the length, and the decoder never works past what it was trained for.

    Attributes:
        chunks: read at once; None for as many as the longest command trained on had.
        unread: chunks at the end of a window that are read and planned again with the next: where a command goes on,
            the network must not think it ends. Which number is best depends on the commands; 7 was never far from it.
    """

    chunks: int | None = None
    unread: int = 7

    def ends(self, first: int, count: int, manifest: Manifest) -> tuple[int, int]:
        """Return the chunk up to which `count` chunks are planned at once from chunk `first`, and up to which read."""
        trained = int(manifest.trained_on["samples"][1]) // manifest.one_pan.chunk
        most = max(self.unread + 1, trained if self.chunks is None else self.chunks)
        seen = min(count, first + most)
        return (count if seen == count else seen - self.unread), seen


class OnePanReader(NamedTuple):
    """B commands of equally many chunks, as far as they have been read; see `runtime.network.reader.Reader`.

    Attributes:
        bundle: the network.
        commands: what is read; past its end a command is held.
        window: how much is read at once.
        first, last: chunks between which the present window is planned.
        n: decoder iterations done in it.
        ahead: (B, chunks, 4C) the window as the network reads it.
        origin: (B, 1, 4) object states that positions are relative to.
        memory: what the decoder carries.
    """

    bundle: Bundle
    commands: Sequence[Command]
    window: Window
    first: int
    last: int
    n: int
    ahead: Float32Array
    origin: FloatArray
    memory: LstmState

    @classmethod
    def at(cls, bundle: Bundle, commands: Sequence[Command], first: int = 0, window: Window | None = None) -> Self:
        """Read commands from chunk `first` on."""
        window, manifest = window or Window(), bundle.manifest
        last, seen = window.ends(first, max(chunk_count(commands[0], manifest), first + 1), manifest)
        ahead = np.stack([_chunks(command, manifest, first, seen) for command in commands])
        origin = np.zeros((len(commands), 1, 4))
        origin[:, 0, :2] = [
            command.position[min(first * manifest.one_pan.chunk, len(command) - 1)] for command in commands
        ]
        memory = bundle.encode(ahead[:, : seen - first])
        return cls(bundle, commands, window, first, last, 0, ahead, origin, memory)

    @property
    def chunk(self) -> int:
        """Samples of an answer, C."""
        return self.bundle.manifest.one_pan.chunk

    @property
    def now(self) -> int:
        """The sample at which it is asked next."""
        return (self.first + self.n) * self.chunk

    def look(self, pan: FloatArray, sliding: FloatArray, last: FloatArray) -> tuple[FloatArray, Self]:
        """Ask for the next chunk; see `runtime.network.reader.Reader.look`.

        A network that plans for level pans sees nothing of the pan's height, and asks for none.
        """
        network, reader = self.bundle.manifest.one_pan, self
        if self.first + self.n == self.last < chunk_count(self.commands[0], self.bundle.manifest):
            reader = self.at(self.bundle, self.commands, self.last, self.window)
        seen = np.arange(reader.n, reader.n + network.command_ahead)
        command = reader.ahead[:, np.minimum(seen, reader.ahead.shape[1] - 1)]
        states = np.concatenate([pan[:, :, IN_PLANE], sliding - reader.origin], axis=2)
        observation = np.concatenate([states.reshape(len(pan), -1), command.reshape(len(pan), -1)], axis=1)
        u, memory = self.bundle.decode_step(observation.astype(np.float32), reader.memory)
        if not np.isfinite(u).all():
            name = self.bundle.manifest.name
            raise BundleError(f"the network of bundle {name!r} gave no finite number in iteration {reader.n}")
        asked = np.zeros((*u.shape[:2], 3))
        asked[..., :2] = u
        return asked, reader._replace(memory=memory)

    def after(self, samples: int) -> Self:
        """Go on after so many samples of the answer have been executed.

        Raises:
            InputError: not all of them have.
        """
        if samples != self.chunk:
            raise InputError(
                f"a network for one pan is asked again after all {self.chunk} samples of a chunk, not after {samples}"
            )
        return self._replace(n=self.n + 1)


def chunk_count(command: Command, manifest: Manifest) -> int:
    """Return the number of chunks the command fills, the last one maybe in part."""
    return -(-len(command) // manifest.one_pan.chunk)


def _chunks(command: Command, manifest: Manifest, first: int, last: int) -> Float32Array:
    """Lay chunks `first` to `last` of a command out as the network reads them.

    Returns:
        (chunks, 4C) rows x, y, vx, vy relative to the first position of chunk `first`; `command_ahead` chunks more
        than asked for. Past its end the command is held at rest.
    """
    chunk = manifest.one_pan.chunk
    part = slice(first * chunk, (last + manifest.one_pan.command_ahead) * chunk)
    position, velocity = command.position[part], command.velocity[part]
    samples = len(position)
    origin = command.position[min(part.start, len(command) - 1)]
    rows = np.zeros((part.stop - part.start, 4), dtype=np.float32)
    rows[:samples, :2] = position - origin
    rows[:samples, 2:] = velocity
    rows[samples:, :2] = command.position[-1] - origin
    return rows.reshape(-1, 4 * chunk)
