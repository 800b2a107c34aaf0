"""The joint evidence of a valve's windows over weeks, in the words and for the picture that report,
pages, work orders and alerts share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, date, datetime, tzinfo

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.evidence_over_windows import (
    MEMORY,
    FindingState,
    LastingFinding,
    WindowEvidence,
    lasting_findings,
    pooled_stiction,
    windows_that_count,
)
from stemwatch.models.history.trend_over_weeks import TrendOverWeeks, trend_of_size
from stemwatch.models.mismatch.findings import Mismatch, Stiction
from stemwatch.models.words import capitalised
from stemwatch.service.presenter.physics_words import effect_name, parameter_name
from stemwatch.service.presenter.wording import interval, span_percent

MOST_SHOWN = 30  # windows of the picture, the newest

POOLED_NOT_USED = (
    "an alternative, since of a valve and window the S and J of the verdict count, from the "
    "stretch in which OP moves most"
)


@dataclass(frozen=True, kw_only=True)
class EvidenceOfWeeks:
    """``windows`` are those that count, in order of time; ``findings`` are sorted, those that hold
    first; ``pooled`` is S and J over the windows that name exactly the effects that hold;
    ``recording_began`` is the beginning of the recording where all windows are parts of one.
    ``by_whole`` has the effects that this recording names as a whole and that its windows gain
    by."""

    windows: tuple[WindowEvidence, ...]
    findings: tuple[LastingFinding, ...]
    pooled: Stiction | None = None
    recording_began: datetime | None = None
    by_whole: tuple[str, ...] = ()

    @property
    def confirmed(self) -> tuple[LastingFinding, ...]:
        """The findings that hold now."""
        return tuple(finding for finding in self.findings if finding.holds)

    @property
    def decides(self) -> bool:
        """Whether the valve has a history: an effect was tested in more than one window, so that
        work follows the joint evidence and not the newest window alone."""
        return any(finding.of > 1 for finding in self.findings)

    @property
    def first_seen(self) -> tuple[LastingFinding, ...]:
        """The findings that one window named and no other has confirmed."""
        return tuple(
            finding for finding in self.findings if finding.state is FindingState.FIRST_SEEN
        )

    @property
    def of_one_recording(self) -> bool:
        """Whether all windows are parts of one recording."""
        return self.recording_began is not None

    @property
    def p_value(self) -> float | None:
        """The smallest p value of what is confirmed; ``None`` where nothing is."""
        return min((finding.p_value for finding in self.confirmed), default=None)

    def in_order_of_work(self, newest: Mismatch | None) -> tuple[LastingFinding, ...]:
        """The confirmed findings, in the order of the ``newest`` window as far as it names them."""
        named = [] if newest is None else [effect.slug for effect in newest.effects]
        place = {slug: number for number, slug in enumerate(named)}
        return tuple(
            sorted(self.confirmed, key=lambda lasting: place.get(lasting.slug, len(place)))
        )

    def in_short(self, newest: Mismatch | None, zone: tzinfo = UTC) -> str:
        """The confirmed effects, in the words of the ``newest`` window where it names them too."""
        confirmed = self.in_order_of_work(newest)
        effects = {effect.slug: effect for effect in newest.effects} if newest is not None else {}
        own_words = [
            effects[lasting.slug].sentence for lasting in confirmed[:1] if lasting.slug in effects
        ]
        sentences = [*own_words, *(finding_sentence(finding, zone) for finding in confirmed)]
        return " ".join(sentence for sentence in sentences if sentence)

    @property
    def shown(self) -> tuple[WindowEvidence, ...]:
        """The windows of the picture."""
        return self.windows[-MOST_SHOWN:]

    def sentences(self, zone: tzinfo = UTC) -> tuple[str, ...]:
        """One sentence for each finding, and one for S and J where they are pooled."""
        if self.of_one_recording:
            sentences = [
                _within_recording(finding, finding.slug in self.by_whole)
                for finding in self.findings
            ]
            sentences = sentences or [
                f"None of {len(self.windows)} windows of the recording names anything."
            ]
        else:
            sentences = [self.sentence_of(finding, zone) for finding in self.findings]
        return (*sentences, *([self.pooled_sentence] if self.pooled is not None else []))

    def sentence_of(self, finding: LastingFinding, zone: tzinfo = UTC) -> str:
        """One finding in a sentence, and how its size goes over the weeks."""
        sentence, trends = finding_sentence(finding, zone), [*self.size_trends(finding).values()]
        if not trends:
            return sentence
        if changes := [trend.words for trend in trends if trend.is_change]:
            return f"{sentence} Over the weeks: {', '.join(changes)}."
        return f"{sentence} Over the weeks: {trends[0].words}, no more than its scatter."

    def size_trends(self, finding: LastingFinding) -> dict[str, TrendOverWeeks]:
        """How the numbers of a confirmed effect go, by name, from the windows that name it since
        the last work on the valve, the last one of each day; those with days enough."""
        by_day: dict[str, dict[date, Estimate]] = {}
        for window in self.windows if finding.holds and not self.of_one_recording else ():
            for (slug, name), size in window.sizes.items():
                if slug == finding.slug:
                    by_day.setdefault(name, {})[window.at.date()] = size
        trends = {
            name: trend_of_size(parameter_name(name, finding.slug), sizes)
            for name, sizes in by_day.items()
        }
        return {name: trend for name, trend in trends.items() if trend is not None}

    @property
    def pooled_over(self) -> str:
        """The windows that S and J are pooled over."""
        if not self.of_one_recording:
            return "the windows that name it"
        return f"the windows that name {'just that' if self.confirmed else 'nothing'}"

    @property
    def pooled_sentence(self) -> str:
        """S and J over the windows; empty where there are too few of them."""
        if self.pooled is None:
            return ""
        S, J = self.pooled.S, self.pooled.J
        text = (
            f"Over {self.pooled_over}, S is {span_percent(S.value)} % ({interval(S)}) and "
            f"J {span_percent(J.value)} % ({interval(J)})"
        )
        return f"{text}: {POOLED_NOT_USED}." if self.of_one_recording else f"{text}."


def evidence_of_weeks(windows: Iterable[WindowEvidence]) -> EvidenceOfWeeks | None:
    """The joint evidence of ``windows`` of one valve; ``None`` where no effect was tested in
    them."""
    counting = tuple(windows_that_count(windows))
    findings = lasting_findings(counting)
    if not findings:
        return None
    any_holds = any(finding.holds for finding in findings)
    pooled = pooled_stiction(counting, findings) if any_holds else None
    return EvidenceOfWeeks(windows=counting, findings=findings, pooled=pooled)


def finding_sentence(finding: LastingFinding, zone: tzinfo = UTC) -> str:
    """One finding in a sentence: since when, and how sure."""
    name = capitalised(effect_name(finding.slug))
    text = f"{name}: first seen on {_day(finding.first_seen, zone)}"
    if finding.state is FindingState.FIRST_SEEN:
        if finding.of == 1:
            return f"{text}, in the only window that counts so far; another one must confirm it."
        return f"{text}, in {_count_text(finding)}; not confirmed yet."
    if finding.state is FindingState.GONE:
        assert finding.confirmed is not None
        return (
            f"{text} and confirmed on {_day(finding.confirmed, zone)}; gone: last seen on "
            f"{_day(finding.last_seen, zone)}, and not in the windows since."
        )
    if finding.named == 1:
        return (
            f"{text}, named in {_count_text(finding)} and confirmed by what it gains in the others."
        )
    return f"{text}, confirmed in {_count_text(finding)}."


def _within_recording(finding: LastingFinding, by_whole: bool) -> str:
    """One finding of a recording that was explained as several windows, and ``by_whole`` as one."""
    name = capitalised(effect_name(finding.slug))
    if by_whole:
        name_it = "names it" if finding.named == 1 else "name it"
        return (
            f"{name}: named in the recording as a whole, and confirmed by what {finding.of} "
            f"windows of it gain together, {finding.named} of which {name_it}."
        )
    sentence = f"{name}: named in {finding.named} of {finding.of} windows"
    if finding.state is FindingState.FIRST_SEEN:
        return f"{sentence} of the recording, which the others do not confirm."
    if finding.state is FindingState.GONE:
        return f"{sentence} of the recording, and in none of the last ones."
    gain_clause = ", and confirmed by what it gains in the others" if finding.named == 1 else ""
    return f"{sentence} of the recording{gain_clause or ', which confirms it'}."


def _count_text(finding: LastingFinding) -> str:
    """``5 of 8 windows``: the last ones, where there were more."""
    last = "the last " if finding.of == MEMORY else ""
    return f"{finding.named} of {last}{finding.of} windows"


def _day(instant: datetime, zone: tzinfo) -> str:
    return instant.astimezone(zone).strftime("%Y-%m-%d")
