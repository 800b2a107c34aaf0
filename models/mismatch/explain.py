"""``explain``: where simulation and recording differ, what physics was left out, and what it gains.

record effects -> base (S, J, reading) -> terms, one by one -> the reading's own errors
               -> parameters with intervals -> fit before and after on unseen data -> words
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.forensics import quiet_sigma
from stemwatch.models.mismatch import evaluator as base_coordinate
from stemwatch.models.mismatch.acceptance_limits import (
    MEAN_OF_A_LINE,
    MEAN_WHERE_MUCH_IS_LEFT,
    chance,
    convincing,
    much_left,
    not_little_left,
)
from stemwatch.models.mismatch.base_fit import (
    BaseFit,
    fit_base,
    fit_naive,
    naive_evaluator,
    naive_layout,
)
from stemwatch.models.mismatch.batched_search import conclude
from stemwatch.models.mismatch.between_samples import Archive, find_archive, stands_for_friction
from stemwatch.models.mismatch.crossfit import CAREFUL, Fitted, curvature, search
from stemwatch.models.mismatch.describe_effect import (
    Directions,
    by_events,
    directions,
    effect,
    residual_map,
    sentence_of,
)
from stemwatch.models.mismatch.drive import NOT_RESOLVED, name_drive, starts_of_first_part
from stemwatch.models.mismatch.drive import TERMS as OF_A_DRIVE
from stemwatch.models.mismatch.evaluator import DRIVE, CoordinateLayout, Evaluator
from stemwatch.models.mismatch.findings import (
    Effect,
    Finding,
    HeldOutFit,
    Mismatch,
    RecordEffect,
    Stiction,
    Untestable,
)
from stemwatch.models.mismatch.flow import as_position
from stemwatch.models.mismatch.force_balance import ForceBalance, force_balance
from stemwatch.models.mismatch.held_out import HeldOutComparison, show
from stemwatch.models.mismatch.identifiability import NO_POSITION, audit
from stemwatch.models.mismatch.nothing_left_out import doubt
from stemwatch.models.mismatch.reading import COORDINATES, Off, findings, values_of, without
from stemwatch.models.mismatch.record_effects import (
    RecordSettled,
    late_effect,
    settle,
    with_op_told,
)
from stemwatch.models.mismatch.rivals import left_open, on_site
from stemwatch.models.mismatch.stiction import of_balance, stiction
from stemwatch.models.mismatch.term import Look, Term, Way
from stemwatch.models.mismatch.term_selection import Named, Needed, TermScore, lacking, name
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.mismatch.tried_effects import scores_of, what_was_tried
from stemwatch.models.mismatch.uncertainty import draws
from stemwatch.models.own_clock import on_own_clock
from stemwatch.models.percent import without_impossible_values
from stemwatch.models.recording import PERCENT, Floats, Recording
from stemwatch.models.stickslip.breakaways import LATE
from stemwatch.models.stickslip.clock_shift import brought_forward, find_op_late
from stemwatch.models.stickslip.find_stroke_curve import find_stroke_curve
from stemwatch.models.stickslip.op_within_steps import op_within_steps
from stemwatch.models.stickslip.problem import FitProblem, make_problem
from stemwatch.models.stickslip.stroke_curve import StrokeCurve, in_travel

FEWEST_SAMPLES = 60
WORSE = 1.15
# Percent, on unseen data: below it a screening says that S and J describe nothing (``Limits``), and
# so it is with what is named. A force recorded as command leaves 35; of 20 simulated valves of
# development on which something was named none leaves less than 76.
LEAST_FIT_OF_NAMED, NEAR_NOISE = 40.0, 2.0
LEAST_SHARE = 0.09  # of the held-out loss that an effect must remove to matter
STRAIGHT_LINE, DELAY = ("zero_shift", "span_error"), "dead_time"
NOTHING_REFUSED: Mapping[str, str] = MappingProxyType({})
BEND = "bend"  # is not in the catalogue; its limits are those of a term
MOST_S = 10.0  # percent; a base that is led astray must not decide what was exercised
READING = ("zero_shift", "span_error", "sensor_drift")
LEAST_SIGMA = 1e-3  # percent
DOOR_NOISE = 0.17  # of the archive's deviation
# Cross-fitting needs blocks; of a short record they are shorter.
FEWEST_BLOCKS, LEAST_BLOCK_SAMPLES = 16, 40
MUCH_NEARER = 0.7  # of the error of S and J alone


@dataclass(frozen=True)
class _Case:
    """One recording, and what the steps of ``explain`` have settled of it so far."""

    recording: Recording
    settled: RecordSettled
    base: BaseFit
    refused: Mapping[str, str]
    ceiling: Floats | None
    own_reading: bool
    balance: ForceBalance | None  # of a drive whose motion the samples resolve


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
) -> Mismatch:
    """All that is known of the mismatch of one recording; never raises for what it holds.

    ``ceiling`` (n,) is a network's free run of MV, NaN where it has none: the share of the
    residual that is systematic at all. ``curve`` is the curve from OP to stroke where it is known;
    else it is looked for here, unless ``look_for_curve`` says that there is none. ``late_s`` is how
    late OP was stored, in units of the own clock; it is looked for where it is ``None``.
    ``look_within_steps``: whether PV and set point may tell an OP that has coarse steps.
    ``restore``: whether S and J may be raised by what a slow archive lost of OP's peaks;
    ``archive`` is that archive where it is known, else it is looked for.
    """
    began, recording = time.perf_counter(), without_impossible_values(on_own_clock(recording))
    # What the archive did to OP is seen in OP as it was recorded.
    settled = replace(settle(recording), restore=restore, archive=archive)
    late_s = find_op_late(recording) if late_s is None else late_s
    if late_s:
        recording = brought_forward(recording, late_s)
        effects = (late_effect(late_s, recording.unit_s), *settled.effects)
        settled = replace(settled, effects=effects)
    told = op_within_steps(recording) if look_within_steps else None
    if told is not None:
        recording, settled = told.recording, with_op_told(settled, told)
    if curve is None and look_for_curve:
        curve = find_stroke_curve(recording)
    if recording.mv is not None and recording.mv.unit != PERCENT:
        mismatch = _through_flow(recording)
    elif curve is not None:
        mismatch = _through_curve(recording, settled, ceiling, curve)
    else:
        mismatch = _explained(recording, settled, ceiling)
    left = on_site(mismatch.open_question, recording, mismatch.stroke_curve)
    return replace(mismatch, open_question=left, seconds=time.perf_counter() - began)


def _explained(
    recording: Recording,
    settled: RecordSettled,
    ceiling: Floats | None,
    *,
    own_reading: bool = True,
    refused: Mapping[str, str] = NOTHING_REFUSED,
    unsure_degree: int = 0,
) -> Mismatch:
    """``refused`` are terms that are left out from the start, and why."""
    reason = _cannot(recording, settled)
    if reason is not None:
        return _not_testable(settled, reason)
    problem = replace(problem_of(recording, settled), unsure_degree=unsure_degree)
    case = _fitted(recording, settled, ceiling, problem, own_reading=own_reading)
    return _told(replace(case, refused={**case.refused, **refused}))


def _through_curve(
    recording: Recording, settled: RecordSettled, ceiling: Floats | None, curve: StrokeCurve
) -> Mismatch:
    """A recording whose command is percent of travel only after a curve; S and J in percent of
    OP."""
    refused = dict.fromkeys(STRAIGHT_LINE, "zero and span are part of the curve from OP to stroke")
    degree, commanded = curve.unsure_degree, in_travel(recording, curve)
    mismatch = _explained(commanded, settled, ceiling, refused=refused, unsure_degree=degree)
    return replace(
        mismatch,
        sentence=f"{curve.sentence()} {mismatch.sentence}",
        naive=_in_op(mismatch.naive, curve),
        restated=_in_op(mismatch.restated, curve),
        stroke_curve=curve,
    )


def _in_op(stiction: Stiction, curve: StrokeCurve) -> Stiction:
    return Stiction(S=curve.in_op(stiction.S), J=curve.in_op(stiction.J, is_jump=True))


def _through_flow(recording: Recording) -> Mismatch:
    """A recording whose MV is no position but, at best, the flow that the stem makes."""
    assert recording.mv is not None
    read = as_position(recording)
    if read is None:
        unit = recording.mv.unit or "an unknown unit"
        reason = (
            f"{recording.mv.tag} is in {unit}, not in percent of travel, and is no rising curve of "
            "where the stem would be: other things change it too. Record the position, or give "
            "its values at 0 % and 100 %"
        )
        return _not_testable(settle(recording), reason)
    position, curve = read
    mismatch = _explained(position, settle(position), None, own_reading=False)
    told = (
        f"{recording.mv.tag} stands for the position, read through a characteristic that explains "
        f"{100.0 * curve.share:.1f} % of it."
    )
    return replace(mismatch, sentence=f"{told} {mismatch.sentence}")


def _cannot(recording: Recording, settled: RecordSettled) -> str | None:
    """Why nothing can be said of this recording, or ``None``."""
    if recording.mv is None:
        return NO_POSITION
    if np.count_nonzero(settled.real & recording.usable) < FEWEST_SAMPLES:
        return f"fewer than {FEWEST_SAMPLES} samples of the position were really measured"
    real = recording.mv.values[settled.real & recording.usable]
    if float(np.ptp(real)) == 0.0:
        return "the position does not change by one digit"
    if float(np.ptp(recording.op.values[recording.op.usable])) == 0.0:
        return "OP never moves"
    return None


def problem_of(recording: Recording, settled: RecordSettled) -> FitProblem:
    """The fitting problem, scored on samples that were measured, or drawn near what was."""
    problem = make_problem(recording)
    n = problem.op.size
    n_blocks = max(problem.n_blocks, min(FEWEST_BLOCKS, n // LEAST_BLOCK_SAMPLES))
    told = settled.real | (settled.slack > 0.0)
    block = np.where(problem.scored & told, np.arange(n) * n_blocks // n, -1)
    sigma = max(_noise(recording, settled), settled.sigma_floor, LEAST_SIGMA)
    return replace(
        problem,
        block=block.astype(np.int64),
        n_blocks=n_blocks,
        sigma=sigma,
        op_open=settled.op_open,
    )


def _noise(recording: Recording, settled: RecordSettled) -> float:
    """Noise of MV, percent; stored knots are where the signal bends and tell nothing of it."""
    if settled.slack.any():
        return DOOR_NOISE * float(settled.slack.max())
    return quiet_sigma(_measured(recording, settled))


def _measured(recording: Recording, settled: RecordSettled) -> Floats:
    """(n,) MV where it was really measured, else NaN."""
    assert recording.mv is not None
    return np.where(recording.usable & settled.real, recording.mv.values, np.nan)


def look_of(problem: FitProblem) -> Look:
    """What terms may know of the recording."""
    op, mv = problem.op, problem.mv[problem.scored]
    op_low, op_high = np.percentile(op, (1.0, 99.0))
    mv_low, mv_high = np.percentile(mv, (1.0, 99.0))
    return Look(
        interval_s=problem.interval_s,
        duration_s=problem.op.size * problem.interval_s,
        op_low=float(op_low),
        op_high=float(op_high),
        mv_low=float(mv_low),
        mv_high=float(mv_high),
        sigma=problem.sigma,
        S=0.0,
        J=0.0,
    )


def _fitted(
    recording: Recording,
    settled: RecordSettled,
    ceiling: Floats | None,
    problem: FitProblem,
    *,
    own_reading: bool = True,
) -> _Case:
    base = fit_base(problem, look_of(problem), settled.slack, own_reading=own_reading)
    candidate = base.fitted.candidates.mean(axis=0)
    simulated = base.evaluator.simulate(base.fitted.layout, candidate)
    look = base.evaluator.look
    refused = audit(
        problem.op,
        problem.mv,
        simulated,
        problem.scored,
        problem.interval_s,
        problem.sigma,
        min(look.S, MOST_S),
        min(look.J, MOST_S),
        settled.spacing_s,
        problem.unit_s,
    )
    if not own_reading:
        refused |= dict.fromkeys(READING, "zero and span are those of the flow's characteristic")
    balance = force_balance(problem) if own_reading else None
    if balance is None:
        refused |= dict.fromkeys(OF_A_DRIVE, NOT_RESOLVED)
    return _Case(recording, settled, base, refused, ceiling, own_reading, balance)


def admissible(refused: Mapping[str, str]) -> dict[str, Term]:
    """The terms that the recording could have shown."""
    return {slug: term for slug, term in catalogue().items() if slug not in refused}


@dataclass(frozen=True)
class _Hypothesis:
    """A hypothesis fitted to the whole record: everything in it was accepted.

    ``worse`` says that something else was not, because unseen samples were predicted worse with it.
    """

    evaluator: Evaluator
    layout: CoordinateLayout
    fitted: Fitted
    best: Floats
    drawn: Callable[[], Floats]
    effects: tuple[Effect, ...]
    open_end: bool
    shown: HeldOutComparison
    named: Named
    worse: str = ""


def _named(case: _Case, terms: Mapping[str, Term]) -> Named:
    """What the recording needs: as a drive whose motion it resolves, or else term by term."""
    drive = name_drive(case.base, case.balance, terms) if case.balance is not None else None
    if drive is not None:
        return drive
    one_by_one = (slug for slug in terms if slug not in OF_A_DRIVE)
    return name(
        case.base, [terms[slug] for slug in one_by_one if terms[slug].way is not Way.READING]
    )


def _told(case: _Case) -> Mismatch:
    reached = _following(_accepted(case))
    evaluator, shown, effects = reached.evaluator, reached.shown, reached.effects
    plain = naive_evaluator(evaluator)
    simple = naive_layout(plain)
    naive = conclude(plain, fit_naive(plain, np.ones(evaluator.problem.n_blocks, dtype=bool)))
    archive = _archive(case, evaluator, reached.best)
    # With nothing left out that moves the levels, and every sample kept, the breakaways tell S and
    # J best: a line through the reading moves the two directions apart and not their mean.
    told = not reached.open_end and not reached.worse and archive is None
    told = told and all(effect.slug in (*STRAIGHT_LINE, DELAY) for effect in effects)
    fitted = (reached.best,) if effects else (naive, reached.best)
    elements = fitted if told else ()
    alone = stiction(plain, lambda: draws(plain, simple, naive), naive, () if effects else elements)
    refitted = stiction(evaluator, reached.drawn, reached.best, elements, _delay_s(reached))
    if case.balance is not None and DRIVE in reached.layout.places:
        refitted = of_balance(case.balance, refitted)
    why = reached.worse
    if not effects and not why:
        why = doubt(evaluator, reached.fitted, reached.best, shown, (alone, refitted), naive)
    unsure = "" if effects else why
    finding = _finding(effects, reached.open_end or bool(unsure))
    if not effects and (finding is Finding.UNKNOWN or not shown.heldout.improves):
        shown, refitted = shown.of_naive_alone(), alone
    # The same samples make the same cell of both maps: where the better of the models says that the
    # stem is, which way it goes and when it rests.
    nearest = shown.runs.extended
    noise = shown.heldout.noise_floor
    before = residual_map(evaluator, shown.runs.naive, nearest, noise)
    after = residual_map(evaluator, nearest, nearest, noise)
    tried, together = what_was_tried(reached.named, effects)
    mismatch = Mismatch(
        finding=finding,
        sentence=sentence_of(finding, effects, case.refused, before, unsure),
        naive=alone,
        restated=refitted,
        effects=effects,
        record_effects=case.settled.effects,
        not_testable=tuple(Untestable(slug=s, reason=r) for s, r in case.refused.items()),
        heldout=shown.heldout,
        before=before,
        after=after,
        runs=shown.runs,
        tried=tried,
        together=together,
        p_value=chance(max(effect.evidence.strength for effect in effects)) if effects else None,
        open_question=left_open(evaluator, reached.named, [effect.slug for effect in effects]),
        scores=scores_of(reached.named, effects),
    )
    return mismatch if archive is None else _restored(mismatch, archive, evaluator)


def _restored(mismatch: Mismatch, archive: Archive, evaluator: Evaluator) -> Mismatch:
    """With what a slow archive lost of OP's peaks given back to S and J."""
    restated = mismatch.restated
    if mismatch.finding is Finding.UNKNOWN or stands_for_friction(restated.S, mismatch.naive.S):
        return mismatch
    # What a slow actuator keeps between command and stem was not lost between two samples.
    slow = any(catalogue()[effect.slug].way is Way.COMMAND for effect in mismatch.effects)
    if mismatch.runs is None or (slow and archive.deviation <= 0.0):
        return mismatch
    missed = archive.missed_by(evaluator.problem, mismatch.runs.extended)
    S, J = archive.restored(restated.S, restated.J, missed)
    return replace(
        mismatch,
        restated=Stiction(S=S, J=J),
        record_effects=(*mismatch.record_effects, archive.as_effect(missed)),
    )


