"""Which of the named effects are accepted. They are fitted together to the whole record. Each must
remove a material share of the residual, and together they must predict samples that were not fitted
at least as well as S and J alone do; else the weakest is dropped, until they do.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import replace

from stemwatch.models.mismatch.acceptance.air_or_drag import or_air
from stemwatch.models.mismatch.acceptance.asked_of_the_whole import AskedOfTheWhole
from stemwatch.models.mismatch.acceptance.effects_that_stand import STRAIGHT_LINE
from stemwatch.models.mismatch.acceptance.held_out import FirstPart
from stemwatch.models.mismatch.acceptance.misleading_runs import runs_mislead
from stemwatch.models.mismatch.acceptance.whole_record import AcceptedHypothesis, on_whole_record
from stemwatch.models.mismatch.fit.evaluator import DRIVE
from stemwatch.models.mismatch.prepared_recording import PreparedRecording, admissible
from stemwatch.models.mismatch.search.drive import TERMS as OF_A_DRIVE
from stemwatch.models.mismatch.search.drive import is_refuted, name_drive, of_the_valve
from stemwatch.models.mismatch.search.named_terms import Named
from stemwatch.models.mismatch.search.needed_terms import lacking
from stemwatch.models.mismatch.search.reading_errors import STICKS_AGAIN
from stemwatch.models.mismatch.search.term_pairs import with_pair
from stemwatch.models.mismatch.search.term_selection import name_terms
from stemwatch.models.mismatch.term import Term
from stemwatch.models.mismatch.terms import catalogue


def accepted_hypothesis(case: PreparedRecording) -> AcceptedHypothesis:
    """The hypothesis that is published: what does not stand is taken out, and the rest refitted.

    What is named must also predict, in a free run, the part of the record that was not fitted at
    least as well as S and J alone do; else the weakest of it goes, until it does.
    """
    terms = admissible(case.refused)
    named = named_effects(case, terms)
    pinned: tuple[str, ...] = ()
    dropped_because, spring = "", False
    whole = AskedOfTheWhole(case.own_reading, terms)
    first_part = FirstPart(named.evaluator)
    while True:
        hypothesis, proposed = on_whole_record(case, named, terms, pinned, first_part)
        immaterial = _immaterial(hypothesis)
        if immaterial:
            # What explained it as well may be large enough where it stands alone.
            terms = {slug: term for slug, term in terms.items() if slug not in immaterial}
            named = named_effects(case, terms)
            continue
        spring = spring or hypothesis.spring
        stand = {effect.slug for effect in hypothesis.effects}
        if stand and _none_goes_first(hypothesis, proposed) and not _holds(hypothesis):
            if named.sticks_again is not None:
                named = whole.sliding(named)
                continue
            dropped_because = dropped_because or _why_worse(hypothesis)
            stand.remove(hypothesis.effects[-1].slug)
            if DRIVE in hypothesis.layout.places:
                # Motor and load are one model: what a valve needs is looked for instead.
                case = replace(case, balance=None)
                terms = {slug: term for slug, term in terms.items() if slug not in OF_A_DRIVE}
                named = named_effects(case, terms)
                continue
        elif DRIVE in hypothesis.layout.places:
            return hypothesis
        dropped = proposed - stand
        more = named if dropped or spring else whole.asked(named, terms, stand)
        if more is not named:
            # A stem that sticks again may stand beside what is named now, if it did not before.
            terms, named = {**terms, **whole.sticking}, more
            continue
        if not dropped:
            return replace(
                hypothesis,
                unexplained=hypothesis.unexplained or (spring and not stand),
                dropped_because=dropped_because,
                spring=spring,
            )
        # In one order: a fit without one of them is begun from the fit without the other.
        pinned = tuple(s for s in STRAIGHT_LINE if s in dropped or s in pinned)
        terms = {slug: term for slug, term in terms.items() if slug not in dropped}
        named = lacking(whole.sliding(named) if dropped & set(STICKS_AGAIN) else named, dropped)


def named_effects(case: PreparedRecording, terms: Mapping[str, Term]) -> Named:
    """What the recording needs: as a drive whose motion it resolves, or else term by term
    and two at once."""
    drive = name_drive(case.base, case.balance, terms) if case.balance is not None else None
    sought = of_the_valve(terms)
    term_by_term = or_air(with_pair(name_terms(case.base, sought), sought), sought)
    return term_by_term if drive is None or is_refuted(drive, term_by_term) else drive


def _immaterial(hypothesis: AcceptedHypothesis) -> set[str]:
    """The effects that are large enough where they were found, and too small on the whole
    record."""
    places, summary = hypothesis.layout.places, hypothesis.evaluator.summary
    if DRIVE in places:
        return set()  # motor and load are one model
    return {
        effect.slug
        for effect in hypothesis.effects
        if effect.slug in places
        and not catalogue()[effect.slug].material(hypothesis.best[places[effect.slug]], summary)
    }


def _none_goes_first(hypothesis: AcceptedHypothesis, proposed: Set[str]) -> bool:
    """Whether all effects that were ``proposed`` stand, so that they can be judged: others are part
    of the runs, and a fit without them is judged anew. Motor and load are one model.
    """
    stand = {effect.slug for effect in hypothesis.effects}
    return stand == proposed or DRIVE in hypothesis.layout.places


def _holds(hypothesis: AcceptedHypothesis) -> bool:
    """Whether the effects hold on unseen samples, in runs or by the likelihood."""
    return _predicts_as_well(hypothesis) or _stands_all_the_same(hypothesis)


def _predicts_as_well(hypothesis: AcceptedHypothesis) -> bool:
    """Whether unseen samples are predicted no worse than by S and J alone, in a free run; slip by
    slip, better beyond chance. Where only the likelihood has shown it, no worse beyond chance: what
    no trajectory shows there, none shows here.
    """
    heldout = hypothesis.comparison.heldout
    if heldout.gain_low is None or heldout.gain_high is None:
        return heldout.improves
    if hypothesis.named.sticks_again is not None or _by_likelihood_alone(hypothesis):
        return heldout.gain_high > 0.0
    return heldout.gain_low > 0.0 if heldout.slip_by_slip else heldout.improves


def _stands_all_the_same(hypothesis: AcceptedHypothesis) -> bool:
    """Whether the likelihood shows the effects where a free run does not; a motor with its load has
    none.
    """
    evaluator, fitted = hypothesis.evaluator, hypothesis.fitted
    return DRIVE not in hypothesis.layout.places and runs_mislead(
        evaluator, fitted, hypothesis.best, hypothesis.named.base
    )


def _by_likelihood_alone(hypothesis: AcceptedHypothesis) -> bool:
    """Whether trajectories have shown none of the effects."""
    return all(effect.evidence.likelihood_gain > 0.0 for effect in hypothesis.effects)


def _why_worse(hypothesis: AcceptedHypothesis) -> str:
    """A clause: unseen samples are predicted worse with what was named, or no better."""
    heldout = hypothesis.comparison.heldout
    if heldout.improves:
        return parts_only(hypothesis, "predicted no better with it than by chance")
    return parts_only(hypothesis, "predicted worse with it")


def parts_only(hypothesis: AcceptedHypothesis, outcome: str) -> str:
    """A clause: the effects explain a part of the record, and the ``outcome`` on the unfitted part,
    with both fits.
    """
    words = " and ".join(effect.slug.replace("_", " ") for effect in hypothesis.effects)
    heldout = hypothesis.comparison.heldout
    fit = ""
    if heldout.fit_naive is not None and heldout.fit_extended is not None:
        fit = f" (fit {heldout.fit_naive:.0f} % without, {heldout.fit_extended:.0f} % with it)"
    return (
        f"{words.capitalize()} would explain parts of this recording, but its last part, which was "
        f"not fitted, is {outcome}{fit}"
    )
