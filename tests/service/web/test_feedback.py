"""What people found: who may say it, that it stays with what had been said, counts and labels."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta

import httpx
import pytest
from typer.testing import CliRunner

from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.verdict import Verdict
from stemwatch.service.cli import app
from stemwatch.service.maintenance.labels import COLUMNS, labels_csv
from stemwatch.service.report.csv_file import FORMULA_STARTS
from stemwatch.service.store.accounts.audit import AuditFilter
from stemwatch.service.store.accounts.records import UserRole
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.screenings.feedback import Judgement, count_effects
from stemwatch.service.store.store import Store
from stemwatch.service.web.site import Site
from tests.service.example_mismatches import named
from tests.service.web.example_plant import HEALTHY, NOW, STICKY, screening

FOUND = "=packing was glazed <b>hard</b>"


def last(store: Store, valve: str) -> int:
    """The number of the valve's last screening."""
    return store.screenings(valve, 1)[0].id


def sent(client: httpx.Client, valve: str, number: int, judgement: str) -> httpx.Response:
    """The form of the valve's page, sent with its token."""
    page = client.get("/valve", params={"id": valve}).text
    mark = page.split('name="mark" value="')[1].split('"')[0]
    fields = {"valve": valve, "screening": str(number), "judgement": judgement, "text": FOUND}
    return client.post("/valve/feedback", data={**fields, "mark": mark})


def test_label_keeps_what_had_been_said_though_the_valve_is_screened_again(filled: Store) -> None:
    """The label has verdict, effects, S and J of the screening that it is about."""
    changed = replace(named(), finding=Finding.NAMED, p_value=0.001, runs=None)
    run = filled.begin_run(software_version="1")
    filled.save(screening(STICKY, at=NOW + timedelta(hours=1), mismatch=changed), run)
    number = last(filled, STICKY)
    assert filled.add_feedback(number, NOW, Judgement.RIGHT, "worn cam", "K. Berg") == STICKY
    other = replace(screening(STICKY, at=NOW + timedelta(hours=1)), verdict=Verdict.HEALTHY)
    filled.save(other, filled.begin_run(software_version="2"))
    (label,) = filled.feedback(STICKY)
    assert label.verdict is Verdict.STICKY
    assert label.effects == tuple(effect.slug for effect in changed.effects)
    assert label.S is not None
    assert (label.judgement, label.found, label.who) == (Judgement.RIGHT, "worn cam", "K. Berg")
    assert filled.feedback(HEALTHY) == []
    assert filled.count_feedback() == {(Verdict.STICKY, Judgement.RIGHT): 1}
    assert count_effects([label])[label.effects[0]][Judgement.RIGHT] == 1


def test_screening_that_is_not_there_is_refused(filled: Store) -> None:
    """No label without what had been said."""
    with pytest.raises(StoreError, match="there is no screening 999999"):
        filled.add_feedback(999999, NOW, Judgement.WRONG, "", "")


@pytest.mark.parametrize("role", UserRole)
def test_engineers_and_admins_may_say_it_viewers_may_not_and_it_is_audited(
    live: Site, client_of: Callable[..., httpx.Client], role: UserRole
) -> None:
    """The same right as for maintenance, and an entry in the audit log either way."""
    client, number = client_of(live, role), last(live.store, STICKY)
    allowed = role is not UserRole.VIEWER
    page = client.get("/valve", params={"id": STICKY}).text
    assert ("Say whether this was right" in page) is allowed
    answer = sent(client, STICKY, number, "wrong")
    assert answer.status_code == (303 if allowed else 403)
    assert len(live.store.feedback(STICKY)) == int(allowed)
    entries = live.store.audit.read(AuditFilter(action="say what was found", limit=5))
    assert entries
    assert STICKY in entries[0].about or not allowed


def test_page_counts_shows_and_exports_what_was_found(
    live: Site, client_of: Callable[..., httpx.Client]
) -> None:
    """Counts by verdict, the text escaped, and the same labels as CSV that a program reads."""
    client = client_of(live)
    assert "Nobody has said yet" in client.get("/feedback").text
    for judgement in ("wrong", "right"):
        assert sent(client, STICKY, last(live.store, STICKY), judgement).status_code == 303
    page = client.get("/feedback").text
    assert "By verdict" in page
    assert "<b>hard</b>" not in page
    assert FOUND.replace("<", "&lt;").replace(">", "&gt;") in page
    text = client.get("/feedback/labels")
    assert text.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(text.text)))
    assert tuple(rows[0]) == COLUMNS
    assert {row["judgement"] for row in rows} == {"wrong", "right"}
    assert {row["valve"] for row in rows} == {STICKY}
    assert rows[0]["found"] == f"'{FOUND}"  # no spreadsheet takes it for a formula
    assert "What was found" in client.get("/valve", params={"id": STICKY}).text


@pytest.mark.parametrize("sign", FORMULA_STARTS)
def test_no_label_is_a_formula_whatever_sign_it_begins_with(filled: Store, sign: str) -> None:
    """As in the other tables; of the full-width signs too, which some spreadsheets take."""
    filled.add_feedback(last(filled, STICKY), NOW, Judgement.RIGHT, f"{sign}1+1", "Ann")
    (row,) = csv.DictReader(io.StringIO(labels_csv(filled.feedback()), newline=""))
    assert not row["found"].startswith(sign)


@pytest.mark.parametrize(
    ("number", "judgement", "status"),
    [("0", "right", 404), ("7777777", "right", 404), (None, "perhaps", 409)],
)
def test_nonsense_is_refused_with_what_was_expected(
    live: Site, client_of: Callable[..., httpx.Client], number, judgement: str, status: int
) -> None:
    """A number that no screening has, a word that is no judgement."""
    client = client_of(live)
    given = last(live.store, STICKY) if number is None else int(number)
    answer = sent(client, STICKY, given, judgement)
    assert answer.status_code == status
    assert live.store.feedback() == []


def test_api_takes_it_for_the_last_screening(
    live: Site, client_of: Callable[..., httpx.Client]
) -> None:
    """A program that signs in says it of the valve's last screening."""
    client = client_of(live)
    body = {"text": "seat worn", "judgement": "partly right", "who": "CMMS"}
    answer = client.post("/api/v1/valve/feedback", params={"id": STICKY}, json=body)
    assert answer.status_code == 200, answer.text
    (label,) = live.store.feedback()
    assert label.judgement is Judgement.PARTLY
    assert label.who.startswith("CMMS (through ")


def test_command_counts_and_exports_the_same_labels(filled: Store, tmp_path) -> None:
    """The file is what the page gives."""
    filled.add_feedback(last(filled, STICKY), NOW, Judgement.RIGHT, "glazed packing", "K. Berg")
    file = tmp_path / "labels.csv"
    requested = ["feedback", "--db", str(filled.address), "--out", str(file)]
    result = CliRunner().invoke(app, requested, env={"COLUMNS": "250"})
    assert result.exit_code == 0, result.output
    assert "1 finding was judged: 1 right, 0 wrong, 0 partly right." in result.output
    assert file.read_bytes().decode() == labels_csv(filled.feedback())
