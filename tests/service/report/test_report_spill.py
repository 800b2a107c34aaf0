"""The spill: results on a disk, plots of the worst, and reports of thousands of valves."""

from __future__ import annotations

import json
import weakref
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.report import write_report
from stemwatch.service.report.charts.valve_plots import (
    EXCERPT_SAMPLES,
    may_need_work,
    plots_instead_of_samples,
    plots_of,
)
from stemwatch.service.report.html_page import MOST_PLOTTED, MOST_SECTIONS
from stemwatch.service.run.spill import ResultSpill


def spilled(screenings, plotted: int = MOST_PLOTTED) -> ResultSpill:
    """A spill that contains every packed screening, stored in reverse order."""
    spill = ResultSpill(plotted)
    for index in reversed(range(len(screenings))):
        spill.add(index, *plots_instead_of_samples(screenings[index]))
    return spill


def test_what_is_read_is_what_was_put(mixed_plant) -> None:
    """Screenings come back in the order of their places, without samples that no valve needs."""
    spill = spilled(mixed_plant)
    assert [item.valve for item in spill] == [item.valve for item in mixed_plant]
    for back, complete in zip(spill, mixed_plant, strict=True):
        assert (back.verdict, back.S, back.reason) == (
            complete.verdict,
            complete.S,
            complete.reason,
        )
        assert back.indicators.keys() == complete.indicators.keys()
        assert back.window == complete.window
        assert back.seen == complete.seen
        assert back.finite_share() == complete.finite_share()
        if back.recording is not None:
            assert len(back.recording) <= EXCERPT_SAMPLES
        assert (back.recording is None) == (
            complete.recording is None or not may_need_work(complete)
        )


def test_the_report_from_a_spill_is_the_same(mixed_plant, make_context, tmp_path) -> None:
    """Packed results give byte for byte the report of those with all samples."""
    context = make_context(mixed_plant)
    complete = write_report(mixed_plant, context, tmp_path / "whole")
    spill = spilled(mixed_plant)
    from_spill = write_report(spill, context, tmp_path / "spill", spill.evidence)
    for name in ("html", "csv", "json"):
        assert getattr(complete, name).read_bytes() == getattr(from_spill, name).read_bytes()


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.integers(0, 100), min_size=1, max_size=30), st.integers(1, 8))
def test_plots_are_kept_of_the_worst(make_screening, severities, plotted) -> None:
    """However they come in, the plots of the worst are there, and of no other."""
    model = make_screening("FV", Verdict.STICKY, S=2.0, J=0.0, samples=30)
    nothing = plots_of(model.without_samples())
    spill = ResultSpill(plotted)
    for index, severity in enumerate(severities):
        changed = replace(model.without_samples(), valve=f"FV-{index:02}", severity=float(severity))
        spill.add(index, changed, nothing)
    kept = {index for index in range(len(severities)) if spill.evidence(index) is not None}
    order = sorted(range(len(severities)), key=lambda index: (-severities[index], index))
    assert kept == set(order[:plotted])


def test_an_excerpt_is_the_samples_that_were_there(make_screening) -> None:
    """The excerpt of a long record holds its own samples and traces, and knows the whole."""
    screening = make_screening("FV-1", Verdict.STICKY, S=5.0, J=1.0, samples=20_000)
    short = screening.excerpt(500, 900)
    assert len(short.recording) == 400
    assert np.array_equal(short.recording.op.values, screening.recording.op.values[500:900])
    if screening.traces.stiction is not None:
        assert np.array_equal(
            short.traces.stiction, screening.traces.stiction[500:900], equal_nan=True
        )
    assert short.seen.samples == 20_000
    assert short.window == screening.window
    assert short.without_samples().seen == screening.seen


@pytest.mark.long
def test_a_thousand_valves_are_a_page_that_opens(make_screening, make_context, tmp_path) -> None:
    """Every valve has its row, the worst have sections and plots, and the files hold all."""
    model, evidence = plots_instead_of_samples(
        make_screening("FV", Verdict.STICKY, S=2.2, J=0.4, samples=6000)
    )
    model = model.without_samples()
    spill = ResultSpill(MOST_PLOTTED)
    for index in range(1000):
        verdict = Verdict.STICKY if index % 5 == 0 else Verdict.HEALTHY
        spill.add(index, replace(model, valve=f"FV-{index:04}", verdict=verdict), evidence)
    files = write_report(spill, make_context([model]), tmp_path, spill.evidence)
    text = files.html.read_text("utf-8")
    assert text.count('<tr role="row" data-anchor=') == 1000
    assert text.count('<article class="valve') == MOST_SECTIONS
    assert text.count('<article class="valve with-plots"') == MOST_PLOTTED
    assert f"The first {MOST_SECTIONS} valves have a section of their own" in text
    assert len(text) < 9e6
    assert len(json.loads(files.json.read_text("utf-8"))) == 1000
    assert len(files.csv.read_text("utf-8-sig").splitlines()) == 1001


class Watched(ResultSpill):
    """A spill that counts how many of its screenings are in memory at a time."""

    alive = 0
    most = 0

    def _read(self, offset):
        """What was put there, counted until it is gone."""
        value = super()._read(offset)
        if isinstance(value, Screening):
            self.alive += 1
            self.most = max(self.most, self.alive)
            weakref.finalize(value, self._gone)
        return value

    def _gone(self) -> None:
        self.alive -= 1


def test_a_report_holds_few_valves_at_a_time(make_screening, make_context, tmp_path) -> None:
    """While a report of many valves is written, no more than a few are in memory."""
    model, evidence = plots_instead_of_samples(
        make_screening("FV", Verdict.STICKY, S=2.2, J=0.4, samples=100)
    )
    spill = Watched(MOST_PLOTTED)
    for index in range(80):
        spill.add(index, replace(model, valve=f"FV-{index:04}"), evidence)
    write_report(spill, make_context([model]), tmp_path, spill.evidence)
    assert 1 <= spill.most <= 5
