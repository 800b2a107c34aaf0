"""The ranking: what its address says, in the database's order, for every tag there is."""

from __future__ import annotations

from urllib.parse import parse_qs, urlsplit

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from starlette.datastructures import QueryParams

from stemwatch.models.verdict import NoVerdict, Verdict
from stemwatch.service.presenter.wording import finite
from stemwatch.service.report.bars import bar_top
from stemwatch.service.report.ranking import rank_valves
from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.store.screenings.ranking import SORTS, RankingFilter
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.store import open_store
from stemwatch.service.web.pages.ranking_page import link, wanted_of
from tests.service.web.example_plant import (
    BLIND,
    HEALTHY,
    HOSTILE,
    NOW,
    STICKY,
    WATCH,
    fill,
    screening,
)


def names(store, **wanted) -> list[str]:
    """The valves of one page."""
    return [line.valve for line in store.ranking(RankingFilter(**wanted)).lines]


def test_the_worst_valve_stands_first(filled):
    """Sticky, watch by severity, undetermined, healthy: nobody knows that a blind one is well."""
    assert names(filled) == [STICKY, HOSTILE, WATCH, BLIND, HEALTHY]
    assert names(filled, descending=True) == [HEALTHY, BLIND, WATCH, HOSTILE, STICKY]


def test_order_and_severity_are_those_of_a_report(filled):
    """A stem that may be stuck fast stands where the report has it, also without S."""
    run = filled.begin_run(software_version="0.1")
    for valve, why in (
        ("STUCK-1", NoVerdict.POSITION_FROZEN),
        ("SHORT-1", NoVerdict.TOO_SHORT),
    ):
        filled.save(
            screening(valve, Verdict.UNDETERMINED, None, None, no_verdict=why, severity=0.0), run
        )
    report = rank_valves(filled.latest_screenings(), ReportContext(started=NOW))
    lines = filled.ranking(RankingFilter()).lines
    assert [line.valve for line in lines] == [ranked.screening.valve for ranked in report]
    expected = {r.screening.valve: finite(r.decision.severity) or 0.0 for r in report}
    assert {line.valve: line.severity for line in lines} == expected
    assert expected["STUCK-1"] == 90.0
    by_severity = names(filled, sort="severity", descending=True)
    assert by_severity.index("STUCK-1") < by_severity.index("SHORT-1")


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        ({"text": "fic"}, [STICKY, WATCH]),
        ({"text": "REFLUX 100"}, [WATCH]),
        ({"text": "50 %"}, [BLIND]),
        ({"text": "_"}, []),
        ({"text": "<script>"}, [HOSTILE]),
        ({"areas": ("Area 200", "A&B <i>")}, [HOSTILE, HEALTHY]),
        ({"verdicts": ("healthy", "sticky")}, [STICKY, HEALTHY]),
        ({"criticalities": (2, 3)}, [STICKY, BLIND, HEALTHY]),
        ({"text": "fic", "criticalities": (1,), "verdicts": ("sticky",)}, []),
    ],
)
def test_filters_work_together(filled, wanted, expected):
    """Every word must be found, wildcards are letters, and each filter narrows the others."""
    assert names(filled, **wanted) == expected


@pytest.mark.parametrize("sort", SORTS)
def test_every_sort_turns_round_and_keeps_unknown_numbers_last(filled, sort):
    """Both directions show the same valves; a valve without S is last either way."""
    up, down = names(filled, sort=sort), names(filled, sort=sort, descending=True)
    assert sorted(up) == sorted(down)
    if sort in ("S", "J", "confidence"):
        assert up[-1] == down[-1] == BLIND
    if sort in ("S", "J"):
        assert up[:-1] == down[:-1][::-1]


def test_a_valve_that_was_never_screened_is_there(filled):
    """It stands at the end, has no verdict, and can be asked for alone."""
    filled.save_valves([StoredValve(id="NEW-1")])
    assert names(filled)[-1] == "NEW-1"
    assert names(filled, verdicts=("none",)) == ["NEW-1"]
    result = filled.ranking(RankingFilter(verdicts=("none",)))
    assert result.counts["none"] == result.total == 1
    assert result.lines[0].verdict is None


def test_pages_divide_the_ranking_without_gap_or_overlap(filled):
    """Two pages of two and one of one hold every valve once, with places that go on."""
    pages = [names(filled, page=page, size=2) for page in (1, 2, 3, 4)]
    assert [len(page) for page in pages] == [2, 2, 1, 0]
    assert [name for page in pages for name in page] == names(filled)
    second = filled.ranking(RankingFilter(page=2, size=2))
    assert [line.place for line in second.lines] == [3, 4]
    assert second.total == 5


def test_the_screening_before_is_the_newest_older_one(filled):
    """The trend compares with the last run, not with any other and not with itself."""
    line = filled.ranking(RankingFilter(text=STICKY)).lines[0]
    assert line.at == NOW
    assert line.previous.verdict is Verdict.STICKY
    assert line.previous.S == pytest.approx(line.S.value * 5 / 6)


@pytest.mark.postgres
def test_the_same_answers_come_from_postgresql(postgres_url):
    """Order, filters, paging and the screening before are the same on the other engine."""
    with open_store(postgres_url) as store:
        fill(store, months=1)
        store.save(screening("fic-900", S=9.0), store.begin_run(software_version="0.1"))
        assert names(store, text="FIC")[0] == "fic-900"
        assert names(store, sort="S", descending=True)[-1] == BLIND
        assert names(store, sort="S")[-1] == BLIND
        assert names(store, verdicts=("none",)) == []
        lines = store.ranking(RankingFilter(text=STICKY)).lines
        assert lines[0].previous is not None


words = st.text(max_size=20).map(str.strip)


@given(
    text=words,
    areas=st.lists(words.filter(bool), max_size=2, unique=True),
    verdicts=st.lists(st.sampled_from(["sticky", "none"]), max_size=2, unique=True),
    levels=st.lists(st.sampled_from([1, 2, 3]), max_size=3, unique=True),
    sort=st.sampled_from(SORTS),
    descending=st.booleans(),
    page=st.integers(1, 10_000),
)
def test_an_address_says_all_of_what_is_wanted(
    text, areas, verdicts, levels, sort, descending, page
):
    """From a view to its address and back nothing is lost, whatever is written in it."""
    expected = RankingFilter(
        text=text,
        areas=tuple(areas),
        verdicts=tuple(verdicts),
        criticalities=tuple(levels),
        sort=sort,
        descending=descending,
        page=page,
    )
    try:
        address = link(expected)
    except UnicodeEncodeError:
        return  # a lone surrogate is in no address
    assert wanted_of(QueryParams(urlsplit(address).query)) == expected


@given(st.dictionaries(st.sampled_from(["q", "area", "verdict", "sort", "page"]), st.text()))
@example({"page": "9" * 5000})
def test_an_address_that_makes_no_sense_is_the_plain_ranking(fields):
    """Whatever stands in an address, something can be shown."""
    expected = wanted_of(QueryParams(list(fields.items())))
    assert expected.sort in SORTS
    assert expected.page >= 1


def test_a_new_filter_begins_at_the_first_page():
    """Sorting or clearing from page 7 does not end on a page that is not there."""
    address = link(RankingFilter(page=7, text="x"), q="", page="")
    assert parse_qs(urlsplit(address).query) == {}


@given(st.floats(0.0, 1e4))
def test_bars_end_at_a_round_number_that_holds_every_value(largest):
    """Never below the largest value, and never more than two and a half times above it."""
    top = bar_top(largest)
    assert top >= largest
    assert top <= max(2.0, 2.5 * largest)
