"""Whether a dead time that was named may be clocks of two tags that differ, or readings of uneven
age.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.mismatch.acceptance.whole_record import AcceptedHypothesis
from stemwatch.models.mismatch.findings import Effect, RecordEffect
from stemwatch.models.mismatch.measurement.record_effects import (
    small_delay_effect,
    uneven_readings_effect,
)
from stemwatch.models.mismatch.measurement.uneven_readings import (
    UnevenReadings,
    find_uneven_readings,
)
from stemwatch.models.mismatch.prepared_recording import PreparedRecording
from stemwatch.models.mismatch.search.reading_errors import STICKS_AGAIN
from stemwatch.models.mismatch.terms.dead_time import about_a_sample

DELAY = "dead_time"


def but_for_clocks(
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
