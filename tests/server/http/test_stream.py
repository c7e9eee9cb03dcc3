"""The closed loop over the wire: the same as in the process, and bounded."""

from __future__ import annotations

import json
import math
import struct
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from runtime import Friction, InputError, Limits, Planner, ServerError, Start, StreamStatus
from runtime.cli.run import run_main
from runtime.client import Client, RemoteStream
from runtime.client.messages import Chunk, Reading, Step, pack_chunk, pack_step, unpack_chunk, unpack_step
from runtime.limits import NO_LIMITS
from runtime.physics.law import slide_one
from runtime.physics.pan import integrate_pan

from ..conftest import wait_for


def dial(server: Any, **options: Any) -> ClientConnection:
    return connect(server.url.replace("http", "ws") + "/stream", **options).__enter__()


def opened(server: Any, **others: Any) -> ClientConnection:
    socket = dial(server)
    command = {"dt": 0.001, "position": [[0.0, 0.0], [0.0001, 0.0]]}
    socket.send(json.dumps({"format": "slide-stream/2", "command": command} | others))
    assert json.loads(socket.recv())["chunk"] > 0
    return socket


def refused(socket: ClientConnection, message: str | bytes) -> dict[str, Any]:
    """Send a message and return the problem it is answered with, after which the socket is closed."""
    socket.send(message)
    problem: dict[str, Any] = json.loads(socket.recv())
    with pytest.raises(ConnectionClosed) as caught:
        socket.recv()
    assert caught.value.rcvd is not None
    assert caught.value.rcvd.code == 1008
    return problem


@pytest.mark.parametrize(("packed", "tolerance"), [(False, 0.0), (True, 1e-5)])
def test_remote_stream_gives_what_a_stream_in_the_process_gives(
    server: Any, make_curve: Callable[..., Any], packed: bool, tolerance: float
) -> None:
    position, friction = make_curve(450), Friction(0.9, 0.45)
    planner = Planner()
    own = planner.stream(position, friction, limits=Limits(jerk=8000.0))
    with RemoteStream(server.url, position, friction, limits=Limits(jerk=8000.0), packed=packed) as remote:
        assert remote.model == {"name": planner.bundle.manifest.name, "sha256": planner.bundle.sha256}
        chunk = own.chunk
        assert remote.chunk == chunk
        pan, sliding = np.zeros((chunk, 6)), np.tile([*position[0], 0.0, 0.0], (chunk, 1))
        for _ in range(5):
            expected, got = own.step(pan, sliding), remote.step(pan, sliding)
            assert np.abs(got - expected).max() <= tolerance * 30.0
            assert remote.last is not None
            assert remote.last.status is own.status is StreamStatus.FOLLOWING
            assert np.abs(remote.last.brake - own.brake(chunk)).max() <= tolerance * 30.0
            pan = integrate_pan(pan[-1], expected)
            sliding = slide_one(sliding[-1], expected, friction)


@pytest.mark.parametrize("packed", [False, True])
def test_delay_noise_another_command_and_a_reset_go_over_the_wire(
    server: Any, make_curve: Callable[..., Any], packed: bool
) -> None:
    position, other = make_curve(450), make_curve(300)[::-1]
    options: dict[str, Any] = {"command_delay": 0.02, "noise": 0.002}
    own = Planner().stream(position, search=False, **options)
    tolerance = 2e-4 if packed else 0.0
    with RemoteStream(server.url, position, packed=packed, **options) as remote:
        for k in range(12):
            for stream in (own, remote):
                if k == 3:
                    stream.retarget(other)
                if k == 11:
                    stream.reset(Start(object_position=(0.01, 0.0)))
                if k < 3:
                    stream.see_object(position[0] + 1e-6 * k, 0.03)
                    stream.see_pan(np.full(6, 1e-6 * k))
            expected, got = own.step(), remote.step()
            assert remote.last is not None
            assert remote.last.status is own.status
            assert np.abs(got - expected).max() <= tolerance * 30.0
            assert remote.refused is None
            if k == 10:
                assert own.status is StreamStatus.BRAKING
        assert own.status is StreamStatus.FOLLOWING


