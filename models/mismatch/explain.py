"""``explain``: where simulation and recording differ, what physics was left out, and what it gains.

record effects -> base (S, J, reading) -> terms, one by one -> the reading's own errors
               -> parameters with intervals -> fit before and after on unseen data -> words
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from stemwatch.models.mismatch.acceptance.effects_that_stand import STRAIGHT_LINE
from stemwatch.models.mismatch.acceptance.rivals import on_site
from stemwatch.models.mismatch.answer import answer_of, not_testable
from stemwatch.models.mismatch.findings import Finding, Mismatch, Stiction
from stemwatch.models.mismatch.measurement.between_samples import Archive
from stemwatch.models.mismatch.measurement.flow import as_position
from stemwatch.models.mismatch.measurement.record_effects import (
    MeasuredRecord,
    late_effect,
    measured_record,
    with_steps_resolved,
)
from stemwatch.models.mismatch.measurement.refreshes import AtRefreshes, at_refreshes
from stemwatch.models.mismatch.measurement.vibration import (
    find_vibration,
    vibration_effect,
    without_vibration,
)
from stemwatch.models.mismatch.prepared_recording import prepare, problem_of, why_not
from stemwatch.models.mismatch.refined_curve import refined
from stemwatch.models.mismatch.term import ActsOn
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.record_checks.frozen import without_frozen
from stemwatch.models.recording import PERCENT, Floats, Recording
from stemwatch.models.signals.percent import without_impossible_values
from stemwatch.models.stickslip.clock_shift import brought_forward, find_op_late
from stemwatch.models.stickslip.find_stroke_curve import find_stroke_curve
from stemwatch.models.stickslip.force_balance import moves_as_a_motor
from stemwatch.models.stickslip.op_within_steps import op_within_steps
from stemwatch.models.stickslip.problem import make_problem
from stemwatch.models.stickslip.stroke_curve import StrokeCurve, in_travel

# Curved errors over travel, the same both ways: of a curve from OP to stroke that was found in a
# recording they are one class with its own bends.
BENDS = ("bowed_linkage", "flow_force")
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
        return not_testable(measured, reason)
    problem = replace(problem_of(recording, measured), unsure_degree=unsure_degree)
    case = prepare(recording, measured, ceiling, problem, own_reading=own_reading)
    if case.untold:
        return not_testable(measured, case.untold)
    return answer_of(replace(case, refused={**case.refused, **refused}))


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
    return replace(stiction, S=curve.in_op(stiction.S), J=curve.in_op(stiction.J, is_jump=True))


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
        return not_testable(measured_record(recording), reason)
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
