"""``/api/v1/me``: by which name and with which rights a program is let in."""

from __future__ import annotations

from fastapi import APIRouter

from stemwatch.service.access.rights import Operation
from stemwatch.service.web import shapes
from stemwatch.service.web.shapes_access import MeAnswer
from stemwatch.service.web.visit import AtVisit

router = APIRouter(prefix="/api/v1", tags=["read"], responses=shapes.REFUSALS)


@router.get("/me")
def me(visitor: AtVisit) -> MeAnswer:
    """Who asks, and what that allows."""
    scopes = None if visitor.scopes is None else sorted(visitor.scopes)
    return MeAnswer(
        name=visitor.name,
        role=visitor.role,
        how=visitor.how,
        scopes=scopes,
        may=[one.value for one in Operation if visitor.may(one)],
    )
