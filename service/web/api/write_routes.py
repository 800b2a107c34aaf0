"""The API that changes something. Bodies are JSON, which no form of a foreign page can send."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from stemwatch.service.web.actions import Missing, Refused
from stemwatch.service.web.api import schemas as shapes
from stemwatch.service.web.api.read_routes import Id, Number
from stemwatch.service.web.auth.current_user import SignedIn
from stemwatch.service.web.dependencies import Deps

AlertId = Annotated[Number, Query(alias="id", description="the alert's number")]
RunId = Annotated[Number, Query(alias="id", description="the run's number")]

router = APIRouter(prefix="/api/v1", tags=["change"], responses=shapes.REFUSALS)


@router.post("/runs", status_code=202)
def begin_run(deps: Deps, current_user: SignedIn, body: shapes.AskRun) -> shapes.Done:
    """Queue a run over these valves, or over all where none are named."""
    return shapes.Done(
        done="queued", id=deps.actions.run_now(body.valves, current_user.signature(body.who))
    )


@router.post("/run/cancel")
def cancel_run(
    deps: Deps, current_user: SignedIn, run: RunId, signed: shapes.Signed
) -> shapes.Done:
    """Ask that a run ends early; what it has done stays."""
    deps.actions.cancel(run, current_user.signature(signed.who))
    return shapes.Done(done="asked to end", id=run)


@router.post("/alert/acknowledge")
def acknowledge(
    deps: Deps, current_user: SignedIn, alert: AlertId, signed: shapes.Signed
) -> shapes.Done:
    """Note that somebody has seen an alert."""
    deps.actions.acknowledge(alert, current_user.signature(signed.who), signed.text)
    return shapes.Done(done="acknowledged", id=alert)


@router.post("/alert/snooze")
def snooze(
    deps: Deps, current_user: SignedIn, alert: AlertId, body: shapes.AskSnooze
) -> shapes.Done:
    """Let an alert rest until an instant in the future; its zone must be given."""
    if body.until <= deps.now:
        raise Refused("until must lie in the future")
    deps.actions.snooze(alert, body.until, current_user.signature(body.who))
    return shapes.Done(done="snoozed", id=alert)


@router.post("/alert/false-alarm")
def false_alarm(
    deps: Deps, current_user: SignedIn, alert: AlertId, signed: shapes.Signed
) -> shapes.Done:
    """Note that an alert was wrong."""
    deps.actions.false_alarm(alert, current_user.signature(signed.who), signed.text)
    return shapes.Done(done="marked as a false alarm", id=alert)


@router.post("/valve/note")
def note(deps: Deps, current_user: SignedIn, valve: Id, body: shapes.AskRemark) -> shapes.Done:
    """Keep a remark about a valve."""
    deps.actions.note(
        deps.need_valve(valve),
        body.at or deps.now,
        _text(body),
        current_user.signature(body.who),
    )
    return shapes.Done(done="kept")


@router.post("/valve/maintenance")
def maintenance(
    deps: Deps, current_user: SignedIn, valve: Id, body: shapes.AskRemark
) -> shapes.Done:
    """Record work on a valve; the first window after it becomes its baseline."""
    work_time, who = body.at or deps.now, current_user.signature(body.who)
    deps.actions.maintenance(deps.need_valve(valve), work_time, _text(body), who, deps.now)
    return shapes.Done(done="recorded")


@router.post("/valve/feedback")
def feedback(
    deps: Deps, current_user: SignedIn, valve: Id, body: shapes.AskFeedback
) -> shapes.Done:
    """Keep whether what was said of a valve was right, and what was found."""
    name = deps.need_valve(valve)
    number = body.screening
    if number is None:
        latest = deps.store.screenings(name, 1)
        if not latest:
            raise Missing(f"{name} was not screened yet")
        number = latest[0].id
    deps.actions.feedback(
        number,
        body.at or deps.now,
        body.judgement,
        body.text.strip(),
        current_user.signature(body.who),
    )
    return shapes.Done(done="kept", id=number)


@router.post("/valve/baseline")
def baseline(deps: Deps, current_user: SignedIn, valve: Id, signed: shapes.Signed) -> shapes.Done:
    """Make the network fitted last the valve's baseline."""
    deps.actions.baseline(deps.need_valve(valve), signed.text, current_user.signature(signed.who))
    return shapes.Done(done="set")


def _text(body: shapes.Signed) -> str:
    if not body.text.strip():
        raise Refused("text says what was seen or done; it is needed")
    return body.text.strip()
