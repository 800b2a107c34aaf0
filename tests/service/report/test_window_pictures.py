"""What is kept of a window for its pictures: small, as it was, and the same in every place."""

from __future__ import annotations

import json
import re
import zlib
from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.recording import ProcessRange, Recording, Role
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.report.charts.effect_pictures import effect_pictures
from stemwatch.service.report.charts.valve_charts import chart_of
from stemwatch.service.report.charts.valve_plots import plots_of
from stemwatch.service.report.charts.window_pictures import (
    WindowPictures,
    before_and_after,
    pack_pictures,
    unpack_pictures,
    window_pictures,
)
from stemwatch.service.report.html_page import html_bytes
from stemwatch.service.report.ranking import rank_valves
from tests.service.maintenance.example_work_list import context, with_effects
from tests.service.report.conftest import recording, screening


def test_what_is_packed_comes_back_as_it_was_drawn() -> None:
    """Title, words, every line and note of every picture, to a tenth of a pixel; in some KB."""
    result = window_pictures(with_effects())
    kept = pack_pictures(result)
    assert 1_000 < len(kept) < 40_000
    back = unpack_pictures(kept)
    assert [item.title for item in back.effects] == [item.title for item in result.effects]
    assert len(back.effects) >= 5
    for item, other in zip(result.effects, back.effects, strict=True):
        assert (item.caption, item.plot.description, item.plot.x_label) == (
            other.caption,
            other.plot.description,
            other.plot.x_label,
        )
        assert [note.text for note in item.plot.notes] == [note.text for note in other.plot.notes]
        assert re.sub(r"[\d. -]+", "", str(item.svg)) == re.sub(r"[\d. -]+", "", str(other.svg))
        for line, repeated in zip(item.plot.lines, other.plot.lines, strict=True):
            span = np.nanmax(line.y) - np.nanmin(line.y) if np.isfinite(line.y).any() else 1.0
            np.testing.assert_allclose(repeated.y, line.y, atol=1e-3 * max(span, 1e-9))
    assert result.loop is not None
    assert back.loop is not None
    np.testing.assert_allclose(back.loop.mv, result.loop.mv, atol=0.01)


def test_the_report_has_the_pictures_that_explain_has() -> None:
    """Strokes, OP later by the dead time, both loops and what shows it, from the same samples;
    also where the samples were let go."""
    result = with_effects(verdict=Verdict.STICKY)
    assert result.mismatch is not None
    titles = [
        effect_picture.title
        for effect_picture in effect_pictures(result.recording, result.mismatch)
    ]
    assert {"Stroke 1", "Stroke 3", "What shows it: asymmetric rate limit"} <= set(titles)
    assert sum("MV against OP" in title for title in titles) == 2
    evidence, light = plots_of(result), result.without_samples()
    ranked = rank_valves([light], context([light]), lambda _: evidence)
    page = html_bytes(ranked, context([light])).decode()
    assert page.count('class="small-plot"') == len(titles)
    for title in titles:
        assert f"<figcaption>{title}</figcaption>" in page


@pytest.mark.parametrize("kept", [b"", zlib.compress(json.dumps({"version": 99}).encode())])
def test_nothing_kept_or_a_newer_form_is_no_picture(kept: bytes) -> None:
    """Neither hurts a page."""
    assert unpack_pictures(kept) == WindowPictures()
    assert pack_pictures(WindowPictures()) == b""


def test_a_valve_without_a_position_has_no_loop() -> None:
    """Nor has one whose position is in another unit than OP: they cannot share axes."""
    result = screening("FV-1")
    assert result.recording is not None
    signals = dict(result.recording.signals)
    other = replace(signals[Role.MV], unit="mm")
    for changed in ({**signals, Role.MV: other}, {Role.OP: signals[Role.OP]}):
        part = replace(result, recording=replace(result.recording, signals=changed))
        assert window_pictures(part).loop is None


def test_before_and_after_share_axes_and_are_told_apart_without_colour() -> None:
    """Two lines, one of them dashed, each named in the legend."""
    loops = [window_pictures(screening("FV-1", S=S, J=J)).loop for S, J in ((6.0, 2.0), (0.3, 0))]
    before, after = loops
    assert before is not None
    assert after is not None
    svg = str(before_and_after(before, after).svg())
    assert svg.count('<path class="l naive dashed"') == 2  # the line, and its legend
    assert svg.count('<path class="l mv"') == 2
    assert "before the work" in svg
    assert 'role="img" aria-label="MV against OP' in svg


def ranged(made: Recording) -> Screening:
    """PV kept as percent of 0 to 16 bar, as a plant file with ``low`` and ``high`` has it."""
    signals = dict(made.signals)
    for role in (Role.PV, Role.SP):
        percent = 100.0 * signals[role].values / 160.0
        bar = ProcessRange(low=0.0, high=16.0, unit="bar")
        signals[role] = replace(signals[role], values=percent, unit="%", range=bar)
    return replace(screening(made.valve), recording=replace(made, signals=signals))


def test_the_process_is_drawn_in_its_own_unit() -> None:
    """A pressure in bar is drawn in bar, though all that is fitted is in percent."""
    chart = chart_of(ranged(recording("PIC-1", 5.0, 2.0)))
    assert chart is not None
    (process,) = [panel for panel in chart["panels"] if panel["id"] == "process"]
    assert process["unit"] == "bar"
    assert "PV between 11" in process["summary"]