def _accepted(case: _Case) -> _Hypothesis:
    """The hypothesis that is published: what does not stand is taken out, and the rest refitted.

    What is named must also predict, in a free run, the part of the record that was not fitted at
    least as well as S and J alone do; else the weakest of it goes, until it does.
    """
    terms = admissible(case.refused)
    named = _named(case, terms)
    pinned: set[str] = set()
    worse = ""
    while True:
        reached, proposed = _whole_record(case, named, terms, pinned)
        stand = {effect.slug for effect in reached.effects}
        if stand and not reached.shown.heldout.improves:
            worse = worse or _worse(reached)
            stand.remove(reached.effects[-1].slug)
            if DRIVE in reached.layout.places:
                # Motor and load are one model: what a valve needs is looked for instead.
                case = replace(case, balance=None)
                terms = {slug: term for slug, term in terms.items() if slug not in OF_A_DRIVE}
                named = _named(case, terms)
                continue
        elif DRIVE in reached.layout.places:
            return reached
        gone = proposed - stand
        if not gone:
            return replace(reached, worse=worse)
        pinned |= gone & set(STRAIGHT_LINE)
        terms = {slug: term for slug, term in terms.items() if slug not in gone}
        named = lacking(named, gone)


def _whole_record(
    case: _Case, named: Named, terms: dict[str, Term], pinned: set[str]
) -> tuple[_Hypothesis, set[str]]:
    """The hypothesis ``named`` on the whole record, and the slugs of all that it holds: terms that
    were needed, and the reading's errors. ``pinned`` are errors of the reading that it must not
    have."""
    evaluator = named.evaluator
    off, fitted = findings(evaluator, named.fitted, terms)
    for slug in pinned:
        fitted = without(evaluator, fitted, *COORDINATES[slug])
    layout, best = _whole(evaluator, fitted)
    # Half of the draws are never asked for, and each costs as much as a search.
    drawn = cache(lambda: draws(evaluator, layout, best))
    wanted = drawn() if named.needed or off else np.empty((0, layout.size))
    candidates = _effects(case.recording, named, off, layout, best, wanted)
    large = tuple(candidate for candidate in candidates if _matters(candidate))
    of_drive = starts_of_first_part(evaluator, layout)
    in_turn = (
        layout.hypothesis.terms
        if DRIVE in layout.places
        else [score.term for score in named.needed]
    )
    shown = show(evaluator, layout, in_turn, case.ceiling, of_drive)
    effects, open_end = _standing(case, evaluator, fitted, large, shown.heldout)
    proposed = {candidate.slug for candidate in candidates}
    reached = _Hypothesis(evaluator, layout, fitted, best, drawn, effects, open_end, shown, named)
    return reached, proposed


