"""``score``: opened truths and answers to marks, and everything counted as plain JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from stemwatch.service.studies.proof.answers import Answer
from stemwatch.service.studies.proof.figures import heldout, seconds, stiction_errors
from stemwatch.service.studies.proof.marks import CaseMark, mark
from stemwatch.service.studies.proof.rates import (
    Rate,
    Tally,
    by_concealment,
    by_effect,
    confusions,
    headline,
    record_rates,
)
from stemwatch.service.studies.proof.truth import CaseTruth, Seal

VERSION = 1


def score(truths: Sequence[CaseTruth], said: Sequence[Answer]) -> list[CaseMark]:
    """One mark a case. Raises ``ValueError`` where answers and truths are not of the same files."""
    answers = {one.file: one for one in said}
    missing = sorted({one.file for one in truths} ^ set(answers))
    if missing:
        raise ValueError(
            f"every case needs one answer; {len(missing)} files have only a truth or only an "
            f"answer, the first is {missing[0]}"
        )
    return [mark(one, answers[one.file]) for one in truths]


def as_json(marks: Sequence[CaseMark], seal: Seal, seed: int) -> dict[str, Any]:
    """All that was counted, and every case, in types that ``json.dumps`` takes."""
    fit, time = heldout(marks), seconds(marks)
    return {
        "version": VERSION,
        "seed": seed,
        "cases": len(marks),
        "digest": seal.digest,
        "rates": [_rate(one) for one in headline(marks)],
        "record_effects": [_rate(one) for one in record_rates(marks)],
        "by_effect": [_tally(one) for one in by_effect(marks)],
        "by_concealment": [_tally(one) for one in by_concealment(marks)],
        "confusions": [
            {"truth": truth, "said": said, "count": count}
            for truth, said, count in confusions(marks)
        ],
        "heldout": None if fit is None else asdict(fit),
        "stiction": [asdict(one) | {"reached": one.reached} for one in stiction_errors(marks)],
        "seconds": None if time is None else asdict(time) | {"reached": time.reached},
        "marks": [_mark(one) for one in marks],
    }


def _rate(rate: Rate) -> dict[str, Any]:
    low, high = rate.interval
    return asdict(rate) | {"share": rate.share, "low": low, "high": high, "reached": rate.reached}


def _tally(tally: Tally) -> dict[str, Any]:
    low, high = tally.interval
    return asdict(tally) | {"low": low, "high": high}


def _mark(mark: CaseMark) -> dict[str, Any]:
    return {
        "truth": asdict(mark.truth),
        "said": asdict(mark.said),
        "outcome": mark.outcome.value,
        "wrong_names": list(mark.wrong_names),
    }
