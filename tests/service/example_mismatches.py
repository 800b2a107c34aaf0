"""Mismatches made by hand: one of every verdict, for the JSON, the pages and the terminal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import (
    Cell,
    Effect,
    EffectEvidence,
    Finding,
    FreeRuns,
    Gain,
    HeldOutFit,
    HotPlace,
    Mismatch,
    RecordEffect,
    ResidualMap,
    Stiction,
    TriedEffect,
    TriedOutcome,
    Untestable,
)
from stemwatch.models.recording import Recording
from stemwatch.models.stickslip.stroke_curve import StrokeCurve

COLUMNS = ("stick", "slip", "settling", "moving", "reversal")
EDGES = (30.0, 38.0, 46.0, 54.0, 62.0)
PHASES = (
    ("stick", 0.41, 0.12),
    ("slip", 0.09, 0.31),
    ("moving", 0.28, 0.5),
    ("reversal", 0.2, 0.07),
)


def percent(value: float, low: float, high: float) -> Estimate:
    """A value in percent with its interval."""
    return Estimate(value=value, low=low, high=high, unit="%")


def residual_map(scale: float, hot: bool) -> ResidualMap:
    """A map whose residual is ``scale`` times as large, with one empty cell."""
    rng = np.random.default_rng(4)
    drawn = scale * (0.2 + rng.random((len(EDGES) - 1, len(COLUMNS))))
    grid: list[tuple[float | None, ...]] = [tuple(row.tolist()) for row in drawn]
    grid[0] = (None, *grid[0][1:])
    cells = [
        Cell(
            facet="phase",
            label=label,
            samples=round(3600 * weight),
            weight=weight,
            share=share,
            mean=0.1 * scale,
            rms=scale * (0.3 + share),
            z=6.1 if share > 0.4 else 0.4,
            bias_z=0.2,
        )
        for label, weight, share in PHASES
    ]
    sides = (("falling", 0.5, 0.82), ("rising", 0.5, 0.18))
    cells += [
        Cell(
            facet="direction",
            label=label,
            samples=1800,
            weight=weight,
            share=share,
            mean=-0.3 * scale,
            rms=scale * share,
            z=7.7 if share > 0.5 else -1.0,
            bias_z=3.0,
        )
        for label, weight, share in sides
    ]
    hot_place = HotPlace(
        facet="direction",
        label="falling",
        share=0.82,
        z=7.7,
        sentence="82 % of the residual lies where the stem falls, in 50 % of the time.",
    )
    return ResidualMap(
        cells=tuple(cells),
        hot=(hot_place,) if hot else (),
        travel_edges=EDGES,
        columns=COLUMNS,
        grid=tuple(grid),
    )


def effect() -> Effect:
    """A rate limit one way, which nothing else explains."""
    return Effect(
        slug="asymmetric_rate_limit",
        members=("asymmetric_rate_limit",),
        sentence="The actuator closes at no more than 2.9 %/s (2.7 to 3.1 %/s) but opens freely.",
        where="While the stem falls after command steps of more than 4 %.",
        check="Check the exhaust restriction, the booster and the air supply.",
        decide="Step OP by 10 % both ways and time each stroke.",
        parameters={
            "rate_falling": Estimate(value=2.9, low=2.7, high=3.1, unit="%/s"),
            "rate_rising": Estimate.unknown("never reached", unit="%/s"),
        },
        evidence=EffectEvidence(
            mean=0.71, t=9.3, share=0.88, note="A lag explains 31 % less of it."
        ),
    )


def second_effect() -> Effect:
    """A dead time that this recording cannot tell from a lag."""
    return Effect(
        slug="dead_time",
        members=("dead_time", "actuator_lag"),
        sentence="The command arrives 1.1 s (0.9 to 1.3 s) late.",
        where="At every reversal.",
        check="Check the clocks of the recorder and the output scan.",
        decide="Step OP by 2 % and by 10 %.",
        parameters={"dead_time": Estimate(value=1.1, low=0.9, high=1.3, unit="s")},
        evidence=EffectEvidence(mean=0.2, t=4.4, share=0.21),
    )


def tried(slug: str, alone: float, beside: float | None, outcome: TriedOutcome) -> TriedEffect:
    """One effect that was tried, with gains of these sizes."""
    on_top = None if beside is None else Gain(mean=beside, t=20.0 * beside)
    return TriedEffect(
        slug=slug, alone=Gain(mean=alone, t=20.0 * alone), beside=on_top, outcome=outcome
    )


def named(recording: Recording | None = None) -> Mismatch:
    """Two effects accepted, everything known; runs where there is a recording with MV."""
    runs = None
    if recording is not None and recording.mv is not None:
        mv = np.nan_to_num(recording.mv.values, nan=50.0)
        late = np.roll(mv, 6)
        late[:6] = mv[0]
        split = round(0.6 * len(recording))
        runs = FreeRuns(naive=late, extended=mv + 0.05, heldout_from=split)
    return Mismatch(
        finding=Finding.NAMED,
        sentence="The actuator closes at no more than 2.9 %/s but opens freely.",
        naive=Stiction(S=percent(11.8, 11.0, 12.5), J=percent(0.1, 0.0, 0.4)),
        restated=Stiction(S=percent(1.0, 0.8, 1.2), J=percent(0.3, 0.2, 0.5)),
        effects=(effect(), second_effect()),
        record_effects=(
            RecordEffect(
                slug="quantisation",
                sentence="MV is stored in steps of 0.06 %.",
                parameters={"step_percent": 0.06},
            ),
        ),
        not_testable=(
            Untestable(slug="travel_stop", reason="MV never came within 10 % of an end of travel."),
            Untestable(slug="flow_force", reason="OP covers 12 % of the travel; 40 % are needed."),
        ),
        heldout=HeldOutFit(
            rmse_naive=2.1,
            rmse_extended=0.6,
            rmse_ceiling=0.5,
            noise_floor=0.06,
            fit_naive=24.2,
            fit_extended=69.4,
            gain_low=38.0,
            gain_high=51.0,
        ),
        before=residual_map(1.6, hot=True),
        after=residual_map(0.4, hot=False),
        runs=runs,
        tried=(
            tried("asymmetric_rate_limit", 0.71, None, TriedOutcome.NAMED),
            tried("dead_time", 0.3, None, TriedOutcome.NAMED),
            tried("rate_limit", 0.2, 0.001, TriedOutcome.ADDS_NOTHING),
            tried("actuator_lag", 0.1, None, TriedOutcome.AS_GOOD),
            tried("stem_creep", -0.01, 0.0, TriedOutcome.CHANCE),
        ),
        together=Gain(mean=0.9, t=11.0),
        seconds=0.8,
    )


def of_every_kind(recording: Recording | None = None) -> list[Mismatch]:
    """One mismatch of each verdict."""
    selection = named(recording)
    candidates = replace(
        selection,
        finding=Finding.CANDIDATES,
        sentence="A dead time or an actuator lag: this recording cannot tell them apart.",
        effects=(second_effect(),),
        stroke_curve=StrokeCurve(op=(50.0, 75.0, 100.0), travel=(0.0, 52.0, 100.0)),
    )
    unknown = replace(
        selection,
        finding=Finding.UNKNOWN,
        sentence="Something systematic is left that nothing in the catalogue explains.",
        effects=(),
        restated=selection.naive,
    )
    none = replace(
        unknown,
        finding=Finding.NONE,
        sentence="S and J explain the recording.",
        before=replace(selection.before, hot=()),
        record_effects=(),
    )
    blind = Estimate.unknown("there is no position in the recording", unit="%")
    untestable = Mismatch(
        finding=Finding.NOT_TESTABLE,
        sentence="There is no position in the recording.",
        naive=Stiction(S=blind, J=blind),
        restated=Stiction(S=blind, J=blind),
    )
    return [selection, candidates, unknown, none, untestable]
