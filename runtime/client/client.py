"""A client in Python: plans over HTTP, and a closed loop over WS.

with Client("http://127.0.0.1:8000") as client:
    plan = client.plan(position)
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from runtime import Friction, Limits, Plan, ServerError, Start
from runtime.client.stream import RemoteStream, said
from runtime.documents.files import parse_json
from runtime.errors import InputError, extra
from runtime.physics.law import DT

if TYPE_CHECKING:
    import httpx


class Client:
    """Talks to one server; a context manager.

    Args:
        url: of the server, as in http://127.0.0.1:8000.
        token: its bearer token, if it wants one.
        timeout: longest wait for an answer (s).

    Raises:
        MissingExtraError: httpx is not installed.
    """

    def __init__(self, url: str, token: str | None = None, timeout: float = 30.0) -> None:
        with extra("client"):
            import httpx
        self._url, self._token, self._timeout = url.rstrip("/"), token, timeout
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._http = httpx.Client(base_url=self._url, headers=headers, timeout=timeout)

    def plan(
        self,
        position: ArrayLike,
        friction: Friction | None = None,
        *,
        limits: Limits | None = None,
        start: Start | None = None,
        refine_ms: float | None = None,
        tolerance: float | None = None,
    ) -> Plan:
        """Plan for one command; the arguments are those of `Planner.plan`.

        Raises:
            ServerError: the server cannot be reached or refuses; what it says is passed on.
        """
        request = {"command": _command(position), **_options(friction, limits, start)}
        request |= {name: it for name, it in (("refine_ms", refine_ms), ("tolerance", tolerance)) if it is not None}
        with _answering(self._url):
            return self._read(self._http.post("/plan", json=request))

    def plans(
        self,
        positions: Iterable[ArrayLike],
        friction: Friction | None = None,
        *,
        limits: Limits | None = None,
        start: Start | None = None,
    ) -> Iterator[Plan]:
        """Plan for many commands; each plan is yielded as soon as it is there, in the order of the commands.

        Raises:
            ServerError: as for `plan`, or one command could not be planned.
        """
        request = {"commands": [_command(position) for position in positions], **_options(friction, limits, start)}
        with _answering(self._url), self._http.stream("POST", "/plans", json=request) as response:
            if response.is_error:
                response.read()
                self._read(response)
            for line in response.iter_lines():
                yield self._plan(parse_json(line))

    def stream(self, position: ArrayLike, friction: Friction | None = None, **options: Any) -> RemoteStream:
        """Follow a command with a controller that measures; see `RemoteStream`."""
        return RemoteStream(self._url, position, friction, token=self._token, **options)

    def info(self) -> dict[str, Any]:
        """Return what the server plans with and what it was told.

        Raises:
            ServerError: as for `plan`.
        """
        with _answering(self._url):
            response = self._http.get("/info")
            if response.is_error:
                self._read(response)
            document: dict[str, Any] = response.json()
            return document

    def close(self) -> None:
        """Hang up."""
        self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _read(self, response: httpx.Response) -> Plan:
        return self._plan(parse_json(response.text))

    def _plan(self, document: Any) -> Plan:
        if isinstance(document, dict) and "type" in document:
            raise ServerError(f"{self._url}: {said(document)}")
        return Plan.from_dict(document, "answer")


@contextmanager
def _answering(url: str) -> Iterator[None]:
    """Turn what goes wrong on the wire into a ServerError."""
    import httpx

    try:
        yield
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        raise ServerError(f"{url}: cannot be reached: {error}") from None
    except InputError as error:
        raise ServerError(f"{url}: not an answer of ours: {error}") from None


def _command(position: ArrayLike) -> dict[str, Any]:
    return {"dt": DT, "position": np.asarray(position, dtype=np.float64).tolist()}


def _options(friction: Friction | None, limits: Limits | None, start: Start | None) -> dict[str, Any]:
    given = (("friction", friction), ("limits", limits), ("start", start))
    return {
        name: {key: item for key, item in vars(value).items() if item is not None}
        for name, value in given
        if value is not None
    }
