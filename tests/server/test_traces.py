"""Traces: off unless asked for, one span a request, named after its route, with the request's name."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from server.traces import wanted

from .conftest import Process, process, wait_for

pytest.importorskip("opentelemetry.sdk", reason="the extra otel is not installed")
pytest.importorskip("opentelemetry.instrumentation.asgi", reason="the extra otel is not installed")

from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter

PARENT = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"


@pytest.fixture(scope="module")
def traced(run_server: Callable[..., Any]) -> Iterator[tuple[Any, InMemorySpanExporter]]:
    exporter, provider = InMemorySpanExporter(), TracerProvider()
    provider.add_span_processor(SimpleSpanProcessor(exporter))
    with run_server(tracing=provider) as server:
        yield server, exporter


def one_span(exporter: InMemorySpanExporter) -> Any:
    wait_for(lambda: len(exporter.get_finished_spans()) > 0)
    (span,) = exporter.get_finished_spans()
    exporter.clear()
    return span


def test_plan_is_a_span_with_its_name_its_times_and_the_callers_trace(
    traced: Any, make_request: Callable[..., Any]
) -> None:
    server, exporter = traced
    headers = {"X-Request-ID": "a-name", "traceparent": PARENT}
    answer = server.post("/plan?secret=1", json=make_request(), headers=headers)
    span = one_span(exporter)
    assert span.name == "POST /plan"
    assert f"{span.context.trace_id:032x}" == PARENT.split("-")[1]
    assert span.attributes["http.route"] == "/plan"
    assert span.attributes["http.response.header.x_request_id"] == ("a-name",)
    assert span.attributes["http.response.header.server_timing"] == (answer.headers["Server-Timing"],)


@pytest.mark.parametrize(("path", "name"), [("/no/such/path", "GET"), ("/info", "GET /info")])
def test_spans_have_few_names(traced: Any, path: str, name: str) -> None:
    server, exporter = traced
    answer = server.get(path)
    span = one_span(exporter)
    assert span.name == name
    assert span.attributes["http.response.header.x_request_id"] == (answer.headers["X-Request-ID"],)


def test_stream_is_a_span_and_has_a_name_also_where_it_is_refused(traced: Any) -> None:
    server, exporter = traced
    url = server.url.replace("http", "ws") + "/stream"
    with connect(url, additional_headers={"X-Request-ID": "a-stream"}) as stream:
        stream.send(json.dumps({"format": "slide-stream/1", "command": {"dt": 0.001, "position": [[0, 0], [0, 0]]}}))
        stream.recv()
        assert stream.response.headers["X-Request-ID"] == "a-stream"
    span = one_span(exporter)
    assert span.name == "WS /stream"
    assert span.attributes["http.response.header.x_request_id"] == ("a-stream",)
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(url, origin="http://elsewhere", additional_headers={"X-Request-ID": "b"}),
    ):
        pass
    assert refused.value.response.headers["X-Request-ID"] == "b"
    assert one_span(exporter).attributes["http.response.header.x_request_id"] == ("b",)


def test_health_and_figures_make_no_spans(traced: Any) -> None:
    server, exporter = traced
    for path in ("/health/live", "/health/ready", "/metrics"):
        assert server.get(path).status_code == 200
    assert exporter.get_finished_spans() == ()


@pytest.mark.parametrize(
    ("variables", "asked"),
    [
        ({}, False),
        ({"OTEL_EXPORTER_OTLP_ENDPOINT": "http://localhost:4318"}, True),
        ({"OTEL_EXPORTER_OTLP_TRACES_ENDPOINT": "http://localhost:4318/v1/traces"}, True),
        ({"OTEL_EXPORTER_OTLP_ENDPOINT": "http://localhost:4318", "OTEL_SDK_DISABLED": "true"}, False),
        ({"OTEL_EXPORTER_OTLP_ENDPOINT": "http://localhost:4318", "OTEL_TRACES_EXPORTER": "none"}, False),
        ({"OTEL_TRACES_EXPORTER": "otlp"}, False),
    ],
)
def test_variables_ask_for_traces(variables: dict[str, str], asked: bool) -> None:
    assert wanted(variables) == asked


def test_variables_that_ask_for_what_there_is_not_are_named() -> None:
    code, said = Process(OTEL_EXPORTER_OTLP_ENDPOINT="http://127.0.0.1:9", OTEL_EXPORTER_OTLP_PROTOCOL="grpc").ended()
    assert code == 2
    assert said == "slide-serve: error: OTEL_EXPORTER_OTLP_PROTOCOL must be http/protobuf, got 'grpc'\n"


@pytest.fixture
def collector() -> Iterator[tuple[str, list[bytes]]]:
    """A collector that keeps what it is sent."""
    kept: list[bytes] = []

    class Keep(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            kept.append(self.rfile.read(int(self.headers["Content-Length"])))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            """Say nothing."""

    listening = HTTPServer(("127.0.0.1", 0), Keep)
    threading.Thread(target=listening.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{listening.server_port}", kept
    listening.shutdown()
    listening.server_close()


def test_slide_serve_sends_its_last_spans_before_it_ends(collector: tuple[str, list[bytes]]) -> None:
    endpoint, kept = collector
    with process(
        OTEL_EXPORTER_OTLP_ENDPOINT=endpoint, OTEL_EXPORTER_OTLP_COMPRESSION="none", OTEL_SERVICE_NAME="pan"
    ) as server:
        name = server.get("/info").headers["X-Request-ID"]
        server.process.terminate()
        assert server.ended()[0] == 0
    assert any(name.encode() in each and b"pan" in each for each in kept)


def test_collector_that_never_answers_stops_neither_plans_nor_the_end(make_request: Callable[..., Any]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        endpoint = f"http://127.0.0.1:{deaf.getsockname()[1]}"
        with process(OTEL_EXPORTER_OTLP_ENDPOINT=endpoint) as server:
            assert server.post("/plan", json=make_request()).status_code == 200
            server.process.terminate()
            code, said = server.ended()
    assert code == 0
    assert "Traceback" not in said
