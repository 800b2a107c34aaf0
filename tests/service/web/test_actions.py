"""Actions of users: handling alerts, adding notes, queueing runs, from our own pages only."""

from __future__ import annotations

from datetime import timedelta

import pytest

from stemwatch.service.access.sessions import form_token_of
from stemwatch.service.store.accounts.records import UserRole
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.web.auth.forms import COOKIE
from tests.service.open_alerts import open_alerts
from tests.service.web.example_plant import HEALTHY, HOSTILE, NOW, STICKY, WATCH
from tests.service.web.signed_in import NAMES, cookie_of

ME = NAMES[UserRole.ADMIN]  # whoever is signed in signs; no form asks for a name
JSON = {"content-type": "application/json"}


def alert_of(live, valve=STICKY):
    """The open alert of a valve."""
    (result,) = open_alerts(live.store, valve)
    return result


def test_acknowledging_keeps_who_and_why(live, send, client):
    """The alert stays until its cause is gone, and no longer counts as open."""
    number = str(alert_of(live).id)
    answer = send("/alerts/settle", alert=number, how="acknowledge", text="seen")
    assert answer.status_code == 303
    result = alert_of(live)
    assert (result.acknowledged_by, result.comment, result.closed) == (ME, "seen", None)
    assert "The alert is acknowledged." in client.get(answer.headers["location"]).text
    assert f'id="alert-{number}"' not in client.get("/alerts").text
    assert f'id="alert-{number}"' in client.get("/alerts?state=acknowledged").text


def test_an_alert_that_was_put_off_comes_back(live, send, client):
    """Until then it is among the snoozed, afterwards among the open ones."""
    number = str(alert_of(live).id)
    send("/alerts/settle", alert=number, how="snooze", hours="8")
    assert alert_of(live).snoozed_until == NOW + timedelta(hours=8)
    assert f'id="alert-{number}"' in client.get("/alerts?state=snoozed").text
    object.__setattr__(live, "clock", lambda: NOW + timedelta(hours=9))
    assert f'id="alert-{number}"' in client.get("/alerts").text


def test_a_false_alarm_is_kept_as_one(live, send, client):
    """It leaves the open ones and stands under its own heading."""
    number = str(alert_of(live).id)
    send("/alerts/settle", alert=number, how="false", text="test signal")
    assert open_alerts(live.store, STICKY) == []
    assert "test signal" in client.get("/alerts?state=false").text


def test_all_alerts_of_a_page_are_acknowledged_at_once(live, send, client):
    """One form, one comment; where one of them is not there, none is changed."""
    numbers = [str(alert.id) for alert in open_alerts(live.store)]
    assert len(numbers) > 1
    page = client.get("/alerts").text
    bulk = page[page.index("at once:") : page.index("Acknowledge all")]
    assert all(f'value="{number}"' in bulk for number in numbers)
    wrong = send("/alerts/settle", alert=[*numbers, "999999"], how="acknowledge", text="x")
    assert wrong.status_code == 404
    assert live.store.alerts.count_open(NOW) == len(numbers)
    done = send("/alerts/settle", alert=numbers, how="acknowledge", text="seen in the meeting")
    assert (
        "The alerts that were on the page are acknowledged."
        in client.get(done.headers["location"]).text
    )
    assert live.store.alerts.count_open(NOW) == 0
    noted = client.get("/api/v1/audit", params={"outcome": "done"}).json()[0]
    assert noted["about"] == f"how acknowledge; alert {', '.join(numbers)}"
    assert {open_alert.comment for open_alert in open_alerts(live.store)} == {"seen in the meeting"}


@pytest.mark.parametrize(
    ("fields", "status", "text"),
    [
        ({"alert": "999999", "how": "acknowledge"}, 404, "there is no alert 999999"),
        ({"alert": "x", "how": "acknowledge"}, 422, "the number of an alert"),
        ({"alert": "9" * 30, "how": "acknowledge"}, 422, "the number of an alert"),
        ({"alert": "99999999999", "how": "snooze", "hours": "1"}, 404, "there is no alert"),
        ({"alert": "1", "how": "delete"}, 422, "acknowledge, snooze or false is expected"),
        ({"alert": "1", "how": "snooze", "hours": "-3"}, 422, "a number of hours"),
    ],
)
def test_a_wrong_form_is_refused_with_a_sentence(send, fields, status, text):
    """Nothing is changed, and the reader is told what was expected."""
    answer = send("/alerts/settle", **fields)
    assert answer.status_code == status
    assert text in answer.text


