"""``explain``: where simulation and recording differ, what physics was left out, and what it gains.

record effects -> base (S, J, reading) -> terms, one by one -> the reading's own errors
               -> parameters with intervals -> fit before and after on unseen data -> words
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.acceptance.accepted_hypothesis import (
    DELAY,
    STRAIGHT_LINE,
    AcceptedHypothesis,
    accepted_hypothesis,
)
from stemwatch.models.mismatch.acceptance.held_out import HeldOutComparison
from stemwatch.models.mismatch.acceptance.last_checks import checked
from stemwatch.models.mismatch.acceptance.nothing_left_out import doubt, missed_breakaways
from stemwatch.models.mismatch.acceptance.rivals import left_open, on_site
from stemwatch.models.mismatch.acceptance_limits import (
    chance,
)
from stemwatch.models.mismatch.evidence.describe_effect import (
    in_order_of_work,
    residual_map,
    sentence_of,
)
from stemwatch.models.mismatch.findings import (
    Effect,
    Finding,
    Mismatch,
    RecordEffect,
    ResidualMap,
    Stiction,
    Untestable,
)
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_fit import (
    fit_naive,
    naive_evaluator,
    naive_layout,
)
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.evaluator import DRIVE, Evaluator
from stemwatch.models.mismatch.fit.uncertainty import draws
from stemwatch.models.mismatch.measurement.between_samples import (
    Archive,
    find_archive,
    stands_for_friction,
)
from stemwatch.models.mismatch.measurement.flow import as_position
from stemwatch.models.mismatch.measurement.record_effects import (
    MeasuredRecord,
    late_effect,
    measured_record,
    small_delay_effect,
    uneven_readings_effect,
    with_steps_resolved,
)
from stemwatch.models.mismatch.measurement.refreshes import AtRefreshes, at_refreshes
from stemwatch.models.mismatch.measurement.uneven_readings import (
    UnevenReadings,
    find_uneven_readings,
)
from stemwatch.models.mismatch.measurement.vibration import (
    find_vibration,
    vibration_effect,
    without_vibration,
)
from stemwatch.models.mismatch.prepared_recording import (
    PreparedRecording,
    prepare,
    problem_of,
    why_not,
)
from stemwatch.models.mismatch.refined_curve import refined
from stemwatch.models.mismatch.search.reading_errors import STICKS_AGAIN
from stemwatch.models.mismatch.search.tried_effects import scores_of, what_was_tried
from stemwatch.models.mismatch.stiction import (
    holding_no_jump,
    jump_within_a_step,
    of_balance,
    of_candidate,
    stiction,
)
from stemwatch.models.mismatch.term import ActsOn
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.mismatch.terms.dead_time import about_a_sample
from stemwatch.models.preparation.own_clock import duration, on_own_clock
from stemwatch.models.record_checks.frozen import without_frozen
from stemwatch.models.recording import PERCENT, Floats, Recording
from stemwatch.models.signals.percent import without_impossible_values
from stemwatch.models.stickslip.breakaways import LATE
from stemwatch.models.stickslip.clock_shift import brought_forward, find_op_late
from stemwatch.models.stickslip.find_stroke_curve import find_stroke_curve
from stemwatch.models.stickslip.force_balance import NOT_AS_A_WHOLE, moves_as_a_motor
from stemwatch.models.stickslip.op_within_steps import op_within_steps
from stemwatch.models.stickslip.problem import make_problem
from stemwatch.models.stickslip.stroke_curve import StrokeCurve, in_travel

# Curved errors over travel, the same both ways: of a curve from OP to stroke that was found in a
# recording they are one class with its own bends.
BENDS = ("bowed_linkage", "flow_force")
# Effects that delay the stem by an amount that grows with the speed of its command, as friction
# does.
LAGS = ("actuator_lag", "asymmetric_lag", "viscous_drag", "underdamped_positioner")
STOP = "travel_stop"
NOTHING_REFUSED: Mapping[str, str] = MappingProxyType({})


def explain(
    recording: Recording,
    *,
    ceiling: Floats | None = None,
    curve: StrokeCurve | None = None,
    late_s: float | None = None,
    look_within_steps: bool = True,
    look_for_curve: bool = True,
    restore: bool = True,
    archive: Archive | None = None,
    refused: Mapping[str, str] = NOTHING_REFUSED,
) -> Mismatch:
    """The mismatch of one recording; never raises for what the recording holds.

    ``ceiling`` (n,) is a network's free run of MV, NaN where it has none: the share of the
    residual that is systematic at all. ``curve`` is the curve from OP to stroke where it is known;
    else it is looked for here, unless ``look_for_curve`` says that there is none. ``late_s`` is how
    late OP was stored, in units of the own clock; it is looked for where it is ``None``.
    ``look_within_steps``: whether PV and set point may tell an OP that has coarse steps.
    ``restore``: whether S and J may be raised by what a slow archive lost of OP's peaks;
    ``archive`` is that archive where it is known, else it is looked for. ``refused`` are terms that
    are left out from the start, and why.
    """
    started, recording = time.perf_counter(), without_impossible_values(on_own_clock(recording))
    refreshes = at_refreshes(recording)
    if refreshes is not None:
        mismatch = _explained_at(
            refreshes, recording, ceiling, curve, look_for_curve=look_for_curve
        )
        return replace(mismatch, seconds=time.perf_counter() - started)
    # What the archive did to OP is seen in OP as it was recorded.
    measured = replace(measured_record(recording), restore=restore, archive=archive)
    # A frozen reading is no stem: neither curve nor clock is sought in it, and no fit runs through.
    recording = without_frozen(recording, measured.frozen)
    recording, measured = _stilled(recording, measured)
    if late_s is None:
        late_s = find_op_late(recording)
        if late_s and moves_as_a_motor(make_problem(recording)):
            late_s = 0.0
    if late_s:
        recording = brought_forward(recording, late_s)
        effects = (late_effect(late_s, recording.unit_s), *measured.effects)
        measured = replace(measured, effects=effects)
    resolved = op_within_steps(recording) if look_within_steps else None
    if resolved is not None:
        recording, measured = resolved.recording, with_steps_resolved(measured, resolved)
    if curve is None and look_for_curve:
        curve = refined(recording, find_stroke_curve(recording))
    if recording.mv is not None and recording.mv.unit != PERCENT:
        mismatch = _through_flow(recording)
    elif curve is not None:
        mismatch = _through_curve(recording, measured, ceiling, curve, refused)
        if mismatch.finding is Finding.UNKNOWN and not curve.given:
            mismatch = _or_short_of_it(recording, measured, ceiling, mismatch, refused)
    else:
        mismatch = _explained(recording, measured, ceiling, refused=refused)
    question = on_site(mismatch.open_question, recording, mismatch.stroke_curve)
    return replace(mismatch, open_question=question, seconds=time.perf_counter() - started)


def _explained_at(
    refreshes: AtRefreshes,
    recording: Recording,
    ceiling: Floats | None,
    curve: StrokeCurve | None,
    *,
    look_for_curve: bool,
) -> Mismatch:
    """The mismatch of a ``recording`` whose values change at its refreshes only, as that of these;
    clocks and archive are looked for in them.
    """
    mismatch = explain(
        refreshes.recording,
        ceiling=None if ceiling is None else refreshes.of(ceiling),
        curve=curve,
        look_for_curve=look_for_curve,
        refused=refreshes.refused,
    )
    held = [one for one in measured_record(recording).effects if one.slug == "sampling_jitter"]
    mismatch = replace(mismatch, record_effects=(*held, *mismatch.record_effects))
    return refreshes.spread(mismatch)


def _stilled(recording: Recording, measured: MeasuredRecord) -> tuple[Recording, MeasuredRecord]:
    """Recording and record effects without a vibration of the position's reading, which becomes one
    of these effects.
    """
    if measured.slack.any() or measured.spacing_s > recording.interval_s:
        return recording, measured
    vibration = find_vibration(recording, measured.real)
    if vibration is None:
        return recording, measured
    effects = (*measured.effects, vibration_effect(vibration, recording))
    return without_vibration(recording, vibration), replace(measured, effects=effects)


def _explained(
    recording: Recording,
    measured: MeasuredRecord,
    ceiling: Floats | None,
    *,
    own_reading: bool = True,
    refused: Mapping[str, str] = NOTHING_REFUSED,
    unsure_degree: int = 0,
) -> Mismatch:
    """The mismatch of a recording in percent of travel, or why it cannot be tested.

    ``own_reading``: MV is the stem's own reading, and no flow. ``refused`` are terms that are left
    out from the start, and why. ``unsure_degree`` is that of the curve through which OP was read.
    """
    reason = why_not(recording, measured)
    if reason is not None:
        return _not_testable(measured, reason)
    problem = replace(problem_of(recording, measured), unsure_degree=unsure_degree)
    case = prepare(recording, measured, ceiling, problem, own_reading=own_reading)
    if case.untold:
        return _not_testable(measured, case.untold)
    return _mismatch_of(replace(case, refused={**case.refused, **refused}))


def _through_curve(
    recording: Recording,
    measured: MeasuredRecord,
    ceiling: Floats | None,
    curve: StrokeCurve,
    refused: Mapping[str, str],
) -> Mismatch:
    """The mismatch of a recording whose OP is percent of travel only through ``curve``; S and J in
    percent of OP.
    """
    of_the_curve = "zero and span are part of the curve from OP to stroke"
    refused = {**refused, **dict.fromkeys(STRAIGHT_LINE, of_the_curve)}
    if not curve.given:
        refused |= dict.fromkeys(
            BENDS, "a bend is part of the curve that was found from OP to stroke"
        )
    degree, commanded = curve.unsure_degree, in_travel(recording, curve)
    mismatch = _explained(commanded, measured, ceiling, refused=refused, unsure_degree=degree)
    return replace(
        mismatch,
        sentence=f"{curve.sentence()} {mismatch.sentence}",
        naive=_in_op(mismatch.naive, curve),
        restated=_in_op(mismatch.restated, curve),
        stroke_curve=curve,
    )


def _or_short_of_it(
    recording: Recording,
    measured: MeasuredRecord,
    ceiling: Floats | None,
    through_curve: Mismatch,
    refused: Mapping[str, str],
) -> Mismatch:
    """The answer ``through_curve``; or that of the plain reading, where it names an effect that
    slows or stops the stem and follows the unseen part more closely: a stem that never arrives
    covers less than OP asks for, as one behind a curve does.
    """
    plain = _explained(recording, measured, ceiling, refused=refused)
    short = any(
        effect.slug == STOP or catalogue()[effect.slug].acts_on is ActsOn.COMMAND
        for effect in plain.effects
    )
    fit, fit_by_curve = plain.heldout.fit_extended, through_curve.heldout.fit_extended
    nearer = fit is not None and (fit_by_curve is None or fit > fit_by_curve)
    return plain if short and nearer else through_curve


def _in_op(stiction: Stiction, curve: StrokeCurve) -> Stiction:
    """S and J in percent of OP instead of travel."""
    return Stiction(S=curve.in_op(stiction.S), J=curve.in_op(stiction.J, is_jump=True))


def _through_flow(recording: Recording) -> Mismatch:
    """The mismatch of a recording whose MV is no position but, at best, the flow that it makes."""
    assert recording.mv is not None
    read_as_position = as_position(recording)
    if read_as_position is None:
        unit = recording.mv.unit or "an unknown unit"
        reason = (
            f"{recording.mv.tag} is in {unit}, not in percent of travel, and is no rising curve of "
            "where the stem would be: other things change it too. Record the position, or give "
            "its values at 0 % and 100 %"
        )
        return _not_testable(measured_record(recording), reason)
    position, curve = read_as_position
    mismatch = _explained(position, measured_record(position), None, own_reading=False)
    stands_for = (
        f"{recording.mv.tag} stands for the position, read through a characteristic that explains "
        f"{100.0 * curve.share:.1f} % of it."
    )
    runs = mismatch.runs
    if runs is not None and position.mv is not None:
        followed = np.where(position.mv.usable, position.mv.values, np.nan)
        runs = replace(runs, position=followed)
    return replace(mismatch, sentence=f"{stands_for} {mismatch.sentence}", runs=runs)


def _mismatch_of(case: PreparedRecording) -> Mismatch:
    """What the accepted hypothesis says of a recording, beside S and J alone."""
    hypothesis = checked(accepted_hypothesis(case))
    is_drive = case.balance is not None and case.balance.is_quick
    if is_drive and DRIVE not in hypothesis.layout.places:
        return _not_testable(case.measured, NOT_AS_A_WHOLE)
    evaluator, comparison = hypothesis.evaluator, hypothesis.comparison
    naive_only = naive_evaluator(evaluator)
    naive = conclude(
        naive_only, fit_naive(naive_only, np.ones(evaluator.problem.n_blocks, dtype=bool))
    )
    archive = _archive(case, evaluator, hypothesis.best)
    friction_alone, refitted = _stictions(case, hypothesis, naive_only, naive, archive)
    unsure = _why_unsure(hypothesis, (friction_alone, refitted), naive)
    effects, delays = _but_for_clocks(case, hypothesis)
    effects = in_order_of_work(effects)
    finding = _finding(effects, hypothesis.unexplained or bool(unsure))
    if not hypothesis.effects and (finding is Finding.UNKNOWN or not comparison.heldout.improves):
        comparison, refitted = comparison.of_naive_alone(), friction_alone
    before, after = _residual_maps(evaluator, comparison)
    too_small = [DELAY] if delays else []
    tried_effects, combined_gain = what_was_tried(hypothesis.named, effects, too_small)
    mismatch = Mismatch(
        finding=finding,
        sentence=_what_shakes(hypothesis)
        + sentence_of(
            finding, effects, case.refused, before, unsure, missed_breakaways(comparison)
        ),
        naive=friction_alone,
        restated=refitted,
        effects=effects,
        record_effects=(*case.measured.effects, *delays),
        not_testable=tuple(Untestable(slug=s, reason=r) for s, r in case.refused.items()),
        heldout=comparison.heldout,
        before=before,
        after=after,
        runs=comparison.runs,
        tried=tried_effects,
        together=combined_gain,
        p_value=chance(max(effect.evidence.strength for effect in effects)) if effects else None,
        open_question=left_open(
            evaluator, hypothesis.named, [effect.slug for effect in hypothesis.effects]
        ),
        scores=scores_of(hypothesis.named, hypothesis.effects),
    )
    return mismatch if archive is None else _restored(mismatch, archive, evaluator)


def _residual_maps(
    evaluator: Evaluator, comparison: HeldOutComparison
) -> tuple[ResidualMap, ResidualMap]:
    """The residual of S and J alone and of the better model, in the same cells: place, direction
    and rests are those of the better model's stem.
    """
    naive, better = comparison.runs.naive, comparison.runs.extended
    noise = comparison.heldout.noise_floor
    before = residual_map(evaluator, naive, better, noise)
    return before, residual_map(evaluator, better, better, noise)


def _why_unsure(
    hypothesis: AcceptedHypothesis, both_stictions: tuple[Stiction, Stiction], naive: Floats
) -> str:
    """Why it cannot be said that nothing is left out, a clause; empty where it can, or where
    effects were accepted.
    """
    if hypothesis.effects or hypothesis.shaking is not None:
        return ""
    return hypothesis.dropped_because or doubt(
        hypothesis.evaluator,
        hypothesis.fitted,
        hypothesis.best,
        hypothesis.comparison,
        both_stictions,
        naive,
    )


def _what_shakes(hypothesis: AcceptedHypothesis) -> str:
    """A sentence, with a blank after it, on the swing that shakes the stem; empty where none
    does."""
    shaking, problem = hypothesis.shaking, hypothesis.evaluator.problem
    if shaking is None:
        return ""
    period = duration(shaking.period * problem.interval_s, problem.unit_s, ".3g")
    return (
        f"The stem lets go in time with a swing of {period} that OP does not have: something "
        "outside shakes it, as a pump, a pulsating flow or unsteady supply air does. "
    )


def _but_for_clocks(
    case: PreparedRecording, hypothesis: AcceptedHypothesis
) -> tuple[tuple[Effect, ...], tuple[RecordEffect, ...]]:
    """What is named as physics, and a delay that is not: as long as a sound loop's own, a dead time
    cannot be told from clocks of the two tags that differ, and no more can what readings of uneven
    age are late by on the average.
    """
    evaluator, effects = hypothesis.evaluator, hypothesis.effects
    delay = next((effect for effect in effects if DELAY in effect.members), None)
    if delay is None:
        return effects, ()
    others = tuple(effect for effect in effects if effect is not delay)
    unit_s, delay_s = evaluator.problem.unit_s, _as_dead_time(hypothesis, delay)
    again = any(effect.slug in STICKS_AGAIN for effect in others)
    # The small slips of a stem that sticks again come early or late by chance, as such readings do.
    uneven = None if again else _uneven_readings(case, hypothesis)
    if uneven is not None:
        age_s = uneven.half_width * evaluator.problem.interval_s
        if about_a_sample(delay_s - age_s, evaluator.summary):
            return others, (uneven_readings_effect(age_s, unit_s),)
    if delay.members == (DELAY,) and about_a_sample(delay_s, evaluator.summary):
        return others, (small_delay_effect(delay_s, unit_s),)
    return effects, ()


def _as_dead_time(hypothesis: AcceptedHypothesis, delay: Effect) -> float:
    """How late the command is by an effect that is a dead time, or cannot be told from one; for
    ever where that is not known.
    """
    if delay.slug == DELAY:
        return (delay.parameters["theta"].value or 0.0) / hypothesis.evaluator.problem.unit_s
    stages = [one.stage for one in hypothesis.named.needed if one.term.slug == delay.slug]
    fits = [score.fitted for stage in stages for score in stage.accepted if score.slug == DELAY]
    return float(fits[0].values(DELAY)[:, 0].mean()) if fits else np.inf


def _uneven_readings(
    case: PreparedRecording, hypothesis: AcceptedHypothesis
) -> UnevenReadings | None:
    """The uneven ages of the position's readings, if it has such; averages mix them anyhow."""
    evaluator, problem = hypothesis.evaluator, hypothesis.evaluator.problem
    if case.measured.spacing_s > problem.interval_s:
        return None
    run, _ = evaluator.assimilated(hypothesis.layout, hypothesis.best)
    return find_uneven_readings(run, problem.mv, evaluator.measured, problem.sigma)


