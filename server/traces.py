"""Traces of requests for OpenTelemetry, from the extra `otel`, where its variables OTEL_* say where they go.

A span for each request and each stream, with the caller's as its parent (W3C Trace Context). It carries the answer's
headers X-Request-ID and Server-Timing, as the attributes http.response.header.x_request_id and .server_timing.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from fastapi import FastAPI

from runtime.errors import InputError, extra
from server.http.guard import PROTECTED

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider

DESTINATIONS = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
"""Variables of which one says where traces go."""

PROTOCOLS = ("OTEL_EXPORTER_OTLP_TRACES_PROTOCOL", "OTEL_EXPORTER_OTLP_PROTOCOL")
"""Variables that say how they go; the first that is set counts."""

HEADERS = ["x-request-id", "server-timing"]
"""Headers of an answer that its span carries."""

FAREWELL = 1.0
"""How long the last spans have to be sent when the server ends (s)."""

UNTRACED = "/health/live$,/health/ready$,/metrics$"
"""Asked for every few seconds by machines."""


def wanted(environment: Mapping[str, str]) -> bool:
    """Return whether the variables ask for traces.

    Raises:
        InputError: they ask for what there is not.
    """
    if environment.get("OTEL_SDK_DISABLED", "").lower() == "true":
        return False
    exporter = environment.get("OTEL_TRACES_EXPORTER", "otlp")
    if exporter == "none" or not any(environment.get(name) for name in DESTINATIONS):
        return False
    if exporter != "otlp":
        raise InputError(f"OTEL_TRACES_EXPORTER must be otlp or none, got {exporter!r}")
    protocol = next((environment[name] for name in PROTOCOLS if environment.get(name)), "http/protobuf")
    if protocol != "http/protobuf":
        raise InputError(f"OTEL_EXPORTER_OTLP_PROTOCOL must be http/protobuf, got {protocol!r}")
    return True


def provider_from_variables() -> TracerProvider | None:
    """Return what sends traces as the variables say; None if they ask for none.

    Raises:
        InputError: the variables ask for what there is not.
        MissingExtraError: they ask for traces, and the extra is not installed.
    """
    if not wanted(os.environ):
        return None
    with extra("otel"):
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    provider = TracerProvider(shutdown_on_exit=False)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    return provider


def trace(app: FastAPI, provider: TracerProvider) -> None:
    """Make a span of each request and each stream of an application."""
    with extra("otel"):
        from opentelemetry.instrumentation.asgi import OpenTelemetryMiddleware

    def name(scope: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
        """Return a span's name, one of a few: anybody can ask for any path."""
        path = scope["path"] if scope["path"] in PROTECTED else ""
        return f"{scope.get('method', 'WS')} {path}".rstrip(), {"http.route": path} if path else {}

    app.add_middleware(
        OpenTelemetryMiddleware,
        tracer_provider=provider,
        default_span_details=name,
        excluded_urls=UNTRACED,
        exclude_spans=["receive", "send"],
        http_capture_headers_server_response=HEADERS,
    )


def send_the_rest(provider: TracerProvider) -> None:
    """Send what has not been sent, for no longer than FAREWELL, whether anybody listens or not."""
    thread = threading.Thread(target=provider.shutdown, daemon=True)
    thread.start()
    thread.join(FAREWELL)