def test_maintenance_is_recorded_in_the_plants_time(live, send, client):
    """What is typed as 14:30 in Berlin in March is 13:30 UTC, and shown as 14:30 again."""
    send("/valve/maintenance", valve=STICKY, text="packing", at="2026-03-02T14:30")
    result = live.store.maintenance(STICKY)[-1]
    assert f"{result.at:%H:%M %Z}" == "13:30 UTC"
    assert "2026-03-02 14:30" in client.get("/valve", params={"id": STICKY}).text


def test_work_that_is_yet_to_come_is_refused(live, send):
    """A slip in the date would keep every window until then from being the baseline."""
    before = live.store.maintenance(STICKY)
    answer = send("/valve/maintenance", valve=STICKY, text="packing", at="2027-03-02T14:30")
    assert answer.status_code == 409
    assert "2027-03-02 13:30 UTC has not come yet" in answer.text
    assert live.store.maintenance(STICKY) == before


def test_a_note_without_a_time_is_of_now(live, send):
    """And it may be about a valve whose name is a script."""
    answer = send("/valve/note", valve=HOSTILE, text="<b>odd</b>")
    assert answer.status_code == 303
    assert live.store.notes(HOSTILE)[-1].at == NOW


@pytest.mark.parametrize("at", ["yesterday", "2026-13-01T00:00", "0001-01-01T00:00"])
def test_a_time_that_is_none_is_refused(live, send, at):
    """Nothing is recorded."""
    answer = send("/valve/note", valve=STICKY, text="x", at=at)
    assert answer.status_code == 422
    assert len(live.store.notes(STICKY)) == 1


def test_the_fitted_network_becomes_the_baseline(live, send):
    """The page's button uses the network that was fitted last, with its window and the reason."""
    send("/valve/baseline", valve=STICKY, text="after start-up")
    result = live.store.baseline(STICKY)
    assert result.network == b"newer"
    assert result.reason == f"chosen by {ME}: after start-up"
    assert result.window[1] == NOW


def test_a_valve_without_a_network_has_no_baseline_to_set(send):
    """The refusal says what comes first."""
    answer = send("/valve/baseline", valve=HEALTHY)
    assert answer.status_code == 409
    assert "no fitted network yet" in answer.text


def test_a_run_is_queued_seen_and_cancelled(live, send, client):
    """Over the valves of an area; it waits, and a cancelled one is over."""
    send("/runs/begin", area="Area 100")
    (run,) = live.store.queue.going()
    assert set(run.asked) == {STICKY, WATCH}
    page = client.get("/runs").text
    assert f"Run {run.id}" in page
    assert f"asked by <bdi>{ME}</bdi>" in page
    send("/runs/cancel", run=str(run.id))
    assert live.store.run(run.id).state is RunState.CANCELLED
    assert send("/runs/cancel", run=str(run.id)).status_code == 409


def test_progress_and_time_left_are_seen(live, client):
    """What is done, what was set aside with its reason, and how long it will still take."""
    from stemwatch.service.store.runs.queue import RunToQueue
    from stemwatch.service.store.screenings.records import ValveState

    number = live.store.queue.put(RunToQueue(who="K"), software_version="0.1")
    live.store.queue.claim("worker")
    live.store.queue.plan(number, [STICKY, WATCH, HEALTHY, HOSTILE])
    live.store.queue.mark(number, STICKY, ValveState.DONE)
    live.store.queue.mark(number, HOSTILE, ValveState.SET_ASIDE, "took longer than 60 s")
    started = live.store.run(number).started
    object.__setattr__(live, "clock", lambda: started + timedelta(seconds=100))
    client.cookies.update(cookie_of(live))
    page = client.get("/runs").text
    assert "2 of 4 valves done, 1 of them set aside; about 100 s to go" in page
    assert "took longer than 60 s" in client.get(f"/run?id={number}").text


PLACES = (
    "/alerts/settle",
    "/valve/note",
    "/valve/maintenance",
    "/valve/baseline",
    "/runs/begin",
    "/runs/cancel",
)


@pytest.mark.parametrize("path", PLACES)
def test_a_form_without_its_token_changes_nothing(live, client, path):
    """Another site, which cannot read the token, cannot send our forms."""
    fields = {"alert": "1", "valve": STICKY, "text": "x", "run": "1", "how": "acknowledge"}
    assert client.post(path, data=fields).status_code == 403
    assert client.post(path, data={"mark": "0" * 64, **fields}).status_code == 403
    client.cookies.set(COOKIE, "made-up")
    made_up = form_token_of("made-up")
    assert client.post(path, data={"mark": made_up, **fields}).status_code == 403
    assert len(live.store.notes(STICKY)) == 1
    assert live.store.queue.going() == []


