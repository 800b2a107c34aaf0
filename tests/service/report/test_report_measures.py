"""The numbers beside S and J: what slows the stem, how far models stay off, data quality."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.screening_result import Indicator, Residual
from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.beside_friction import beside_friction, without_them
from stemwatch.service.presenter.wording import not_yet_said
from stemwatch.service.report.bars import fit_bars, spread_percent
from stemwatch.service.report.html_page import html_bytes
from stemwatch.service.report.ranking import rank_valves


@pytest.fixture
def with_indicators(make_screening):
    """A sticky valve, S 5.2 % at 1 s, with the given numbers among its indicators."""

    def make(**numbers):
        results = {
            name: Indicator(name=name, value=value, unit="", meaning="")
            for name, value in numbers.items()
        }
        return replace(make_screening("FV-1", samples=20), indicators=results)

    return make


@pytest.mark.parametrize(
    ("numbers", "sentence"),
    [
        ({}, ""),
        ({"dead_time_s": 0.04}, ""),
        ({"dead_time_s": float("nan")}, ""),
        ({"speed_falling_percent_per_s": 45.0}, ""),
        ({"dead_time_s": 1.02}, "Beside friction: command arrives 1.0 s late."),
        (
            {"dead_time_s": 1.0, "speed_falling_percent_per_s": 3.12},
            "Beside friction: command arrives 1.0 s late; moves at most 3.1 %/s when position "
            "falls.",
        ),
        (
            {"lag_rising_s": 2.0, "lag_falling_s": 2.2},
            "Beside friction: follows with a lag of 2.1 s.",
        ),
        (
            {"lag_rising_s": 0.5, "lag_falling_s": 2.2},
            "Beside friction: follows with a lag of 0.5 s rising and 2.2 s falling.",
        ),
        (
            {"lag_rising_s": 0.5, "lag_falling_s": 0.0},
            "Beside friction: follows with a lag of 0.5 s when position rises.",
        ),
    ],
)
def test_what_slows_the_stem_is_one_plain_line(numbers, sentence, with_indicators):
    """Only what could be seen is said, both directions at once where they are alike."""
    assert beside_friction(with_indicators(**numbers)) == sentence


def test_a_time_far_below_the_sampling_interval_is_not_claimed(with_indicators):
    """Half a second between samples of ten seconds is a guess."""
    valve = with_indicators(dead_time_s=0.5)
    slow = replace(valve, recording=replace(valve.recording, interval_s=10.0))
    assert beside_friction(slow) == ""


@pytest.mark.parametrize(
    ("naive", "sentence"),
    [(5.9, ""), (3.6, ""), (9.9, "S and J alone would have read S 9.90 %.")],
)
def test_a_misleading_s_is_set_against_the_one_found(naive, sentence, with_indicators):
    """A third of S = 5.2 % is the difference from which it is worth a word."""
    assert without_them(with_indicators(naive_S_percent=naive)) == sentence


def test_what_the_reason_already_says_is_not_said_again(with_indicators):
    """The misreading stands once on the page."""
    valve = with_indicators(naive_S_percent=9.9)
    changed = replace(valve, reason="It sticks; S and J alone would have read S as 9.9 %.")
    assert without_them(changed) == ""


def test_bars_share_one_scale_that_ends_at_a_constants_miss():
    """A full bar is MV's own spread; a model that is missing has no length and no number."""
    residuals = {
        "stiction": Residual(rmse=0.5, normalised=0.25),
        "narx": Residual(rmse=4.0, normalised=2.0),
        "baseline": None,
    }
    bars = fit_bars(residuals)
    assert spread_percent(residuals) == 2.0
    assert [(bar.model, bar.rmse, bar.length) for bar in bars] == [
        ("stiction", 0.5, 25.0),
        ("narx", 4.0, 100.0),
        ("baseline", None, 0.0),
    ]
    assert bars[0].fit_percent == 75.0


def test_without_any_residual_there_are_no_bars():
    """An undetermined valve shows no empty comparison."""
    assert fit_bars({"stiction": None, "narx": None, "baseline": None}) == []
    assert spread_percent({}) is None


def test_a_residual_that_is_no_number_has_no_bar():
    """NaN is never drawn as a length."""
    bars = fit_bars({"stiction": Residual(rmse=float("nan"), normalised=float("nan"))})
    assert (bars[0].rmse, bars[0].length) == (None, 0.0)


def test_sentences_already_said_are_left_out():
    """Case and the full stop do not make a sentence new."""
    text = "Cannot tell: the position was frozen for 82 % of the time."
    result = not_yet_said(
        ["The position was frozen for 82 % of the time.", "One gap of 40 s."], text
    )
    assert result == ["One gap of 40 s."]


def article(text: str, valve: str) -> str:
    match = re.search(rf'<article[^>]* id="valve-{valve}".*?</article>', text, re.S)
    assert match is not None
    plain = re.sub(r"<script.*?</script>|<[^>]+>", " ", match.group(0), flags=re.S)
    return re.sub(r"\s+", " ", plain)


def test_an_undetermined_valve_leads_with_why_and_what_helps(make_screening, make_context):
    """Reason, help and what is still seen come first; S and J are one line, not two gauges."""
    valve = make_screening("FV-1", Verdict.UNDETERMINED)
    quality = DataQuality(grade="D", reasons=(valve.reason, "One gap of 40 s."))
    valve = replace(valve, quality=quality)
    context = make_context([valve])
    result = article(html_bytes(rank_valves([valve], context), context).decode(), "FV-1")
    first, _ = result.split("For the control engineer")
    places = [
        first.index(text)
        for text in (
            "Why there is no verdict",
            "What would help",
            "What can still be seen",
            "Data quality",
            "One gap of 40 s.",
            "S and J are not known: OP moved less than 0.5",
        )
    ]
    assert places == sorted(places)
    assert first.count("so that sticking could not show itself") == 1
    assert "dead band + stick band" not in first


def test_the_line_beside_s_and_j_and_the_bars_stand_in_the_page(with_indicators, make_context):
    """Planners read both without opening the part for the control engineer."""
    valve = with_indicators(dead_time_s=1.0, naive_S_percent=9.9)
    context = make_context([valve])
    result = article(html_bytes(rank_valves([valve], context), context).decode(), "FV-1")
    first, _ = result.replace("\N{NO-BREAK SPACE}", " ").split("For the control engineer")
    assert "command arrives 1.0 s late. S and J alone would have read S 9.90 %." in first
    assert "Stick-slip model 0.11 % fit 98 %" in first
