"""Every token of every user, for admins, who can revoke them."""

from __future__ import annotations

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse, RedirectResponse

from stemwatch.service.access.tokens import ENVIRONMENT, SHORTEST_OF_ENVIRONMENT
from stemwatch.service.web.actions import LARGEST_NUMBER
from stemwatch.service.web.auth.current_user import note_about
from stemwatch.service.web.auth.forms import SentForm
from stemwatch.service.web.dependencies import Deps
from stemwatch.service.web.pages.redirects import to_page

router = APIRouter(include_in_schema=False)


@router.get("/tokens")
def token_list(request: Request, deps: Deps) -> HTMLResponse:
    """The tokens that let programs in, the newest first, then those that no longer do."""
    tokens = deps.store.api_tokens.all()
    now = deps.now
    return deps.renderer.page(
        request,
        "tokens_page.html",
        here="tokens",
        open_alerts=deps.open_alerts(),
        tokens=sorted(tokens, key=lambda token: not token.is_open(now)),
        environment=ENVIRONMENT if len(deps.site.token) >= SHORTEST_OF_ENVIRONMENT else "",
    )


@router.post("/tokens/revoke")
def revoke(request: Request, deps: Deps, form: SentForm) -> RedirectResponse:
    """Revoke a token."""
    number = form.number("token", "the number of a token")
    token = deps.store.api_tokens.get(number) if number <= LARGEST_NUMBER else None
    if token is None:
        raise HTTPException(404, f"There is no token {number}.")
    note_about(request, f"revoke {token.name} of {token.user.name}")
    deps.store.api_tokens.revoke(token.id, deps.now)
    return to_page(request, "/tokens", "revoked")
