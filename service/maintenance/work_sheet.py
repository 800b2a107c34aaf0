"""``WorkSheet``: the content of one valve's page in words, which HTML, PDF and work orders lay out.

It says how sure the finding is: its confidence, how often it was seen, how often such findings are
wrong, and whether it stands among all valves of the run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import tzinfo

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import CheckStep, FieldAdvice, IsolationLevel
from stemwatch.models.screening_result import PreviousFinding, Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.config.schema import Stroke, parse_stroke
from stemwatch.service.maintenance.drawing import Drawing
from stemwatch.service.maintenance.evidence_picture import picture_of
from stemwatch.service.maintenance.first_seen import (
    FirstSeen,
    first_seen,
    seen_sentence,
    work_sentence,
)
from stemwatch.service.maintenance.valve_history import ValveHistory
from stemwatch.service.presenter import advice
from stemwatch.service.presenter.false_discoveries import LEVEL_PERCENT
from stemwatch.service.presenter.finding import PresentedFinding, field_test
from stemwatch.service.presenter.suspicion_words import worth_a_test
from stemwatch.service.presenter.urgency import Priority, priority
from stemwatch.service.presenter.wording import (
    as_sentences,
    figure,
    finite,
    interval,
    share,
    span_percent,
)
from stemwatch.service.presenter.work_decision import NO_POSITION, WorkDecision
from stemwatch.service.report.ranking import RankedValve

GENERAL_TEST = "Step OP by 1 %"  # begins the step that is the same for all sticking valves
COMPARED = frozenset({"worse", "better", "same"})
MOST_PAST = 5  # earlier screenings in the table
MEANING = {
    "S": "dead band + stick band: how far OP moves after a turn before the stem lets go",
    "J": "slip jump: how far the stem then jumps at once",
}
# Counted on simulated valves that took no part in choosing the limits: the tables of docs/trial.md
# and docs/proof.md, which a test compares.
FALSE_STICKY = (1, 240, "0.1 to 2.3 %")
FALSE_EFFECT = (0, 54, "0.0 to 6.6 %")
FALSE_EFFECT_SCATTERED = (2, 62, "0.9 to 11.0 %")
STANDS = (
    "What is named beside friction stands among all valves of the run: of such findings at most "
    f"{LEVEL_PERCENT} are expected to be due to chance."
)


@dataclass(frozen=True, kw_only=True)
class Size:
    """S or J as it is printed. ``percent`` of OP span; ``travel`` in the stroke's own unit."""

    name: str
    meaning: str
    percent: str
    interval: str
    travel: str


@dataclass(frozen=True, kw_only=True)
class WorkSheet:
    """The page of one valve. Texts are as they came; who draws them makes them printable.

    ``finding`` is the finding in words, ``advice`` that of the kind to act on first. ``picture`` is
    ``None`` where there are no samples; ``picture_note`` says what is drawn or why nothing is.
    """

    valve: RankedValve
    finding: PresentedFinding
    advice: FieldAdvice
    sizes: tuple[Size, ...]
    stroke_note: str
    steps: tuple[CheckStep, ...]
    parts: tuple[str, ...]
    isolation: tuple[tuple[IsolationLevel, str], ...]
    since: FirstSeen
    since_said: tuple[str, ...]
    past: tuple[PreviousFinding, ...]
    sure: tuple[str, ...]
    priority: Priority
    picture: Drawing | None
    picture_note: str
    run: int | None = None

    @property
    def screening(self) -> Screening:
        """The screening that the page is about."""
        return self.valve.screening

    @property
    def recording(self) -> str:
        """Which of the valve's recordings it is about; empty where there is only one."""
        if not self.valve.recording:
            return ""
        return f"The most urgent of {self.valve.recordings} recordings: {self.valve.recording}"

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of finding, the one to act on first at the front."""
        return self.finding.decision.kinds

    @property
    def title(self) -> str:
        """The finding in at most 30 letters."""
        return self.finding.title

    @property
    def has_order(self) -> bool:
        """Whether it makes a work order."""
        return self.finding.decision.has_order


def work_sheet_of(valve: RankedValve, background: ValveHistory, zone: tzinfo) -> WorkSheet:
    """The page of ``valve``."""
    screening, finding = valve.screening, valve.finding
    kinds = finding.decision.kinds
    earlier = background.earlier(screening)
    since = first_seen(kinds[0], earlier)
    steps = _with_field_test(advice.steps_for(kinds), field_test(screening))
    told = screening.without_position
    if told is not None and kinds[0] == NO_POSITION and worth_a_test(screening):
        # As alert and page say: what was found is the suspicion, not that a transmitter is missing.
        steps = (CheckStep(IsolationLevel.MANUAL, told.advice), *steps)
    picture, note = picture_of(screening, background.samples(screening), zone)
    sizes, stroke_note = sizes_of(screening, valve.facts.stroke)
    return WorkSheet(
        valve=replace(valve, screening=screening.without_samples()),
        finding=finding,
        advice=advice.advice_for(kinds[0]),
        sizes=sizes,
        stroke_note=stroke_note,
        steps=steps,
        parts=advice.parts_for(kinds),
        isolation=advice.isolation_for(steps),
        since=since,
        since_said=_since(since, valve, background, zone),
        past=tuple(earlier[:MOST_PAST]),
        sure=how_sure(valve, since),
        priority=priority(finding.decision.severity, valve.facts.criticality),
        picture=picture,
        picture_note=note,
        run=background.run,
    )


def _with_field_test(steps: tuple[CheckStep, ...], test: str) -> tuple[CheckStep, ...]:
    """The steps, with the test of this valve's own size in place of the one for all valves."""
    test_index = next(
        (k for k, step in enumerate(steps) if step.text.startswith(GENERAL_TEST)), None
    )
    if test_index is None or not test:
        return steps
    return (*steps[:test_index], replace(steps[test_index], text=test), *steps[test_index + 1 :])


