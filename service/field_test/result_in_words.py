"""``TestResult``: which rival models a recorded test supports, in the words and numbers that
terminal, page and JSON show."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np

from stemwatch.models.field_test.judgement import RESPONSES_DRAWN, TestJudgement, TestOutcome
from stemwatch.service.field_test.sheet import outcome_of, rival_name
from stemwatch.service.presenter.physics_words import joined
from stemwatch.service.presenter.wording import finite

VERSION = 1
WITH_THE_HOUR = (
    "Run `stemwatch explain` on the hour before the test and the test together: all effects of the "
    "catalogue are tried there, not these alone."
)


@dataclass(frozen=True, kw_only=True)
class RivalSeen:
    """One rival model compared with the recorded test: ``rms`` of MV less the model in percent,
    ``as_far`` in words, and its sentence."""

    slug: str
    name: str
    rms: float
    as_far: str
    said: str


@dataclass(frozen=True, kw_only=True)
class TestResult:
    """The result for ``valve``. Texts are whole sentences; ``rivals`` are sorted, the nearest
    first."""

    __test__ = False  # is no test of pytest's

    valve: str
    judgement: TestJudgement
    window: tuple[datetime | None, datetime | None]
    title: str
    headline: str
    remarks: tuple[str, ...]
    rivals: tuple[RivalSeen, ...] = ()


def result_of(
    judgement: TestJudgement, valve: str, window: tuple[datetime | None, datetime | None]
) -> TestResult:
    """The words of a ``judgement`` of ``valve``, whose test lies in ``window``."""
    title, headline, closing_remarks = _WORDS[judgement.outcome](judgement)
    return TestResult(
        valve=valve,
        judgement=judgement,
        window=window,
        title=f"{valve}: {title}",
        headline=headline,
        remarks=closing_remarks,
        rivals=_rivals(judgement),
    )


Words = tuple[str, str, tuple[str, ...]]  # title, headline, remarks


def _best(judgement: TestJudgement) -> str:
    return rival_name(judgement.models[judgement.best].slug)


def _follows(judgement: TestJudgement) -> Words:
    name = _best(judgement)
    others = [
        rival_name(model.slug) for model in judgement.models if model.slug != judgement.winner
    ]
    ruled = "is ruled out" if len(others) == 1 else "are ruled out"
    outcome = outcome_of(judgement.models[judgement.best].slug)
    then = (f"First: {outcome.then}",) if outcome.then else ()
    means = f"That means: {outcome.means}."
    return (
        f"the test says {name}",
        f"MV follows {name}; {joined(tuple(others))} {ruled}.",
        (means, *then),
    )


def _cannot_tell(judgement: TestJudgement) -> Words:
    first, *others = (rival_name(slug) for slug in judgement.left)
    also = joined(tuple(others))
    return (
        "the test still cannot tell",
        f"Still open between {joined((first, *others))}: MV follows {first} best, but not by so "
        f"much that {also} would hardly ever look like it.",
        (
            "Play a test with more amplitude or time (`stemwatch plan-test` with --amplitude and "
            "--minutes), or the same once more.",
            WITH_THE_HOUR,
        ),
    )


def _none_follows(judgement: TestJudgement) -> Words:
    names = [rival_name(model.slug) for model in judgement.models]
    return (
        "the test speaks for none of the rivals",
        f"MV follows none of {joined(tuple(names))}: the nearest, {_best(judgement)}, leaves "
        f"{judgement.leaves:.2g} times what it usually leaves of a valve that has it.",
        (
            "What is wrong is not among them, or something else moved the valve or the loop.",
            WITH_THE_HOUR,
        ),
    )


def _not_testable(judgement: TestJudgement) -> Words:
    return (
        "the test cannot be judged",
        f"The test cannot be judged: {judgement.reason.rstrip('?.')}"
        f"{'?' if judgement.reason.endswith('?') else '.'}",
        (
            "Give the recording of the test with OP and MV, from the first move to the last "
            "(--from, --to).",
        ),
    )


_WORDS = {
    TestOutcome.FOLLOWS: _follows,
    TestOutcome.CANNOT_TELL: _cannot_tell,
    TestOutcome.NONE_FOLLOWS: _none_follows,
    TestOutcome.NOT_TESTABLE: _not_testable,
}


def _rivals(judgement: TestJudgement) -> tuple[RivalSeen, ...]:
    if judgement.mv is None:
        return ()
    order = np.argsort([fit.cost for fit in judgement.fits], kind="stable").tolist()
    return tuple(
        RivalSeen(
            slug=judgement.models[k].slug,
            name=rival_name(judgement.models[k].slug),
            rms=float(np.sqrt(np.mean((judgement.fits[k].followed - judgement.mv) ** 2))),
            as_far=_as_far(judgement, k),
            said=_sentence_of_model(judgement, k),
        )
        for k in order
    )


def _as_far(judgement: TestJudgement, index: int) -> str:
    """How often the rival's own response would support the best rival just as strongly, in
    words."""
    if index == judgement.best:
        return ""
    return f"{round(judgement.as_far[index] * (RESPONSES_DRAWN + 1))} in {RESPONSES_DRAWN + 1}"


def _sentence_of_model(judgement: TestJudgement, index: int) -> str:
    if judgement.outcome is TestOutcome.NONE_FOLLOWS:
        return "nearest, does not follow" if index == judgement.best else "does not follow"
    if index == judgement.best:
        return "follows best"
    return "not ruled out" if judgement.models[index].slug in judgement.left else "ruled out"


def to_object(result: TestResult) -> dict[str, Any]:
    """The result as plain JSON types, described in docs/plan-test.md."""
    judgement = result.judgement
    start, end = (None if instant is None else instant.isoformat() for instant in result.window)
    return {
        "version": VERSION,
        "valve": result.valve,
        "outcome": judgement.outcome.value,
        "winner": judgement.winner,
        "left": list(judgement.left),
        "headline": result.headline,
        "remarks": list(result.remarks),
        "start": start,
        "end": end,
        "interval_s": judgement.interval_s,
        "samples": 0 if judgement.op is None else int(judgement.op.size),
        "leaves": finite(judgement.leaves),
        "rivals": [
            {
                "slug": model.slug,
                "name": rival_name(model.slug),
                "cost": finite(fit.cost),
                "as_far": finite(distance),
            }
            for model, fit, distance in zip(
                judgement.models, judgement.fits, judgement.as_far, strict=False
            )
        ],
    }