@pytest.mark.parametrize("packed", [False, True])
def test_command_that_the_server_refuses_is_told_and_the_old_one_kept(run_server: Any, packed: bool) -> None:
    with run_server(max_samples=300) as server, RemoteStream(server.url, np.zeros((300, 2)), packed=packed) as remote:
        with pytest.raises(InputError, match="position"):
            remote.retarget(np.zeros((5, 3)))
        remote.retarget(np.zeros((301, 2)))
        assert remote.step().shape == (remote.chunk, 3)
        assert remote.refused is not None
        assert "301" in remote.refused
        remote.retarget(np.zeros((200, 2)))
        remote.step()
        assert remote.refused is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"command_delay": 0.2}, "command_delay must be between 0 and 0.1 s, got 0.2 s"),
        ({"noise": 0.0}, "noise must be between"),
    ],
)
def test_delay_and_noise_out_of_range_are_refused(server: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ServerError, match=message):
        RemoteStream(server.url, np.zeros((300, 2)), **options)
    with pytest.raises(InputError, match="is not a finite number"):
        RemoteStream(server.url, np.zeros((300, 2)), noise=math.nan)


def test_missing_states_are_predicted_then_braked_and_a_start_begins_again(server: Any) -> None:
    socket = opened(server, command={"dt": 0.001, "position": [[0.0, 0.0]] * 300})
    statuses = []
    for sequence in range(6):
        socket.send(json.dumps({"sequence": sequence}))
        statuses.append(json.loads(socket.recv())["status"])
    assert [*dict.fromkeys(statuses)] == ["following", "predicted", "braking"]
    socket.send(json.dumps({"sequence": 6, "start": {}, "command": {"dt": 0.001, "position": [[0, 0], [0, 0]]}}))
    assert json.loads(socket.recv())["status"] == "following"
    socket.close()


def test_stream_rests_past_the_end_of_its_command(server: Any) -> None:
    socket, statuses = opened(server, command={"dt": 0.001, "position": [[0.0, 0.0]] * 200}), []
    for sequence in range(10):
        state = [
            [1e-6 * sequence, 0.0, 0.0, 0.0]
        ]  # of a level pan, x, y, vx, vy are enough; what never changes counts as missing
        socket.send(json.dumps({"sequence": sequence, "pan": state, "object": state}))
        chunk = json.loads(socket.recv())
        statuses.append(chunk["status"])
    assert [*dict.fromkeys(statuses)] == ["following", "resting"]
    assert not np.any(chunk["acceleration"])
    socket.close()


def test_packed_messages_come_back_the_same() -> None:
    random = np.random.default_rng(0)
    pan, u = random.normal(size=(100, 6)), random.normal(size=(100, 3))
    step = unpack_step(pack_step(Step(7, pan, None, 0.003)))
    assert step.pan is not None
    assert (step.sequence, step.object) == (7, None)
    assert np.allclose(step.pan, pan, atol=1e-6)
    frames = (Reading(pan[0, :2], 0.05, 40), Reading(pan[1, :2], math.nan))
    encoders = (Reading(pan[2], 0.0, 0), Reading(pan[3, :4]))
    told = unpack_step(pack_step(Step(8, None, None, 0.0, frames, encoders, 57)))
    assert (told.pan, told.object, told.executed) == (None, None, 57)
    assert [each.executed for each in (*told.frames, *told.encoders)] == [40, None, 0, None]
    assert np.allclose([each.age for each in told.frames], [0.05, math.nan], equal_nan=True)
    assert np.allclose(told.frames[1].value, pan[1, :2], atol=1e-6)
    assert np.allclose(told.encoders[0].value, pan[2], atol=1e-6)
    assert np.allclose(told.encoders[1].value, [*pan[3, :2], 0.0, *pan[3, 2:4], 0.0], atol=1e-6)
    level = unpack_step(pack_step(Step(7, pan[:, [0, 1, 3, 4]], pan[:1, :4], 0.003)))
    assert level.pan is not None
    assert level.object is not None
    assert np.allclose(level.pan, pan * [1, 1, 0, 1, 1, 0], atol=1e-6)
    assert np.allclose(level.object, pan[:1, :4], atol=1e-6)
    chunk = unpack_chunk(pack_chunk(Chunk(8, u, u[:3], StreamStatus.BRAKING)))
    assert (chunk.sequence, chunk.status) == (8, StreamStatus.BRAKING)
    assert np.allclose(chunk.brake, u[:3], atol=1e-6)


