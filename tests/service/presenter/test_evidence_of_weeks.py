"""Confirmed findings in words, and the evidence by window as a picture."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from xml.etree import ElementTree
from zoneinfo import ZoneInfo

import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.evidence_over_windows import WindowEvidence
from stemwatch.models.mismatch.findings import EffectScore
from stemwatch.service.presenter.evidence_of_weeks import evidence_of_weeks
from stemwatch.service.presenter.finding import confirmed_by_others
from stemwatch.service.report.evidence_by_window import evidence_picture

BEGIN = datetime(2026, 11, 2, 23, 30, tzinfo=UTC)
SLUG = "flow_force"


def window(day, named, strength=0.5):
    """An hour on ``day`` that names the flow force, gains a little by it, or (``None``) nothing."""
    at = BEGIN + timedelta(days=day)
    size = Estimate(value=3.2, low=3.0, high=3.4, unit="%")
    return WindowEvidence(
        at=at,
        start=at - timedelta(hours=1),
        named=((SLUG,),) if named else (),
        scores=(
            EffectScore(
                slug=SLUG,
                mean=0.0 if named is None else 0.03,
                t=0.0 if named is None else 1.0,
                strength=strength,
            ),
        ),
        S=size,
        J=size,
    )


def playing(day, size, name="b"):
    """An hour on ``day`` that names play of ``size`` percent."""
    plain = window(day, None)
    play = {("lost_motion", name): Estimate(value=size, unit="%")}
    return replace(plain, named=(("lost_motion",),), sizes=play)


def test_a_window_that_names_none_of_two_does_not_name_them():
    """Of one effect it is one."""
    assert confirmed_by_others([SLUG]).startswith("Flow force: confirmed by the windows")
    assert confirmed_by_others([SLUG]).endswith("this one alone does not name it.")
    assert confirmed_by_others([SLUG, "dead_time"]).endswith("does not name them.")


def test_a_confirmed_effect_says_how_its_size_goes():
    """Its rate a month over the windows that name it, with the interval."""
    grows = [playing(3 * k, 1.0 + 0.1 * k + 0.01 * (-1) ** k) for k in range(6)]
    evidence = evidence_of_weeks([*grows, window(20, None)])
    (finding,) = evidence.findings
    (trend,) = evidence.size_trends(finding).values()
    assert trend.is_change
    assert trend.per_month == pytest.approx(0.1 / 3.0 * 365.25 / 12.0, rel=0.1)
    assert f"Over the weeks: play +{trend.per_month:.2f} % a month (+" in evidence.sentences()[0]
    stays = evidence_of_weeks([playing(3 * k, 1.0 + 0.1 * (-1) ** k) for k in range(6)])
    assert "a month" in stays.sentences()[0]
    assert "no more than its scatter" in stays.sentences()[0]


def test_a_size_that_few_days_have_has_no_trend():
    """Three days are too few, also where later windows call their number otherwise."""
    mixed = [playing(3 * k, 1.0 + k, "b" if k < 3 else "other") for k in range(6)]
    evidence = evidence_of_weeks(mixed)
    assert evidence.size_trends(evidence.findings[0]) == {}


def said(*named):
    return evidence_of_weeks([window(day, item) for day, item in enumerate(named)]).sentences()


@pytest.mark.parametrize(
    ("named", "sentence"),
    [
        ((True,), "in the only window that counts so far; another one must confirm it."),
        ((True, False, False), "in 1 of 3 windows; not confirmed yet."),
        ((True, False, True, True), "confirmed in 3 of 4 windows."),
        ((True, *[False] * 7), "named in 1 of the last 8 windows and confirmed by what it gains"),
        ((True, True, True, True), "confirmed in 4 of 4 windows."),
    ],
)
def test_each_state_has_its_sentence(named, sentence):
    """First seen with its day, then how many windows confirm it."""
    first = said(*named)[0]
    assert first.startswith("Flow force: first seen on 2026-11-02")
    assert sentence in first


def test_what_is_gone_says_when_it_was_seen():
    """With the day of the confirmation and the last day it was there."""
    first = said(*[True] * 4, *[None] * 6)[0]
    assert "confirmed on 2026-11-03; gone: last seen on 2026-11-05" in first


def test_days_are_those_of_the_plant():
    """Half past eleven in the evening in UTC is the next day in Singapore."""
    evidence = evidence_of_weeks([window(0, True), window(1, True)])
    assert "first seen on 2026-11-03" in evidence.sentences(ZoneInfo("Asia/Singapore"))[0]


def test_s_and_j_are_told_over_the_windows_that_name_it():
    """Pooled, with an interval, and only where something is confirmed."""
    assert said(True, True, True)[1].startswith("Over the windows that name it, S is 3.20 % (2.9")
    assert len(said(True)) == 1


def test_nothing_named_is_nothing_to_say():
    """No windows, and windows that name nothing."""
    assert evidence_of_weeks([]) is None
    assert evidence_of_weeks([window(0, False)]) is None


def test_the_picture_has_a_row_for_each_effect_and_a_cell_for_each_window():
    """PlottedLine as SVG that reads aloud what the sentences say."""
    evidence = evidence_of_weeks([window(0, True), window(1, False), window(2, True)])
    picture = ElementTree.fromstring(str(evidence_picture(evidence, UTC)))
    kinds = [part.get("class") for part in picture if part.tag == "rect"]
    assert kinds == ["named", "gains", "named"]
    assert "confirmed in 2 of 3 windows" in picture.get("aria-label")
    texts = [part.text for part in picture if part.tag == "text"]
    assert "flow force" in texts
    assert "confirmed" in texts
    assert "11-02" in texts
