"""The rules: what in the last screenings of one valve is worth an alert. Pure functions. Findings
with one cause become one alert in ``one_per_cause``.

Screenings come newest first; those without a verdict neither raise nor close anything, because they
say nothing. A finding is raised when it was there in N of the last M, closed when it was not there
in K in a row, or in more where it was there now and then only, and otherwise left as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, tzinfo
from enum import Enum

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.evidence_over_windows import OF_FRICTION, LastingFinding
from stemwatch.models.history.fall_of_stiction import UnexplainedFall
from stemwatch.models.history.trend_over_weeks import TrendOverWeeks
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.models.without_position.suspicion import Suspicion
from stemwatch.service.alerts.when_over import begins, is_over, may_still_stick
from stemwatch.service.config.service_schema import AlertRules
from stemwatch.service.plant_path import levels_of
from stemwatch.service.presenter.advice import after_first_step, first_step, parts_needed
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks
from stemwatch.service.presenter.finding import baseline_left, stiction_grown, why_no_work
from stemwatch.service.presenter.suspicion_words import HOW_SURE
from stemwatch.service.presenter.work_decision import DEPARTED, STICTION, WATCH
from stemwatch.service.store.alerts.alerts import AlertKind, AlertSeverity, RaisedAlert, to_do
from stemwatch.service.store.screenings.records import JudgedScreening, StoredValve

RATIO = "baseline_ratio"


@dataclass(frozen=True, kw_only=True)
class AlertWords:
    """What an alert says: what was found, what to do first, what after that, and which parts to
    have at hand."""

    found: str
    first_step: str
    then: str = ""
    parts: tuple[str, ...] = ()

    @classmethod
    def with_steps_for(cls, kind: str, found: str, then: str | None = None) -> AlertWords:
        """``found`` with the first step of the advice for ``kind``, and its other steps where
        nothing else is to be said ``then``."""
        rest = after_first_step(kind) if then is None else then
        return cls(found=found, first_step=first_step(kind), then=rest, parts=parts_needed((kind,)))


class AlertDecision(Enum):
    """What the last runs say of a finding."""

    RAISE = "raise"
    CLEAR = "clear"
    LEAVE = "leave"


@dataclass(frozen=True, kw_only=True)
class ValveRecord:
    """What is known of a valve when the rules look at it.

    ``screenings`` newest first; ``at_baseline`` S in the baseline's window, percent of OP span;
    ``ratios`` the baseline ratio of each screening of ``screenings`` that has one, by its id;
    ``worked_at`` when the valve was worked on; ``by_window`` what its windows of the last weeks say
    together of effects beside friction, and ``stands`` whether that is more than chance among all
    valves of the run. ``weeks`` is how its S goes over weeks, ``fall`` that it fell without
    recorded work, ``sticky_limit`` from which S it sticks, percent. Days are said in ``zone``.
    """

    valve: StoredValve
    screenings: Sequence[JudgedScreening]
    at_baseline: Estimate | None = None
    ratios: Mapping[int, float] = field(default_factory=dict)
    ratio_limit: float = 3.0
    worked_at: Sequence[datetime] = ()
    by_window: EvidenceOfWeeks | None = None
    stands: bool = False
    weeks: TrendOverWeeks | None = None
    fall: UnexplainedFall | None = None
    sticky_limit: float | None = None
    zone: tzinfo = UTC

    @property
    def began(self) -> datetime | None:
        """When the stem that is there now began; ``None`` where it is the one there ever was."""
        return begins(self.worked_at, self.fall)

    @property
    def confirmed(self) -> tuple[LastingFinding, ...]:
        """The effects that the windows of weeks confirm; without one of friction itself that none
        names since S fell, because that friction is gone."""
        if self.by_window is None:
            return ()
        return tuple(
            finding
            for finding in self.by_window.confirmed
            if self.fall is None
            or finding.slug not in OF_FRICTION
            or finding.last_seen.date() >= self.fall.on
        )


def alert_decision(present: Sequence[bool | None], rules: AlertRules) -> AlertDecision:
    """What a finding's presence in the last judged screenings (newest first) asks for.

    ``None`` is a screening that cannot tell and counts for neither; while the newest cannot, what
    is open stays open and nothing is raised.
    """
    if not present or present[0] is None:
        return AlertDecision.LEAVE
    answers = [answer for answer in present if answer is not None]
    if answers[0] and sum(answers[: rules.of_runs]) >= rules.raise_after_runs:
        return AlertDecision.RAISE
    last = answers[: rules.clear_after_runs]
    if len(last) == rules.clear_after_runs and not any(last):
        return AlertDecision.CLEAR
    return AlertDecision.LEAVE


def apply_rules(record: ValveRecord, rules: AlertRules) -> tuple[list[RaisedAlert], list[str]]:
    """What to raise, and the causes to close, of one valve."""
    raised, closed = _by_verdicts(record, rules)
    suspected = _suspicion(record, rules)
    if isinstance(suspected, RaisedAlert):
        raised.append(suspected)
    elif suspected is AlertDecision.CLEAR:
        closed.append(cause(AlertKind.SUSPECTED, record.valve.id))
    return raised, closed


def _by_verdicts(record: ValveRecord, rules: AlertRules) -> tuple[list[RaisedAlert], list[str]]:
    """What to raise, and the causes to close, by the windows with a verdict."""
    judged = [
        screening
        for screening in record.screenings
        if screening.verdict is not Verdict.UNDETERMINED
    ]
    raised: list[RaisedAlert] = []
    closed: list[str] = []
    for kind, present, text in _findings(record, rules):
        answers = [
            None if _worked_on(record, screening) else present(screening) for screening in judged
        ]
        verdict = alert_decision(answers, rules)
        if verdict is AlertDecision.CLEAR and not _is_over(record, kind, judged, answers, rules):
            verdict = AlertDecision.LEAVE
        if kind is AlertKind.MISMATCH:
            verdict = _of_physics(record, answers, verdict)
        if kind is AlertKind.FORESEEN:
            verdict = _of_weeks(record, judged, answers, rules)
        if verdict is AlertDecision.RAISE:
            alert = _raised(record.valve, kind, text(judged[0]), judged[0])
            if kind is AlertKind.MISMATCH:
                effects = [finding.slug for finding in record.confirmed]
                alert = replace(alert, evidence={**alert.evidence, "effects": effects})
                if _is_friction(record):
                    alert = replace(alert, cause=cause(AlertKind.STICKY, record.valve.id))
            raised.append(alert)
        elif verdict is AlertDecision.CLEAR:
            closed.append(cause(kind, record.valve.id))
    if _is_friction(record):  # not over, though the stem does not stick beyond its limit
        closed = [
            closed_cause
            for closed_cause in closed
            if closed_cause != cause(AlertKind.STICKY, record.valve.id)
        ]
    return raised, closed


def _is_over(
    record: ValveRecord,
    kind: AlertKind,
    judged: Sequence[JudgedScreening],
    answers: Sequence[bool | None],
    rules: AlertRules,
) -> bool:
    """Whether the windows without the finding are enough to close its alert."""
    if kind is AlertKind.STICKY:
        answers = [
            None if may_still_stick(screening, record.sticky_limit) else answer
            for screening, answer in zip(judged, answers, strict=True)
        ]
    return is_over(judged, answers, record.began, rules.clear_after_runs)


def _is_friction(record: ValveRecord) -> bool:
    """Whether what is confirmed beside S and J is how friction itself shows: it has the cause of a
    sticking stem, and its alert becomes that of one."""
    slugs = {finding.slug for finding in record.confirmed}
    return bool(slugs) and slugs <= OF_FRICTION


def _of_weeks(
    record: ValveRecord,
    judged: Sequence[JudgedScreening],
    answers: Sequence[bool | None],
    rules: AlertRules,
) -> AlertDecision:
    """What is foreseen comes from weeks, not from the last runs: it is raised at once, and is over
    when S does not rise any more. Where the stem sticks it has come true, and waits to become the
    alert of that."""
    if not answers or answers[0] is None or judged[0].verdict is Verdict.STICKY:
        return AlertDecision.LEAVE
    foreseen = record.weeks is not None and record.weeks.foresees_within(
        rules.foreseen_within_weeks
    )
    if foreseen is False:
        return AlertDecision.CLEAR
    return AlertDecision.LEAVE if foreseen is None else AlertDecision.RAISE


def _suspicion(record: ValveRecord, rules: AlertRules) -> RaisedAlert | AlertDecision:
    """The alert, or what else to do, about sticking that OP and PV alone suggest in windows
    without a verdict; a verdict says more. Without the user's wish there is none."""
    if not rules.sticking_suspected:
        return AlertDecision.CLEAR
    answers = [
        None if _worked_on(record, screening) else _is_suspected(screening)
        for screening in record.screenings
    ]
    decision = alert_decision(answers, rules)
    if decision is AlertDecision.RAISE:
        newest = record.screenings[0]
        told = newest.without_position
        assert told is not None
        words = AlertWords(found=told.reason, first_step=told.advice, then=HOW_SURE)
        return _raised(record.valve, AlertKind.SUSPECTED, words, newest)
    if decision is AlertDecision.CLEAR and not is_over(
        record.screenings, answers, record.began, rules.clear_after_runs
    ):
        return AlertDecision.LEAVE
    return decision


