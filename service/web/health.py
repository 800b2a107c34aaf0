"""``/health``, ``/ready`` and ``/healthz``, for supervisors and load balancers. They need no login
and say nothing of the plant but the names of parts that do not work."""

from __future__ import annotations

from fastapi import APIRouter, Response

from stemwatch.service import __version__
from stemwatch.service.store.errors import StoreError
from stemwatch.service.web.api.schemas import CheckAnswer, HealthAnswer
from stemwatch.service.web.dependencies import Dependencies, Deps

router = APIRouter(tags=["health"])


@router.get("/health")
def alive() -> HealthAnswer:
    """200 while the process answers; a supervisor restarts one that does not."""
    return HealthAnswer(ok=True, version=__version__, checks=[])


@router.get("/ready", responses={503: {"model": HealthAnswer}})
def ready(deps: Deps, response: Response) -> HealthAnswer:
    """Whether the vital parts work: the database, the scheduler, the collector; 503 with the reason
    while one does not. An unavailable device does not count, since the others go on."""
    return _answer(_checks(deps, vital=True), response)


@router.get("/healthz", responses={503: {"model": HealthAnswer}})
def health(deps: Deps, response: Response) -> HealthAnswer:
    """The database and whatever the service watches; 503 where one of them does not work."""
    return _answer(_checks(deps, vital=False), response)


def _answer(checks: list[CheckAnswer], response: Response) -> HealthAnswer:
    fine = all(check.ok for check in checks)
    response.status_code = 200 if fine else 503
    return HealthAnswer(ok=fine, version=__version__, checks=checks)


def _checks(deps: Dependencies, *, vital: bool) -> list[CheckAnswer]:
    checks = deps.site.checks()
    chosen = [check for check in checks if check.vital or not vital]
    return [_database(deps)] + [
        CheckAnswer(name=check.name, ok=check.ok, says=check.says) for check in chosen
    ]


def _database(deps: Dependencies) -> CheckAnswer:
    try:
        deps.open_alerts()
    except StoreError:
        return CheckAnswer(name="database", ok=False, says="the database does not answer")
    return CheckAnswer(name="database", ok=True, says="")
