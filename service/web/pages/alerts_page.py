"""Alerts: what somebody should look at, and what was said to each."""

from __future__ import annotations

from datetime import timedelta

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse, RedirectResponse

from stemwatch.service.plant_path import PartOfPlant
from stemwatch.service.store.alerts.alerts import MOST_ALERTS, STATES, state_of
from stemwatch.service.web.auth.current_user import SignedIn
from stemwatch.service.web.auth.forms import SentForm
from stemwatch.service.web.dependencies import Deps
from stemwatch.service.web.pages.redirects import to_page

LONGEST_SNOOZE_H = 24 * 366

router = APIRouter(include_in_schema=False)


@router.get("/alerts")
def alert_list(request: Request, deps: Deps) -> HTMLResponse:
    """Alerts in the state that the address names, the open ones unless it says otherwise."""
    state = request.query_params.get("state", "open")
    state = state if state in STATES else "open"
    units = tuple(unit for unit in request.query_params.getlist("unit") if unit)
    alerts = deps.store.alerts.in_state(state, deps.now, part=PartOfPlant(units=units))
    return deps.renderer.page(
        request,
        "alerts_page.html",
        here="alerts",
        open_alerts=deps.open_alerts(),
        state=state,
        states=STATES,
        alerts=alerts,
        units=deps.store.levels()["unit"],
        unit=units[0] if units else "",
        most=MOST_ALERTS,
        state_of=lambda alert: state_of(alert, deps.now),
        back="",
    )


@router.post("/alerts/settle")
def settle(
    request: Request, deps: Deps, current_user: SignedIn, form: SentForm
) -> RedirectResponse:
    """Acknowledge alerts, put them off, or mark them as false; ``how`` says which. All of them or,
    where one is not there, none."""
    numbers = form.numbers("alert", "the number of an alert")
    who, text = current_user.signature(), form.text("text")
    action = form.text("how", needed="what is to be done with the alert")
    if action == "snooze":
        hours = min(form.number("hours", "a number of hours"), LONGEST_SNOOZE_H)
        deps.actions.snooze_all(numbers, deps.now + timedelta(hours=hours), who)
    elif action == "acknowledge":
        deps.actions.acknowledge_all(numbers, who, text)
    elif action == "false":
        deps.actions.false_alarms(numbers, who, text)
    else:
        raise HTTPException(422, f"acknowledge, snooze or false is expected, received {action!r}")
    action_done = {"snooze": "snoozed", "acknowledge": "acknowledged", "false": "false"}[action]
    if len(numbers) > 1:
        action_done = f"all-{action_done}"
    if valve := form.text("back"):
        return to_page(request, "/valve", action_done, anchor="alerts", id=valve)
    return to_page(request, "/alerts", action_done)
