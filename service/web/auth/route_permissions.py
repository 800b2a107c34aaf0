"""Which operation each route performs: the one list that ``Authentication`` goes by.

Which role may perform an operation stands in ``service/access/permissions.py``. A route that is
missing here is for admins alone, and a test names it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from starlette.routing import BaseRoute, Match
from starlette.types import Scope

from stemwatch.service.access.permissions import Operation

ROUTE_OPERATIONS: Mapping[str, Operation] = MappingProxyType(
    {
        "GET /static/{name}": Operation.OPEN,
        "GET /health": Operation.OPEN,
        "GET /healthz": Operation.OPEN,
        "GET /ready": Operation.OPEN,
        "GET /login": Operation.OPEN,
        "POST /login": Operation.OPEN,
        "GET /welcome": Operation.OPEN,
        "POST /welcome": Operation.OPEN,
        "GET /metrics": Operation.METRICS,
        "GET /": Operation.READ,
        "GET /overview": Operation.READ,
        "GET /valve": Operation.READ,
        "GET /valve/what-if": Operation.READ,
        "GET /valve/what-if/valve.fmu": Operation.READ,
        "GET /valve/test-plan": Operation.READ,
        "GET /valve/test-plan/sheet": Operation.READ,
        "GET /oscillations": Operation.READ,
        "GET /alerts": Operation.READ,
        "GET /runs": Operation.READ,
        "GET /run": Operation.READ,
        "GET /run/report": Operation.READ,
        "GET /sources": Operation.READ,
        "GET /settings": Operation.READ,
        "GET /settings/plant.toml": Operation.READ,
        "GET /api/docs": Operation.READ,
        "GET /api/openapi.json": Operation.READ,
        "GET /api/v1/changes": Operation.READ,
        "GET /api/v1/me": Operation.READ,
        "GET /api/v1/valves": Operation.READ,
        "GET /api/v1/valve/signals": Operation.READ,
        "GET /api/v1/valve/loop": Operation.READ,
        "GET /api/v1/valve/history": Operation.READ,
        "GET /api/v1/oscillations": Operation.READ,
        "GET /api/v1/next-steps": Operation.READ,
        "GET /api/v1/alerts": Operation.READ,
        "GET /api/v1/runs": Operation.READ,
        "GET /api/v1/run": Operation.READ,
        "GET /api/v1/sources": Operation.READ,
        "GET /api/v1/schedules": Operation.READ,
        "POST /alerts/settle": Operation.ALERT,
        "POST /api/v1/alert/acknowledge": Operation.ALERT,
        "POST /api/v1/alert/snooze": Operation.ALERT,
        "POST /api/v1/alert/false-alarm": Operation.ALERT,
        "POST /valve/note": Operation.NOTE,
        "POST /api/v1/valve/note": Operation.NOTE,
        "POST /valve/maintenance": Operation.MAINTENANCE,
        "POST /api/v1/valve/maintenance": Operation.MAINTENANCE,
        "POST /valve/feedback": Operation.FEEDBACK,
        "POST /api/v1/valve/feedback": Operation.FEEDBACK,
        "GET /feedback": Operation.READ,
        "GET /feedback/labels": Operation.READ,
        "POST /valve/baseline": Operation.BASELINE,
        "POST /api/v1/valve/baseline": Operation.BASELINE,
        "POST /runs/begin": Operation.RUN,
        "POST /api/v1/runs": Operation.RUN,
        "POST /runs/cancel": Operation.CANCEL,
        "POST /api/v1/run/cancel": Operation.CANCEL,
        "POST /logout": Operation.LOG_OUT,
        "GET /account": Operation.OWN,
        "POST /account/password": Operation.OWN,
        "POST /account/sessions/end": Operation.OWN,
        "POST /account/tokens/make": Operation.OWN,
        "POST /account/tokens/revoke": Operation.OWN,
        "POST /settings/limits": Operation.SETTINGS,
        "POST /settings/schedule": Operation.SETTINGS,
        "POST /settings/schedule/remove": Operation.SETTINGS,
        "GET /users": Operation.USERS,
        "POST /users/invite": Operation.USERS,
        "POST /users/role": Operation.USERS,
        "POST /users/disable": Operation.USERS,
        "POST /users/enable": Operation.USERS,
        "POST /users/password": Operation.USERS,
        "POST /users/links/withdraw": Operation.USERS,
        "GET /tokens": Operation.TOKENS,
        "POST /tokens/revoke": Operation.TOKENS,
        "GET /audit": Operation.AUDIT,
        "GET /api/v1/audit": Operation.AUDIT,
    }
)


class RoutePermissions:
    """Finds the operation of a request by matching it as the application does."""

    def __init__(self, routes: Iterable[BaseRoute]) -> None:
        self._routes = tuple(routes)

    def of(self, scope: Scope) -> Operation:
        """The operation of a request. One that matches no route counts as reading: users who may
        read get 404, all others a refusal."""
        for route in self._routes:
            match, _ = route.matches(scope)
            if match is Match.FULL:
                method = "GET" if scope["method"] == "HEAD" else scope["method"]
                return ROUTE_OPERATIONS.get(f"{method} {path_of(route)}", Operation.UNDECLARED)
        return Operation.READ


def path_of(route: BaseRoute) -> str:
    """The path of a route as it was declared, such as ``/static/{name}``."""
    return str(getattr(route, "path", ""))
