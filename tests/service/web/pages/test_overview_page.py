"""The overview: the one count of valves, weeks, old data, runs; a run that ends is seen at once."""

from __future__ import annotations

import html
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta

import httpx
import pytest

from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.stale_data import DueSchedule, SilentSource, stale_data
from stemwatch.service.presenter.suspicion_words import (
    SUSPECTED_NOTE,
    loops_to_test,
    next_steps,
    suspected_sentence,
)
from stemwatch.service.presenter.work_counts import WorkCounts
from stemwatch.service.store.accounts.records import UserRole
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.runs.schedule import ScreeningSchedule
from stemwatch.service.store.screenings.ranking import RankingFilter
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.web.site import Site
from tests.service.report.test_without_position import no_sign, suspected
from tests.service.web import example_plant
from tests.service.web.example_plant import NOW, STICKY
from tests.service.web.signed_in import cookie_of


def text_of(page: str) -> str:
    """What a reader sees of a page."""
    bare = re.sub(r"<[^>]+>", " ", page.replace("\N{NO-BREAK SPACE}", " "))
    return " ".join(html.unescape(bare).split())


def test_the_headline_is_that_of_the_ranking(live: Site, client: httpx.Client) -> None:
    """One count for both pages, and the one of the store; what cannot be judged has its own."""
    counts = WorkCounts.of_states(live.store.ranking(RankingFilter()).states)
    text = text_of(client.get("/overview").text)
    assert counts.headline in text
    assert f"{counts.not_judged} cannot be judged" in text
    assert f"{counts.no_work} without work" in text
    assert counts.sentence in text_of(client.get("/").text)
    assert counts == live.store.work_counts(NOW)


def test_the_weeks_count_what_was_known_then(live: Site, client: httpx.Client) -> None:
    """A month ago FIC-101 may have been better: each week counts by the screening it had."""
    early = live.store.work_counts(NOW - timedelta(days=400))
    assert early.valves == 0
    page = client.get("/overview").text
    assert "Over the weeks" in page
    rows = re.findall(r'<th scope="row">(\d{4}-\d\d-\d\d)[^<]*</th><td class="num">(\d+)', page)
    assert len(rows) >= 2
    assert int(rows[0][1]) == live.store.work_counts(NOW).needs_work


def test_a_repaired_valve_leaves_the_count_of_later_weeks_alone(live: Site) -> None:
    """A screening of today changes today, and no week before it."""
    before = live.store.work_counts(NOW - timedelta(days=7))
    run = live.store.begin_run(command="test", software_version="test", settings_digest="")
    fine = example_plant.screening(STICKY, Verdict.HEALTHY, 0.1, 0.0, at=NOW + timedelta(hours=1))
    live.store.save(fine, run)
    assert live.store.work_counts(NOW - timedelta(days=7)) == before
    now = live.store.work_counts(NOW + timedelta(hours=2))
    assert now.needs_work == live.store.work_counts(NOW).needs_work - 1


def test_old_data_are_said_and_fresh_ones_are_not() -> None:
    """A silent source, a schedule that did not begin, a failed run, an old recording."""
    fresh = DueSchedule(name="nightly", next_due=NOW + timedelta(hours=3), spread=timedelta(0))
    assert stale_data(NOW, newest=NOW, schedules=[fresh], silent=[]) == []
    late = replace(fresh, next_due=NOW - timedelta(hours=5))
    source = SilentSource(name="gateway", last_good=NOW - timedelta(days=3), fault="refused")
    text = stale_data(
        NOW,
        newest=NOW - timedelta(days=6),
        schedules=[late],
        silent=[source],
        failed="no export was found.",
    )
    assert text == [
        "The source gateway has delivered no good sample for 3 days (refused): its valves are not "
        "watched.",
        "The schedule nightly was due 5 hours ago and has not begun: check whether stemwatch serve "
        "is running.",
        "The last run failed: no export was found.",
        "The newest recording that was screened ended 6 days ago: what is shown here is as old.",
    ]
    spread = replace(late, spread=timedelta(hours=6))
    assert stale_data(NOW, newest=NOW, schedules=[spread], silent=[]) == []


def test_a_skipped_instant_does_not_hide_that_the_run_before_it_failed(
    live: Site, client: httpx.Client
) -> None:
    """While a run works on, further instants of its schedule are noted as skipped. When it fails,
    it is the last run, and the page says that results are out of date."""
    live.store.schedules.take_from_file([ScreeningSchedule(name="quick", every_s=60.0)])
    asked = RunToQueue(schedule="quick", due=NOW, who="")
    number = live.store.queue.put(asked, software_version="test")
    later = replace(asked, due=NOW + timedelta(minutes=1))
    assert live.store.queue.put(later, software_version="test") is not None
    live.store.queue.finish(number, RunState.FAILED, reason="the disk is full")
    text = text_of(client.get("/overview").text)
    assert "The last run failed: the disk is full." in text
    assert f"failed Run {number}" in text


