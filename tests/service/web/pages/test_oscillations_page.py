"""The page of loops that oscillate together, the sentence on a valve's page, and the API."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

from stemwatch.models.oscillation_groups.plant_groups import GroupMember, OscillationGroup
from tests.service.web.example_plant import HEALTHY, HOSTILE, NOW, STICKY, WATCH, screening

DAY = timedelta(days=1)


def group(days_ago: int) -> OscillationGroup:
    """A group of a day: a sticking valve, one that it moves, and one with a hostile name."""
    return OscillationGroup(
        period_s=229.0,
        members=(
            GroupMember(loop=STICKY, share=0.8, probability=0.6, evidence=("it leads",)),
            GroupMember(loop=WATCH, share=0.5, probability=0.2),
            GroupMember(loop=HOSTILE, share=0.2, probability=0.1),
        ),
        outside=0.1,
        regularity=5.0,
        start=NOW - days_ago * DAY,
        duration_s=86400.0,
        since=None,
        strength=(0.1, 1.4),
        periods_s=(40.0, 60.0, 90.0, 135.0, 229.0, 900.0),
        spectra=((0.0, 0.0, 0.1, 0.2, 1.0, 0.3),) * 3,
    )


def test_the_page_says_since_when_and_where_it_begins(live, client) -> None:
    """Two days running: the source with a link, the history as bars, no markup from a name."""
    for days_ago in (3, 2):
        run = live.store.begin_run(software_version="1")
        live.store.keep_oscillations(run, [group(days_ago)])
    page = client.get("/oscillations").text
    assert "3 loops oscillate together every 3.8 min" in page
    assert "It was found in 2 windows so far." in page
    assert "Share of the variance of its loops, by window" in page
    assert f'valve?id={STICKY}"' in page
    assert "<script>alert" not in page
    valve = client.get("/valve", params={"id": WATCH}).text
    assert f"with {STICKY} (50\N{NO-BREAK SPACE}% of its PV" in valve
    assert "retuning this loop would not help" in valve
    assert "where it more likely begins" not in client.get("/valve", params={"id": HEALTHY}).text
    assert "3 loops oscillate together every 3.8 min" in client.get("/overview").text
    (answer,) = client.get("/api/v1/oscillations").json()
    assert (answer["source"], answer["windows"], answer["over"]) == (STICKY, 2, False)
    assert [member["loop"] for member in answer["members"]] == [STICKY, WATCH, HOSTILE]


def test_results_that_are_months_old_say_what_their_report_says(live, client_of) -> None:
    """Days are counted from the newest results: verdicts of that age are shown, groups too."""
    run = live.store.begin_run(software_version="1")
    live.store.keep_oscillations(run, [group(1)])
    later = client_of(replace(live, clock=lambda: NOW + 300 * DAY))
    assert "3 loops oscillate together every 3.8 min" in later.get("/oscillations").text
    assert "3 loops oscillate together every 3.8 min" in later.get("/overview").text
    live.store.save(
        screening(STICKY, at=NOW + 60 * DAY), live.store.begin_run(software_version="1")
    )
    assert "No two loops" in later.get("/oscillations").text


def test_without_any_it_says_so(client) -> None:
    """An empty page is an answer."""
    page = client.get("/oscillations").text
    assert "No two loops were found to oscillate together in the 30 days before" in page
    assert client.get("/api/v1/oscillations").json() == []