def _is_suspected(screening: JudgedScreening) -> bool | None:
    """Whether sticking is suspected from OP and PV alone; ``None`` where they cannot tell."""
    if screening.verdict is not Verdict.UNDETERMINED:
        return False
    told = screening.without_position
    if told is None or told.verdict is Suspicion.CANNOT_TELL:
        return None
    return told.verdict is Suspicion.SUSPECTED


def _of_physics(
    record: ValveRecord, answers: Sequence[bool | None], by_runs: AlertDecision
) -> AlertDecision:
    """An effect beside friction is raised where the windows of weeks confirm it and it stands among
    all valves of the run; what was only seen once closes nothing either."""
    if not answers or answers[0] is None:
        return AlertDecision.LEAVE
    if record.confirmed:
        return AlertDecision.RAISE if record.stands else AlertDecision.LEAVE
    first_seen = record.by_window is not None and record.by_window.first_seen
    is_clear = by_runs is AlertDecision.CLEAR and not first_seen
    return AlertDecision.CLEAR if is_clear else AlertDecision.LEAVE


def _worked_on(record: ValveRecord, judged: JudgedScreening) -> bool:
    """True where the window holds two valves: the one before the work and the one after it."""
    start, end = judged.window
    if start is None or end is None:
        return False
    return any(start < work_time < end for work_time in record.worked_at)