@pytest.mark.parametrize("age", [1e308, -1e308, -1.0, 1e300, None])
def test_what_was_measured_at_no_time_is_taken_for_missing(server: Any, age: float | None) -> None:
    readings = (
        {"frames": [{"position": [0.05, 0.0], "age": age}]},
        {"encoders": [{"state": [0.05, 0, 0, 0], "age": age}]},
    )
    with opened(server) as plain:
        plain.send(json.dumps({"sequence": 0}))
        expected = json.loads(plain.recv())["acceleration"]
    for told in (*readings, {"pan": [[0.05, 0, 0, 0]], "object": [[0, 0, 0, 0]], "age": age}):
        with opened(server) as stream:
            stream.send(json.dumps({"sequence": 0, **told}))
            assert json.loads(stream.recv())["acceleration"] == expected


@pytest.mark.parametrize(
    ("message", "name"),
    [
        ("{", "malformed"),
        ('{"sequence": 1}', "invalid"),
        ('{"sequence": -1}', "invalid"),
        ('{"sequence": true}', "invalid"),
        ('{"sequence": 0, "pan": [[0, 0, 0]]}', "invalid"),
        ('{"sequence": 0, "pan": [[0, 0, 0, 0, 0]]}', "invalid"),
        ('{"sequence": 0, "object": [[0, 0, 0, 0, 0, 0]]}', "invalid"),
        ('{"sequence": 0, "pan": [[0, 0, 0, 0], [0, 0, 0, 0]]}', "invalid"),
        ('{"sequence": 0, "start": {"pan_position": [9, 9]}}', "invalid"),
        ('{"sequence": 0, "frames": [{"position": [0]}]}', "invalid"),
        ('{"sequence": 0, "frames": [{"position": [0, 0], "executed": 101}]}', "invalid"),
        ('{"sequence": 0, "encoders": [{"state": [0, 0, 0, 0, 0]}]}', "invalid"),
        (b"", "malformed"),
        (b"\0" * 11, "malformed"),
        (pack_step(Step(0, np.zeros(6), None)) + b"\0", "malformed"),
        (pack_step(Step(3, np.zeros(6), None)), "invalid"),
        (pack_step(Step(0, None, None, frames=(Reading(np.zeros(2)),) * 257)), "invalid"),
        (pack_step(Step(0, None, None, encoders=(Reading(np.zeros(6), 0.0, 400),))), "invalid"),
        (pack_step(Step(0, None, None, frames=(Reading(np.zeros(2)),)))[:-4] + struct.pack("<f", 0.5), "malformed"),
        ('{"sequence": 0, "executed": 1000}', "invalid"),
    ],
)
def test_bad_step_ends_the_stream_with_a_problem(server: Any, message: str | bytes, name: str) -> None:
    problem = refused(opened(server), message)
    assert problem["type"] == f"urn:slide-planner:problem:{name}"


def test_bad_opening_is_a_problem(server: Any) -> None:
    for message in ("", "{}", '{"format": "slide-stream/3"}', b"\xff", "[" * 10_000):
        assert refused(dial(server), message)["status"] in (400, 422)
    with pytest.raises(ServerError, match="start: start: the pan is 9"):
        RemoteStream(server.url, np.zeros((5, 2)), start=Start(pan_position=(9.0, 0.0)))


def test_stream_of_a_level_pan_has_x_and_y_alone(server: Any) -> None:
    command = {"dt": 0.001, "position": [[0.0, 0.0], [0.0001, 0.0]] * 100}
    space = opened(server, command=command)
    space.send(json.dumps({"sequence": 0, "pan": [[0.0] * 6]}))
    for packed in (False, True):
        socket = dial(server)
        socket.send(json.dumps({"format": "slide-stream/1", "command": command, "packed": packed}))
        begun = json.loads(socket.recv())
        assert begun["format"] == "slide-stream/1"
        if packed:
            socket.send(struct.pack("<IfHH", 0, 0.0, 1, 0) + np.zeros(4, "<f4").tobytes())
            head, values = struct.calcsize("<IHHHxx"), socket.recv()
            assert isinstance(values, bytes)
            u = np.frombuffer(values, "<f4", 2 * begun["chunk"], head).reshape(begun["chunk"], 2)
            brake = np.frombuffer(values, "<f4", -1, head + u.nbytes)
            assert len(brake) % 2 == 0
        else:
            socket.send(json.dumps({"sequence": 0, "pan": [[0.0] * 4]}))
            plane, answer = json.loads(socket.recv()), json.loads(space.recv())
            assert np.shape(plane["brake"])[1] == 2
            assert np.shape(answer["brake"])[1] == 3
            assert [row[:2] for row in answer["acceleration"]] == plane["acceleration"]
            assert not any(row[2] for row in answer["acceleration"])
            u = np.array(plane["acceleration"])
        assert u.shape == (begun["chunk"], 2)
        socket.close()
    space.close()
    lifting = dial(server)
    opening = {"format": "slide-stream/1", "command": command, "limits": {"height": 0.1}}
    assert "the pan lifts by 0.1 m" in refused(lifting, json.dumps(opening))["detail"]


