"""What a server is told: by options of `slide-serve` or by variables `SLIDE_*`, checked when built."""

from __future__ import annotations

import ipaddress
import math
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, SecretStr, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

PREFIX = "SLIDE_"

SECRETS = {"token", "tokens"}
"""Given by a variable only, and never shown."""

PRIVATE = {"model"}
"""Kept out of `/info` besides the secrets: paths of the machine are nobody's business."""


class Settings(BaseSettings):
    """Settings of the server: the one place of their names, defaults, ranges and meaning.

    Each may be given as a variable, `SLIDE_` and the name in capitals, and all but the secrets as an option.
    """

    model_config = SettingsConfigDict(env_prefix=PREFIX, frozen=True, extra="ignore")

    host: str = Field("127.0.0.1", description="Address to listen on.")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on; 0 for any that is free.")
    token: SecretStr | None = Field(None, description="Bearer token that requests must carry.")
    tokens: SecretStr | None = Field(None, description="Bearer tokens of several clients, as in NAME=TOKEN,NAME=TOKEN.")
    hosts: str = Field(
        "", description="Names this server goes by, as in slide.example.com,slide; localhost and addresses always do."
    )
    proxies: str = Field("", description="Addresses of proxies whose X-Forwarded-For is believed, as in 10.0.0.0/8.")
    metrics_port: int | None = Field(
        None, ge=0, le=65535, description="Port of its own for /metrics and /health, which needs no token."
    )
    insecure: bool = Field(False, description="Listen beyond this machine without a token.")
    model: Path | None = Field(None, description="Bundle folder; the shipped one if not given.")
    bundle_sha256: str | None = Field(
        None, pattern="^[0-9a-f]{64}$", description="sha256 that the bundle's manifest must have."
    )

    log: Literal["text", "json"] = Field("text", description="Form of the log's lines.")
    log_requests: bool = Field(False, description="Log a line for each request.")

    max_body: int = Field(1 << 20, ge=1 << 10, le=1 << 28, description="Largest request body (bytes).")
    max_samples: int = Field(20_000, ge=2, le=600_001, description="Longest command (samples at 1 kHz).")
    max_commands: int = Field(64, ge=1, le=1024, description="Most commands in one request of /plans.")
    max_chunks: int = Field(560, ge=1, le=100_000, description="Most chunks, of some 60 ms, planned together.")
    max_queue: int = Field(128, ge=1, le=4096, description="Most commands that wait to be planned.")
    max_batch: int = Field(24, ge=1, le=256, description="Most commands planned together.")
    max_refine_ms: float = Field(200.0, ge=0.0, le=10_000.0, description="Longest refinement of a plan (ms).")
    max_candidates: int = Field(16, ge=1, le=256, description="Most candidates of one plan.")
    max_held: int = Field(1 << 25, ge=1 << 20, description="Most bytes of requests that are held at once.")
    max_unread: int = Field(
        1 << 26, ge=1 << 20, description="Most bytes of finished plans that are held until they are read."
    )
    client_share: float = Field(
        0.5, gt=0.0, le=1.0, description="Largest share of places, bytes and streams that one client may hold."
    )
    weights: str = Field("", description="Clients with more or less time than others, as in NAME=2,ADDRESS=0.5.")
    batch_window_ms: float = Field(2.0, ge=0.0, le=100.0, description="Longest wait for company under load (ms).")
    max_wait: float = Field(0.55, gt=0.0, le=600.0, description="Longest wait of a command for its turn (s).")
    deadline: float = Field(5.0, gt=0.0, le=600.0, description="Longest time until a plan is ready (s).")
    hang_deadlines: float = Field(
        6.0, ge=1.0, le=1000.0, description="Deadlines that planning or reading may take until its process is replaced."
    )
    header_timeout: float = Field(8.0, gt=0.0, le=600.0, description="Longest time to send a header (s).")
    body_timeout: float = Field(10.0, gt=0.0, le=600.0, description="Longest time to send a body (s).")
    write_timeout: float = Field(60.0, gt=0.0, le=600.0, description="Longest time to make room for an answer (s).")
    drain_timeout: float = Field(7.0, gt=0.0, le=600.0, description="Longest time to finish when stopped (s).")

    max_connections: int = Field(1000, ge=1, le=100_000, description="Most connections open at once.")
    max_streams: int = Field(64, ge=1, le=1024, description="Most streams open at once.")
    stream_rate: float = Field(200.0, gt=0.0, le=10_000.0, description="Most chunks a second of one stream.")
    stream_idle: float = Field(10.0, gt=0.0, le=3600.0, description="Longest silence of a stream (s).")

    @model_validator(mode="after")
    def _guarded(self) -> Self:
        if self.token is not None and not self.token.get_secret_value():
            raise ValueError("token must not be empty")
        if self.tokens is not None and not self.clients:
            raise ValueError("tokens must not be empty")
        if len(set(self.clients.values())) < len(self.clients):
            raise ValueError("tokens: two clients have the same token")
        for name, weight in self.shares_of_time.items():
            if not 0.0 < weight < math.inf:
                raise ValueError(f"weights: the weight of {name} must be greater than 0, got {weight:g}")
        if not self.needs_token and not self.insecure and not loopback(self.host):
            raise ValueError(
                f"host {self.host} is reachable from other machines: give a token (SLIDE_TOKEN), or say --insecure"
            )
        return self

    @cached_property
    def clients(self) -> dict[str, str]:
        """Token of each named client."""
        return {} if self.tokens is None else pairs("tokens", self.tokens.get_secret_value(), secret=True)

    @cached_property
    def names(self) -> frozenset[str]:
        """Names this server goes by, in lower case."""
        return frozenset(
            name.strip().lower() for name in f"localhost,{self.host},{self.hosts}".split(",") if name.strip()
        )

    @cached_property
    def shares_of_time(self) -> dict[str, float]:
        """Weight of each client that has one."""
        return {name: float(weight) for name, weight in pairs("weights", self.weights).items()}

    @property
    def needs_token(self) -> bool:
        """Whether requests must carry a token."""
        return self.token is not None or self.tokens is not None

    def shown(self) -> dict[str, Any]:
        """Return the settings that anybody may see."""
        shown = self.model_dump(mode="json", exclude=SECRETS | PRIVATE)
        return {**shown, "token_needed": self.needs_token}


def pairs(setting: str, text: str, secret: bool = False) -> dict[str, str]:
    """Return the names and values of a setting NAME=VALUE,NAME=VALUE.

    Raises:
        ValueError: it is none; nothing of it is shown if it is secret.
    """
    result: dict[str, str] = {}
    for number, part in enumerate(filter(None, (part.strip() for part in text.split(",")))):
        name, _, value = (each.strip() for each in part.partition("="))
        if not name or not value or name in result:
            shown = f"number {number + 1}" if secret else repr(part)
            raise ValueError(f"{setting}: {shown} must be NAME=VALUE, with a name of its own")
        result[name] = value
    return result


def variable(name: str) -> str:
    """Return the variable that gives a setting."""
    return f"{PREFIX}{name.upper()}"


def loopback(host: str) -> bool:
    """Whether only this machine can reach an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
