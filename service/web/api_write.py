"""The API that changes something. Bodies are JSON, which no form of a foreign page can send."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from stemwatch.service.web import shapes
from stemwatch.service.web.actions import Refused
from stemwatch.service.web.api_read import Id, Number
from stemwatch.service.web.desk import AtDesk
from stemwatch.service.web.visit import AtVisit

AlertId = Annotated[Number, Query(alias="id", description="the alert's number")]
RunId = Annotated[Number, Query(alias="id", description="the run's number")]

router = APIRouter(prefix="/api/v1", tags=["change"], responses=shapes.REFUSALS)


@router.post("/runs", status_code=202)
def begin_run(desk: AtDesk, visitor: AtVisit, asked: shapes.AskRun) -> shapes.Done:
    """Queue a run over these valves, or over all where none are named."""
    return shapes.Done(
        done="queued", id=desk.actions.run_now(asked.valves, visitor.signs(asked.who))
    )


@router.post("/run/cancel")
def cancel_run(desk: AtDesk, visitor: AtVisit, run: RunId, signed: shapes.Signed) -> shapes.Done:
    """Ask that a run ends early; what it has done stays."""
    desk.actions.cancel(run, visitor.signs(signed.who))
    return shapes.Done(done="asked to end", id=run)


@router.post("/alert/acknowledge")
def acknowledge(
    desk: AtDesk, visitor: AtVisit, alert: AlertId, signed: shapes.Signed
) -> shapes.Done:
    """Note that somebody has seen an alert."""
    desk.actions.acknowledge(alert, visitor.signs(signed.who), signed.text)
    return shapes.Done(done="acknowledged", id=alert)


@router.post("/alert/snooze")
def snooze(desk: AtDesk, visitor: AtVisit, alert: AlertId, asked: shapes.AskSnooze) -> shapes.Done:
    """Let an alert rest until an instant in the future; its zone must be given."""
    if asked.until <= desk.now:
        raise Refused("until must lie in the future")
    desk.actions.snooze(alert, asked.until, visitor.signs(asked.who))
    return shapes.Done(done="snoozed", id=alert)


@router.post("/alert/false-alarm")
def false_alarm(
    desk: AtDesk, visitor: AtVisit, alert: AlertId, signed: shapes.Signed
) -> shapes.Done:
    """Note that an alert was wrong."""
    desk.actions.false_alarm(alert, visitor.signs(signed.who), signed.text)
    return shapes.Done(done="marked as a false alarm", id=alert)


@router.post("/valve/note")
def note(desk: AtDesk, visitor: AtVisit, valve: Id, asked: shapes.AskRemark) -> shapes.Done:
    """Keep a remark about a valve."""
    desk.actions.note(
        desk.need_valve(valve), asked.at or desk.now, _text(asked), visitor.signs(asked.who)
    )
    return shapes.Done(done="kept")


@router.post("/valve/maintenance")
def maintenance(desk: AtDesk, visitor: AtVisit, valve: Id, asked: shapes.AskRemark) -> shapes.Done:
    """Record work on a valve; the first window after it becomes its baseline."""
    at = asked.at or desk.now
    desk.actions.maintenance(desk.need_valve(valve), at, _text(asked), visitor.signs(asked.who))
    return shapes.Done(done="recorded")


@router.post("/valve/baseline")
def baseline(desk: AtDesk, visitor: AtVisit, valve: Id, signed: shapes.Signed) -> shapes.Done:
    """Make the network fitted last the valve's baseline."""
    desk.actions.baseline(desk.need_valve(valve), signed.text, visitor.signs(signed.who))
    return shapes.Done(done="set")


def _text(asked: shapes.Signed) -> str:
    if not asked.text.strip():
        raise Refused("text says what was seen or done; it is needed")
    return asked.text.strip()
