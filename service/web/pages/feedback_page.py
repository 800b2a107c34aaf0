"""What people found at the valves, counted beside what had been said, and as labels to download."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from stemwatch.models.verdict import WORST_FIRST
from stemwatch.service.maintenance.labels import LABELS, labels_csv
from stemwatch.service.store.screenings.feedback import MOST_SHOWN, Judgement, count_effects
from stemwatch.service.web.dependencies import Deps

router = APIRouter(include_in_schema=False)


@router.get("/feedback")
def feedback(request: Request, deps: Deps) -> HTMLResponse:
    """Counts by verdict and by effect, and the newest labels."""
    labels = deps.store.feedback()
    counts = deps.store.count_feedback()
    return deps.renderer.page(
        request,
        "feedback_page.html",
        here="ranking",
        open_alerts=deps.open_alerts(),
        labels=labels[:MOST_SHOWN],
        total=len(labels),
        judgements=list(Judgement),
        verdicts=[
            (verdict, [counts.get((verdict, judgement), 0) for judgement in Judgement])
            for verdict in WORST_FIRST
            if any((verdict, judgement) in counts for judgement in Judgement)
        ],
        effects=count_effects(labels),
    )


@router.get("/feedback/labels")
def labels(deps: Deps) -> Response:
    """Every label as CSV."""
    headers = {"content-disposition": f'attachment; filename="{LABELS}"'}
    text = labels_csv(deps.store.feedback())
    return Response(text, media_type="text/csv; charset=utf-8", headers=headers)
