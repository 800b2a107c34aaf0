"""The page: alone, readable in both themes, bounded in size, and honest about its limits."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from importlib.resources import files

import numpy as np
import pytest

from stemwatch.models.screening_result import Indicator
from stemwatch.models.verdict import Verdict
from stemwatch.service.report import ReportContext
from stemwatch.service.report.charts.traces import unpacked
from stemwatch.service.report.charts.valve_charts import chart_of
from stemwatch.service.report.html_page import (
    MOST_PLOTTED,
    MOST_SECTIONS,
    environment,
    html_bytes,
)
from stemwatch.service.report.ranking import rank_valves

ATTRIBUTES_THAT_FETCH = {"src", "srcset", "href", "xlink:href", "poster", "data", "action"}


class Page(HTMLParser):
    """What a browser would see: tags with attributes, ids, and the text of each script."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.raw: dict[str, list[str]] = {"script": [], "style": []}
        self._inside = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._inside = tag if tag in self.raw else ""

    def handle_endtag(self, tag):
        self._inside = ""

    def handle_data(self, data):
        if self._inside:
            self.raw[self._inside].append(data)

    def attribute(self, name):
        return [attrs[name] for _, attrs in self.tags if name in attrs]


def render(screenings, context) -> str:
    return html_bytes(rank_valves(screenings, context), context).decode()


@pytest.fixture
def page(mixed_plant, make_context) -> str:
    return render(mixed_plant, make_context(mixed_plant))


def test_nothing_is_fetched(page):
    """No attribute and no style points anywhere but into the page; no script can call out."""
    seen = Page(page)
    links = [v for k in ATTRIBUTES_THAT_FETCH for v in seen.attribute(k)]
    assert links
    assert [link for link in links if not link.startswith("#")] == []
    styles = "".join(seen.raw["style"])
    assert re.findall(r"@import|url\(", styles) == []
    assert {tag for tag, _ in seen.tags} & {"link", "iframe", "object", "embed", "base"} == set()
    scripts = "".join(seen.raw["script"])
    assert re.findall(r"fetch\(|XMLHttpRequest|WebSocket|sendBeacon|import\(", scripts) == []
    policy = seen.attribute("content")[0]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")


def test_every_link_of_the_ranking_leads_to_its_valve(page):
    """Anchors exist, once each, even where two valves share a tag but for its spelling."""
    ids = Page(page).attribute("id")
    assert len(ids) == len(set(ids))
    links = set(re.findall(r'href="#([^"]+)"', page))
    assert links <= set(ids)
    assert "valve-FV-100" in links


def test_valves_of_one_name_get_anchors_of_their_own(make_screening, make_context):
    """Two windows of one valve, or tags that differ in case or punctuation, do not collide."""
    valves = [make_screening(tag, samples=20) for tag in ("FV 1", "FV/1", "fv-1", "FV 1", "§")]
    anchors = [rank_valve.anchor for rank_valve in rank_valves(valves, make_context(valves))]
    assert len({anchor.casefold() for anchor in anchors}) == 5
    assert "valve-unnamed" in anchors


@pytest.mark.parametrize(
    ("verdicts", "headline"),
    [
        ([Verdict.STICKY, Verdict.STICKY, Verdict.HEALTHY], "2 of 3 valves need work"),
        ([Verdict.STICKY, Verdict.WATCH], "1 of 2 valves needs work"),
        ([Verdict.HEALTHY], "The valve needs no work"),
        ([Verdict.WATCH], "The valve is to be watched"),
    ],
)
def test_the_first_line_counts_the_work(verdicts, headline, make_screening, make_context):
    """The headline is a plain sentence: how many valves, how many need work."""
    valves = [make_screening(f"FV-{k}", verdict, samples=20) for k, verdict in enumerate(verdicts)]
    text = re.sub(r"<[^>]+>", "", render(valves, make_context(valves)))
    assert headline in re.sub(r"\s+", " ", text)


def test_all_that_is_said_of_a_valve_stands_in_the_page(make_screening, make_context):
    """Reason, advice, S and J with intervals, still seen, decisions and digest are all there."""
    valves = [make_screening("FV-1"), make_screening("FV-2", Verdict.UNDETERMINED)]
    text = render(valves, make_context(valves)).replace("\N{NO-BREAK SPACE}", " ")
    for answer in (valves[0].reason, valves[0].advice, *valves[1].still_seen):
        assert answer in text
    for answer in ("5.20", "4.78 to 5.72", "MV was told by the tag mapping.", "reversals_per_h"):
        assert answer in text
    assert valves[0].provenance.digest in text
    assert "S and J are not known: OP moved less than 0.5 %." in text


def test_intervals_of_another_width_are_not_passed_off_as_95_percent(make_screening, make_context):
    """What the sticking does to the loop comes from running it again, with intervals of 90 %."""
    share = Indicator(
        name="variance_from_sticking_percent", value=69.0, unit="%", meaning="", low=44.0, high=75.0
    )
    valve = make_screening("FIC-1")
    for indicators, told in (
        (valve.indicators, "Intervals are of 95 %."),
        (
            {**valve.indicators, share.name: share},
            "Intervals are of 95 %; those of what the sticking does to the loop, which come from "
            "running it again, of 90 %.",
        ),
    ):
        context = make_context([valve])
        ranking = rank_valves([replace(valve, indicators=indicators)], context)
        assert told in html_bytes(ranking, context).decode()


def test_without_scripts_a_sentence_says_what_is_missing(page):
    """The page has a noscript sentence, and shows its script-only parts by a class of a script."""
    assert "need JavaScript" in page
    assert "html:not(.js) .needs-js" in page


