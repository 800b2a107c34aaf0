"""What ``screen`` and ``explain`` give back: in a few lines, in a notebook, as JSON, as a table."""

from __future__ import annotations

import csv
import io
import json
import re
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pandas as pd
import pytest

import stemwatch as sw
from stemwatch.connectors.connector import ConnectorError
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.recording import Recording
from stemwatch.models.verdict import Verdict
from stemwatch.results import ExplainedValve, ExplainedValves, ScreenedValve, ScreenedValves
from stemwatch.service.presenter.false_discoveries import discoveries
from stemwatch.service.report import ReportContext
from stemwatch.service.report.csv_file import write_csv
from stemwatch.service.report.json_contract import to_contract
from stemwatch.service.report.ranking import rank_valves

REPOSITORY = Path(__file__).parent.parent.parent
SCHEMA = json.loads((REPOSITORY / "service/report/contract.schema.json").read_text("utf-8"))
EXPLAIN_SCHEMA = json.loads((REPOSITORY / "service/explain/explain.schema.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def sticking() -> Recording:
    """Half an hour of a valve with S 5 and J 2."""
    return sw.simulate(S=5.0, J=2.0, minutes=30, seed=3, valve="FIC-101")


@pytest.fixture(scope="module")
def screened(sticking: Recording) -> ScreenedValve:
    """The sticking valve, screened."""
    return sw.screen(sticking, narx=False)


@pytest.fixture(scope="module")
def work(sticking: Recording) -> ScreenedValves:
    """The sticking valve, a named healthy one, and a frame that cannot be read."""
    healthy = sw.simulate(S=0.3, J=0.0, minutes=30, seed=4)
    broken = pd.DataFrame({"something": np.ones(9)}, index=pd.RangeIndex(9))
    valves = {"<b>PIC-102": healthy, "FIC-101": sticking, "TIC-103": broken}
    return sw.screen(valves, narx=False)


@pytest.fixture(scope="module")
def explained(sticking: Recording) -> ExplainedValve:
    """The sticking valve that also lags, so that something is named."""
    lagging = sticking.signals
    assert sticking.mv is not None
    late = np.roll(sticking.mv.values, 4)
    return sw.explain(op=lagging[next(iter(lagging))].values, mv=late, interval_s=1.0, narx=False)


def test_a_simulated_valve_is_found_as_it_was_made(screened: ScreenedValve) -> None:
    """The intervals hold the S and J that the simulator was given."""
    assert Verdict.STICKY == screened.verdict
    assert screened.S.low < 5.0 < screened.S.high
    assert screened.J.low < 2.0 < screened.J.high


def test_the_same_seed_gives_the_same_recording(sticking: Recording) -> None:
    """Another seed another one; the start is the one that was asked for."""
    repeated = sw.simulate(S=5.0, J=2.0, minutes=30, seed=3, valve="FIC-101")
    np.testing.assert_array_equal(sticking.op.values, repeated.op.values)
    other = sw.simulate(S=5.0, J=2.0, minutes=5, seed=5, start=datetime(2026, 7, 1, tzinfo=UTC))
    assert not np.array_equal(other.op.values, sticking.op.values[: len(other)])
    assert datetime(2026, 7, 1, tzinfo=UTC) == other.start
    with pytest.raises(ValueError, match="S must not be negative, received -1"):
        sw.simulate(S=-1.0)


def test_a_result_prints_a_few_lines(screened: ScreenedValve, work: ScreenedValves) -> None:
    """The verdict, the sentence, S and J: not the arrays."""
    for text in (repr(screened), repr(work), repr(screened.screening), repr(screened.recording)):
        assert len(text) < 1200
        assert len(text.splitlines()) <= 14
    assert "FIC-101: ■ sticky" in repr(screened)
    assert screened.S.value is not None
    assert str(screened.S) in repr(screened)
    assert "3 valves: 1 sticky, 1 undetermined, 1 healthy" in repr(work)
    assert "? undetermined  Cannot tell: DataFrame: the index holds no times" in repr(work)
    assert repr(work[:1][0]) == repr(sw.screen([work[0].recording], narx=False))
    first = repr(work).splitlines()[1]
    assert re.match(r"  1 FIC-101 .*■ sticky", first)


def test_a_notebook_shows_sentence_numbers_picture_and_mismatch(screened: ScreenedValve) -> None:
    """One piece of HTML that stands alone: no script, nothing from outside."""
    page = screened._repr_html_().replace("\N{NO-BREAK SPACE}", " ")
    assert screened.reason in page
    assert page.count("<svg") >= 1
    assert "stick band of S and J" in page
    assert screened.mismatch is not None
    assert screened.mismatch.sentence in page
    for mark in ("<script", "http:", "https:", "src=", "@import", "url("):
        assert mark not in page


def test_names_from_outside_are_escaped(work: ScreenedValves) -> None:
    """Markup in a tag is shown as text."""
    page = work._repr_html_() + work["<b>PIC-102"]._repr_html_()
    assert "<b>PIC-102" not in page
    assert "&lt;b&gt;PIC-102" in page


def test_one_valve_is_the_json_contract(screened: ScreenedValve, work: ScreenedValves) -> None:
    """``to_dict`` is what ``valves.json`` holds, by its schema."""
    objects = [screened.to_dict(), *work.to_dict()]
    jsonschema.validate(json.loads(json.dumps(objects, allow_nan=False)), SCHEMA)
    (stands,) = discoveries([screened.screening.mismatch]).standing
    assert to_contract(screened.screening, stands=stands) == screened.to_dict()


def test_many_valves_are_the_rows_of_the_csv(work: ScreenedValves) -> None:
    """``to_frame`` has the columns, the order and the numbers of ``valves.csv``."""
    file, context = io.BytesIO(), ReportContext(started=datetime.now(UTC))
    write_csv(rank_valves([item.screening for item in work], context), context, file)
    rows = list(csv.DictReader(io.StringIO(file.getvalue().decode("utf-8-sig"))))
    table = work.to_frame()
    assert list(rows[0]) == list(table.columns)
    assert [row["valve"] for row in rows] == list(table["valve"])
    assert [row["S (%)"] for row in rows] == ["" if pd.isna(S) else str(S) for S in table["S (%)"]]


def test_results_are_found_by_place_and_by_name(work: ScreenedValves) -> None:
    """In the order in which they were given; an unknown name is answered with the nearest."""
    assert ["<b>PIC-102", "FIC-101", "TIC-103"] == [item.valve for item in work]
    assert work[1] is work["FIC-101"] is work.ranked()[0]
    assert list(work[:2]) == [work[0], work[1]]
    with pytest.raises(KeyError, match=r"no valve 'FIC-100' among 3 \(did you mean 'FIC-101'"):
        work["FIC-100"]


def test_one_that_cannot_be_read_costs_the_others_nothing(work: ScreenedValves) -> None:
    """It is undetermined with the sentence; alone it is an error."""
    broken = work["TIC-103"]
    assert Verdict.UNDETERMINED == broken.verdict
    assert "the index holds no times" in broken.reason
    with pytest.raises(ConnectorError, match="the index holds no times"):
        sw.screen(pd.DataFrame({"something": np.ones(9)}))


def test_what_is_no_data_in_a_list_is_said_with_its_place() -> None:
    """A mistake in the call is an error at once, not a valve."""
    wrong: Any = [3.0]
    with pytest.raises(TypeError, match="entry 0 is a float; expected a pandas DataFrame"):
        sw.screen(wrong)


def test_a_folder_is_screened_like_the_command_line(sticking: Recording, tmp_path: Path) -> None:
    """Each valve of each file; what is no recording says so and the rest goes on."""
    times = pd.date_range("2026-03-02 06:00", periods=len(sticking), freq="s", tz="UTC")
    assert sticking.mv is not None
    frame = pd.DataFrame({"FIC101.OP": sticking.op.values, "FIC101.ZT": sticking.mv.values}, times)
    frame.to_csv(tmp_path / "a.csv", index_label="Time")
    frame.rename(columns=lambda name: f"x{name[-1]}").to_csv(tmp_path / "b.csv")
    screened_valve = sw.screen(tmp_path, narx=False, mismatch=False)
    assert {"FIC101": "sticky", "b": "undetermined"} == {
        item.valve: item.verdict for item in screened_valve
    }


def test_limits_of_the_verdict_can_be_set(sticking: Recording) -> None:
    """A limit beyond its S makes the valve one to watch; one that does not exist is named."""
    limits = {"sticky_S_percent": 20.0}
    screened_valve = sw.screen(sticking, narx=False, mismatch=False, limits=limits)
    assert Verdict.WATCH == screened_valve.verdict
    with pytest.raises(ValueError, match=r"'sticky_percent' is no limit \(did you mean 'sticky_S"):
        sw.screen(sticking, limits={"sticky_percent": 1.0})


def test_an_explanation_names_what_is_left_out(explained: ExplainedValve) -> None:
    """A command that comes late is named, restated and shown, by the schema of ``explain.json``."""
    assert "dead_time" in {slug for effect in explained.mismatch.effects for slug in effect.members}
    assert explained.sentence.split(" ")[0] in repr(explained)
    assert "with S and J alone" in repr(explained)
    page = explained._repr_html_()
    assert "dead time" in page
    assert page.count("<svg") == 2
    several = sw.explain([sw.simulate(S=3.0, J=0.0, minutes=10)], narx=False)
    assert isinstance(several, ExplainedValves)
    assert several[0].finding is Finding.NONE
    assert several[0].S.value is not None
    assert f"<b>{several[0].S.value:.2f}" in several[0]._repr_html_()
    jsonschema.validate([explained.to_dict(), *several.to_dict()], EXPLAIN_SCHEMA)


def test_a_plot_without_matplotlib_names_the_extra(
    screened: ScreenedValve, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is missing and how it is installed."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'stemwatch\[notebook\]'"):
        screened.plot()


def test_plots_show_both_views(
    screened: ScreenedValve, explained: ExplainedValve, work: ScreenedValves
) -> None:
    """OP, MV and the model over time, and MV against OP; a valve without samples says so."""
    pytest.importorskip("matplotlib", reason="PLOTS ARE NOT TESTED: matplotlib is not installed")
    time, loop = screened.plot().axes
    assert {"OP", "MV", "model"} == {line.get_label() for line in time.get_lines()}
    assert "MV, %" == loop.get_ylabel()
    (axes,) = explained.plot().axes
    assert "S and J alone" in {line.get_label() for line in axes.get_lines()}
    with pytest.raises(ValueError, match="TIC-103: no samples of the controller output"):
        work["TIC-103"].plot()


def test_what_cannot_be_tested_is_said_once() -> None:
    """Without a position nothing can be explained; the line does not say so twice."""
    loop = sw.simulate(minutes=10)
    blind = sw.explain(op=loop.op.values, interval_s=1.0, narx=False)
    text = " ".join(repr(blind).split())
    assert "Cannot be tested: there is no valve position in this recording" in text