def cause(kind: AlertKind, valve: str) -> str:
    """What makes two alerts of a valve the same."""
    return f"{kind.value}:{valve}"


_Finding = tuple[
    AlertKind, Callable[[JudgedScreening], bool | None], Callable[[JudgedScreening], AlertWords]
]


def _findings(record: ValveRecord, rules: AlertRules) -> list[_Finding]:
    return [
        (AlertKind.STICKY, lambda judged: judged.verdict is Verdict.STICKY, _sticky),
        (AlertKind.FORESEEN, lambda _: True, lambda _: _foreseen(record)),
        (
            AlertKind.GROWN,
            lambda judged: has_grown(judged.S, record.at_baseline, rules.grown_S_percent),
            lambda judged: AlertWords.with_steps_for(
                _kind_of_friction(judged),
                stiction_grown(record.at_baseline, judged.S),
                judged.advice,
            ),
        ),
        (
            AlertKind.BASELINE,
            lambda judged: (
                record.ratios[judged.id] > record.ratio_limit
                if judged.id in record.ratios
                else None
            ),
            lambda judged: AlertWords.with_steps_for(
                DEPARTED, baseline_left(record.ratios[judged.id])
            ),
        ),
        (AlertKind.MISMATCH, lambda judged: judged.named, lambda judged: _mismatch(record, judged)),
    ]


def has_grown(now: Estimate, before: Estimate | None, least_percent: float) -> bool:
    """Whether S has grown by ``least_percent`` of span or more, and its interval lies above the
    one it had: a growth that both runs' uncertainty cannot explain."""
    if before is None or now.value is None or before.value is None:
        return False
    if now.low is None or before.high is None:
        return False
    return now.value - before.value >= least_percent and now.low > before.high


def _sticky(judged: JudgedScreening) -> AlertWords:
    """The screening's reason, and which of the effects in it ask for no work, as report and work
    order say it."""
    effects = () if judged.mismatch is None else judged.mismatch.effects
    no_work = [e for e in effects if e.inherent and e.sentence in judged.reason]
    found = f"{judged.reason} {why_no_work(no_work)}" if no_work else judged.reason
    return AlertWords.with_steps_for(_kind_of_friction(judged), found, judged.advice)


def _kind_of_friction(judged: JudgedScreening) -> str:
    """The kind of finding that the stem's friction is; while it does not stick, one to watch."""
    if judged.verdict is not Verdict.STICKY:
        return WATCH
    return STICTION[judged.shape or Shape.UNDERSHOOT]


def _foreseen(record: ValveRecord) -> AlertWords:
    """The trend and when it is there, in the words of report and ranking."""
    assert record.weeks is not None
    return AlertWords(
        found=f"{record.weeks.words}, where the stem counts as sticky.",
        first_step="Plan its maintenance before that.",
        then="The trend on the valve's page says how sure this is.",
    )


def _mismatch(record: ValveRecord, judged: JudgedScreening) -> AlertWords:
    """What is confirmed, in the words of the newest window where that names it too."""
    assert record.by_window is not None
    lead = record.by_window.in_order_of_work(judged.mismatch)[0]
    return AlertWords.with_steps_for(
        lead.slug, record.by_window.in_short(judged.mismatch, record.zone)
    )


def _raised(
    valve: StoredValve, kind: AlertKind, words: AlertWords, judged: JudgedScreening
) -> RaisedAlert:
    unit = f"unit {valve.unit}" if valve.unit else ""
    said = ", ".join(part for part in (valve.description, unit) if part)
    name = f"{valve.id} ({said})" if said else valve.id
    evidence = {
        **levels_of(valve),
        "S": judged.S.value,
        "S_low": judged.S.low,
        "S_high": judged.S.high,
        "J": judged.J,
        "severity": judged.severity,
        "screening": judged.id,
        **to_do(words.first_step, words.then, words.parts),
        "window": [None if end is None else end.isoformat() for end in judged.window],
    }
    return RaisedAlert(
        cause=cause(kind, valve.id),
        kind=kind,
        severity=severity_of(kind, valve.criticality),
        text=f"{name}: {words.found}",
        valve=valve.id,
        run_id=judged.run_id,
        evidence=evidence,
    )


def severity_of(kind: AlertKind, criticality: int) -> AlertSeverity:
    """How urgent: by how much the plant needs the valve; what sticks before what changes."""
    order = (AlertSeverity.LOW, AlertSeverity.MEDIUM, AlertSeverity.HIGH)
    level = criticality - 1 - (kind is not AlertKind.STICKY)
    return order[min(max(level, 0), 2)]
