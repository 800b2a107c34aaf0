"""The rates of a blind trial, each with its interval and its target."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from stemwatch.service.studies.detection_rates import wilson
from stemwatch.service.studies.proof.answers import BlindAnswer
from stemwatch.service.studies.proof.figures import heldout, seconds, stiction_errors
from stemwatch.service.studies.proof.marks import CaseMark, CaseOutcome, mark
from stemwatch.service.studies.proof.truth import (
    RECORD_EFFECTS,
    WIDE_SCATTER,
    CaseKind,
    CaseTruth,
    Seal,
)

RIGHT = (CaseOutcome.EXACT, CaseOutcome.CLASS)
NO_VERDICT = "not_testable"
# Concealments that make a record harder, with the share of effects to find there. Every other one
# counts among the routine records.
HARDER = {"quantised": 0.80, "compressed": 0.80, "quiet": 0.80, "short": 0.75}

VERSION = 1


@dataclass(frozen=True, kw_only=True)
class Rate:
    """``hits`` of ``of`` cases, with the share to reach: at least, or at most where ``at_most``."""

    group: str
    name: str
    hits: int
    of: int
    target: float | None = None
    at_most: bool = False

    @property
    def share(self) -> float | None:
        """Share of hits, ``None`` where there was no such case."""
        return self.hits / self.of if self.of else None

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share, Wilson (1927)."""
        return wilson(self.hits, self.of)

    @property
    def reached(self) -> bool | None:
        """Whether the share itself meets the target; ``None`` without target or case."""
        share = self.share
        if self.target is None or share is None:
            return None
        return share <= self.target if self.at_most else share >= self.target


def headline(marks: Sequence[CaseMark]) -> list[Rate]:
    """The rates with a target, and those that show how far these can be trusted."""
    singles = [m for m in marks if m.truth.kind is CaseKind.SINGLE and m.truth.excited]
    routine = [m for m in singles if m.truth.concealment not in HARDER]
    rates = _naming("one effect, 1 h, moving", routine, by_class=0.90, when_named=0.97, exact=0.88)
    for concealment, share in HARDER.items():
        group = [m for m in singles if m.truth.concealment == concealment]
        rates += _naming(f"one effect, {concealment}", group, by_class=share, when_named=0.92)
    return [
        *rates,
        *_pairs(marks),
        *_nulls(marks),
        *_unknowns(marks),
        *_unexcited(marks),
        _rate("every case", "no verdict at all", marks, lambda m: m.answer.verdict == NO_VERDICT),
    ]


def _rate(
    group: str,
    name: str,
    marks: Sequence[CaseMark],
    hit: Callable[[CaseMark], bool],
    target: float | None = None,
    *,
    at_most: bool = False,
) -> Rate:
    hits = sum(map(hit, marks))
    return Rate(group=group, name=name, hits=hits, of=len(marks), target=target, at_most=at_most)


def _naming(
    group: str,
    marks: Sequence[CaseMark],
    *,
    by_class: float | None = None,
    when_named: float | None = None,
    exact: float | None = None,
) -> list[Rate]:
    """Of all cases, and of those in which something was named."""
    named = [m for m in marks if m.named]
    return [
        _rate(group, "right by class", marks, lambda m: m.outcome in RIGHT, by_class),
        _rate(group, "right when named", named, lambda m: bool(m.right_name), when_named),
        _rate(group, "every name right", named, lambda m: not m.wrong_names),
        _rate(group, "exact name", marks, lambda m: m.outcome is CaseOutcome.EXACT, exact),
        _rate(group, "nothing named", marks, lambda m: m.outcome is CaseOutcome.MISS),
    ]