@pytest.mark.parametrize(
    "headers",
    [
        *({"origin": origin} for origin in ("https://example.org", "null", "http://[", "")),
        {"sec-fetch-site": "cross-site"},
    ],
)
def test_another_sites_page_can_send_nothing(live, client, headers):
    """Neither to the forms nor to the API, even with the right content type."""
    assert client.post("/runs/begin", headers=headers).status_code == 403
    answer = client.post("/api/v1/runs", json={}, headers=headers)
    assert answer.status_code == 403
    assert live.store.queue.going() == []


def test_the_api_takes_json_and_nothing_that_a_form_could_send(live, client):
    """A form's content type is refused, so that no foreign page needs to be asked about."""
    answer = client.post("/api/v1/runs", content="{}", headers={"content-type": "text/plain"})
    assert answer.status_code == 422
    assert live.store.queue.going() == []


def test_the_api_does_what_the_pages_do(live, client):
    """Run, cancel, acknowledge, snooze, note and work, each with what came of it."""
    run = client.post("/api/v1/runs", json={"valves": [STICKY], "who": "script"})
    assert run.status_code == 202
    number = run.json()["id"]
    assert client.get(f"/api/v1/run?id={number}").json()["state"] == "waiting"
    assert client.post(f"/api/v1/run/cancel?id={number}", json={}).status_code == 200
    alert = alert_of(live).id
    until = (NOW + timedelta(days=1)).isoformat()
    answer = client.post(f"/api/v1/alert/snooze?id={alert}", json={"until": until, "who": "s"})
    assert answer.status_code == 200
    assert client.get("/api/v1/alerts?state=snoozed").json()[0]["id"] == alert
    assert client.post(f"/api/v1/alert/acknowledge?id={alert}", json={"who": "s"}).is_success
    text = {"text": "renewed", "who": "s", "at": "2026-03-29T10:00:00+02:00"}
    assert client.post("/api/v1/valve/maintenance", params={"id": STICKY}, json=text).is_success
    done = live.store.maintenance(STICKY)[-1]
    assert (done.note, done.who) == ("renewed", f"s (through {ME})")


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/api/v1/valve/note?id=FIC-101", {"text": "x", "at": "TIME"}),
        ("/api/v1/valve/maintenance?id=FIC-101", {"text": "x", "at": "TIME"}),
        ("/api/v1/valve/feedback?id=FIC-101", {"judgement": "right", "at": "TIME"}),
        ("/api/v1/alert/snooze?id=ALERT", {"until": "TIME"}),
    ],
)
@pytest.mark.parametrize("time", ["9999-12-31T23:59:59Z", "9999-12-31T23:59:59-05:00"])
def test_a_time_that_no_page_could_show_is_refused(live, client, path, body, time):
    """In the plant's own zone it may lie behind the end of the calendar."""
    sent = {key: time if text == "TIME" else text for key, text in body.items()}
    answer = client.post(path.replace("ALERT", str(alert_of(live).id)), json=sent)
    assert answer.status_code == 409
    assert "a time between 1970 and 2200 is expected" in answer.json()["detail"]
    for page in (f"/valve?id={STICKY}", "/alerts?state=all"):
        assert client.get(page).status_code == 200


@pytest.mark.parametrize(
    ("path", "body", "status"),
    [
        ("/api/v1/runs", {"valves": ["nobody"]}, 404),
        ("/api/v1/alert/snooze?id=1", {"until": "2020-01-01T00:00:00Z"}, 409),
        ("/api/v1/alert/snooze?id=1", {"until": "2027-01-01T00:00:00"}, 422),
        ("/api/v1/alert/acknowledge?id=999", {}, 404),
        ("/api/v1/valve/note?id=nobody", {"text": "x"}, 404),
        ("/api/v1/valve/note?id=FIC-101", {"text": " "}, 409),
        ("/api/v1/run/cancel?id=1", {}, 409),
    ],
)
def test_the_api_refuses_with_a_sentence(client, path, body, status):
    """What cannot be done is JSON with ``detail``, never a page and never a trace."""
    answer = client.post(path, json=body)
    assert answer.status_code == status
    assert len(answer.json()["detail"]) > 10
