"""Where a form leads: back to a page, which says what was done."""

from __future__ import annotations

from urllib.parse import urlencode

from fastapi import Request
from fastapi.responses import RedirectResponse

from stemwatch.service.web.path_prefix import root_of


def to_page(
    request: Request, place: str, done: str, anchor: str = "", **query: str
) -> RedirectResponse:
    """Redirect to the page ``place`` with ``query``, at its ``anchor``; ``done`` is a key of the
    renderer's ```DONE```. By 303, so that going back in the browser sends no form again."""
    address = f"{root_of(request.scope)}{place}?{urlencode({**query, 'done': done})}"
    return RedirectResponse(f"{address}#{anchor}" if anchor else address, 303)