def _pairs(marks: Sequence[CaseMark]) -> list[Rate]:
    pairs = [m for m in marks if m.truth.kind is CaseKind.PAIR and m.truth.excited]
    moving = [m for m in pairs if m.truth.concealment not in HARDER]
    harder = [m for m in pairs if m.truth.concealment in HARDER]
    at_least_one = (CaseOutcome.BOTH, CaseOutcome.ONE)
    rates = []
    for group, members, target in (
        ("two effects, 1 h, moving", moving, 0.80),
        ("two effects, harder records", harder, 0.80),
    ):
        rates += [
            _rate(
                group,
                "both by class",
                members,
                lambda m: m.outcome is CaseOutcome.BOTH,
                target,
            ),
            _rate(group, "at least one", members, lambda m: m.outcome in at_least_one),
            _rate(group, "a wrong name", members, lambda m: bool(m.wrong_names)),
        ]
    return rates


def _nulls(marks: Sequence[CaseMark]) -> list[Rate]:
    nulls = [m for m in marks if m.truth.kind is CaseKind.NULL]
    usual_scatter = [m for m in nulls if m.truth.scatter < WIDE_SCATTER]
    wide = [m for m in nulls if m.truth.scatter >= WIDE_SCATTER]

    def alarms(group: str, members: Sequence[CaseMark]) -> Rate:
        return _rate(
            group, "false alarm", members, lambda m: m.outcome is CaseOutcome.FALSE_ALARM, 0.03,
            at_most=True,
        )  # fmt: skip

    return [
        alarms("nothing hidden, scatter to 8 %", usual_scatter),
        alarms("nothing hidden, scatter over 8 %", wide),
    ]


def _unknowns(marks: Sequence[CaseMark]) -> list[Rate]:
    group = [m for m in marks if m.truth.kind is CaseKind.UNKNOWN]
    excited = [m for m in group if m.truth.excited]
    name = CaseKind.UNKNOWN.value
    return [
        _rate(name, "caught as unknown", excited, lambda m: m.outcome is CaseOutcome.CAUGHT, 0.85),
        _rate(
            name, "misnamed", group, lambda m: m.outcome is CaseOutcome.MISNAMED, 0.05, at_most=True
        ),
    ]


def _unexcited(marks: Sequence[CaseMark]) -> list[Rate]:
    """Cases whose record cannot show the effect: naming nothing is right."""
    kinds = (CaseKind.SINGLE, CaseKind.PAIR)
    group = [m for m in marks if m.truth.kind in kinds and not m.truth.excited]
    return [
        _rate("not excited", "silent or right", group, lambda m: not m.wrong_names),
        _rate("not excited", "a wrong name", group, lambda m: bool(m.wrong_names)),
        _rate(
            "not excited", "said to be not testable", group,
            lambda m: set(m.truth.physics) <= set(m.answer.not_testable),
        ),
    ]  # fmt: skip


def record_rates(marks: Sequence[CaseMark]) -> list[Rate]:
    """How often each record effect is found where it is, and claimed where it is not."""
    rates = []
    for slug in RECORD_EFFECTS:
        present = [m for m in marks if slug in m.truth.record_effects]
        absent = [m for m in marks if slug not in m.truth.record_effects]
        for name, group in (("found", present), ("claimed in error", absent)):
            hits = sum(slug in m.answer.record_effects for m in group)
            rates.append(Rate(group=slug, name=name, hits=hits, of=len(group)))
    return rates