def test_rate_size_and_silence_are_limited(run_server: Callable[..., Any]) -> None:
    with run_server(stream_rate=5.0, stream_idle=1.0, max_body=4096) as server:
        socket = opened(server)
        for sequence in range(60):
            socket.send(json.dumps({"sequence": sequence}))
        answers = []
        with suppress(ConnectionClosed):
            while True:
                answers.append(json.loads(socket.recv()))
        assert 20 <= len(answers) < 60
        assert answers[-1]["type"].endswith(":too-fast")

        begin = time.monotonic()
        socket = opened(server)
        assert json.loads(socket.recv())["type"].endswith(":idle")
        assert 0.9 < time.monotonic() - begin < 10.0

        socket = opened(server)
        socket.send("x" * 5000)
        with pytest.raises(ConnectionClosed) as caught:
            socket.recv()
        assert caught.value.rcvd is not None
        assert caught.value.rcvd.code == 1009


def test_too_many_streams_are_refused(run_server: Callable[..., Any]) -> None:
    with run_server(max_streams=1) as server:
        first = opened(server)
        with pytest.raises(ServerError, match="Too much is waiting to be planned: all 1 streams are taken"):
            RemoteStream(server.url, np.zeros((5, 2)))
        first.close()
        wait_for(lambda: server.service.streams == 0)
        RemoteStream(server.url, np.zeros((5, 2))).close()