def _following(reached: _Hypothesis) -> _Hypothesis:
    """The hypothesis, without its effects where a free run of it does not follow the part that was
    not fitted: as little as S and J alone then do they describe what moved the stem."""
    held = reached.shown.heldout
    if not reached.effects or held.fit_extended is None or held.rmse_extended is None:
        return reached
    # A stem that hardly moves in its noise is followed as well as can be.
    noise = NEAR_NOISE * (held.noise_floor or 0.0)
    if held.fit_extended >= LEAST_FIT_OF_NAMED or held.rmse_extended <= noise:
        return reached
    return replace(reached, effects=(), worse=_parts_only(reached, "not followed with it either"))


def _worse(reached: _Hypothesis) -> str:
    """That unseen samples are predicted worse with what was named."""
    return _parts_only(reached, "predicted worse with it")


def _parts_only(reached: _Hypothesis, what: str) -> str:
    words = " and ".join(effect.slug.replace("_", " ") for effect in reached.effects)
    heldout = reached.shown.heldout
    fit = ""
    if heldout.fit_naive is not None and heldout.fit_extended is not None:
        fit = f" (fit {heldout.fit_naive:.0f} % without, {heldout.fit_extended:.0f} % with it)"
    return (
        f"{words.capitalize()} would explain parts of this recording, but its last part, which was "
        f"not fitted, is {what}{fit}"
    )


