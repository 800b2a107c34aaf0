"""The pictures that show the evidence for named effects: strokes, shift, loop, signature.

They are made while the samples are in memory, from the recording, the free runs of both models, and
the numbers that the page gives beside them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.evidence.effect_signature import (
    EffectSignature,
    Moves,
    effect_signature,
)
from stemwatch.models.mismatch.findings import Effect, Mismatch, Stiction
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.words import capitalised
from stemwatch.service.presenter.physics_words import effect_name
from stemwatch.service.presenter.wording import finite, span_percent
from stemwatch.service.report.charts.loop_shapes import BAND, stick_band
from stemwatch.service.report.charts.shown_stretch import (
    EXTENDED,
    NAIVE,
    ShownStretch,
    seconds_from,
)
from stemwatch.service.report.charts.small_plot import Picture, PlottedLine, SmallPlot
from stemwatch.service.report.charts.stroke_pictures import stroke_pictures
from stemwatch.service.report.charts.typical_stretch import typical_stretch_of

MOST_POINTS = 350  # of a cloud
BINS, FEWEST_IN_BIN = 14, 5
LONGEST_STRETCH = 240  # samples of a picture that shows sample by sample


def effect_pictures(recording: Recording | None, mismatch: Mismatch) -> tuple[Picture, ...]:
    """The pictures of what ``mismatch`` names, from the stretch that it was named on; none where
    nothing is named or no samples are left."""
    runs = mismatch.runs
    if recording is None or recording.mv is None or runs is None or not mismatch.effects:
        return ()
    if runs.naive.size != len(recording):
        return ()
    seen = ShownStretch.of(recording, runs, mismatch)
    scale = 1.0 if mismatch.stroke_curve is None else abs(mismatch.stroke_curve.slope)
    return (
        *stroke_pictures(seen, mismatch.effects),
        *_loops(seen, (mismatch.naive, mismatch.restated), scale),
        *_shifted(seen),
        *(picture for effect in mismatch.effects for picture in _signature(seen, effect)),
    )


# OP as the stem had it, over MV


def _shifted(seen: ShownStretch) -> Iterator[Picture]:
    if not seen.late_s:
        return
    first, last = _stretch(seen)
    sample_index = np.arange(first, last)
    time = seconds_from(sample_index, first, seen.interval_s)
    plot = SmallPlot(
        x_label="time, s",
        y_label="percent",
        description=f"OP; {seen.command_name}; and MV over a typical stretch.",
        lines=[
            PlottedLine("op", "OP", time, seen.op[sample_index], dashed=True),
            PlottedLine("sp", seen.command_name, time, seen.command[sample_index]),
            PlottedLine("mv", f"{seen.position}, recorded", time, seen.mv[sample_index]),
        ],
        width=740,
    )
    yield Picture(
        title=f"{seen.command_name}, over MV",
        plot=plot,
        caption="Where the delay is right, MV turns where the shifted OP turns.",
    )


def _stretch(seen: ShownStretch) -> tuple[int, int]:
    stretch = typical_stretch_of(seen.recording, seen.runs.extended, seen.runs.heldout_from)
    if stretch is None:
        return max(0, seen.op.size - LONGEST_STRETCH), seen.op.size
    return stretch.first, min(stretch.last, stretch.first + LONGEST_STRETCH)


# The loop before and after


def _loops(
    seen: ShownStretch, stictions: tuple[Stiction, Stiction], scale: float
) -> Iterator[Picture]:
    """Both loops with the band of the S and J that each goes with; ``scale`` is percent of travel
    for a percent of OP."""
    first, last = _stretch(seen)
    part = slice(first, last)
    runs = (("naive", NAIVE, seen.runs.naive), ("extended", EXTENDED, seen.runs.extended))
    all_values = np.concatenate([seen.mv[part], *(run[part] for _, _, run in runs)])
    command = seen.command[part]
    bands = [_band_of(seen, part, stiction, scale) for stiction in stictions]
    drawn = [line for band in bands for line in band]
    limits = (
        *_around(np.concatenate([command, *(line.x for line in drawn)])),
        *_around(np.concatenate([all_values, *(line.y for line in drawn)])),
    )
    for (kind, name, run), stiction, band in zip(runs, stictions, bands, strict=True):
        plot = SmallPlot(
            x_label=f"{seen.command_name}, %",
            y_label=f"{seen.position}, %",
            description=f"{seen.position} against OP, recorded and {name}.",
            lines=[
                *band,
                PlottedLine("mv", "recorded", command, seen.mv[part]),
                PlottedLine(kind, name, command, run[part]),
            ],
            equal=True,
            limits=limits,
            height=300,
        )
        yield Picture(
            title=f"{capitalised(seen.position)} against OP: {name}",
            plot=plot,
            caption=(
                f"A typical stretch; one percent is as long along both axes. {_sizes(stiction)}"
            ),
        )


def _band_of(
    seen: ShownStretch, part: slice, stiction: Stiction, scale: float
) -> tuple[PlottedLine, ...]:
    """The loop that S and J alone would draw where OP usually turns, closed; nothing where OP does
    not move enough to leave it."""
    both_finite = np.isfinite(seen.op[part]) & np.isfinite(seen.mv[part])
    if not both_finite.any():
        return ()
    op, mv = seen.command[part][both_finite], seen.mv[part][both_finite]
    S, J = (_scaled(estimate, scale) for estimate in (stiction.S, stiction.J))
    corners = stick_band(S, J, op, mv)
    if corners is None:
        return ()
    closed = np.vstack((corners, corners[:1]))
    return (PlottedLine("band", BAND, closed[:, 0], closed[:, 1]),)


def _scaled(estimate: Estimate, scale: float) -> Estimate:
    return replace(estimate, value=None if estimate.value is None else scale * estimate.value)


def _sizes(stiction: Stiction) -> str:
    """S and J of the band, as they are said beside it; empty where one is not known."""
    if finite(stiction.S.value) is None or finite(stiction.J.value) is None:
        return ""
    S, J = span_percent(stiction.S.value), span_percent(stiction.J.value)
    return f"S {S} % is the band's flat part, J {J} % its upright step."


def _around(values: Floats) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    margin = max(0.05 * (high - low), 1e-3)
    return low - margin, high + margin


# What shows the effect directly


def _signature(seen: ShownStretch, effect: Effect) -> Iterator[Picture]:
    late = 0.0 if effect.slug == "dead_time" else seen.late_s

    def of(position: Floats) -> EffectSignature | None:
        return effect_signature(
            effect.slug, Moves(seen.op, position, seen.interval_s, late, effect.parameters)
        )

    recorded = of(seen.mv)
    if recorded is None:
        return
    lines = [*_points(recorded)]
    for kind, name, run in (
        ("naive", NAIVE, seen.runs.naive),
        ("extended", EXTENDED, seen.runs.extended),
    ):
        simulated = of(run)
        if simulated is not None:
            x, y = _course(simulated, recorded)
            lines.append(PlottedLine(kind, name, x, y, dashed=kind == "naive"))
    lines += [PlottedLine("law", law.label, law.x, law.y) for law in recorded.laws]
    plot = SmallPlot(
        x_label=recorded.x_label,
        y_label=recorded.y_label,
        description=f"{recorded.y_label} against {recorded.x_label}: {recorded.caption}",
        lines=lines,
        limits=None if recorded.joined else (*_bulk(recorded.x), *_bulk(recorded.y)),
        width=740,
        height=300,
    )
    yield Picture(
        title=f"What shows it: {effect_name(effect.slug)}",
        plot=plot,
        caption=f"{recorded.caption} Points are recorded; lines through the models are medians."
        if not recorded.joined
        else recorded.caption,
    )


def _points(seen_signature: EffectSignature) -> Iterator[PlottedLine]:
    if seen_signature.joined:
        yield PlottedLine("mv", "recorded", seen_signature.x, seen_signature.y)
        return
    stride = -(-seen_signature.x.size // MOST_POINTS)
    kept_points = np.arange(0, seen_signature.x.size, stride)
    for kind, name, group in (
        ("mv", "rising", seen_signature.rising),
        ("pv", "falling", ~seen_signature.rising),
    ):
        chosen = kept_points[group[kept_points]]
        if chosen.size:
            yield PlottedLine(
                kind,
                f"recorded, {name}",
                seen_signature.x[chosen],
                seen_signature.y[chosen],
                dots=True,
            )


def _course(seen_signature: EffectSignature, reference: EffectSignature) -> tuple[Floats, Floats]:
    """Medians of a point cloud in equal bins of the range that the recording covers."""
    if seen_signature.joined:
        return seen_signature.x, seen_signature.y
    edges = np.linspace(*_bulk(reference.x), BINS + 1)
    bin_of_point = np.digitize(seen_signature.x, edges) - 1
    x, y = 0.5 * (edges[1:] + edges[:-1]), np.full(BINS, np.nan)
    for k in range(BINS):
        in_bin = seen_signature.y[bin_of_point == k]
        if in_bin.size >= FEWEST_IN_BIN:
            y[k] = np.median(in_bin)
    return x, y


def _bulk(values: Floats) -> tuple[float, float]:
    """Limits that contain all values but one percent at each end."""
    low, high = (float(bound) for bound in np.percentile(values, [1.0, 99.0]))
    margin = 0.06 * (high - low) or max(abs(high), 1.0) * 0.05
    return low - margin, high + margin