@dataclass(frozen=True, kw_only=True)
class Tally:
    """Single excited effects of one group: how many, and how each ended."""

    group: str
    of: int
    exact: int
    by_class: int  # exact ones included
    wrong: int
    missed: int
    unexcited: int  # further cases that the record could not show

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share that is right by class, Wilson (1927)."""
        return wilson(self.by_class, self.of)


def by_effect(marks: Sequence[CaseMark]) -> list[Tally]:
    """One row for each hidden effect."""
    return _tallies(marks, lambda m: m.truth.label)


def by_concealment(marks: Sequence[CaseMark]) -> list[Tally]:
    """One row for each way in which effects were concealed."""
    return _tallies(marks, lambda m: m.truth.concealment)


def _tallies(marks: Sequence[CaseMark], group_of: Callable[[CaseMark], str]) -> list[Tally]:
    singles = [m for m in marks if m.truth.kind is CaseKind.SINGLE]
    tallies = []
    for group in sorted({group_of(m) for m in singles}):
        members = [m for m in singles if group_of(m) == group]
        counts = Counter(m.outcome for m in members if m.truth.excited)
        tallies.append(
            Tally(
                group=group,
                of=counts.total(),
                exact=counts[CaseOutcome.EXACT],
                by_class=sum(counts[outcome] for outcome in RIGHT),
                wrong=counts[CaseOutcome.WRONG],
                missed=counts[CaseOutcome.MISS],
                unexcited=sum(not m.truth.excited for m in members),
            )
        )
    return tallies


def confusions(marks: Sequence[CaseMark]) -> list[tuple[str, str, int]]:
    """(truth, what was said, how often), by truth and then the most frequent answer first."""
    counts = Counter((m.truth.label, _answer(m)) for m in marks if m.truth.excited)
    rows = [(truth, answer, count) for (truth, answer), count in counts.items()]
    return sorted(rows, key=lambda row: (row[0], -row[2], row[1]))


def _answer(mark: CaseMark) -> str:
    """What was said; all names right and none more reads as the truth does, in its order."""
    slugs = sorted(name.slug for name in mark.answer.names)
    return mark.truth.label if slugs and slugs == sorted(mark.truth.physics) else mark.answer.label


def without_verdict(marks: Sequence[CaseMark]) -> list[tuple[str, int]]:
    """(reason, how often) where the judge gave no verdict, the commonest first.

    Such a case counts in every rate as one in which nothing was named.
    """
    return Counter(
        m.answer.reason or "no reason given" for m in marks if m.answer.verdict == NO_VERDICT
    ).most_common()


def score(truths: Sequence[CaseTruth], said: Sequence[BlindAnswer]) -> list[CaseMark]:
    """One mark a case. Raises ``ValueError`` where answers and truths are not of the same files."""
    answers = {answer.file: answer for answer in said}
    missing = sorted({truth.file for truth in truths} ^ set(answers))
    if missing:
        raise ValueError(
            f"every case needs one answer; {len(missing)} files have only a truth or only an "
            f"answer, the first is {missing[0]}"
        )
    return [mark(truth, answers[truth.file]) for truth in truths]


def as_json(marks: Sequence[CaseMark], seal: Seal, seed: int) -> dict[str, Any]:
    """All that was counted, and every case, in types that ``json.dumps`` takes."""
    fit, time = heldout(marks), seconds(marks)
    return {
        "version": VERSION,
        "seed": seed,
        "cases": len(marks),
        "digest": seal.digest,
        "rates": [_rate_as_json(rate) for rate in headline(marks)],
        "record_effects": [_rate_as_json(record_rate) for record_rate in record_rates(marks)],
        "by_effect": [_tally(tally) for tally in by_effect(marks)],
        "by_concealment": [_tally(tally) for tally in by_concealment(marks)],
        "confusions": [
            {"truth": truth, "said": answer, "count": count}
            for truth, answer, count in confusions(marks)
        ],
        "heldout": None if fit is None else asdict(fit),
        "stiction": [
            asdict(error) | {"reached": error.reached} for error in stiction_errors(marks)
        ],
        "seconds": None if time is None else asdict(time) | {"reached": time.reached},
        "marks": [_mark(mark) for mark in marks],
    }


def _rate_as_json(rate: Rate) -> dict[str, Any]:
    low, high = rate.interval
    return asdict(rate) | {"share": rate.share, "low": low, "high": high, "reached": rate.reached}


def _tally(tally: Tally) -> dict[str, Any]:
    low, high = tally.interval
    return asdict(tally) | {"low": low, "high": high}


def _mark(mark: CaseMark) -> dict[str, Any]:
    return {
        "truth": asdict(mark.truth),
        "said": asdict(mark.answer),
        "outcome": mark.outcome.value,
        "wrong_names": list(mark.wrong_names),
    }