def _restored(mismatch: Mismatch, archive: Archive, evaluator: Evaluator) -> Mismatch:
    """The mismatch with S and J raised by what a slow archive lost of OP's peaks."""
    restated, naive = mismatch.restated, mismatch.naive
    in_place = stands_for_friction(restated.S, naive.S)
    if mismatch.finding is Finding.UNKNOWN or (in_place and archive.deviation <= 0.0):
        return mismatch
    # A distance between command and stem that a slow actuator causes was not lost between samples.
    slow = any(catalogue()[effect.slug].acts_on is ActsOn.COMMAND for effect in mismatch.effects)
    if mismatch.runs is None or (slow and archive.deviation <= 0.0):
        return mismatch
    missed = archive.missed_by(evaluator.problem, mismatch.runs.extended)
    S, J = archive.restored(restated.S, restated.J, missed)
    return replace(
        mismatch,
        restated=Stiction(S=S, J=J),
        record_effects=(*mismatch.record_effects, archive.as_effect(missed)),
    )


def _archive(case: PreparedRecording, evaluator: Evaluator, best: Floats) -> Archive | None:
    """The slow archive that S and J are restored from, if any."""
    if not case.measured.restore or case.measured.archive is not None:
        return case.measured.archive
    archive = find_archive(case.recording)
    if archive is None:
        return None
    gain, zero = 1.0 + float(best[base_coordinate.GAIN]), float(best[base_coordinate.ZERO])
    return archive.with_slips(evaluator.problem, gain, zero)


