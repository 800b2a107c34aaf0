"""The values that a page shows of one mismatch: pictures, bars, and the residual in each part of
the record (facet), before and after."""

from __future__ import annotations

import math
from dataclasses import dataclass

from markupsafe import Markup

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import (
    Cell,
    Finding,
    Gain,
    Mismatch,
    Stiction,
    TriedOutcome,
)
from stemwatch.models.recording import Recording
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks
from stemwatch.service.presenter.physics_words import (
    OUTCOME_MEANING,
    effect_name,
    facet_title,
)
from stemwatch.service.presenter.wording import finite
from stemwatch.service.report.charts.effect_pictures import effect_pictures
from stemwatch.service.report.charts.small_plot import Picture
from stemwatch.service.report.charts.traces import Chart
from stemwatch.service.report.charts.valve_charts import overlay_of
from stemwatch.service.report.heatmap import heat_map, largest


@dataclass(frozen=True, kw_only=True)
class MismatchView:
    """``mismatch`` with its pictures; ``anchor`` and ``tag`` name the valve in the page.

    ``S`` and ``J`` are those of the valve, the only ones that count on a page; ``alternatives`` are
    other estimates, each with the reason why it is not used. ``held_back`` is why its effects do
    not stand among all valves of the run; empty where they do. ``in_words``: without pictures and
    numbers.
    """

    mismatch: Mismatch
    anchor: str
    tag: str
    before: Markup | None
    after: Markup | None
    top: float  # rms in percent of span at the full colour of both maps
    facets: tuple[FacetBars, ...]
    overlay: Chart | None
    pictures: tuple[Picture, ...]
    S: Estimate
    J: Estimate
    alternatives: tuple[Alternative, ...] = ()
    held_back: str = ""
    in_words: bool = False

    @property
    def brief(self) -> bool:
        """Whether words are enough: nothing was left out, nothing could be tested, or there is no
        room for more."""
        return self.in_words or self.mismatch.finding in (Finding.NONE, Finding.NOT_TESTABLE)


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """Estimates of S and J that do not count, and how they were obtained."""

    of: str
    stiction: Stiction


@dataclass(frozen=True, kw_only=True)
class ResidualBar:
    """One bar of the fit: ``rmse`` in percent of span, ``length`` in percent of the longest."""

    kind: str
    name: str
    rmse: float
    fit_percent: float | None
    length: float


def mismatch_view(
    mismatch: Mismatch,
    recording: Recording | None,
    anchor: str,
    tag: str,
    held_back: str = "",
    overlay: Chart | None = None,
    counts: tuple[Estimate, Estimate] | None = None,
    pictures: tuple[Picture, ...] = (),
    by_window: EvidenceOfWeeks | None = None,
    *,
    in_words: bool = False,
) -> MismatchView:
    """The view of ``mismatch``; without ``recording`` with the ``overlay`` and the ``pictures``
    given, if any.

    ``counts`` are the valve's S and J from a screening; without them those of the mismatch are
    used. ``by_window`` is set where the recording was explained as several windows.
    """
    S, J = counts or (mismatch.restated.S, mismatch.restated.J)
    maps = _NO_MAPS if in_words else _both_maps(mismatch, tag)
    return MismatchView(
        mismatch=mismatch,
        anchor=anchor,
        tag=tag,
        before=maps[0],
        after=maps[1],
        top=maps[2],
        facets=() if in_words else tuple(facet_bars(mismatch)),
        overlay=overlay_of(recording, mismatch.runs) or overlay,
        pictures=effect_pictures(recording, mismatch) or pictures,
        S=S,
        J=J,
        alternatives=alternatives_of(mismatch, S, J, by_window),
        held_back=held_back,
        in_words=in_words,
    )


_Maps = tuple[Markup | None, Markup | None, float]
_NO_MAPS: _Maps = (None, None, 0.0)


def _both_maps(mismatch: Mismatch, tag: str) -> _Maps:
    """Of the residual before and after, and the end of their common scale."""
    top = largest(mismatch.before, mismatch.after)
    return (
        heat_map(mismatch.before, top, f"Residual of S and J alone, {tag}"),
        heat_map(mismatch.after, top, f"Residual of the extended model, {tag}"),
        top,
    )


def alternatives_of(
    mismatch: Mismatch, S: Estimate, J: Estimate, by_window: EvidenceOfWeeks | None = None
) -> tuple[Alternative, ...]:
    """What else was read than the valve's ``S`` and ``J``, and of what: over the windows of a long
    recording, and by the fit of S and J alone."""
    others: list[Alternative] = []
    if by_window is not None and by_window.pooled is not None:
        others.append(Alternative(of=f"over {by_window.pooled_over}", stiction=by_window.pooled))
    if (mismatch.naive.S, mismatch.naive.J) != (S, J):
        if by_window is not None:
            of = "S and J alone, in the window that is shown"
        elif mismatch.effects:
            of = "S and J alone, without what was named"
        else:
            of = "the fit that physics beside friction was looked for from"
        others.append(Alternative(of=of, stiction=mismatch.naive))
    return tuple(others)