def _archive(case: _Case, evaluator: Evaluator, best: Floats) -> Archive | None:
    """The slow archive that S and J are restored from, if any."""
    if not case.settled.restore or case.settled.archive is not None:
        return case.settled.archive
    archive = find_archive(case.recording)
    if archive is None:
        return None
    gain, zero = 1.0 + float(best[base_coordinate.GAIN]), float(best[base_coordinate.ZERO])
    return archive.with_slips(evaluator.problem, gain, zero)


def _standing(
    case: _Case,
    evaluator: Evaluator,
    fitted: Fitted,
    effects: tuple[Effect, ...],
    heldout: HeldOutFit,
) -> tuple[tuple[Effect, ...], bool]:
    """The effects that stand although something is left, and whether it must be said to be unknown.

    Where much is left, an effect must explain a good part of it; a straight line through the
    reading must do so nearly alone, predict the rest of the record, and leave no bend.
    """
    # An archive that drew lines, or a flow, leaves no noise to compare with.
    noise_known = case.own_reading and not _compressed(case.settled)
    open_end = noise_known and not_little_left(evaluator, fitted)
    if noise_known and much_left(evaluator, fitted):
        nearer = _much_nearer(heldout)
        effects = tuple(
            effect
            for effect in effects
            if effect.evidence.mean >= _least_mean(effect) or (nearer and _of_air(effect))
        )
    lines = [effect for effect in effects if effect.slug in STRAIGHT_LINE]
    if lines and (
        _refuted(heldout) or convincing(curvature(evaluator, fitted), evaluator.told, BEND)
    ):
        effects = tuple(effect for effect in effects if effect.slug not in STRAIGHT_LINE)
        open_end = open_end or not effects
    return effects, open_end


