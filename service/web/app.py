"""``create_app``: the pages and the API of one site, as an ASGI application."""

from __future__ import annotations

import logging

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.routing import Route

from stemwatch.service import __version__
from stemwatch.service.access.tokens import ENVIRONMENT, SHORTEST_OF_ENVIRONMENT
from stemwatch.service.store.errors import StoreError
from stemwatch.service.web import assets, health, metrics
from stemwatch.service.web.actions import Actions, Missing, Refused
from stemwatch.service.web.api import openapi, read_routes, write_routes
from stemwatch.service.web.api.openapi import describe_access
from stemwatch.service.web.auth.authentication import AWAY, Authentication
from stemwatch.service.web.auth.route_permissions import RoutePermissions
from stemwatch.service.web.dependencies import Dependencies
from stemwatch.service.web.middleware import SecurityMiddleware
from stemwatch.service.web.page_renderer import PageRenderer
from stemwatch.service.web.pages import (
    account_page,
    alerts_page,
    audit_page,
    feedback_page,
    login_page,
    oscillations_page,
    overview_page,
    ranking_page,
    run_report,
    runs_page,
    settings_page,
    sources_page,
    test_plan_page,
    tokens_page,
    twin_page,
    users_page,
    valve_page,
)
from stemwatch.service.web.path_prefix import own_path
from stemwatch.service.web.site import Site

log = logging.getLogger(__name__)

UNFORESEEN = "Something went wrong here; the service's log says what."
ROUTERS = (
    assets.router,
    health.router,
    metrics.router,
    overview_page.router,
    ranking_page.router,
    valve_page.router,
    test_plan_page.router,
    twin_page.router,
    alerts_page.router,
    feedback_page.router,
    oscillations_page.router,
    runs_page.router,
    run_report.router,
    sources_page.router,
    settings_page.router,
    login_page.router,
    account_page.router,
    users_page.router,
    tokens_page.router,
    audit_page.router,
    openapi.router,
    audit_page.api,
    read_routes.router,
    write_routes.router,
)


def create_app(site: Site) -> FastAPI:
    """The application. It serves what is in the store and never screens by itself."""
    actions = Actions(site.store) if site.actions is None else site.actions
    deps = Dependencies(site=site, renderer=PageRenderer(site), actions=actions)
    app = FastAPI(
        title="stemwatch",
        version=__version__,
        description="Sticking control valves: findings, evidence, alerts and runs.",
        docs_url=None,  # the ready-made pages load from a content network
        redoc_url=None,
        openapi_url="/api/openapi.json",
    )
    if 0 < len(site.token) < SHORTEST_OF_ENVIRONMENT:
        log.error(
            "%s has %d characters and lets nobody in: one that cannot be guessed has at least %d",
            ENVIRONMENT,
            len(site.token),
            SHORTEST_OF_ENVIRONMENT,
        )
    app.state.deps = deps
    for router in ROUTERS:
        app.include_router(router)
    own_routes = [route for route in app.routes if isinstance(route, Route)]
    permissions = RoutePermissions(
        [*own_routes, *(route for router in ROUTERS for route in router.routes)]
    )
    _say_errors(app, deps)
    describe_access(app)
    app.add_middleware(
        SecurityMiddleware,
        hosts=site.hosts,
        authentication=Authentication(site, permissions, lambda *failure: _failure(deps, *failure)),
        failed=lambda request: _failure(deps, request, 500, UNFORESEEN),
    )
    return app


def _say_errors(app: FastAPI, deps: Dependencies) -> None:
    """Every failure as a page or as JSON, with a sentence and without a trace."""

    @app.exception_handler(HTTPException)
    def http(request: Request, error: HTTPException) -> Response:
        return _failure(deps, request, error.status_code, str(error.detail))

    @app.exception_handler(RequestValidationError)
    def invalid(request: Request, error: RequestValidationError) -> Response:
        problems = [
            f"{'.'.join(map(str, mistake['loc']))}: {mistake['msg']}" for mistake in error.errors()
        ]
        return _failure(deps, request, 422, "; ".join(problems))

    @app.exception_handler(Refused)
    def refused(request: Request, error: Refused) -> Response:
        return _failure(deps, request, 404 if isinstance(error, Missing) else 409, str(error))

    @app.exception_handler(StoreError)
    def store(request: Request, error: StoreError) -> Response:
        log.warning("%s %s: %s", request.method, request.url.path, error)
        return _failure(deps, request, 503, AWAY)


def _failure(deps: Dependencies, request: Request, status: int, text: str) -> Response:
    path = own_path(request.scope)
    if path == "/metrics" or (path.startswith("/api/") and path != "/api/docs"):
        return JSONResponse({"detail": text}, status)
    try:
        return deps.renderer.page(
            request, "error_page.html", status=status, here="", text=text, code=status
        )
    except Exception:  # a page that cannot even say what failed must still answer
        log.exception("the error page failed")
        return HTMLResponse("<h1>Something went wrong</h1>", status)
