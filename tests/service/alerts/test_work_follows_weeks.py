"""Where a valve has a history, work follows what the windows of the last weeks confirm: the same
verdict in report, ranking, counts, work orders and words, whatever the newest window names."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import (
    Effect,
    EffectEvidence,
    EffectScore,
    Finding,
    Mismatch,
    Stiction,
)
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.maintenance.stored import facts_of, report_of_store
from stemwatch.service.presenter.advice import term_words
from stemwatch.service.report.ranking import Ranking, rank_valves
from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.run.finish import hold_back
from stemwatch.service.store.screenings.ranking import RankingFilter
from stemwatch.service.store.store import Store

START = datetime(2026, 3, 2, tzinfo=UTC)
S = Estimate(value=0.4, low=0.3, high=0.5, unit="%")
BOTH = Stiction(S=S, J=Estimate.unknown("few"))
SCORED = tuple(
    EffectScore(slug=slug, mean=0.0, t=0.0, strength=0.0) for slug in ("viscous_drag", "dead_time")
)
PLAIN = Mismatch(finding=Finding.NONE, sentence="", naive=BOTH, restated=BOTH, scores=SCORED)


def named(*slugs: str, p_value: float = 1e-5) -> Mismatch:
    """These effects, as probable as this by chance."""
    effects = tuple(
        Effect(
            slug=slug, members=(slug,), sentence=f"There is {slug}.", where="", decide="",
            check=f"Mend {slug}.", parameters={},
            evidence=EffectEvidence(mean=0.2, t=5.0, share=0.4),
        )
        for slug in slugs
    )  # fmt: skip
    return replace(PLAIN, finding=Finding.NAMED, effects=effects, p_value=p_value)


def screened(valve: str, hour: int, mismatch: Mismatch | None) -> Screening:
    """A stem that follows, in one hour."""
    start = START + timedelta(hours=hour)
    op = Signal.good(np.zeros(60), "OP")
    return Screening(
        valve=valve, verdict=Verdict.HEALTHY, reason="It follows.", advice="Nothing.", shape=None,
        severity=5.0, confidence=0.9, S=S, J=Estimate.unknown("few"), residuals={},
        quality=DataQuality(grade="A"), indicators={}, mismatch=mismatch,
        recording=Recording(valve=valve, signals={Role.OP: op}, interval_s=60.0, start=start),
    )  # fmt: skip


DRAG, LATE = named("viscous_drag"), named("dead_time")
WINDOWS = {
    "AGREED": [DRAG, DRAG, PLAIN],  # the newest misses what two have named
    "AGAIN": [DRAG, PLAIN, DRAG],
    "ONCE": [PLAIN, PLAIN, DRAG],  # however strong: another window must confirm it
    "FIRST": [None, None, DRAG],  # no history: the newest decides, as in a run without a store
    "OVER": [DRAG, PLAIN, PLAIN],
    "BESIDE": [DRAG, DRAG, named("viscous_drag", "dead_time")],
    "WEAK": [named("viscous_drag", p_value=0.6)] * 3,  # confirmed, and no more than chance
    "CLEAN": [PLAIN, PLAIN, PLAIN],
}
DEFECTIVE = {"AGREED", "AGAIN", "FIRST", "BESIDE"}


@pytest.fixture
def run(either_store: Store) -> int:
    """The last of three runs, with what stands among its valves decided."""
    for hour in range(3):
        number = either_store.begin_run(software_version="1")
        for valve, mismatches in WINDOWS.items():
            either_store.save(screened(valve, hour, mismatches[hour]).without_samples(), number)
        hold_back(either_store, number)
        either_store.finish_run(number)
    return number


def ranked(store: Store, run: int) -> Ranking:
    """The run as its report has it."""
    every = store.screenings_of_run(run)
    valves = facts_of(store, None, every)
    return rank_valves(every, ReportContext(started=START, valves=valves))


def test_every_output_has_the_verdict_of_the_weeks(
    either_store: Store, run: int, tmp_path: Path
) -> None:
    """Report, ranking, count of the run, history, work list, and marks that outlive a second
    look."""
    ranking = ranked(either_store, run)
    assert {one.screening.valve for one in ranking if one.verdict is Verdict.DEFECTIVE} == DEFECTIVE
    lines = either_store.ranking(RankingFilter()).lines
    assert {line.valve for line in lines if line.verdict is Verdict.DEFECTIVE} == DEFECTIVE
    assert [line.valve for line in lines] == [one.screening.valve for one in ranking]
    assert either_store.run(run).counts[Verdict.DEFECTIVE] == len(DEFECTIVE)
    for valve in WINDOWS:
        newest = either_store.s_and_j(valve)[-1]
        assert (newest.verdict is Verdict.DEFECTIVE) is (valve in DEFECTIVE)
    book = report_of_store(either_store, tmp_path, run=run).work_list
    assert {sheet.screening.valve for sheet in book.to_work_on} == DEFECTIVE
    assert hold_back(either_store, run) == hold_back(either_store, run)
    assert either_store.ranking(RankingFilter()).lines == lines
    assert either_store.confirmed_in_run(run) == {"AGREED", "AGAIN", "BESIDE"}


def test_what_was_confirmed_is_said_with_what_to_check_though_this_window_misses_it(
    either_store: Store, run: int
) -> None:
    """And what one window alone names is held back in words that say why."""
    words = term_words("viscous_drag")
    assert words is not None
    said = {one.screening.valve: one.finding for one in ranked(either_store, run)}
    agreed = said["AGREED"]
    assert agreed.reason == (
        "It follows. Viscous drag: confirmed by the windows of the last weeks; this one alone does "
        "not name it."
    )
    assert agreed.next_step == words.check
    assert agreed.decision.kinds == ("viscous_drag",)
    assert [effect.slug for effect in said["BESIDE"].decision.effects] == ["viscous_drag"]
    assert "the windows of the last weeks do not confirm this" in said["ONCE"].held_back
    assert "across 8 valves chance alone" in said["WEAK"].held_back
    stored = {valve: either_store.screenings(valve, 1)[0] for valve in WINDOWS}
    assert stored["AGREED"].confirmed == ("viscous_drag",)
    assert (stored["ONCE"].confirmed, stored["FIRST"].confirmed) == ((), None)
    assert stored["ONCE"].held_back == said["ONCE"].held_back
