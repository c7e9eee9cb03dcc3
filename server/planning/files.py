"""Command files, read by a process for each: what a file may be made to unfold to, and what it takes, ends with it.

One is read at a time, beside everything else that the reading process reads: its server sends no second one before.
"""

from __future__ import annotations

import logging
import multiprocessing
import resource
import signal
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

import orjson

from runtime import Command, InputError, MissingExtraError, Reading
from runtime.commands.build import build
from runtime.commands.files import parse
from runtime.physics.law import DT
from server.planning.messages import Channel, ReadReply, ReadRequest
from server.problems import Problem

log = logging.getLogger("slide-serve")

MOST_POINTS = 200_000
"""Most positions of a file; of a recording at 10 kHz 20 s."""

MOST_MEMORY = 1 << 26
"""Most memory that reading a file may take (bytes)."""

MOST_TIME = 2
"""Most time of a processor that it may take (s): twenty times what the largest recordings take."""

FORK = multiprocessing.get_context("fork")


class Files:
    """Reads files for the reading process, one at a time.

    Args:
        channel: of the reading process, which the others close.
        max_samples: of a command.

    Attributes:
        answers: where what comes of the present one comes; None while there is none.
    """

    def __init__(self, channel: Channel, max_samples: int) -> None:
        self._channel, self._max_samples = channel, max_samples
        self.answers: Connection | None = None

    def begin(self, request: ReadRequest) -> None:
        """Begin to read one; there is no other."""
        self.answers, its = FORK.Pipe(duplex=False)
        self._number = request.number
        self._process = FORK.Process(target=self._read, args=(its, request), daemon=True)
        self._process.start()
        its.close()

    def end(self) -> ReadReply:
        """Return what came of it, once `answers` has something."""
        assert self.answers is not None
        try:
            reply: ReadReply = self.answers.recv()
        except EOFError:
            self._process.join()
            late = self._process.exitcode in (-signal.SIGXCPU, -signal.SIGKILL)
            why = Problem("invalid", f"to read this takes more than {MOST_TIME} s") if late else Problem("failed")
            reply = ReadReply(self._number, why)
        self._process.join()
        self.answers.close()
        self.answers = None
        return reply

    def _read(self, answers: Connection, request: ReadRequest) -> None:
        """Read a file, in the process that is there for it."""
        assert self.answers is not None
        self.answers.close()
        self._channel.close()
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CPU, (MOST_TIME, MOST_TIME + 1))
        most = _data() + MOST_MEMORY
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
        with suppress(BrokenPipeError):
            answers.send(ReadReply(request.number, self._result(request)))

    def _result(self, request: ReadRequest) -> bytes | Problem | InputError:
        try:
            return read_file(request.body, Reading(**request.options), self._max_samples)
        except MemoryError:
            return Problem("invalid", f"to read this takes more than {MOST_MEMORY >> 20} MiB")
        except MissingExtraError as error:
            return Problem("invalid", str(error))
        except InputError as error:
            return error
        except Exception:
            log.exception("reading failed")
            return Problem("failed")


def read_file(body: bytes, reading: Reading, max_samples: int) -> bytes:
    """Return the answer of `POST /command`, as JSON.

    Raises:
        InputError: it is no command, or a longer one than is taken.
    """
    points, reading = parse(body, reading)
    if len(points.position) > MOST_POINTS:
        raise InputError(f"the file has {len(points.position)} positions, at most {MOST_POINTS} are read", "position")
    command = Command(*build(points, reading))
    if len(command) > max_samples:
        raise InputError(f"the command has {len(command)} samples at 1 kHz, at most {max_samples} are taken")
    document = {"command": {"dt": DT, "position": command.position}, "notes": [*command.notes, *command.remarks]}
    return orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY)


def _data() -> int:
    """Return what this process holds by the measure of RLIMIT_DATA (bytes)."""
    status = Path("/proc/self/status")
    text = status.read_text() if status.exists() else ""
    return int(text.partition("VmData:")[2].split()[0]) << 10 if "VmData:" in text else 0
