"""The user or program that sent a request, as the routes see it. ``Authentication`` puts it beside
the request before any route begins."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Depends, Request
from starlette.types import Scope

from stemwatch.service.access.permissions import CurrentUser, Operation

_NOBODY = "a route that needs nobody to be signed in asked for the current user"


def state_of(scope: Scope) -> dict[str, Any]:
    """The state stored with a request."""
    state: dict[str, Any] = scope.setdefault("state", {})
    return state


def current_user_of(request: Request) -> CurrentUser | None:
    """The user of a request; ``None`` on the few pages that are open to everybody."""
    current_user: CurrentUser | None = state_of(request.scope).get("current_user")
    return current_user


async def _need_user(request: Request) -> CurrentUser:
    current_user = current_user_of(request)
    if current_user is None:
        raise RuntimeError(_NOBODY)
    return current_user


SignedIn = Annotated[CurrentUser, Depends(_need_user)]


def address_of(scope: Scope) -> str:
    """The address that a request came from; behind a proxy on this machine the one it names."""
    client = scope.get("client")
    return str(client[0]) if client else ""


def note_about(request: Request, text: str) -> None:
    """Say for the audit log what a request is about: a valve, a user. Never a secret."""
    state = state_of(request.scope)
    state["about"] = "; ".join(part for part in (state.get("about", ""), text) if part)


def may(current_user: CurrentUser | None, name: str) -> bool:
    """Whether somebody may do the operation of this name, such as ``NOTE``; for templates."""
    return current_user is not None and current_user.may(Operation[name])
