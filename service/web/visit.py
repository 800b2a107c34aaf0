"""Who asks, as the routes see it: put beside the request by ``Door`` before any route begins."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Depends, Request
from starlette.types import Scope

from stemwatch.service.access.rights import Operation, Visitor

_NOBODY = "a route asked for a visitor where the door is open to everybody"


def state_of(scope: Scope) -> dict[str, Any]:
    """What is kept beside a request."""
    found: dict[str, Any] = scope.setdefault("state", {})
    return found


def visitor_of(request: Request) -> Visitor | None:
    """Who asks; ``None`` on the few pages that are open to everybody."""
    found: Visitor | None = state_of(request.scope).get("visitor")
    return found


async def _need_visitor(request: Request) -> Visitor:
    visitor = visitor_of(request)
    if visitor is None:
        raise RuntimeError(_NOBODY)
    return visitor


AtVisit = Annotated[Visitor, Depends(_need_visitor)]


def address_of(scope: Scope) -> str:
    """The address that a request came from; behind a proxy on this machine the one it names."""
    client = scope.get("client")
    return str(client[0]) if client else ""


def note_about(request: Request, text: str) -> None:
    """Say for the audit log what a request is about: a valve, a user. Never a secret."""
    state = state_of(request.scope)
    state["about"] = "; ".join(part for part in (state.get("about", ""), text) if part)


def may(visitor: Visitor | None, name: str) -> bool:
    """Whether somebody may do the operation of this name, such as ``NOTE``; for templates."""
    return visitor is not None and visitor.may(Operation[name])
