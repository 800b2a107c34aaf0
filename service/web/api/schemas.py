"""What the API gives: every field with its unit. Times are ISO 8601 in UTC, percent is of span."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from pydantic import AwareDatetime, BaseModel, Field

from stemwatch.service.store.accounts.records import AuditOutcome, Scope, UserRole

Percent = float | None
FOR_WHOM = "for whom a program acts; kept beside the name of whoever is signed in"


class Refusal(BaseModel):
    """Why there is no answer, in one sentence."""

    detail: str


REFUSALS: dict[int | str, dict[str, Any]] = {
    404: {"model": Refusal, "description": "There is no such valve, alert or run."},
    409: {"model": Refusal, "description": "It cannot be done now."},
    422: {"model": Refusal, "description": "What was sent is not what is expected."},
}


class Estimated(BaseModel):
    """A number with its 95 % interval, or the reason why there is none."""

    value: float | None = None
    low: float | None = None
    high: float | None = None
    reason: str | None = None


class ValveLine(BaseModel):
    """A valve with its latest finding; ``verdict`` is null where it was not screened yet."""

    valve: str
    description: str
    site: str
    area: str
    unit: str
    loop: str
    criticality: int = Field(description="1 to 3; 3 is what the plant can least do without")
    verdict: str | None = Field(description="sticky, defective, watch, undetermined or healthy")
    ne107: str | None = Field(description="state by NAMUR NE 107; null where undetermined")
    stem_verdict: str | None = Field(description="what S and J alone say; never defective")
    at: datetime | None = Field(description="end of the window that the finding speaks for")
    severity: float = Field(description="0 to 100")
    priority: int | None = Field(
        description="1 (most urgent) to 4, null for a valve without a work order"
    )
    confidence: float | None = Field(description="in the verdict, 0 to 1; null where defective")
    stem_confidence: float | None = Field(description="in the stem's verdict, 0 to 1")
    grade: str = Field(description="data quality, A to D; empty where not screened")
    shape: str | None
    S: Estimated = Field(description="dead band plus stick band, percent of OP span")
    J: Estimated = Field(description="slip jump, percent of OP span")
    cost_per_month: Estimated | None = Field(
        description="money that its sticking costs, 90 % interval; null without a price"
    )
    left_out: list[str] = Field(
        description="effects beside S and J, what needs work first at the front"
    )
    held_back: bool = Field(description="across all valves chance alone may have named left_out")


class RankingAnswer(BaseModel):
    """One page of the ranking."""

    total: int
    page: int
    size: int
    counts: dict[str, int] = Field(description="valves of each verdict before that filter")
    valves: list[ValveLine]


class OscillationMember(BaseModel):
    """A loop that oscillates with others."""

    loop: str
    share: float = Field(description="of the variance of its PV, 0 to 1")
    probability: float = Field(description="that the oscillation begins here, 0 to 1")
    evidence: list[str] = Field(description="what speaks for that")


class OscillationAnswer(BaseModel):
    """Loops that oscillate together, the likeliest source first."""

    period_s: float
    source: str | None = Field(description="the likeliest loop; null where a cause outside is")
    outside_probability: float = Field(description="that none of these loops is the source")
    members: list[OscillationMember]
    since: datetime | None = Field(description="null where it always did or nobody knows")
    first_found: datetime | None = Field(description="start of the first window that had it")
    windows: int = Field(description="in how many windows running it was found")
    until: datetime = Field(description="end of the newest of them")
    over: bool = Field(description="a later run over the same loops did not find it again")


class NextStepAnswer(BaseModel):
    """What to do next at loops of which OP and PV alone say the same, those to test first first."""

    verdict: str = Field(
        description="suspected, cannot_tell or no_sign; not a verdict on the valve"
    )
    why: str = Field(description="why nothing can be told; empty where something can")
    step: str = Field(description="what to do")
    loops: list[str] = Field(description="those that look most like sticking first")


class Trace(BaseModel):
    """Points of one signal; null breaks the line."""

    role: str
    label: str
    tag: str
    unit: str
    at_s: list[float] = Field(description="seconds since 1970 UTC")
    values: list[float | None]


class SignalsAnswer(BaseModel):
    """Signals over time, thinned to their lowest and highest where there are more samples."""

    valve: str
    start_s: float
    stop_s: float
    first_s: float | None = Field(description="the first sample there is at all")
    last_s: float | None
    bucket_s: float = Field(description="what a pair of points stands for; 0: every sample")
    traces: list[Trace]
    says: str = Field(description="why there is nothing, in one sentence; empty otherwise")


class LoopTrace(BaseModel):
    """One path against OP."""

    role: str
    label: str
    values: list[float | None]


class LoopShape(BaseModel):
    """The curve from OP to stroke as a line, or the stick band of S and J by its corners."""

    role: str
    label: str
    op: list[float]
    values: list[float]


class LoopAnswer(BaseModel):
    """MV (PV where there is no MV) against OP, instant by instant."""

    valve: str
    start_s: float
    stop_s: float
    op: list[float | None]
    at_s: list[float]
    y: str
    y_unit: str
    thinned: int = Field(description="samples a point stands for")
    traces: list[LoopTrace]
    shapes: list[LoopShape] = []
    curve_says: str = Field(default="", description="the curve from OP to stroke in a sentence")
    says: str = Field(description="which stretch is drawn and why, or why there is nothing")


class HistoryLine(BaseModel):
    """S and J of one screening, in percent of OP span."""

    at: datetime
    verdict: str
    S: Percent
    S_low: Percent
    S_high: Percent
    J: Percent
    J_low: Percent
    J_high: Percent
    severity: float
    grade: str
    run: int
    baseline: int | None = Field(description="number of the baseline it was compared with")


class Mark(BaseModel):
    """Something that happened to a valve: a baseline, work, a note."""

    kind: str
    at: datetime
    text: str
    who: str = ""


class HistoryAnswer(BaseModel):
    """S and J over time, what they are measured against, and what happened in between."""

    valve: str
    watch_S_percent: float
    sticky_S_percent: float
    points: list[HistoryLine]
    marks: list[Mark]


class AlertLine(BaseModel):
    """An alert as it stands now."""

    id: int
    state: str = Field(description="open, acknowledged, snoozed, closed or false")
    kind: str
    severity: str
    valve: str | None
    source: str | None
    text: str = Field(description="of the newest window that shows the finding")
    S: float | None = Field(description="in that window, percent of OP span")
    S_when_raised: float | None = Field(description="in the window for which it was raised first")
    first_step: str = Field(description="what to do first; empty where an older version raised it")
    opened: datetime
    seen: datetime = Field(description="when its cause was last found")
    opened_again: datetime | None = Field(
        description="when the same trouble came back and opened it again, the last time"
    )
    closed: datetime | None
    closed_why: str
    acknowledged: datetime | None
    acknowledged_by: str
    comment: str
    snoozed_until: datetime | None
    false_alarm: bool


class ChangesAnswer(BaseModel):
    """What a page compares with what it saw before: the newest runs with state and valves done, and
    how many alerts are open."""

    runs: list[str]
    open_alerts: int


class RunAnswer(BaseModel):
    """A run that waits, goes on or is over."""

    id: int
    state: str
    schedule: str | None
    who: str
    started: datetime
    finished: datetime | None
    total: int
    done: int
    set_aside: int
    left_s: float | None = Field(description="seconds to go, where anything tells")
    reason: str
    counts: dict[str, int]


class SourceAnswer(BaseModel):
    """How a source of data is doing."""

    source: str
    kind: str
    address: str
    updated: datetime
    last_good: datetime | None
    connected: bool
    fault: str
    figures: dict[str, float | None]


class ScheduleAnswer(BaseModel):
    """When which valves are screened; no areas, units and valves mean all."""

    name: str
    cron: str | None
    every_s: float | None
    window_s: float | None
    areas: list[str]
    units: list[str]
    valves: list[str]
    enabled: bool
    last_due: datetime | None
    next_due: datetime | None


class CheckAnswer(BaseModel):
    """One part of the service and whether it works."""

    name: str
    ok: bool
    says: str


class HealthAnswer(BaseModel):
    """Whether the service works."""

    ok: bool
    version: str
    checks: list[CheckAnswer]


class Signed(BaseModel):
    """Who asks, and what is to be remembered with it."""

    who: str = Field(default="", max_length=200, description=FOR_WHOM)
    text: str = Field(default="", max_length=2000)


class AskRun(BaseModel):
    """A run over these valves, or all where there are none."""

    valves: list[str] = Field(default=[], max_length=5000)
    who: str = Field(default="", max_length=200, description=FOR_WHOM)


class AskSnooze(BaseModel):
    """Until when an alert rests."""

    until: AwareDatetime
    who: str = Field(default="", max_length=200, description=FOR_WHOM)


class AskRemark(Signed):
    """A note, or work on a valve; ``at`` is now where it is left out."""

    at: AwareDatetime | None = None


class AskFeedback(AskRemark):
    """Whether what a screening said was right (``judgement``: right, wrong, partly right), and what
    was found, in ``text``; ``screening`` is the number of the screening, else the valve's last."""

    judgement: str = Field(max_length=40)
    screening: int | None = Field(default=None, ge=1)


class Done(BaseModel):
    """What was done; ``id`` numbers what came of it, where it has one."""

    done: str
    id: int | None = None


class MeAnswer(BaseModel):
    """Who asks, as the service sees it."""

    name: str
    role: UserRole
    how: str = Field(description="session, or the name of the token")
    scopes: list[Scope] | None = Field(description="of a token; null for a session")
    may: list[str] = Field(description="the operations that are allowed")


class AuditLine(BaseModel):
    """One entry of the audit log."""

    id: int
    at: datetime
    who: str = Field(description="empty where nobody was signed in")
    how: str
    address: str
    action: str
    about: str
    outcome: AuditOutcome
    detail: str
