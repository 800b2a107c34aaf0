"""The S that a slow archive may hide from a fit, percent of OP: between its samples, or in its
averages (``decision.shaken_loose``).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from stemwatch.models.decision.shaken_loose import S_averaged, S_unseen
from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.measurement.between_samples import ArchiveKind
from stemwatch.models.screening.fitted_recording import FittedRecording
from stemwatch.models.signals.averages_in_steps import keeps_averages
from stemwatch.models.stickslip.fit import StickSlipFit


def S_that_may_be_hidden(fitted: FittedRecording, S: Estimate) -> float:
    """The S that may be there where noise of OP shakes the stem loose between samples, or within
    each average of an archive that is known to keep such."""
    between = _may_be_there(S_unseen, fitted, S)
    return max(between, S_if_averaged(fitted, S)) if _averages(fitted) else between


def S_if_averaged(fitted: FittedRecording, S: Estimate) -> float:
    """The S that may be there if the archive keeps averages; no more than ``S`` where it is known
    to keep samples."""
    return _may_be_there(partial(S_averaged, averages=_averages(fitted)), fitted, S)


def _averages(fitted: FittedRecording) -> bool | None:
    """Whether the archive keeps averages, by steps of OP and set point or by slips of the stem;
    ``None`` where neither shows it."""
    by_steps, archive = keeps_averages(fitted.recording), fitted.archive
    if by_steps is not None or archive is None or archive.kind_open:
        return by_steps
    return True if archive.kind is ArchiveKind.AVERAGES else None


def _may_be_there(
    hidden: Callable[[StickSlipFit, float], float], fitted: FittedRecording, S: Estimate
) -> float:
    """The S that may be ``hidden`` behind the one that is seen; 0 where not even that is known."""
    slope = fitted.op_per_travel
    return 0.0 if S.value is None else slope * hidden(fitted.fit, S.value / slope)