def sizes_of(screening: Screening, stroke: str) -> tuple[tuple[Size, ...], str]:
    """S and J, each with its travel, and how that was reckoned.

    Travel is S or J in percent of OP times the slope of the curve from OP to stroke (1 where there
    is none) times the stroke.
    """
    full, curve = _stroke(stroke), screening.stroke_curve
    slope_is_known = full is not None and (curve is None or curve.slope_known)
    slope = 1.0 if curve is None else abs(curve.slope)
    sizes = tuple(
        _size(name, getattr(screening, name), full, slope, slope_is_known) for name in MEANING
    )
    if full is None:
        return sizes, "The plant file gives no stroke, so there is no travel in mm or degrees."
    if not slope_is_known:
        return sizes, "No travel: how far a percent of OP moves this valve is not known."
    note = f"Travel: of a stroke of {full}, 100 % of OP taken as the whole of it."
    if curve is not None:
        note = (
            f"Travel: of a stroke of {full}; 1 % of OP moves the stem {figure(slope, 2)} % of it, "
            "by the curve from OP to stroke."
        )
    return sizes, note if any(size.travel for size in sizes) else ""


def _stroke(text: str) -> Stroke | None:
    try:
        return parse_stroke(text) if text else None
    except ValueError:  # the plant file checks the stroke; another caller may not
        return None


def _size(
    name: str, estimate: Estimate, full: Stroke | None, slope: float, slope_is_known: bool
) -> Size:
    value = finite(estimate.value)
    return Size(
        name=name,
        meaning=MEANING[name],
        percent="not known" if value is None else f"{span_percent(value)} %",
        interval=f"{interval(estimate)} %" if value is not None and interval(estimate) else "",
        travel=(
            full.of_percent(slope * value)
            if slope_is_known and full is not None and value is not None
            else ""
        ),
    )


def _since(
    seen: FirstSeen, valve: RankedValve, background: ValveHistory, zone: tzinfo
) -> tuple[str, ...]:
    screening, by_window = valve.screening, valve.facts.by_window
    seen_since = seen.first.at if seen.first is not None else screening.window[1]
    work = background.work(screening.valve)
    sentences: tuple[str, ...] = (
        seen_sentence(seen, zone),
        work_sentence(work, seen_since, screening.window[0], zone),
        _trend(valve),
    )
    if by_window is not None:
        sentences += by_window.sentences(zone)
    return tuple(sentence for sentence in sentences if sentence)


def _trend(valve: RankedValve) -> str:
    """How it goes since the last run; empty where there is none to compare it with."""
    return f"Trend: {valve.trend.words}." if valve.trend.direction in COMPARED else ""


def brief_of(valve: RankedValve) -> str:
    """One line for a valve that gets no page."""
    screening = valve.screening
    if screening.verdict is Verdict.UNDETERMINED:
        return f"{screening.reason} {valve.finding.next_step}".rstrip()
    S = finite(screening.S.value)
    size_clause = "" if S is None else f", S {span_percent(S)} %"
    return f"{valve.finding.meaning}{size_clause}; trend: {valve.trend.words}"


def how_sure(valve: RankedValve, seen: FirstSeen) -> tuple[str, ...]:
    """One sentence for each source of doubt, the nearest first."""
    screening = valve.screening
    sentences = [_confidence(valve.decision), _seen_often(seen), _wrong_of_sticky(screening)]
    if valve.stands is not None:
        sentences.append(valve.finding.held_back or STANDS)
        sentences.append(_rate("simulated valves with nothing hidden, yet named", *FALSE_EFFECT))
        sentences.append(_rate("the same where breakaways scatter", *FALSE_EFFECT_SCATTERED))
    sentences.append(_data(screening))
    return tuple(sentence for sentence in sentences if sentence)


def _confidence(decision: WorkDecision) -> str:
    if decision.confidence is None:
        return ""
    return f"Confidence in the verdict {decision.verdict.value}: {share(decision.confidence)}."


def _seen_often(seen: FirstSeen) -> str:
    if seen.count == 1:
        return "One screening shows it; a second one would make it firmer."
    return f"{seen.count} screenings in a row show it."


def _wrong_of_sticky(screening: Screening) -> str:
    if screening.verdict is not Verdict.STICKY:
        return ""
    return _rate("simulated healthy valves, called sticky", *FALSE_STICKY)


def _rate(statement: str, count: int, total: int, interval: str) -> str:
    return (
        f"Published false alarms: {statement}: {count} of {total} ({100 * count / total:.1f} %, "
        f"{interval})."
    )


def _data(screening: Screening) -> str:
    quality = screening.quality
    return f"Data grade {quality.grade}. {as_sentences(quality.reasons)}".rstrip()
