"""The application: its routes, what guards them, and its life from start to stop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from functools import partial
from importlib.metadata import metadata, version
from pathlib import Path
from typing import TYPE_CHECKING

import orjson
from fastapi import FastAPI, Request
from prometheus_client import CONTENT_TYPE_LATEST
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.staticfiles import StaticFiles

from runtime.errors import InputError
from server.http import commands, plans, stream
from server.http.guard import Guard
from server.http.openapi import describe, problems
from server.planning.process import PLANNING_COMMAND
from server.problems import Problem, for_input, for_status
from server.service import Service
from server.settings import Settings
from server.traces import trace

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider

STATIC = Path(__file__).parent / "static"


def create_app(
    settings: Settings | None = None,
    command: Sequence[str] = PLANNING_COMMAND,
    tracing: TracerProvider | None = None,
) -> FastAPI:
    """Make the application.

    Args:
        settings: what the server is told; from the environment if None.
        command: how the planning process is run.
        tracing: what makes spans; None for none.
    """
    service = Service(Settings() if settings is None else settings, command)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        planning = asyncio.create_task(service.run())
        try:
            yield
        finally:
            service.stopping = True
            planning.cancel()
            with suppress(asyncio.CancelledError):
                await planning

    app = FastAPI(
        title="slide-planner",
        version=version("slide-planner"),
        description="Plans the motion of a frying pan that makes the object on it slide along a given path.",
        lifespan=lifespan,
        docs_url=None,  # its page would load scripts from elsewhere
        redoc_url=None,
        redirect_slashes=False,
    )
    app.state.service = service
    app.add_exception_handler(Problem, _problem)
    app.add_exception_handler(InputError, _input_error)
    app.add_exception_handler(HTTPException, _http_exception)
    app.include_router(plans.router)
    app.include_router(commands.router)
    app.include_router(stream.router)
    _add_views(app, service)
    app.mount("/viewer", StaticFiles(packages=[("runtime.report", "viewer")]))  # what the page shares with the report
    app.mount("/arms", StaticFiles(packages=[("runtime.arms", "shipped")]))
    # Not a mount: one at "/" would take what other routes refuse, and a wrong method would be not found.
    app.router.default = StaticFiles(directory=STATIC, html=True)
    app.openapi = partial(describe, app)  # type: ignore[method-assign]
    app.add_middleware(Guard, service=service)
    if tracing is not None:
        trace(app, tracing)
    return app


def _add_views(app: FastAPI, service: Service) -> None:
    more = links()  # which is read from a file

    @app.get("/health/live")
    async def live() -> dict[str, str]:
        """Say that the server runs."""
        return {"status": "alive"}

    @app.get("/health/ready", responses=problems(503))
    async def ready() -> dict[str, str]:
        """Say whether the server takes work: the bundle's hashes and a golden plan have passed, and nothing hangs."""
        if service.dispatcher.busy > service.settings.deadline:
            raise Problem("not-ready", "a plan takes longer than the deadline", headers={"Retry-After": "1"})
        return {"status": "ready"}

    @app.get("/info", response_class=Response, responses=problems(401, 421, 503))
    async def info() -> Response:
        """Say what the server plans with and what it was told."""
        bundle = service.planner.bundle
        manifest = bundle.manifest.to_dict()
        shown = {name: manifest[name] for name in ("name", "precision", "network", "dt", "friction", "limits", "sizes")}
        model = {**shown, "trained_on": manifest["trained_on"], "sha256": bundle.sha256}
        document = {"version": app.version, "model": model, "settings": service.settings.shown(), "links": more}
        return Response(orjson.dumps(document), media_type="application/json")

    @app.get("/metrics", response_class=Response, responses=problems(401, 421))
    async def metrics() -> Response:
        """Give what is counted, in Prometheus form."""
        return Response(service.metrics.text(), media_type=CONTENT_TYPE_LATEST)


def links() -> dict[str, str]:
    """Return where more is to be read, by name, as the package says."""
    given = metadata("slide-planner").get_all("Project-URL") or []
    pairs = (line.partition(",") for line in given)
    return {name.strip().lower(): address.strip() for name, _, address in pairs}


async def _problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, Problem)
    return error.response()


async def _input_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, InputError)
    return for_input(error).response()


async def _http_exception(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    if error.status_code == 405:  # of the page's files, which say nothing
        headers.setdefault("Allow", "GET, HEAD")
    return for_status(error.status_code, headers).response()