def _delay_s(hypothesis: AcceptedHypothesis) -> float:
    """The dead time that was named, less what stems usually are late by; 0 where none was."""
    coordinate_slice = hypothesis.layout.places.get(DELAY)
    if coordinate_slice is None or all(effect.slug != DELAY for effect in hypothesis.effects):
        return 0.0
    usual_s = LATE[0] * hypothesis.evaluator.problem.interval_s
    return max(float(hypothesis.best[coordinate_slice][0]) - usual_s, 0.0)


def _stictions(
    case: PreparedRecording,
    hypothesis: AcceptedHypothesis,
    naive_only: Evaluator,
    naive: Floats,
    archive: Archive | None,
) -> tuple[Stiction, Stiction]:
    """S and J of friction ``naive`` alone and of the hypothesis, each with its intervals."""
    evaluator, effects = hypothesis.evaluator, hypothesis.effects
    # Where no named effect moves the levels, and every sample was kept, the breakaways give the
    # best S and J: a drift of the reading shifts both directions and not their mean.
    can_be_restated = (
        not hypothesis.unexplained and not hypothesis.dropped_because and archive is None
    )
    can_be_restated = can_be_restated and all(
        effect.slug in (*STRAIGHT_LINE, DELAY) for effect in effects
    )
    fitted = (hypothesis.best,) if effects else (naive, hypothesis.best)
    elements = fitted if can_be_restated else ()
    simple = naive_layout(naive_only)
    friction_alone = stiction(
        naive_only, lambda: draws(naive_only, simple, naive), naive, () if effects else elements
    )
    refitted = stiction(
        evaluator,
        hypothesis.drawn,
        hypothesis.best,
        elements,
        _delay_s(hypothesis),
        with_lag=any(effect.slug in LAGS for effect in effects),
    )
    if case.balance is not None and DRIVE in hypothesis.layout.places:
        refitted = of_balance(case.balance, refitted)
    if effects and (not elements or jump_within_a_step(evaluator.problem, refitted)):
        refitted = holding_no_jump(evaluator, hypothesis.fitted, refitted)
    for S, J in of_rivals(hypothesis):
        # The rivals cannot be separated, so the intervals must hold the S and J of each of them.
        refitted = Stiction(S=refitted.S.holding(S), J=refitted.J.holding(J))
    return friction_alone, refitted


def of_rivals(hypothesis: AcceptedHypothesis) -> Iterator[tuple[Estimate, Estimate]]:
    """S and J of the models that the recording cannot separate from the last effect found."""
    if not hypothesis.named.needed or not hypothesis.effects:
        return
    for rival in hypothesis.named.needed[-1].stage.accepted[1:]:
        middle = rival.fitted.candidates.mean(axis=0)
        yield of_candidate(middle)


def _finding(effects: tuple[Effect, ...], unexplained: bool) -> Finding:
    """``unexplained``: without effects it cannot be said that nothing is left out."""
    if not effects:
        return Finding.UNKNOWN if unexplained else Finding.NONE
    single = all(len(effect.members) == 1 for effect in effects)
    return Finding.NAMED if single else Finding.CANDIDATES


def _not_testable(measured: MeasuredRecord, reason: str) -> Mismatch:
    return Mismatch.unknown(
        f"Nothing can be said: {reason}.",
        reason,
        record_effects=measured.effects,
        not_testable=tuple(Untestable(slug=slug, reason=reason) for slug in catalogue()),
    )
