"""The page of the planned test: its limits, its sheet, and where it is reached from."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import httpx
import pytest

from stemwatch.models.mismatch.findings import Finding
from stemwatch.service.store.store import Store
from tests.service.example_mismatches import named
from tests.service.field_test.planned_tests import QUESTION
from tests.service.web.example_plant import BLIND, HEALTHY, NOW, STICKY, screening

QUICK = {"minutes": "2"}


@pytest.fixture
def open_to_question(filled: Store) -> Store:
    """The small plant, whose sticky valve leaves lag and dead time open, a healthy one nothing."""
    run = filled.begin_run(software_version="1")
    told = named()  # the first of its two effects has no rival
    left_open = replace(told, finding=Finding.CANDIDATES, open_question=QUESTION)
    settled = replace(told, effects=told.effects[:1], open_question=replace(QUESTION, models=()))
    for valve, mismatch in ((STICKY, left_open), (HEALTHY, settled)):
        changed = replace(mismatch, p_value=0.001, runs=None)
        filled.save(screening(valve, at=NOW + timedelta(hours=1), mismatch=changed), run)
    return filled


def test_valve_page_leads_to_the_plan_where_something_is_left_open(
    open_to_question: Store, client: httpx.Client
) -> None:
    """The sentence, the link, and no link where nothing is left or, for want of a position, no test
    can be planned."""
    page = client.get("/valve", params={"id": STICKY}).text
    assert "A test of some minutes may tell actuator lag and dead time apart" in page
    assert f"/valve/test-plan?id={STICKY}" in page
    for valve in (HEALTHY, BLIND):
        assert "/valve/test-plan" not in client.get("/valve", params={"id": valve}).text


def test_plan_is_shown_with_its_sheet_and_as_one_page_to_print(
    open_to_question: Store, client: httpx.Client
) -> None:
    """Sentences, picture, table, and the same as PDF."""
    page = client.get("/valve/test-plan", params={"id": STICKY, **QUICK})
    assert page.status_code == 200
    for text in ("is found with a probability of", "stemwatch never writes to a plant", "<svg"):
        assert text in page.text
    paper = client.get("/valve/test-plan/sheet", params={"id": STICKY, **QUICK})
    assert paper.headers["content-type"] == "application/pdf"
    assert paper.content.startswith(b"%PDF")


def test_limits_of_the_reader_are_kept_and_those_without_sense_said(
    open_to_question: Store, client: httpx.Client
) -> None:
    """A decimal comma is a number; an amplitude of nothing is refused with what was expected."""
    limits = {"id": STICKY, **QUICK, "amplitude": "3,5", "op_now": "60"}
    assert (
        "between 56.5 and 63.5\N{NO-BREAK SPACE}%"
        in client.get("/valve/test-plan", params=limits).text
    )
    for field, text in (("amplitude", "0"), ("minutes", "soon"), ("pv_upset", "nan")):
        refused = client.get("/valve/test-plan", params={"id": STICKY, field: text})
        assert refused.status_code == 422
        assert "expected" in refused.text
        paper = client.get("/valve/test-plan/sheet", params={"id": STICKY, field: text})
        assert paper.status_code == 422


def test_nothing_left_no_verdict_and_an_unknown_valve_each_have_their_words(
    open_to_question: Store, client: httpx.Client
) -> None:
    """Nothing to tell apart; a bump test or why there is none; 404."""
    nothing = client.get("/valve/test-plan", params={"id": HEALTHY, **QUICK})
    assert "Nothing is left to be told apart" in nothing.text
    blind = client.get("/valve/test-plan", params={"id": BLIND, **QUICK})
    assert blind.status_code == 200
    assert "No test can be planned" in blind.text or "bump test" in blind.text
    assert client.get("/valve/test-plan", params={"id": "nobody"}).status_code == 404
    assert client.get("/valve/test-plan/sheet", params={"id": "nobody"}).status_code == 404
