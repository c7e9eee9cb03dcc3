"""Plans from a server, over HTTP."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from types import TracebackType
from typing import Any

from numpy.typing import ArrayLike

from runtime.client.request import command_document, options_document
from runtime.client.stream import RemoteStream, problem_text
from runtime.command import Command
from runtime.documents.files import parse_json
from runtime.errors import InputError, ServerError, extra
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.plan import Plan
from runtime.sizes import Sizes
from runtime.start import Start


class Client(AbstractContextManager["Client"]):
    """Plans with one server; a context manager.

        with Client("http://127.0.0.1:8000") as client:
            plan = client.plan(position)  # (K, 2) metres at 1 kHz

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
        self._unreachable = httpx.HTTPError, httpx.InvalidURL
        self._http = httpx.Client(base_url=self._url, headers=headers, timeout=timeout)

    def plan(
        self,
        position: Command | ArrayLike,
        friction: Friction | None = None,
        *,
        limits: Limits | None = None,
        start: Start | None = None,
        sizes: Sizes | None = None,
        tolerance: float | None = None,
        candidates: int | None = None,
        robust: float | None = None,
        refine_ms: float | None = None,
    ) -> Plan:
        """Plan for one command; the arguments are those of `Planner.plan`.

        Raises:
            InputError: a position or an option is no finite number, or the limits are not finite.
            ServerError: the server cannot be reached or refuses; what it says is passed on.
        """
        options = options_document(
            friction=friction,
            limits=limits,
            start=start,
            sizes=sizes,
            tolerance=tolerance,
            candidates=candidates,
            robust=robust,
            refine_ms=refine_ms,
        )
        request = {"command": command_document(position), **options}
        with self._asking():
            return self._read(self._http.post("/plan", json=request))

    def plans(
        self,
        positions: Iterable[Command | ArrayLike],
        friction: Friction | None = None,
        *,
        limits: Limits | None = None,
        start: Start | None = None,
        sizes: Sizes | None = None,
    ) -> Iterator[Plan]:
        """Plan for many commands; each plan is yielded as soon as it is there, in the order of the commands.

        Raises:
            InputError: as for `plan`.
            ServerError: as for `plan`, or one command could not be planned.
        """
        commands = [command_document(position) for position in positions]
        options = options_document(friction=friction, limits=limits, start=start, sizes=sizes)
        request = {"commands": commands, **options}
        with self._asking(), self._http.stream("POST", "/plans", json=request) as response:
            if response.is_error:
                response.read()
                self._read(response)
            for line in response.iter_lines():
                yield self._plan(parse_json(line))

    def stream(self, position: Command | ArrayLike, friction: Friction | None = None, **options: Any) -> RemoteStream:
        """Follow a command with a controller that measures; see `RemoteStream`."""
        return RemoteStream(self._url, position, friction, token=self._token, **options)

    def ready(self) -> bool:
        """Return whether the server takes work.

        Raises:
            ServerError: it cannot be reached.
        """
        with self._asking():
            return bool(self._http.get("/health/ready").is_success)

    def info(self) -> dict[str, Any]:
        """Return what the server plans with and what it was told.

        Raises:
            ServerError: as for `plan`.
        """
        with self._asking():
            response = self._http.get("/info")
            if response.is_error:
                self._read(response)
            document: dict[str, Any] = response.json()
            return document

    def close(self) -> None:
        """Hang up."""
        self._http.close()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    @contextmanager
    def _asking(self) -> Iterator[None]:
        """Turn what goes wrong between here and the server into a ServerError."""
        try:
            yield
        except self._unreachable as error:
            raise ServerError(f"{self._url}: cannot be reached: {error}") from None
        except InputError as error:
            raise ServerError(f"{self._url}: not an answer of ours: {error}") from None

    def _read(self, response: Any) -> Plan:
        return self._plan(parse_json(response.text))

    def _plan(self, document: Any) -> Plan:
        if isinstance(document, dict) and "type" in document:
            raise ServerError(f"{self._url}: {problem_text(document)}")
        return Plan.from_dict(document, "answer")
