"""``TestSheet``: every word and number of a planned test, for terminal, page, PDF and JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from stemwatch.models.field_advice import IsolationLevel
from stemwatch.models.field_test.design import REPLICATES, DesignedTest
from stemwatch.models.field_test.plan import FREE, STICKS, STICKY, FieldTestPlan, PlanKind
from stemwatch.models.field_test.programme import Programme
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.service.presenter.physics_words import joined, rival_names
from stemwatch.service.presenter.wording import finite

VERSION = 1
LAST_WORD = "stemwatch never writes to a plant: a person sets OP."
READINGS = 4  # instants for which the sheet gives the predicted readings
READING_HOLDS_S = 4.0  # before and after, in which the predicted readings must differ too
LEAST_APART_S = 20.0  # between two of them
NAMES = {
    FREE: "a stem that moves freely",
    STICKS: f"a stem that sticks, with S of {STICKY[0]:g} %",
}
MEANINGS = {
    "": "friction explains the valve; nothing else is wrong with it that this test could show",
    FREE: "no verdict against the valve: S is well below the limits",
    STICKS: "the valve sticks; screen the window of the test for S and J with their intervals",
}

# Of a bump test: no verdict may have been possible just because the position never moved.
STILL = (
    "An MV that stands still all the time is a reading that is frozen or a stem that is stuck "
    "fast: somebody at the valve watches the stem itself and writes its travel down."
)


@dataclass(frozen=True, kw_only=True)
class OpMove:
    """Successive values of OP in one direction, or a rest.

    From ``at_s`` on OP goes to ``to`` percent in ``values`` of ``step`` percent, each held
    ``hold_s``.
    """

    at_s: float
    to: float
    change: float
    values: int
    step: float
    hold_s: float

    @property
    def shift(self) -> str:
        """The change from where OP began, with its sign."""
        return f"{self.change:+.1f}" if round(self.change, 1) else "0"

    @property
    def clock(self) -> str:
        """When it begins: minutes and seconds from the start."""
        return clock(self.at_s)

    @property
    def words(self) -> str:
        """What to do, in one line."""
        if self.step == 0.0:
            return f"leave OP for {self.values * self.hold_s:g} s"
        if self.values == 1:
            return f"set OP, hold {self.hold_s:g} s"
        return f"in {self.values} steps of {self.step:.3g} %, one every {self.hold_s:g} s"


@dataclass(frozen=True, kw_only=True)
class ReadingInstant:
    """An instant at which the rivals predict different MV: time from the start, OP, and the MV of
    each rival, percent."""

    at_s: float
    op: float
    mv: tuple[float, ...]

    @property
    def clock(self) -> str:
        """Minutes and seconds from the start."""
        return clock(self.at_s)


@dataclass(frozen=True, kw_only=True)
class RivalOutcome:
    """One rival: its name, what it means if MV follows it, and what is done then."""

    name: str
    means: str
    then: str


@dataclass(frozen=True, kw_only=True)
class TestSheet:
    """The operator's sheet. Texts are whole sentences; ``test`` is ``None`` where no test is
    possible."""

    __test__ = False  # is no test of pytest's

    valve: str
    plan: FieldTestPlan
    title: str
    headline: str
    remarks: tuple[str, ...]
    before: tuple[str, ...] = ()
    moves: tuple[OpMove, ...] = ()
    readings: tuple[ReadingInstant, ...] = ()
    outcomes: tuple[RivalOutcome, ...] = ()
    stop: tuple[str, ...] = ()
    passes: str = ""
    after: str = ""

    @property
    def test(self) -> DesignedTest | None:
        """The test, where there is one."""
        return self.plan.test

    @property
    def rivals(self) -> tuple[str, ...]:
        """The explanations between which the test decides, in words."""
        return tuple(rival_name(slug) for slug in self.plan.rivals)


def rival_name(slug: str) -> str:
    """The name of a rival model in words."""
    return NAMES.get(slug) or rival_names([slug])[0]


def clock(seconds: float) -> str:
    """``3:05`` for 185 s."""
    whole_seconds = round(seconds)
    return f"{whole_seconds // 60}:{whole_seconds % 60:02d}"


def sheet_of(plan: FieldTestPlan, valve: str) -> TestSheet:
    """The sheet of a plan for ``valve``."""
    names = tuple(rival_name(slug) for slug in plan.rivals)
    if plan.kind is PlanKind.NOTHING_LEFT:
        title = f"{valve}: no test is needed"
        sentence = (
            "Nothing is left to be told apart: the last recording names what it shows, or needs "
            "nothing beside S and J."
        )
        return TestSheet(
            valve=valve, plan=plan, title=title, headline=sentence, remarks=(LAST_WORD,)
        )
    title = f"{valve}: the test that tells {joined(names)} apart"
    if plan.kind is PlanKind.BUMP:
        title = f"{valve}: the bump test that would give a verdict"
    test = plan.test
    if not names:
        title, sentence = (
            f"{valve}: no test can be planned",
            f"No test can be planned: {plan.reason}.",
        )
        return TestSheet(
            valve=valve, plan=plan, title=title, headline=sentence, remarks=(LAST_WORD,)
        )
    if test is None:
        sentence = f"No test within these limits can tell {joined(names)} apart: {plan.reason}."
        closing_remarks = (*_wider(plan), *_over_weeks(plan), LAST_WORD)
        return TestSheet(
            valve=valve, plan=plan, title=title, headline=sentence, remarks=closing_remarks
        )
    return TestSheet(
        valve=valve,
        plan=plan,
        title=title,
        headline=_headline(plan, test, names),
        remarks=tuple(_remarks_on_test(plan, test)),
        before=tuple(_before(plan, test)),
        moves=op_moves_of(test.programme, plan.op),
        readings=readings_of(plan, test),
        outcomes=tuple(outcome_of(slug) for slug in plan.rivals),
        stop=tuple(_stop(plan, test)),
        passes=_passes(plan),
        after=_after(plan, valve),
    )


def _after(plan: FieldTestPlan, valve: str) -> str:
    export = "Export OP, MV and PV with the hour before the test and the test itself."
    if plan.kind is PlanKind.BUMP:
        return f"{export} `stemwatch screen FILE` gives the verdict, as does the next screening."
    return (
        f"{export} `stemwatch judge-test {valve} FILE --from START --to END` says which of them MV "
        "followed; `stemwatch explain FILE` and a valve's next screening try all effects."
    )


def _headline(plan: FieldTestPlan, test: DesignedTest, names: tuple[str, ...]) -> str:
    minutes = test.programme.duration_s / 60.0
    share = sureness(test)
    low, high = float(test.change.min()), float(test.change.max())
    where_text = (
        f"in {minutes:.0f} minutes with OP between {plan.op + low:.1f} and {plan.op + high:.1f} %"
    )
    if plan.kind is PlanKind.CANNOT_TELL:
        return (
            f"No test within these limits tells {joined(names)} apart: the best one, {where_text}, "
            f"finds the right one with a probability of {share}, where guessing has "
            f"{100.0 / len(names):.0f} %."
        )
    return (
        f"The right one of {joined(names)} is found with a probability of {share}, "
        f"{where_text}; each is taken to be as likely as the others."
    )


def sureness(test: DesignedTest) -> str:
    """The probability of a right decision in words; where every simulated test was decided rightly,
    the bound that their number allows (rule of three, 95 %)."""
    runs_drawn = REPLICATES * len(test.models)
    if test.probability > 1.0 - 0.5 / runs_drawn:
        return f"more than {100.0 * (1.0 - 3.0 / runs_drawn):.0f} %"
    return f"{100.0 * test.probability:.0f} %"


def _remarks_on_test(plan: FieldTestPlan, test: DesignedTest) -> Iterator[str]:
    for first, second in plan.undecided:
        yield f"This test does not tell {rival_name(first)} from {rival_name(second)}."
    yield from _wider(plan)
    yield from _over_weeks(plan)
    process = plan.question.process
    if test.upset is None:
        reason = "" if process is None else process.gain.reason or ""
        yield (
            "How PV answers OP is not known"
            + (f" ({reason})" if reason else "")
            + ": begin with the smallest step and watch PV; no limit of PV was kept."
        )
    else:
        unit = "" if process is None else f" {process.unit}".rstrip()
        limit = "" if plan.allowed_upset is None else f" (limit {plan.allowed_upset:.3g})"
        yield f"PV is expected to change by at most {test.upset:.3g}{unit}{limit}."
    if not plan.op_known:
        yield (
            "Where OP was at last is not known: the values assume 50 %, take the changes from "
            "where OP is."
        )
    else:
        yield (
            f"OP was last at {plan.op:.1f} %. Where it is elsewhere by then, take the changes, "
            "not the values."
        )
    yield LAST_WORD


def _wider(plan: FieldTestPlan) -> Iterator[str]:
    if plan.kind is not PlanKind.CANNOT_TELL or set(plan.too_slow) & set(plan.rivals):
        return
    wider = plan.wider
    if wider is None:
        yield (
            "Nor does one within four times the amplitude and three times the time that was tried: "
            "look at the valve instead, in the order of its checks."
        )
        return
    yield (
        f"A test of ±{wider.amplitude:g} % in {wider.duration_s / 60.0:g} minutes would, with a "
        f"probability of about {100.0 * min(plan.wider_probability or 0.0, 0.95):.0f} % "
        f"(--amplitude {wider.amplitude:g} --minutes {wider.duration_s / 60.0:g})."
    )


def _over_weeks(plan: FieldTestPlan) -> Iterator[str]:
    """How to detect a rival that is too slow for a test of minutes."""
    if plan.too_slow:
        yield (
            f"What would tell {joined(tuple(map(rival_name, plan.too_slow)))}: windows of weeks. "
            "Record the valve as it runs, each time as long as this recording or longer; screened "
            "into one database, its page then shows how S changes and what the windows agree on."
        )


def _before(plan: FieldTestPlan, test: DesignedTest) -> Iterator[str]:
    yield "Agree time and limits with the shift; see that nothing upstream or downstream is moved."
    yield (
        f"Record OP, MV and PV every {test.interval_s:.3g} s or faster, compression off, from now "
        "until ten minutes after."
    )
    yield f"Put the controller in manual at OP {plan.op:.1f} %; start the watch."


def _stop(plan: FieldTestPlan, test: DesignedTest) -> Iterator[str]:
    process = plan.question.process
    if plan.allowed_upset is not None:
        unit = "" if process is None else f" {process.unit}".rstrip()
        yield f"PV has changed by more than {plan.allowed_upset:.3g}{unit} from where it was."
    farthest = _farthest(plan, test)
    yield f"MV is more than {farthest:.0f} % away from where it began."
    yield "An alarm comes, or somebody needs the loop."
    yield f"To stop: OP back to {plan.op:.1f} %, and the controller to automatic."


def _farthest(plan: FieldTestPlan, test: DesignedTest) -> float:
    reach = float(np.max(np.abs(test.predicted - test.predicted[:, :1])))
    return max(1.5 * reach, plan.limits.amplitude + 2.0)


def _passes(plan: FieldTestPlan) -> str:
    sigma = plan.question.sigma
    tolerance = max(3.0 * sigma, 2.0 * plan.question.scatter, 0.2)
    passes = (
        f"Passed: at each of these instants MV is within {tolerance:.1f} % of one and the same "
        "column. Failed: it follows none of them, or another one each time; then what is wrong "
        "is not among them, and `stemwatch explain` of the recording tries all other effects."
    )
    return f"{passes} {STILL}" if plan.kind is PlanKind.BUMP else passes


def outcome_of(slug: str) -> RivalOutcome:
    """What it means if MV follows the rival ``slug``, and what is done then."""
    name = rival_name(slug)
    if slug in MEANINGS:
        return RivalOutcome(name=name, means=MEANINGS[slug], then="")
    words = catalogue()[slug].words
    first = next(
        (step.text for step in words.advice.steps if step.level is not IsolationLevel.DESK),
        words.check,
    )
    return RivalOutcome(name=name, means=words.plain, then=first)


def op_moves_of(programme: Programme, op: float) -> tuple[OpMove, ...]:
    """The values of a test programme, successive ones in one direction together."""
    legs: list[OpMove] = []
    for begin, move in zip(programme.begins_s, programme.moves, strict=True):
        last, k = 0.0, 0
        while k < len(move.changes):
            first = _rounded(move.changes[k] - last)
            end = k + 1
            while end < len(move.changes) and _same_way(
                _rounded(move.changes[end] - move.changes[end - 1]), first
            ):
                end += 1
            count, level = end - k, move.changes[end - 1]
            legs.append(
                OpMove(
                    at_s=begin + k * move.hold_s,
                    to=op + level,
                    change=level,
                    values=count,
                    step=abs(level - last) / count,
                    hold_s=move.hold_s,
                )
            )
            last, k = level, end
    return tuple(legs)


def _rounded(step: float) -> float:
    return round(step, 6)


def _same_way(step: float, first: float) -> bool:
    """Whether a step continues the first one; steps of a staircase differ by OP's resolution."""
    if first == 0.0 or step == 0.0:
        return step == first
    return (step > 0.0) == (first > 0.0) and abs(step - first) <= 0.11


