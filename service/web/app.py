"""``create_app``: the pages and the API of one site, as an ASGI application."""

from __future__ import annotations

import logging

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse, Response
from starlette.exceptions import HTTPException

from stemwatch.service import __version__
from stemwatch.service.store.errors import StoreError
from stemwatch.service.web import (
    alerts_page,
    api_docs,
    api_read,
    api_write,
    assets,
    health,
    ranking_page,
    reports,
    runs_page,
    settings_page,
    sources_page,
    valve_page,
)
from stemwatch.service.web.actions import Actions, Missing, Refused
from stemwatch.service.web.desk import Desk
from stemwatch.service.web.frame import Frame
from stemwatch.service.web.guard import Guard
from stemwatch.service.web.site import Site

log = logging.getLogger(__name__)

SHORTEST_TOKEN = 16
UNFORESEEN = "Something went wrong here; the service's log says what."
ROUTERS = (
    assets.router,
    health.router,
    ranking_page.router,
    valve_page.router,
    alerts_page.router,
    runs_page.router,
    reports.router,
    sources_page.router,
    settings_page.router,
    api_docs.router,
    api_read.router,
    api_write.router,
)


def create_app(site: Site) -> FastAPI:
    """The application. It serves what is in the store and never screens by itself."""
    actions = Actions(site.store) if site.actions is None else site.actions
    desk = Desk(site=site, frame=Frame(site), actions=actions)
    app = FastAPI(
        title="stemwatch",
        version=__version__,
        description="Sticking control valves: findings, evidence, alerts and runs.",
        docs_url=None,  # the ready-made pages load from a content network
        redoc_url=None,
        openapi_url="/api/openapi.json",
    )
    if 0 < len(site.token) < SHORTEST_TOKEN:
        log.warning(
            "the token has %d characters; one that cannot be guessed has more", len(site.token)
        )
    app.state.desk = desk
    for router in ROUTERS:
        app.include_router(router)
    _say_errors(app, desk)
    app.add_middleware(
        Guard,
        hosts=site.hosts,
        token=site.token,
        failed=lambda request: _failure(desk, request, 500, UNFORESEEN),
    )
    return app


def _say_errors(app: FastAPI, desk: Desk) -> None:
    """Every failure as a page or as JSON, with a sentence and without a trace."""

    @app.exception_handler(HTTPException)
    def http(request: Request, error: HTTPException) -> Response:
        return _failure(desk, request, error.status_code, str(error.detail))

    @app.exception_handler(RequestValidationError)
    def invalid(request: Request, error: RequestValidationError) -> Response:
        said = [f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in error.errors()]
        return _failure(desk, request, 422, "; ".join(said))

    @app.exception_handler(Refused)
    def refused(request: Request, error: Refused) -> Response:
        return _failure(desk, request, 404 if isinstance(error, Missing) else 409, str(error))

    @app.exception_handler(StoreError)
    def store(request: Request, error: StoreError) -> Response:
        log.warning("%s %s: %s", request.method, request.url.path, error)
        text = "The database does not answer; the page is there again when it does."
        return _failure(desk, request, 503, text)


def _failure(desk: Desk, request: Request, status: int, text: str) -> Response:
    if request.url.path.startswith("/api/") and request.url.path != "/api/docs":
        return JSONResponse({"detail": text}, status)
    try:
        return desk.frame.page(
            request, "error_page.html", status=status, here="", text=text, code=status
        )
    except Exception:  # a page that cannot even say what failed must still answer
        log.exception("the error page failed")
        return HTMLResponse("<h1>Something went wrong</h1>", status)