def _much_nearer(heldout: HeldOutFit) -> bool:
    """True where the free run on unseen samples loses a good part of its error, beyond chance."""
    if heldout.rmse_naive is None or heldout.rmse_extended is None or heldout.gain_low is None:
        return False
    return heldout.rmse_extended <= MUCH_NEARER * heldout.rmse_naive and heldout.gain_low > 0.0


def _of_air(effect: Effect) -> bool:
    """True for what shapes the command: friction or a force that wanders is not like it."""
    return catalogue()[effect.slug].way is Way.COMMAND


def _least_mean(effect: Effect) -> float:
    return MEAN_OF_A_LINE if effect.slug in STRAIGHT_LINE else MEAN_WHERE_MUCH_IS_LEFT


def _whole(evaluator: Evaluator, fitted: Fitted) -> tuple[CoordinateLayout, Floats]:
    """The hypothesis fitted to the whole record, from the fits to both folds."""
    everything = np.ones(evaluator.problem.n_blocks, dtype=bool)
    starts = np.vstack((fitted.candidates, fitted.candidates.mean(axis=0)))
    best = conclude(evaluator, search(evaluator, fitted.layout, everything, starts, CAREFUL))
    return fitted.layout, best.candidate


def _delay_s(reached: _Hypothesis) -> float:
    """The dead time that was named, less what stems usually are late by; 0 where none was."""
    place = reached.layout.places.get(DELAY)
    if place is None or all(effect.slug != DELAY for effect in reached.effects):
        return 0.0
    usual_s = LATE[0] * reached.evaluator.problem.interval_s
    return max(float(reached.best[place][0]) - usual_s, 0.0)