def test_a_schedule_that_is_switched_off_is_neither_missing_nor_run(
    live: Site, client: httpx.Client
) -> None:
    """The pages say that it is off; the instants that pass meanwhile are no runs of it."""
    off = ScreeningSchedule(name="nightly", every_s=60.0, enabled=False)
    live.store.schedules.take_from_file([off])
    live.store.schedules.note("nightly", NOW, None)
    assert "Every schedule is switched off: runs begin" in text_of(client.get("/overview").text)
    assert "nightly switched off Runs" in text_of(client.get("/runs").text)


def test_an_empty_store_says_what_to_do(
    store: object, client_of: Callable[[Site], httpx.Client]
) -> None:
    """No valve, no run, no schedule: no number is made up."""
    page = client_of(Site(store=store, clock=lambda: NOW)).get("/overview")  # type: ignore[arg-type]
    assert page.status_code == 200
    assert "No valve was screened yet" in page.text
    assert "Over the weeks" not in page.text


def test_changes_are_another_answer_only_when_something_changed(
    live: Site, client: httpx.Client
) -> None:
    """A page asks for these few words often, and for itself only when they are others."""
    first = client.get("/api/v1/changes").json()
    assert client.get("/api/v1/changes").json() == first
    number = live.store.queue.put(RunToQueue(who="test"), software_version="test")
    assert number is not None
    assert client.get("/api/v1/changes").json()["runs"][0] == f"{number} waiting 0"


def test_nobody_looks_without_signing_in(
    live: Site, client_of: Callable[..., httpx.Client]
) -> None:
    """The overview leads to the login, and what changed is refused."""
    stranger = client_of(live, role=None)
    assert stranger.get("/overview").status_code in (303, 401)
    assert stranger.get("/api/v1/changes").status_code == 401
    assert client_of(live, UserRole.VIEWER).get("/overview").status_code == 200


@pytest.mark.browser
def test_a_finished_run_appears_without_a_reload(live: Site, windows) -> None:
    """The page of somebody who only looks shows the run that has just ended, and stays where it
    is; no rule of the content policy is broken."""
    with example_plant.serving(live) as base:
        (name, value) = next(iter(cookie_of(live).items()))
        complaints: list[str] = []
        page = windows.open(
            f"{base}/overview",
            cookies=[{"name": name, "value": value, "url": base}],
            logged=complaints,
        )
        with page.expect_response("**/api/v1/changes"):
            page.reload()
        page.evaluate("window.stayed = true")
        number = live.store.queue.put(RunToQueue(who="the night shift"), software_version="test")
        assert number is not None
        live.store.queue.finish(number, RunState.DONE)
        page.get_by_text("the night shift").first.wait_for(timeout=60_000)
        assert page.evaluate("window.stayed")
        assert not [text for text in complaints if "Content Security Policy" in text]
        windows.close()


def test_what_to_do_at_valves_without_a_verdict_is_that_of_the_report(
    live: Site, client: httpx.Client
) -> None:
    """Overview, ranking and API have the loops that deserve a test, from the function that the
    report uses; a valve that got a verdict since is in none of them."""
    run = live.store.begin_run(command="test", software_version="test", settings_digest="")
    for valve, answer in {
        "FIC-7": suspected(0.9),
        "FIC-8": no_sign(),
        "FIC-9": suspected(),
    }.items():
        blind = example_plant.screening(valve, Verdict.UNDETERMINED, None, None)
        live.store.save(replace(blind, without_position=answer), run)
    judged = example_plant.screening(
        "FIC-9", Verdict.HEALTHY, 0.1, 0.0, at=NOW + timedelta(hours=1)
    )
    live.store.save(judged, run)
    steps = next_steps(live.store.without_verdict())
    assert loops_to_test(steps) == ("FIC-7",)
    noted = re.findall(
        rf"id=([\w-]+)\"><bdi>(?:(?!</tr>).)*{SUSPECTED_NOTE}</span>", client.get("/overview").text
    )
    assert noted == ["FIC-7"]
    sentence = suspected_sentence(("FIC-7",))
    page = client.get("/overview").text
    text = text_of(page)
    assert text.count(sentence) == 1
    for step in steps:
        assert step.step in text
        for loop in step.loops:
            assert f'<a href="/valve?id={loop}"><bdi>{loop}</bdi></a>' in page
    assert sentence in text_of(client.get("/").text)
    assert [one["loops"] for one in client.get("/api/v1/next-steps").json()] == [
        list(step.loops) for step in steps
    ]


def test_where_every_valve_has_a_verdict_there_is_no_table(client: httpx.Client) -> None:
    """No heading over nothing."""
    assert "Valves without a verdict" not in client.get("/overview").text
    assert client.get("/api/v1/next-steps").json() == []
