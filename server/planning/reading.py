"""The reading process: it parses and checks what clients send, so that nobody waits for the longest of it.

The server starts it with one end of a socket and sends ReaderOptions; the answer is "". From then on each ReadRequest
is answered by a ReadReply. Bodies are read side by side, a command at a time, and the next step is for the client that
has had the least time: a short body does not wait for the end of a long one. Command files are read by a process for
each, `server.planning.files`. The process ends when the socket does.
"""

from __future__ import annotations

import gc
import logging
import pickle
import resource
import select
import signal
import socket
import sys
import time
from collections import defaultdict, deque
from collections.abc import Generator
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from runtime import Command, InputError, Start
from runtime.assess.several import MOST_CHUNKS, SEVERAL
from runtime.client.messages import AXES, LEVEL_STREAM_FORMAT, STREAM_FORMAT
from runtime.network.reader import chunk_samples
from server import logs
from server.http.schemas import (
    MOST_NAMES,
    NAMES_OF_A_COMMAND,
    PlanRequest,
    PlansRequest,
    StepRequest,
    StreamRequest,
    read,
    to_command,
    to_job,
    to_start,
)
from server.planning.bounds import BRACKET, check_positions, stop_samples
from server.planning.files import Files
from server.planning.messages import FILE, Channel, PlanJob, ReaderOptions, ReadJob, ReadReply, ReadRequest
from server.problems import Problem, for_input
from server.shares import Turns

log = logging.getLogger("slide-serve")

MOST_MEMORY = 1 << 28
"""Most memory that the process may hold, besides what programs are (bytes)."""

Steps = Generator[None, None, Any]
"""Reads a body; between two steps others have their turn."""


def plan(options: ReaderOptions, body: bytes, npz: bool = False) -> Steps:
    """Read the body of `POST /plan`: a list of one ReadJob."""
    asked = read(PlanRequest, body)
    yield
    command = to_command(asked.command, options.max_samples, "command")
    job = to_job(asked, asked.command.given(), options)._replace(npz=npz)
    return [_read_job(job, command, options, several=job.candidates is None and job.refine_ms is None)]


def plans(options: ReaderOptions, body: bytes) -> Steps:
    """Read the body of `POST /plans`: a ReadJob for each command."""
    asked = read(PlansRequest, body, MOST_NAMES + options.max_commands * NAMES_OF_A_COMMAND)
    if len(asked.commands) > options.max_commands:
        raise Problem("invalid", f"at most {options.max_commands} commands are taken", "commands")
    result = []
    for index, each in enumerate(asked.commands):
        yield
        command = to_command(each, options.max_samples, f"commands[{index}]")
        result.append(_read_job(to_job(asked, each.given(), options), command, options))
    return result


def _read_job(job: PlanJob, command: Command, options: ReaderOptions, several: bool = False) -> ReadJob:
    """Return a job and what it costs; it is planned several ways, if that is asked, only where that is allowed."""
    chunks = -(-len(command) // chunk_samples(job.limits)) * (job.candidates or 1)
    if chunks > options.max_chunks and job.candidates is not None:
        detail = f"{job.candidates} candidates have {chunks} chunks together, at most {options.max_chunks} are planned"
        raise InputError(detail, "candidates")
    rows = len(command) + stop_samples(job.limits, job.start)
    allowed = options.max_candidates >= SEVERAL and SEVERAL * chunks <= options.max_chunks
    several = several and allowed and chunks <= MOST_CHUNKS
    data = pickle.dumps(job._replace(several=several), pickle.HIGHEST_PROTOCOL)
    key = None if job.alone else (chunks, job.tolerance)
    return ReadJob(data, len(command), rows, chunks, key, SEVERAL * chunks if several else 0)


def stream(options: ReaderOptions, body: bytes) -> Steps:
    """Read what opens a stream: the Command, its PlanJob, what it is told of delay and noise, and how messages are.

    The last two are whether messages are packed, and along how many axes the pan moves.
    """
    check_positions(body.count(BRACKET), options.max_samples)
    asked = read(StreamRequest, body)
    yield
    command = to_command(asked.command, options.max_samples, "command")
    job = to_job(asked, asked.command.given(), options)
    stop_samples(job.limits, job.start, job.friction)
    axes = 2 if asked.format == LEVEL_STREAM_FORMAT else AXES
    if axes == 2 and not job.limits.level:
        detail = f"the pan lifts by {job.limits.height:g} m: open the stream as {STREAM_FORMAT}"
        raise Problem("invalid", detail, "format")
    return command, job, {"command_delay": asked.command_delay, "noise": asked.noise}, asked.packed, axes


def step(options: ReaderOptions, body: bytes) -> Steps:
    """Read a step that carries a command: the step, the Command or what is wrong with it, the Start if there is one."""
    asked = read(StepRequest, body)
    yield
    command: Command | Problem | None = None
    if asked.command is not None:
        try:
            command = to_command(asked.command, options.max_samples, "command")
        except InputError as error:
            command = for_input(error)
        except Problem as problem:
            command = problem
    start: Start | None = None if asked.start is None else to_start(asked.start)
    return asked, command, start


KINDS = {reading.__name__: reading for reading in (plan, plans, stream, step)}


def serve(channel: Channel) -> None:
    """Read until the server hangs up."""
    options: ReaderOptions = channel.receive()
    gc.freeze()  # what is loaded stays: it need not be looked through again and again
    channel.send("")
    turns = Turns(options.shares_of_time)
    bodies: defaultdict[str, deque[tuple[int, Steps]]] = defaultdict(deque)
    files = Files(channel, options.max_samples)
    while True:
        while True:
            ends: list[Channel | Connection] = [channel] if files.answers is None else [channel, files.answers]
            ready = select.select(ends, [], [], 0.0 if bodies else None)[0]
            if files.answers in ready:
                channel.send(files.end())
            if channel not in ready:
                break
            request: ReadRequest = channel.receive()
            if request.kind == FILE:
                files.begin(request)
            else:
                steps = KINDS[request.kind](options, request.body, **request.options)
                bodies[request.client].append((request.number, steps))
            del request
        if not bodies:
            continue
        client = turns.order(bodies)[0]
        begin, (number, steps) = time.perf_counter(), bodies[client].popleft()
        reply = _step(number, steps)
        if reply is None:
            bodies[client].append((number, steps))
        else:
            channel.send(reply)
        turns.charge(client, time.perf_counter() - begin)
        if not bodies[client]:
            del bodies[client]


def _step(number: int, steps: Steps) -> ReadReply | None:
    """Take one step of reading a body; return what came of it if it was the last one."""
    try:
        next(steps)
    except StopIteration as end:
        return ReadReply(number, end.value)
    except MemoryError:
        return ReadReply(number, Problem("invalid", f"to read this takes more than {MOST_MEMORY >> 20} MiB"))
    except (Problem, InputError) as problem:
        return ReadReply(number, problem)
    except Exception:
        log.exception("reading failed")
        return ReadReply(number, Problem("failed"))
    return None


def main() -> None:
    """Run the process; its last argument is the number of its end of the socket, which it inherits."""
    for stop in (signal.SIGINT, signal.SIGTERM):  # sent to all processes of a terminal or a service: the server stops
        signal.signal(stop, signal.SIG_IGN)
    logs.set_up("text")
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_MEMORY, MOST_MEMORY))  # a file may be made to unfold
    with socket.socket(fileno=int(sys.argv[-1])) as connection, suppress(EOFError, ConnectionError):
        serve(Channel(connection))
