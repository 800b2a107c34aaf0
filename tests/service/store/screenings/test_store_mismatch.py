"""What is kept of a mismatch, and of the baseline that a screening refers to."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import numpy as np
from sqlalchemy import select, text

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import (
    Cell,
    Effect,
    EffectEvidence,
    Finding,
    FreeRuns,
    HeldOutFit,
    Mismatch,
    RecordEffect,
    ResidualMap,
    Stiction,
    Untestable,
)
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.models.verdict import Verdict
from stemwatch.service.store.screenings.ranking import RankingFilter
from stemwatch.service.store.screenings.tables import ScreeningRow
from stemwatch.service.store.store import Store

S = Estimate(value=2.0, low=1.5, high=2.5, unit="%")
NAIVE = Stiction(S=S, J=Estimate.unknown("too few slips"))
EFFECT = Effect(
    slug="lost_motion",
    members=("lost_motion", "zero_shift"),
    sentence="Play between stem and sensor.",
    where="at reversals",
    check="Look at the linkage.",
    decide="",
    parameters={"play_percent": S},
    evidence=EffectEvidence(mean=0.2, t=5.0, share=0.4),
)
MISMATCH = Mismatch(
    finding=Finding.NAMED,
    sentence="Lost motion.",
    naive=NAIVE,
    restated=NAIVE,
    effects=(EFFECT,),
    record_effects=(RecordEffect(slug="quantisation", sentence="Coarse.", parameters={"q": 0.5}),),
    not_testable=(Untestable(slug="travel_stop", reason="no end was reached"),),
    heldout=HeldOutFit(rmse_naive=0.5, rmse_extended=0.2),
    before=ResidualMap(
        cells=(
            Cell(
                facet="phase", label="slip", samples=3, weight=0.1, share=0.4, mean=0.1, rms=0.2,
                z=4.0, bias_z=1.0,
            ),
        ),
        travel_edges=(0.0, 50.0, 100.0),
        columns=("slip",),
        grid=((0.1,), (None,)),
    ),
    runs=FreeRuns(naive=np.zeros(3), extended=np.ones(3), heldout_from=2),
)  # fmt: skip


def test_a_mismatch_comes_back_without_its_samples(store: Store, make_screening) -> None:
    """All that was found beside S and J survives the database but the free runs."""
    store.save(make_screening(mismatch=MISMATCH), store.begin_run(software_version="1"))
    (result,) = store.screenings("FIC-101")
    assert result.mismatch == replace(MISMATCH, runs=None)
    with store.transactions.reading() as session:
        row = session.execute(text("SELECT mismatch_finding, mismatch_slugs FROM screenings")).one()
    assert row[0] == "named"
    assert "lost_motion" in str(row[1])


def test_what_belongs_to_the_machine_counts_nowhere_as_a_defect(
    store: Store, make_screening
) -> None:
    """Counts, ranking, history and the next screening's past say so; what an older version stored
    has no such key, and all its effects count."""
    run, machine = store.begin_run(software_version="1"), replace(EFFECT, inherent=True)
    mismatch = replace(MISMATCH, effects=(machine,))
    changed = replace(make_screening(mismatch=mismatch), verdict=Verdict.HEALTHY)
    store.save(changed, run)

    def said() -> list[str]:
        (line,) = store.ranking(RankingFilter()).lines
        (point,) = store.s_and_j("FIC-101")
        (judged,) = store.recent(["FIC-101"], 1, "none")["FIC-101"].screenings
        assert line.left_out == ("lost_motion",)
        counts = store.finish_run(run).counts
        counted = [verdict.value for verdict, count in counts.items() if count]
        return [*counted, line.verdict.value, point.verdict.value, str(judged.named)]

    assert said() == ["healthy", "healthy", "healthy", "False"]
    with store.transactions.writing("as an older version") as session:
        (row,) = session.scalars(select(ScreeningRow))
        row.mismatch = {key: item for key, item in row.mismatch.items() if key != "defects"}
    assert said() == ["defective", "defective", "defective", "True"]


def test_the_curves_of_the_last_windows_are_known(store: Store, make_screening) -> None:
    """Newest first, with their windows; one of a version that looked for none says nothing."""
    run, curve = store.begin_run(software_version="1"), StrokeCurve(op=(50, 100), travel=(0, 100))
    first = make_screening(mismatch=replace(MISMATCH, stroke_curve=curve))
    begin, end = first.window
    windows = [(begin + timedelta(days=day), end + timedelta(days=day)) for day in range(3)]
    for day, result in enumerate((curve, None, curve)):
        recording = replace(first.recording, start=windows[day][0])
        mismatch = replace(MISMATCH, stroke_curve=result)
        store.save(replace(first, recording=recording, mismatch=mismatch), run)
    assert [
        (earlier_curve.start, earlier_curve.end)
        for earlier_curve in store.earlier_curves("FIC-101")
    ] == windows[::-1]
    assert [earlier_curve.curve for earlier_curve in store.earlier_curves("FIC-101")] == [
        curve,
        None,
        curve,
    ]
    (older, *_) = store.screenings("FIC-101")
    with store.transactions.writing("as an older version") as session:
        row = session.get(ScreeningRow, older.id)
        row.mismatch = {
            key: earlier_curve
            for key, earlier_curve in row.mismatch.items()
            if key != "stroke_curve"
        }
    assert [earlier_curve.curve for earlier_curve in store.earlier_curves("FIC-101")] == [
        None,
        curve,
    ]


def test_a_screening_knows_its_baseline(store: Store, make_screening) -> None:
    """Which baseline the numbers refer to stays known after another has taken its place."""
    store.set_baseline("FIC-101", b"first", reason="first healthy window")
    first = store.baseline("FIC-101")
    store.save(make_screening(), store.begin_run(software_version="1"), first.id)
    store.set_baseline("FIC-101", b"second", reason="after maintenance")
    assert store.screenings("FIC-101")[0].baseline_id == first.id
    assert [(mark.reason, mark.active) for mark in store.baseline_marks("FIC-101")] == [
        ("first healthy window", False),
        ("after maintenance", True),
    ]
    assert (first.network, store.baseline("FIC-101").network) == (b"first", b"second")