def residual_bars(mismatch: Mismatch) -> list[ResidualBar]:
    """Rmse before and after beside what is systematic at all and the noise; known ones only.

    "After" is listed where it differs. A model with a smaller error than the estimated noise gives
    an upper bound of the noise, which is shown instead; a network that a model beats is not called
    a ceiling.
    """
    heldout = mismatch.heldout
    before, ceiling = finite(heldout.rmse_naive), finite(heldout.rmse_ceiling)
    after = finite(heldout.rmse_extended)
    if after == before and not mismatch.effects:
        after = None
    noise = finite(heldout.noise_floor)
    nearest = min((rmse for rmse in (before, after, ceiling) if rmse is not None), default=math.inf)
    network = "NARX network, the ceiling"
    if ceiling is not None and nearest < ceiling:
        network = "NARX network"
    floor, floor_name = noise, "noise floor"
    if noise is not None and nearest < noise:
        # The nearest model leaves noise at least, so what it leaves is all that is known of it.
        floor, floor_name = nearest, "noise, no more than the nearest model's"
    rows = (
        ("naive", "S and J alone", before, heldout.fit_naive),
        ("extended", _after(mismatch), after, heldout.fit_extended),
        ("narx", network, ceiling, None),
        ("floor", floor_name, floor, None),
    )
    rows_with_rmse = [
        (*row[:2], rmse, row[3]) for row in rows if (rmse := finite(row[2])) is not None
    ]
    longest = max((rmse for _, _, rmse, _ in rows_with_rmse), default=0.0)
    return [
        ResidualBar(
            kind=kind,
            name=name,
            rmse=rmse,
            fit_percent=finite(fit),
            length=round(100.0 * rmse / longest, 1) if longest > 0.0 else 0.0,
        )
        for kind, name, rmse, fit in rows_with_rmse
    ]


def how_both_ran(mismatch: Mismatch) -> str:
    """How the two models ran whose errors are shown, a clause; the pictures have these runs too."""
    if mismatch.heldout.alternate_blocks:
        return (
            "of free runs over every other block of time: both models, in the pictures too, were "
            "fitted to the blocks between, as the first part cannot foretell what changes along "
            "the recording, or acts in few places"
        )
    if not mismatch.heldout.slip_by_slip:
        return "of free runs"
    return (
        "slip by slip: both models, in the pictures too, let go where the stem was seen to, as a "
        "free run that misses single breakaways is soon a slip ahead or behind"
    )


def _after(mismatch: Mismatch) -> str:
    """What the model contains beside S and J."""
    return "with what was left out" if mismatch.effects else "with the reading's zero and gain"


@dataclass(frozen=True, kw_only=True)
class GainRow:
    """By how much one effect, or all together, reduce the error on held-out blocks, in percent:
    ``alone`` relative to S and J, ``besides`` relative to a model with all other effects."""

    name: str
    alone: Gain | None
    besides: Gain | None


def gain_rows(mismatch: Mismatch) -> list[GainRow]:
    """Each named effect and, where they are several, all together; empty where nothing is named."""
    gain_alone = {tried.slug: tried.alone for tried in mismatch.tried}
    rows = [
        GainRow(
            name=effect_name(effect.slug),
            alone=gain_alone.get(effect.slug),
            besides=Gain(mean=effect.evidence.mean, t=effect.evidence.t),
        )
        for effect in mismatch.effects
    ]
    if len(rows) > 1 and mismatch.together is not None:
        rows.append(GainRow(name="all together", alone=mismatch.together, besides=None))
    return rows


@dataclass(frozen=True, kw_only=True)
class RejectedRow:
    """An effect that was tried and is not named, with its scores and why."""

    name: str
    alone: Gain
    beside: Gain | None
    why: str


def rejected_rows(mismatch: Mismatch) -> list[RejectedRow]:
    """What was tried and is not named, the largest gain first."""
    return [
        RejectedRow(
            name=effect_name(tried.slug),
            alone=tried.alone,
            beside=tried.beside,
            why=OUTCOME_MEANING[tried.outcome],
        )
        for tried in mismatch.tried
        if tried.outcome is not TriedOutcome.NAMED
    ]


@dataclass(frozen=True, kw_only=True)
class PlaceBar:
    """One cell: rms before and after in percent of span, and both as percent of a full bar.

    ``share`` of the squared residual before and ``weight`` of the samples, 0 to 1; ``hot`` where
    the place has significantly more of the residual than its share of samples.
    """

    label: str
    before: float | None
    after: float | None
    before_length: float
    after_length: float
    share: float | None
    weight: float | None
    hot: bool


@dataclass(frozen=True, kw_only=True)
class FacetBars:
    """All places of one facet, under its heading."""

    title: str
    places: tuple[PlaceBar, ...]


def facet_bars(mismatch: Mismatch) -> list[FacetBars]:
    """The facets in the order of the map; the longest bar of all is the largest rms before."""
    before = mismatch.before.cells
    after = {(cell.facet, cell.label): cell for cell in mismatch.after.cells}
    hot = {(cell.facet, cell.label) for cell in mismatch.before.hot}
    values = [finite(cell.rms) or 0.0 for cell in (*before, *after.values())]
    top = max(values, default=0.0)
    bars: dict[str, list[PlaceBar]] = {}
    for cell in before:
        key = (cell.facet, cell.label)
        bars.setdefault(cell.facet, []).append(_place_bar(cell, after.get(key), key in hot, top))
    return [
        FacetBars(title=facet_title(facet), places=tuple(places)) for facet, places in bars.items()
    ]


def _place_bar(before: Cell, after: Cell | None, hot: bool, top: float) -> PlaceBar:
    rms = finite(before.rms)
    rms_after = None if after is None else finite(after.rms)
    return PlaceBar(
        label=before.label,
        before=rms,
        after=rms_after,
        before_length=_length(rms, top),
        after_length=_length(rms_after, top),
        share=finite(before.share),
        weight=finite(before.weight),
        hot=hot,
    )


def _length(rms: float | None, top: float) -> float:
    return 0.0 if rms is None or top <= 0.0 else round(100.0 * min(rms / top, 1.0), 1)
