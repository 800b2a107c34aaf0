"""Whether free runs mislead: effects that they do not show, and the likelihood of the whole record
does.

A free run lets go where the model says, and one breakaway that comes early or late by chance is an
error that lasts until the next. In a quiet loop, or where breakaways scatter, that decides which of
two runs is the worse. The likelihood follows all breakaways. Where it leaves nothing of the record
beside the effects, and the record is as much more likely with them as a term must make it before it
is named, they stand.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.mismatch.acceptance.nothing_left_out import likelihood_explains
from stemwatch.models.mismatch.fit.base_coordinate import N_BASE
from stemwatch.models.mismatch.fit.crossfit import Fitted
from stemwatch.models.mismatch.fit.evaluator import Evaluator, TermSet
from stemwatch.models.mismatch.likelihood.likelihood_evidence import evidence_of
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    Likeliest,
    RecordLikelihood,
    likeliest_of,
)
from stemwatch.models.mismatch.search.breakaway_scatter import less_scattered
from stemwatch.models.mismatch.search.reading_errors import COORDINATES, pinned
from stemwatch.models.recording import Floats

# Share of the noise up to which readings lie about the most likely stem if what is named is right:
# at most 1.0 on 15 development valves with a line of the reading or a lag, 1.26 and 1.27 on two
# with a spring with hysteresis and a wave of friction.
NOISE_OF_A_NAME = 1.2


def runs_mislead(evaluator: Evaluator, fitted: Fitted, best: Floats, base: Fitted) -> bool:
    """True where the likelihood leaves nothing of the record beside the effects that are ``fitted``
    to both folds and ``best`` (size,) to the whole record, and shows them against S and J alone.

    ``base`` is the fit of S, J and the reading, from which the latter is begun.
    """
    if not likelihood_explains(evaluator, fitted, best, NOISE_OF_A_NAME):
        return False
    likelihood = RecordLikelihood(evaluator)
    rich = likeliest_of(likelihood, fitted)
    return evidence_of(rich, _alone(likelihood, rich, base)).strength >= 1.0


def _alone(likelihood: RecordLikelihood, rich: Likeliest, base: Fitted) -> Likeliest:
    """Where the record is most likely by S and J alone, the reading right and the stem sliding."""
    layout = likelihood.evaluator.layout(TermSet(()))
    for coordinate, largest in COORDINATES.values():
        layout = pinned(layout, coordinate, largest)
    rows = layout.bounds.clip(np.vstack((base.candidates[:, :N_BASE], rich.candidate[:N_BASE])))
    points = [
        np.append(row, of_record)
        for row in rows
        for of_record in (likelihood.first_of_record, rich.of_record)
    ]
    return less_scattered(likelihood, likelihood.maximised(layout, points))