def readings_of(plan: FieldTestPlan, test: DesignedTest) -> tuple[ReadingInstant, ...]:
    """The instants at which the rivals' readings lie farthest apart, in order of time."""
    predicted = test.predicted
    # A reading decides only if the two predictions nearest to each other differ.
    separation = np.min(np.diff(np.sort(predicted, axis=0), axis=0), axis=0)
    separation = separation + 0.2 * np.ptp(predicted, axis=0)
    # A slip comes a little earlier or later than predicted, so predictions must differ for some
    # seconds.
    around = max(round(READING_HOLDS_S / test.interval_s), 1)
    edges = np.pad(separation, around, constant_values=0.0)
    separation = np.lib.stride_tricks.sliding_window_view(edges, 2 * around + 1).min(axis=1)
    chosen: list[int] = []
    for k in np.argsort(-separation, kind="stable").tolist():
        if all(abs(k - other) * test.interval_s >= LEAST_APART_S for other in chosen):
            chosen.append(k)
        if len(chosen) == READINGS:
            break
    return tuple(
        ReadingInstant(
            at_s=k * test.interval_s,
            op=plan.op + float(test.change[k]),
            mv=tuple(float(value) for value in predicted[:, k]),
        )
        for k in sorted(chosen)
    )


def to_object(sheet: TestSheet) -> dict[str, Any]:
    """The plan as plain JSON types, described in docs/plan-test.md."""
    plan, test = sheet.plan, sheet.test
    limits = plan.limits
    return {
        "version": VERSION,
        "valve": sheet.valve,
        "kind": plan.kind.value,
        "rivals": list(plan.rivals),
        "too_slow": list(plan.too_slow),
        "headline": sheet.headline,
        "remarks": list(sheet.remarks),
        "limits": {
            "amplitude_percent": limits.amplitude,
            "duration_s": limits.duration_s,
            "op_low_percent": limits.op_low,
            "op_high_percent": limits.op_high,
            "pv_upset": finite(plan.allowed_upset),
        },
        "op_percent": plan.op,
        "op_known": plan.op_known,
        "probability": None if test is None else finite(test.probability),
        "wins": None if test is None else test.wins.round(3).tolist(),
        "undecided": [list(pair) for pair in plan.undecided],
        "wider": None
        if plan.wider is None
        else {
            "amplitude_percent": plan.wider.amplitude,
            "duration_s": plan.wider.duration_s,
            "probability": finite(plan.wider_probability),
        },
        "pv_upset": None if test is None else finite(test.upset),
        "pv_gain": _gain(plan),
        "duration_s": None if test is None else test.programme.duration_s,
        "values": []
        if test is None
        else [
            {
                "at_s": value.at_s,
                "op_percent": round(plan.op + value.change, 3),
                "change": value.change,
            }
            for value in test.programme.values()
        ],
        "looks": [
            {
                "at_s": reading.at_s,
                "op_percent": round(reading.op, 3),
                "mv_percent": dict(
                    zip(plan.rivals, (round(mv, 3) for mv in reading.mv), strict=True)
                ),
            }
            for reading in sheet.readings
        ],
    }


def _gain(plan: FieldTestPlan) -> dict[str, Any] | None:
    process = plan.question.process
    if process is None:
        return None
    gain = process.gain
    return {
        "value": finite(gain.value),
        "low": finite(gain.low),
        "high": finite(gain.high),
        "unit": process.unit,
        "integrating": process.integrating,
        "reason": gain.reason,
    }
