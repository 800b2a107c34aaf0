"""One alert for one cause: which findings of a valve are the same trouble.

What looks like a sticking stem from afar (growth of S, a position that leaves its baseline) is
evidence in its alert and none of its own. An open alert whose trouble gets another name stays the
same one, and so does one whose trouble comes back soon. Pure functions.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from stemwatch.models.verdict import Verdict
from stemwatch.service.alerts.rules import ValveRecord, cause
from stemwatch.service.alerts.when_over import same_since
from stemwatch.service.config.service_schema import AlertRules
from stemwatch.service.store.alerts.alerts import AlertKind, RaisedAlert
from stemwatch.service.store.screenings.records import JudgedScreening

# What may stand behind one cause, the finding that says most first. Growth of S and a position that
# leaves its baseline are what a sticking stem or an effect beside friction looks like from afar.
LEADS = (
    AlertKind.STICKY,
    AlertKind.MISMATCH,
    AlertKind.FORESEEN,
    AlertKind.GROWN,
    AlertKind.BASELINE,
    AlertKind.SUSPECTED,
)
FOLLOWS = {
    AlertKind.FORESEEN: (AlertKind.STICKY,),
    AlertKind.GROWN: (AlertKind.STICKY, AlertKind.FORESEEN),
    AlertKind.BASELINE: (
        AlertKind.STICKY,
        AlertKind.MISMATCH,
        AlertKind.FORESEEN,
        AlertKind.GROWN,
    ),
    AlertKind.SUSPECTED: (AlertKind.STICKY,),
}

# What is the same trouble under another name, where the one replaces the other in the windows.
RENAMED = {
    AlertKind.STICKY: (AlertKind.MISMATCH,),
    AlertKind.MISMATCH: (AlertKind.STICKY, AlertKind.FORESEEN),
}

# Kinds of which one that comes back soon may be the trouble that another told.
SAME_TROUBLE = {
    kind: frozenset(
        other
        for other in LEADS
        if other is kind
        or kind in (*FOLLOWS.get(other, ()), *RENAMED.get(other, ()))
        or other in (*FOLLOWS.get(kind, ()), *RENAMED.get(kind, ()))
    )
    for kind in LEADS
}


def with_earlier_cause(record: ValveRecord, alert: RaisedAlert) -> RaisedAlert:
    """The alert, with the causes under which the same trouble may have closed, and since when it
    must have been there for that."""
    newest = next(
        screening for screening in record.screenings if screening.id == alert.evidence["screening"]
    )
    since = same_since(newest, record.began)
    causes = tuple(cause(kind, record.valve.id) for kind in sorted(SAME_TROUBLE[alert.kind]))
    return alert if since is None else replace(alert, again=causes, again_since=since)


def faded(record: ValveRecord, rules: AlertRules) -> frozenset[AlertKind]:
    """The kinds of finding that the last windows do not tell any more (or never did): another name
    that they tell is a new one for the same trouble. After work on the valve it is another trouble,
    and so nothing counts as faded until ``of_runs`` windows are behind it."""
    judged = [
        screening
        for screening in record.screenings
        if screening.verdict is not Verdict.UNDETERMINED
    ]
    last = judged[: rules.of_runs]
    if any(_before_work(record, screening) for screening in last):
        return frozenset()
    counts = {
        AlertKind.STICKY: sum(screening.verdict is Verdict.STICKY for screening in last),
        AlertKind.MISMATCH: _named_lately(record, rules.of_runs),
        AlertKind.FORESEEN: rules.raise_after_runs if _foresees(record, rules) else 0,
    }
    return frozenset(kind for kind, count in counts.items() if count < rules.raise_after_runs)


def _before_work(record: ValveRecord, judged: JudgedScreening) -> bool:
    start, _ = judged.window
    return start is not None and any(start < work_time for work_time in record.worked_at)


def _named_lately(record: ValveRecord, of_runs: int) -> int:
    """How many of the last windows name an effect that is confirmed."""
    if record.by_window is None:
        return 0
    slugs = [finding.slug for finding in record.confirmed]
    windows = record.by_window.windows[-of_runs:]
    return sum(any(window.names(slug) for slug in slugs) for window in windows)


def _foresees(record: ValveRecord, rules: AlertRules) -> bool:
    weeks = record.weeks
    return weeks is not None and weeks.foresees_within(rules.foreseen_within_weeks) is True


def one_per_cause(
    raised: Sequence[RaisedAlert],
    still_open: Collection[str],
    past: Collection[AlertKind] = (),
) -> tuple[list[RaisedAlert], list[str]]:
    """The alerts of one valve, ``raised`` by ``apply_rules``, with one for each cause that lists
    its evidence and says under which causes it may have stood so far; and the causes that another
    alert speaks for now.

    ``still_open`` are the causes that were open before and are not over, ``past`` the kinds that
    have ``faded``.
    """
    by_kind = {alert.kind: alert for alert in raised}
    merged_into: dict[AlertKind, list[RaisedAlert]] = {}
    joined: list[str] = []
    for kind, alert in by_kind.items():
        valve = alert.valve or ""
        lead = next(
            (
                leading_kind
                for leading_kind in _leads(alert, past)
                if leading_kind in by_kind or cause(leading_kind, valve) in still_open
            ),
            None,
        )
        if lead is not None:
            merged_into.setdefault(lead, []).append(alert)
            joined.append(cause(kind, valve))
    merged_kinds = {alert.kind for alerts in merged_into.values() for alert in alerts}
    lead_kinds = [kind for kind in LEADS if kind in by_kind and kind not in merged_kinds]
    told = []
    for kind in lead_kinds:
        merged = merged_into.get(kind, ())
        former = {cause(other.kind, other.valve or "") for other in (by_kind[kind], *merged)}
        former |= {
            cause(other, by_kind[kind].valve or "")
            for other in LEADS
            if other not in lead_kinds and _is_former(other, by_kind[kind], past)
        }
        standing = sorted(former & set(still_open) - {by_kind[kind].cause})
        told.append(replace(_with_evidence(by_kind[kind], merged), formerly=tuple(standing)))
    return told, joined


def _leads(alert: RaisedAlert, past: Collection[AlertKind]) -> tuple[AlertKind, ...]:
    """The kinds of alert that speak for this one where they are open."""
    of_sticking = alert.cause == cause(AlertKind.STICKY, alert.valve or "")
    if alert.kind is AlertKind.MISMATCH and (of_sticking or AlertKind.MISMATCH in past):
        return (AlertKind.STICKY,)
    return FOLLOWS.get(alert.kind, ())


def _is_former(kind: AlertKind, alert: RaisedAlert, past: Collection[AlertKind]) -> bool:
    """Whether an open alert of ``kind`` is of the trouble that ``alert`` tells: it looked like this
    from afar, or was another name for it that the windows do not tell any more."""
    if alert.kind in FOLLOWS.get(kind, ()):
        return True
    return kind in RENAMED.get(alert.kind, ()) and kind in past


def _with_evidence(alert: RaisedAlert, merged: Sequence[RaisedAlert]) -> RaisedAlert:
    """The alert with what else points to its cause."""
    if not merged:
        return alert
    name, _, _ = alert.text.partition(": ")
    texts = [other.text.removeprefix(f"{name}: ") for other in merged]
    evidence = {
        **alert.evidence,
        "findings": [
            {"kind": other.kind.value, "text": text}
            for other, text in zip(merged, texts, strict=True)
        ],
    }
    text = f"{alert.text} Also seen: {' '.join(texts)}"
    return replace(alert, text=text, evidence=evidence)
