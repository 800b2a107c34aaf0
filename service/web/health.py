"""``/healthz``: whether the service works, for a supervisor; needs no token, tells no names."""

from __future__ import annotations

from fastapi import APIRouter, Response

from stemwatch.service import __version__
from stemwatch.service.store.errors import StoreError
from stemwatch.service.web.desk import AtDesk
from stemwatch.service.web.shapes import CheckAnswer, HealthAnswer

router = APIRouter(tags=["health"])


@router.get("/healthz", responses={503: {"model": HealthAnswer}})
def health(desk: AtDesk, response: Response) -> HealthAnswer:
    """The database and whatever the service watches; 503 where one of them does not work."""
    checks = [_database(desk)]
    checks += [CheckAnswer(name=one.name, ok=one.ok, says=one.says) for one in desk.site.checks()]
    fine = all(check.ok for check in checks)
    response.status_code = 200 if fine else 503
    return HealthAnswer(ok=fine, version=__version__, checks=checks)


def _database(desk: AtDesk) -> CheckAnswer:
    try:
        desk.open_alerts()
    except StoreError:
        return CheckAnswer(name="database", ok=False, says="the database does not answer")
    return CheckAnswer(name="database", ok=True, says="")
