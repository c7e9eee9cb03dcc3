"""What the server and the processes beside it say to each other, and how it travels.

A message is pickled, which is safe between programs that are one. Before it goes its length, and the length of the
bytes that follow it: a plan travels beside its message, for to pickle it would copy it three times more. A job that was
read by one process goes to the other as it came: the server only looks at what it must know of it.
"""

from __future__ import annotations

import pickle
import socket
import struct
import threading
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from runtime import Command, Friction, InputError, Limits, Reading, Sizes, Start
from runtime.documents.checks import FloatArray
from runtime.network.manifest import Manifest
from runtime.physics.law import DT
from server.planning.bounds import SHORT_CHUNKS
from server.problems import Problem

LENGTHS = struct.Struct("<QQ")
"""Lengths (bytes) of a message and of what follows it."""

BUFFER = 1 << 20
"""Bytes that may wait between the processes, as far as the system allows: about three plans."""

PIECE = 1 << 16
"""Bytes of a plan that the server handles at a time: what it reads, copies and sends in one go is soon done."""

Lane = Literal["short", "long"]
"""Which jobs: those of a few chunks that can be planned together, or all others. Each lane is planned in a thread of
its own."""

LANES: tuple[Lane, Lane] = "short", "long"


class PlannerOptions(NamedTuple):
    """What the planning process plans with; its first message.

    Attributes:
        model: the bundle's folder; the shipped one if None.
        sha256: what the bundle must have.
        compile: whether to compile what can be, which takes seconds: plans are made faster, and can be refined.
        compiled: folder that what is compiled is kept in and loaded from; none if None.
    """

    model: Path | None
    sha256: str
    compile: bool
    compiled: Path | None = None


class ReaderOptions(NamedTuple):
    """What the reading process reads with; its first message.

    Attributes:
        manifest: of the bundle.
        max_samples, max_commands, max_refine_ms, max_candidates, max_chunks, shares_of_time: of the settings.
    """

    manifest: Manifest
    max_samples: int
    max_commands: int
    max_refine_ms: float
    max_candidates: int
    max_chunks: int
    shares_of_time: dict[str, float]


class GivenCommand(NamedTuple):
    """A command as it was given: what is made of it takes more room, and is made again where it is needed.

    Attributes:
        position: (n, 2) as given.
        t: (n,) times; None where there are none.
        dt: sampling interval (s), where there are no times.
        reading: what the numbers mean.
    """

    position: FloatArray
    t: FloatArray | None
    dt: float | None
    reading: Reading

    def command(self) -> Command:
        """Return the command.

        Raises:
            InputError: the numbers make no command.
        """
        if self.t is not None:
            return Command.from_waypoints(self.t, self.position, self.reading)
        return Command.from_samples(self.position, self.dt or DT, self.reading)


class PlanJob(NamedTuple):
    """One command to be planned, in the runtime's terms.

    Attributes:
        given: the command.
        friction, limits, start, sizes, tolerance, candidates, robust, refine_ms: as for `Planner.plan`.
        npz: whether the plan is written as npz; as JSON otherwise.
        several: whether it is planned several ways where its one plan is bad; once without candidates otherwise.
    """

    given: GivenCommand
    friction: Friction
    limits: Limits
    start: Start
    sizes: Sizes
    tolerance: float | None = None
    candidates: int | None = None
    robust: float | None = None
    refine_ms: float | None = None
    npz: bool = False
    several: bool = False

    @property
    def alone(self) -> bool:
        """Whether no other job can be planned together with this one."""
        return self.candidates not in (None, 1) or self.refine_ms is not None


class ReadJob(NamedTuple):
    """A job as the server handles it.

    Attributes:
        data: the PlanJob, pickled.
        samples: of its command.
        rows: of its plan, at most.
        chunks: that are planned, of all candidates together; equally many can be planned together.
        key: what jobs that can be planned together have in common; None if this one is planned alone.
        chunks_of_several: that are planned if it is planned several ways, which it is where its one plan is bad; 0 if
            it is not.
    """

    data: bytes
    samples: int
    rows: int
    chunks: int
    key: tuple[int, float | None] | None
    chunks_of_several: int = 0

    @property
    def several(self) -> ReadJob:
        """The same job, to be planned several ways."""
        return self._replace(chunks=self.chunks_of_several, key=None, chunks_of_several=0)

    @property
    def lane(self) -> Lane:
        """Where it is planned."""
        return "long" if self.key is None or self.chunks > SHORT_CHUNKS else "short"


class Batch(NamedTuple):
    """Jobs that are planned together.

    Attributes:
        lane: of all of them.
        jobs: PlanJobs, pickled.
    """

    lane: Lane
    jobs: list[bytes]


FILE = "file"
"""Kind of a request whose body is a command file."""


class ReadRequest(NamedTuple):
    """A body that is to be read.

    Attributes:
        number: of the request.
        client: who sent it.
        kind: what it is: FILE, or the name of a function of `server.planning.reading`.
        body: as it came.
        options: for that function, or of `Reading`.
    """

    number: int
    client: str
    kind: str
    body: bytes
    options: dict[str, Any]


class ReadReply(NamedTuple):
    """What came of a body.

    Attributes:
        number: of the request.
        result: what was read, or the problem with it.
    """

    number: int
    result: Any | Problem | InputError


class PlanReply(NamedTuple):
    """About a plan, which follows.

    Attributes:
        lane: of its batch.
        number: of the job in its batch, from 0.
        status: of the plan.
        together: plans made together, said with the first of them; 0 with the others.
        encode, decode: time in the encoder, and in all the rest of the planning, of all made together (s).
        write: time to write this plan (s).
        bad: whether it should be planned several ways.
    """

    lane: Lane
    number: int
    status: str
    together: int
    encode: float
    decode: float
    write: float
    bad: bool = False


class PlanFailure(NamedTuple):
    """About a plan that could not be made.

    Attributes:
        lane: of its batch.
        number: of the job in its batch, from 0.
        error: what is wrong with the job; None if that is not known.
    """

    lane: Lane
    number: int
    error: InputError | None


def frame(message: object, follows: int = 0) -> bytes:
    """Return a message as it travels, with the lengths before it; so many bytes will follow it."""
    data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
    return LENGTHS.pack(len(data), follows) + data


class Channel:
    """A process's end of the socket to its server; several threads may send.

    Args:
        connection: the end; blocking.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._connection, self._sending = connection, threading.Lock()

    def receive(self) -> Any:
        """Return the next message.

        Raises:
            EOFError: the server is gone.
        """
        length, _ = LENGTHS.unpack(self._exactly(LENGTHS.size))
        return pickle.loads(self._exactly(length))

    def send(self, message: object, follows: bytes = b"") -> None:
        """Send a message and what follows it."""
        with self._sending:
            self._connection.sendall(frame(message, len(follows)))
            self._connection.sendall(follows)

    def close(self) -> None:
        """Close this process's end, for which another one may have a number too."""
        self._connection.close()

    def fileno(self) -> int:
        """Return the number of the socket, to be waited for."""
        return self._connection.fileno()

    def _exactly(self, count: int) -> bytearray:
        data = bytearray(count)
        view = memoryview(data)
        while view:
            received = self._connection.recv_into(view)
            if not received:
                raise EOFError
            view = view[received:]
        return data


def to_array(values: object) -> FloatArray:
    """Return numbers as an array of 64 bits each."""
    return np.array(values, dtype=np.float64)