def _effects(
    recording: Recording,
    named: Named,
    off: list[Off],
    layout: CoordinateLayout,
    best: Floats,
    drawn: Floats,
) -> tuple[Effect, ...]:
    """The accepted terms and the reading's errors, strongest first."""
    evaluator, way = named.evaluator, directions(recording)
    effects = [_needed_effect(named, score, layout, best, drawn, way) for score in named.needed]
    for reading in off:
        share = _share(evaluator, reading.without, named.fitted)
        effects.append(
            effect(
                evaluator,
                reading.term,
                (reading.term.slug,),
                values_of(reading.term.slug, best),
                np.array([values_of(reading.term.slug, row) for row in drawn]),
                reading.advantage,
                share,
                (reading.without.layout, reading.without.candidates.mean(axis=0)),
                way,
            )
        )
    return tuple(sorted(effects, key=lambda item: -item.evidence.mean))


def _needed_effect(
    named: Named,
    needed: Needed,
    layout: CoordinateLayout,
    best: Floats,
    drawn: Floats,
    way: Directions,
) -> Effect:
    place = layout.places[needed.term.slug]
    told = effect(
        named.evaluator,
        needed.term,
        needed.members,
        best[place],
        drawn[:, place],
        needed.advantage,
        _share(named.evaluator, needed.without, named.fitted),
        (needed.without.layout, needed.without.candidates.mean(axis=0)),
        way,
    )
    return told if needed.events is None else by_events(told, needed.events, needed.term, way)


