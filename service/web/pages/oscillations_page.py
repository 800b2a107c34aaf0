"""Loops that oscillate together: since when, where it likely begins, and which are over."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from stemwatch.service.report.group_pictures import windows_bars
from stemwatch.service.store.screenings.oscillations import SHOWN_DAYS
from stemwatch.service.web.dependencies import Deps

router = APIRouter(include_in_schema=False)


@router.get("/oscillations")
def oscillations(request: Request, deps: Deps) -> HTMLResponse:
    """Every group of the last weeks with its members, spectra and strength, the standing ones
    first."""
    kept_oscillations = deps.store.oscillations(deps.now)
    return deps.renderer.page(
        request,
        "oscillations_page.html",
        here="oscillations",
        open_alerts=deps.open_alerts(),
        standing=[
            (oscillation, windows_bars(oscillation.history, deps.site.tz))
            for oscillation in kept_oscillations
            if not oscillation.over
        ],
        over=[one for one in kept_oscillations if one.over],
        days=SHOWN_DAYS,
    )