def test_slide_run_follows_a_plan_on_the_arm_through_the_server(
    server: Any,
    make_curve: Callable[..., Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("pybullet")
    path, documents = tmp_path / "plan.json", []
    with Client(server.url) as client:
        client.plan(make_curve(250)).save(path)
    for loop in (["--server", server.url], ["--closed-loop"]):
        monkeypatch.setattr(sys, "argv", ["slide-run", str(path), "--pybullet", *loop, "--json"])
        with pytest.raises(SystemExit):
            run_main()
        out, err = capfd.readouterr()
        documents.append(json.loads(out))
        assert "error" not in err
        assert "was made by" not in err
    through, own = documents
    assert through["loop"] == "closed loop through a server"
    assert through["results"]["samples"] == 250
    assert through["results"]["object_rms"] == own["results"]["object_rms"]


def test_page_of_another_site_opens_no_stream(server: Any) -> None:
    with pytest.raises(InvalidStatus) as caught:
        dial(server, origin="http://elsewhere")
    assert caught.value.response.status_code == 403
    dial(server, origin=server.url).close()


def test_client_names_what_is_wrong(server: Any) -> None:
    with pytest.raises(ServerError, match=r"http://127.0.0.1:1: cannot be reached"):
        RemoteStream("http://127.0.0.1:1", np.zeros((5, 2)))
    with pytest.raises(ServerError, match="begins with http"):
        RemoteStream("127.0.0.1:1", np.zeros((5, 2)))
    with pytest.raises(ServerError, match="cannot be reached"), Client("http://127.0.0.1:1") as client:
        client.plan(np.zeros((5, 2)))
    with (
        Client(server.url) as client,
        pytest.raises(ServerError, match=r"command\.position\[1\]\[0\]: the command goes 1 m"),
    ):
        client.plan([[0.0, 0.0], [1.0, 0.0]])
    with Client(server.url) as client, pytest.raises(InputError, match=r"position\[1\], column y: nan"):
        client.plan([[0.0, 0.0], [0.0, np.nan]])
    with pytest.raises(InputError, match="these are not finite"):
        RemoteStream(server.url, np.zeros((5, 2)), limits=NO_LIMITS)


def test_what_is_missing_over_the_wire_is_missing_and_ends_nothing(server: Any) -> None:
    command = {"dt": 0.001, "position": [[0.0, 0.0]] * 600}
    socket = opened(server, command=command)
    missing = [
        '{"sequence": 0, "pan": [[0, 0, 0, null]]}',
        '{"sequence": 1, "object": [[0, 0, NaN, 0]], "age": null}',
        '{"sequence": 2, "frames": [{"position": [null, 0]}], "encoders": [{"state": [0, 0, 0, 0], "age": NaN}]}',
    ]
    statuses = []
    for message in missing:
        socket.send(message)
        statuses.append(json.loads(socket.recv())["status"])
    assert statuses[:2] == ["following", "predicted"]
    packed = opened(server, command=command, packed=True)
    packed.send(pack_step(Step(0, np.full(6, np.nan), None, math.nan)))
    assert unpack_chunk(packed.recv()).status is StreamStatus.FOLLOWING
    packed.send(pack_step(Step(1, np.full(6, np.nan), None)))
    assert unpack_chunk(packed.recv()).status is StreamStatus.PREDICTED


def test_frames_and_encoders_are_taken_with_their_ages(server: Any) -> None:
    socket = opened(server, command={"dt": 0.001, "position": [[0.0, 0.0]] * 600})
    stream = server.service.planner.stream(np.zeros((600, 2)))
    for n in range(4):
        message: dict[str, Any] = {"sequence": n}
        if n:
            message["frames"] = [{"position": [0.001, 0.0], "age": 0.02, "executed": 40}]
            message["encoders"] = [{"state": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "age": 0.0}]
            stream.see_object([0.001, 0.0], 0.02, 40)
            stream.see_pan(np.zeros(6), 0.0)
        socket.send(json.dumps(message))
        answer = json.loads(socket.recv())
        np.testing.assert_array_equal(answer["acceleration"], stream.step())
        assert answer["status"] == stream.status


@pytest.mark.parametrize(("packed", "tolerance"), [(False, 0.0), (True, 1e-4)])
def test_remote_stream_sees_what_a_stream_in_the_process_sees(
    server: Any, make_curve: Callable[..., Any], packed: bool, tolerance: float
) -> None:
    """Frames late and early, readings that are none, and a question before the chunk has ended."""
    limits = Limits(acceleration=25.0)  # of a network that may be asked at any time
    position = make_curve(450)
    own = server.service.planner.stream(position, limits=limits, search=False)
    with RemoteStream(server.url, position, limits=limits, packed=packed) as remote:
        for done in (None, own.chunk, 30, own.chunk, 40):
            executed = own.chunk if done is None else done
            expected, got = own.step(executed=done), remote.step(executed=done)
            assert np.abs(got - expected).max() <= tolerance * 30.0
            assert remote.last is not None
            assert remote.last.status is own.status
            pan, (x, y), later = own.pan(10), own.object(15).position, own.object(25).position
            for stream in (own, remote):
                stream.see_pan(pan, executed=10)
                stream.see_pan(None)
                stream.see_object([x + 2.0**-12, y], 0.005, 20)
                stream.see_object([math.nan, 0.0], math.nan)
                stream.see_object(later, 0.0, min(executed, 28))
        with pytest.raises(InputError, match="executed must be a whole number from 0 to"):
            remote.see_pan(np.zeros(6), executed=remote.chunk + 1)
        with pytest.raises(InputError, match=r"position must be \(2,\) numbers"):
            remote.see_object(np.zeros(3))


def test_command_that_cannot_be_followed_leaves_the_old_one_in_place(server: Any) -> None:
    one, other = (opened(server, command={"dt": 0.001, "position": [[0.0, 0.0]] * 300}) for _ in range(2))
    one.send('{"sequence": 0, "command": {"dt": 0.001, "position": [[0, 0], [0, 0], [1, 0]]}}')
    other.send('{"sequence": 0}')
    answer, expected = json.loads(one.recv()), json.loads(other.recv())
    assert answer.pop("refused")["place"] == "command.position[2][0]"
    assert answer == expected
