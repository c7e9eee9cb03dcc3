"""What is counted, in Prometheus form."""

from __future__ import annotations

from collections.abc import Sequence

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

from server.planning.messages import PlanReply

SECONDS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
SIZES = (1, 2, 4, 8, 16, 32, 64, 128, 256)


class Metrics:
    """The counters of one server, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = registry = CollectorRegistry()

        def histogram(name: str, text: str, buckets: Sequence[float] = SECONDS) -> Histogram:
            return Histogram(f"slide_{name}", text, buckets=buckets, registry=registry)

        self.requests = Counter(
            "slide_requests", "Requests answered, by path and status.", ("path", "status"), registry=registry
        )
        self.in_flight = Gauge("slide_requests_in_flight", "Requests being answered.", registry=registry)
        self.queue_depth = Gauge("slide_queue_depth", "Commands that wait to be planned.", registry=registry)
        self.batch_size = histogram("batch_size", "Commands planned together.", SIZES)
        self.queue_time = histogram("queue_seconds", "Time a command waited to be planned.")
        self.encode_time = histogram("encode_seconds", "Time of a batch in the encoder.")
        self.decode_time = histogram("decode_seconds", "Time of a batch in the rest of the planning.")
        self.total_time = histogram("request_seconds", "Time from a request's header to its answer.")
        self.samples = Counter("slide_samples_planned", "Samples planned.", registry=registry)
        self.plans = Counter("slide_plans", "Plans made, by their status.", ("status",), registry=registry)
        self.streams = Gauge("slide_streams", "Streams open.", registry=registry)
        self.chunks = Counter("slide_stream_chunks", "Chunks given to streams.", registry=registry)

    def plan(self, reply: PlanReply, samples: int) -> None:
        """Count a plan, and with the first of those made together, the time that took."""
        if reply.together:
            self.batch_size.observe(reply.together)
            self.encode_time.observe(reply.encode)
            self.decode_time.observe(reply.decode)
        self.samples.inc(samples)
        self.plans.labels(reply.status).inc()

    def text(self) -> bytes:
        """Return the page that Prometheus reads."""
        return generate_latest(self.registry)