@pytest.mark.parametrize("count", [100, pytest.param(500, marks=pytest.mark.long)])
def test_five_hundred_valves_stay_a_page_that_opens(make_screening, make_context, count):
    """Plots and numbers are bounded, every valve keeps its row, its section in words and what to
    do; the page says the bound and where the rest is."""
    model = make_screening("FV", Verdict.HEALTHY, S=0.2, J=0.0, samples=6000)
    valves = [replace(model, valve=f"FV-{k:03}") for k in range(count)]
    text = render(valves, make_context(valves))
    assert text.count('<script type="application/json"') == MOST_PLOTTED
    assert text.count('<article class="valve') == min(count, MOST_SECTIONS)
    assert text.count('<tr role="row" data-anchor=') == count
    assert f"Plots are kept for the first {MOST_PLOTTED} valves of the ranking" in text
    assert text.count('<details class="engineer"') == MOST_PLOTTED
    assert text.count("valves.json have the numbers of every valve") == (
        min(count, MOST_SECTIONS) - MOST_PLOTTED
    )
    assert len(text.encode()) < 7e6


def test_embedded_data_cannot_leave_its_script(make_screening, make_context):
    """A unit that closes the script element is data, and comes back whole."""
    valve = make_screening("FV-1", samples=30)
    recorded = valve.recording
    signals = {k: replace(v, unit="</script><b>") for k, v in recorded.signals.items()}
    valve = replace(valve, recording=replace(recorded, signals=signals))
    text = render([valve], make_context([valve]))
    data = re.search(r'<script type="application/json"[^>]*>(.*?)</script>', text, re.S)
    assert data is not None
    assert json.loads(data.group(1))["panels"][1]["unit"] == "</script><b>"


def test_a_valve_without_mv_is_drawn_with_what_there_is(mixed_plant):
    """PV stands in for MV in the loop, and there are no residuals to draw."""
    chart = chart_of(next(item for item in mixed_plant if item.valve == "PV-310"))
    assert chart is not None
    assert [panel["id"] for panel in chart["panels"]] == ["travel", "process"]
    assert chart["loop"]["title"] == "PV against OP"
    assert [trace["role"] for trace in chart["loop"]["traces"]] == ["recorded"]


def test_the_chart_draws_residual_and_held_out_part(make_screening):
    """Residuals are MV less the simulated stem; the held-out part begins where fitting ended."""
    valve = make_screening("FV-1", samples=1000)
    chart = chart_of(valve)
    assert chart is not None
    residual = chart["panels"][2]["series"][0]["values"]
    expected = valve.recording.mv.values - valve.traces.stiction
    assert np.isnan(unpacked(residual)[340])
    np.testing.assert_allclose(unpacked(residual), expected, atol=5e-4)
    assert chart["heldout"] == 700.0
    assert chart["thinned"] == 1


def test_a_simulated_trace_of_another_length_is_refused(make_screening):
    """The message names the tag and both lengths."""
    valve = make_screening("FV-1", samples=100)
    valve = replace(valve, traces=replace(valve.traces, narx=np.zeros(99)))
    with pytest.raises(ValueError, match=r"FV-1.MV: .*expected \(100,\), received \(99,\)"):
        chart_of(valve)


def test_a_zone_that_is_none_is_refused(make_context):
    """The message gives examples of what is expected."""
    with pytest.raises(ValueError, match=r"'Mars/Base' is not in the time zone database.*Berlin"):
        make_context([], zone="Mars/Base")


def test_a_naive_start_is_refused(make_context):
    """A run's time without a zone cannot be shown in any."""
    naive = make_context([]).started.replace(tzinfo=None)
    with pytest.raises(ValueError, match="timezone aware"):
        ReportContext(started=naive)


def colours(block: str) -> dict[str, str]:
    return dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})\b", block))


def themes() -> dict[str, dict[str, str]]:
    css = files("stemwatch.service.report").joinpath("styles/report.css").read_text("utf-8")
    blocks = re.findall(r":root(?:\[[^]]*\])? \{(.*?)\}", css, re.S)
    return {"light": colours(blocks[0]), "dark": colours(blocks[1])}


def luminance(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(item: str, other: str) -> float:
    high, low = sorted((luminance(item), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_colours_reach_wcag_aa(theme):
    """Text has a contrast of 4.5 on each of its surfaces, plot lines 3 (WCAG 2.2)."""
    result = themes()[theme]
    pairs = [(ink, ground) for ink in ("ink", "quiet") for ground in ("page", "surface", "raised")]
    pairs += [("accent", "surface"), ("accent", "page")]
    words = ("sticky", "watch", "healthy", "undetermined")
    pairs += [(word, f"{word}-tint") for word in words] + [(word, "surface") for word in words]
    weak = {p: contrast(result[p[0]], result[p[1]]) for p in pairs}
    assert {p: c for p, c in weak.items() if c < 4.5} == {}
    lines = {name: contrast(result[name], result["surface"]) for name in result if "trace" in name}
    assert len(lines) == 10
    assert {name: c for name, c in lines.items() if c < 3} == {}


def test_templates_of_one_name_are_not_taken_for_each_other(make_context):
    """What was compiled is kept for all pages, but a template of the same name is another one."""

    def rendered(text: str) -> str:
        page = environment(make_context([]), lambda _: text)
        return page.get_template("same.html").render()

    assert "one 1" == rendered("one {{ 1 }}")
    assert "two 2" == rendered("two {{ 2 }}")
    assert "one 1" == rendered("one {{ 1 }}")