def _matters(effect: Effect) -> bool:
    """True where it removes a good share of the residual; events that tell it are few samples."""
    return effect.evidence.share >= LEAST_SHARE or effect.evidence.events_z > 0.0


def _share(evaluator: Evaluator, before: Fitted, after: Fitted) -> float:
    """The share of the held-out loss that goes."""
    return float(np.clip(1.0 - after.heldout.sum() / max(before.heldout.sum(), 1e-12), -1.0, 1.0))


def _refuted(heldout: HeldOutFit) -> bool:
    """True where the extended model, fitted to the first part, predicts the rest clearly worse."""
    if heldout.rmse_naive is None or heldout.rmse_extended is None or heldout.gain_high is None:
        return False
    return heldout.rmse_extended > WORSE * heldout.rmse_naive and heldout.gain_high < 0.0


def _compressed(settled: RecordSettled) -> bool:
    return any(effect.slug == "historian_compression" for effect in settled.effects)


def _finding(effects: tuple[Effect, ...], open_end: bool) -> Finding:
    if not effects:
        return Finding.UNKNOWN if open_end else Finding.NONE
    single = all(len(effect.members) == 1 for effect in effects)
    return Finding.NAMED if single else Finding.CANDIDATES


def _not_testable(settled: RecordSettled, reason: str) -> Mismatch:
    unknown = Estimate.unknown(reason, unit=PERCENT)
    nothing = Stiction(S=unknown, J=unknown)
    effects: tuple[RecordEffect, ...] = settled.effects
    return Mismatch(
        finding=Finding.NOT_TESTABLE,
        sentence=f"Nothing can be said: {reason}.",
        naive=nothing,
        restated=nothing,
        record_effects=effects,
        not_testable=tuple(Untestable(slug=slug, reason=reason) for slug in catalogue()),
        heldout=HeldOutFit(),
    )


def scores(recording: Recording) -> dict[str, tuple[float, float]]:
    """Mean and t of the advantage of every admissible term over the base alone: what limits are
    calibrated on, with recordings in which nothing is hidden. Empty where nothing can be fitted."""
    recording = on_own_clock(recording)
    settled = settle(recording)
    if _cannot(recording, settled) is not None:
        return {}
    case = _fitted(recording, settled, None, problem_of(recording, settled))
    terms = admissible(case.refused)
    named = _named(replace(case, balance=None), terms)
    first: tuple[TermScore, ...] = named.stages[0].scores
    return {score.slug: (score.advantage.mean, score.advantage.t) for score in first}
