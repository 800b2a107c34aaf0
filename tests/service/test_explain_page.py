"""The page of ``stemwatch explain``: alone, safe, readable without scripts and on a phone."""

from __future__ import annotations

import html
import io
import re
from dataclasses import replace
from datetime import UTC, datetime
from xml.etree import ElementTree

import numpy as np
import pytest
from rich.console import Console

from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.service.cli.explanation_views import explanation
from stemwatch.service.explain.explain_recording import Explained
from stemwatch.service.explain.write_explanation import MOST_PLOTTED, entries, write_pages
from stemwatch.service.report import ReportContext
from tests.service.example_mismatches import named, of_every_kind

HOSTILE = "</script><img src=x onerror=alert(1)>../[bold]\x07"
CONTEXT = ReportContext(
    started=datetime(2026, 3, 2, 12, 30, tzinfo=UTC), title="Where they differ", zone="UTC"
)


def recording(valve="FV-1", samples=900) -> Recording:
    rng = np.random.default_rng(2)
    op = 50.0 + 8.0 * np.sin(np.arange(samples) / 40.0)
    mv = op + rng.normal(0.0, 0.1, samples)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "ZT")}
    return Recording(valve=valve, signals=signals, interval_s=1.0)


def on_terminal(item: Explained) -> str:
    """What a terminal of 200 columns shows."""
    terminal = Console(width=200, file=io.StringIO(), record=True)
    terminal.print(explanation(item), highlight=False)
    return terminal.export_text()


@pytest.fixture
def result() -> list[Explained]:
    """One of every verdict, and one that could not be read."""
    read = recording()
    complete = [
        Explained(source=f"FV-{k}.csv", valve=f"FV-{k}", mismatch=item, recording=read)
        for k, item in enumerate(of_every_kind(read))
    ]
    return [
        *complete,
        Explained(source="x.csv", valve="x", mismatch=Mismatch.unknown("x.csv: no table.")),
    ]


@pytest.fixture
def written(result, tmp_path):
    return write_pages(result, CONTEXT, tmp_path / "out")


def test_the_page_says_everything_in_words(written):
    """Verdicts, effects, checks, sizes, restated S, what was not testable, and why."""
    page = html.unescape(written.html.read_text("utf-8"))
    for words in (
        "hidden physics named",
        "candidates that this recording cannot tell apart",
        "Look for a blocked exhaust, a throttled speed controller, a kinked tube on the slow side",
        "Look whether other valves from the same source show the same delay",
        "82 % of the residual lies where the stem falls",
        "MV never came within 10 % of an end of travel.",
        "11.8 → 1.00",
        "x.csv: no table.",
    ):
        assert words in page.replace("\N{NO-BREAK SPACE}", " ")


def test_a_sceptic_sees_what_was_tried_and_the_pictures(written):
    """Gains alone and together, what was rejected and why, strokes, loops, a test with numbers."""
    page = html.unescape(written.html.read_text("utf-8")).replace("\N{NO-BREAK SPACE}", " ")
    article = page.split("<article")[1]
    assert re.search(r"asymmetric rate limit</th>\s*<td[^>]*><b>51 %</b>", article)
    assert re.search(r"all together</th>\s*<td[^>]*><b>59 %</b>", article)
    assert re.search(
        r"rate limit</th>\s*<td[^>]*><b>18 %</b>.*?<b>0 %</b>.*?adds nothing", article, re.DOTALL
    )
    assert "this recording cannot tell it from what is named" in article
    for heading in ("Stroke 1", "Stroke 2", "Stroke 3", "MV against OP: S and J alone"):
        assert f"<figcaption>{heading}" in article
    assert "What shows it: asymmetric rate limit" in article
    assert "falling in about 6.9 s (6.5 to 7.4)" in article
    assert "Passes:" in article


def test_where_nothing_is_named_there_is_no_picture_of_it(written):
    """What was tried still stands there, with its scores."""
    unknown = written.html.read_text("utf-8").split("<article")[3]
    assert "small-plot" not in unknown
    assert "What else was tried" in unknown


def test_the_page_loads_nothing(written):
    """A policy without any source, and no address but into the page."""
    page = written.html.read_text("utf-8")
    assert "default-src 'none'; script-src 'sha256-" in html.unescape(page)
    assert re.findall(r'(?:src|srcset|action|poster)="', page) == []
    links = set(re.findall(r'href="#([^"]*)"', page))
    assert links <= set(re.findall(r'id="([^"]*)"', page))
    assert re.findall(r'href="[^#]', page) == []
    assert re.findall(r"@import|url\(", page) == []


def test_each_map_is_a_picture_of_its_own(written):
    """Well-formed SVG with its own colours, before and after, for each valve that has maps."""
    assert len(written.maps) == 8
    for path in written.maps:
        root = ElementTree.fromstring(path.read_text("utf-8"))
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert root.get("aria-label").startswith("FV-")


def test_hostile_names_are_text_and_stay_in_the_folder(tmp_path):
    """A valve's name is no markup, steers no terminal and leads no file elsewhere."""
    read = recording(valve=HOSTILE)
    mismatch = replace(named(read), sentence=HOSTILE)
    explained = Explained(source=HOSTILE, valve=HOSTILE, mismatch=mismatch, recording=read)
    written = write_pages([explained], CONTEXT, tmp_path / "out")
    page = written.html.read_text("utf-8")
    assert "<img" not in page
    assert "\x07" not in page
    assert {path.parent for path in written.maps} == {tmp_path / "out" / "maps"}
    text = on_terminal(explained)
    assert "\x07" not in text
    assert "[bold]" in text


def test_two_recordings_of_one_valve_have_anchors_of_their_own(tmp_path):
    """Ids and map files do not collide."""
    read = recording()
    twice = [Explained(source=f"{k}.csv", valve="FV-1", mismatch=named(read)) for k in range(2)]
    assert len({entry.view.anchor for entry in entries(twice)}) == 2
    assert len(set(write_pages(twice, CONTEXT, tmp_path).maps)) == 4


@pytest.mark.long
def test_the_page_stays_small_for_a_large_plant():
    """Beyond the limit there are findings and maps, and no overlay."""
    read = recording(samples=60)
    explained = Explained(source="a.csv", valve="FV-1", mismatch=named(read), recording=read)
    result = entries([explained] * (MOST_PLOTTED + 1))
    assert result[MOST_PLOTTED - 1].view.overlay is not None
    assert result[MOST_PLOTTED].view.overlay is None
    assert result[MOST_PLOTTED].view.before is not None


def test_nothing_to_explain_is_said(tmp_path):
    """An empty run still leaves a page and a list."""
    written = write_pages([], CONTEXT, tmp_path)
    assert "There was nothing to explain." in written.html.read_text("utf-8")
    assert written.json.read_text("utf-8").strip() == "[]"


def test_the_terminal_says_what_matters(result):
    """Verdict word, sentences, what to check, both S, and the fit before and after."""
    text = " ".join(on_terminal(result[0]).split())
    for words in (
        "named FV-0",
        "82 % of the residual lies where the stem falls",
        "Asymmetric rate limit",
        "Look for a blocked exhaust",
        "11.8 (11.0 to 12.5)",
        "1.00 (0.80 to 1.20)",
        "24.2",
        "69.4",
        "fit grows by 38 to 51 percentage points",
        "Not testable here: travel stop, flow force",
    ):
        assert words in text
