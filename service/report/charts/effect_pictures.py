"""The pictures that show the evidence for named effects: strokes, shift, loop, signature.

They are made while the samples are in memory, from the recording, the free runs of both models, and
the numbers that the page gives beside them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.evidence.effect_signature import (
    EffectSignature,
    Moves,
    effect_signature,
    later,
)
from stemwatch.models.mismatch.findings import Effect, FreeRuns, Mismatch, Stiction
from stemwatch.models.preparation.own_clock import duration
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.signals.excitation import reversals, swing
from stemwatch.models.stickslip.stroke_curve import in_travel
from stemwatch.service.presenter.physics_words import effect_name
from stemwatch.service.presenter.wording import figure, finite, span_percent
from stemwatch.service.report.charts.loop_shapes import BAND, stick_band
from stemwatch.service.report.charts.small_plot import Note, PlottedLine, SmallPlot
from stemwatch.service.report.charts.typical_stretch import typical_stretch_of
from stemwatch.service.report.charts.valve_charts import FLOW

STROKES = 3
# The least lag of the stem behind OP, and the least size of a move, as shares of OP's swing.
LEAST_BEHIND, LEAST_STROKE = 0.05, 0.25
SMALLEST_STROKE_PERCENT = 0.3
SHORTEST_STROKE = 3  # samples; one wild value of the reading is back after two
NEAR_AGAIN = 0.2  # of the farthest
MOST_POINTS = 350  # of a cloud
BINS, FEWEST_IN_BIN = 14, 5
TURNS_WITHIN = 3  # samples after the command, and the dead time, in which the stem turns
LONGEST_STRETCH = 240  # samples of a picture that shows sample by sample
NAIVE, EXTENDED = "S and J alone", "with what was left out"


@dataclass(frozen=True, kw_only=True)
class Picture:
    """One picture with its heading and what to see in it."""

    title: str
    plot: SmallPlot
    caption: str = ""

    @property
    def svg(self) -> Markup:
        """The picture as it stands in a page."""
        return self.plot.svg()


@dataclass(frozen=True)
class _Seen:
    """The data that all pictures of a recording share: signals (n,) in percent, times in
    seconds."""

    op: Floats
    mv: Floats
    runs: FreeRuns
    interval_s: float
    late_s: float
    late_digits: str  # as many as the sentence about it has
    recording: Recording
    position: str  # what is drawn as the position

    @property
    def command(self) -> Floats:
        """OP as the stem had it: later by what MV follows by, earlier where OP is stored late."""
        return later(self.op, self.late_s, self.interval_s) if self.late_s else self.op

    @property
    def command_name(self) -> str:
        """What ``command`` is called beside a picture."""
        if not self.late_s:
            return "OP"
        unit_s = self.recording.unit_s
        size = duration(abs(self.late_s) / unit_s, unit_s, self.late_digits)
        return f"OP, {size} {'later' if self.late_s > 0.0 else 'earlier'}"


def effect_pictures(recording: Recording | None, mismatch: Mismatch) -> tuple[Picture, ...]:
    """The pictures of what ``mismatch`` names, from the stretch that it was named on; none where
    nothing is named or no samples are left."""
    runs = mismatch.runs
    if recording is None or recording.mv is None or runs is None or not mismatch.effects:
        return ()
    if runs.naive.size != len(recording):
        return ()
    first, last = runs.stretch
    recording, runs, scale = recording.part(first, last), runs.part(first, last), 1.0
    recording = runs.followed(recording)
    if mismatch.stroke_curve is not None:
        scale = abs(mismatch.stroke_curve.slope)
        recording = in_travel(recording, mismatch.stroke_curve)
    assert recording.mv is not None
    seen = _Seen(
        op=recording.op.values,
        mv=recording.mv.values,
        runs=runs,
        interval_s=recording.interval_s,
        late_s=_late_s(mismatch),
        late_digits=".3g" if any(one.slug == "dead_time" for one in mismatch.effects) else ".1f",
        recording=recording,
        position="MV" if runs.position is None else FLOW,
    )
    return (
        *_strokes(seen, mismatch.effects),
        *_loops(seen, (mismatch.naive, mismatch.restated), scale),
        *_shifted(seen),
        *(picture for effect in mismatch.effects for picture in _signature(seen, effect)),
    )


def _late_s(mismatch: Mismatch) -> float:
    """How much later than in the record the stem had OP, seconds: a dead time that was named, a
    delay too small to be one, less what the record stores OP late."""
    named = sum(_value(one, "theta") for one in mismatch.effects if one.slug == "dead_time")
    of_record = (one.parameters for one in mismatch.record_effects)
    return named + sum(one.get("delay_s", 0.0) - one.get("late_s", 0.0) for one in of_record)


def _value(effect: Effect, name: str) -> float:
    estimate = effect.parameters.get(name)
    return 0.0 if estimate is None or estimate.value is None else float(estimate.value)


# Strokes


@dataclass(frozen=True)
class _Slope:
    """A fitted limit, percent a second; infinite where it was never reached."""

    rising: float
    falling: float

    def of(self, way: int) -> float:
        return self.rising if way > 0 else -self.falling


def _limit(effects: Sequence[Effect]) -> _Slope | None:
    """The speed limit that was named; ``None`` where none was."""
    for effect in effects:
        if effect.slug == "rate_limit":
            rate = _value(effect, "rate") or math.inf
            return _Slope(rate, rate)
        if effect.slug == "asymmetric_rate_limit":
            rising, falling = _value(effect, "rate_rising"), _value(effect, "rate_falling")
            return _Slope(rising or math.inf, falling or math.inf)
    return None


@dataclass(frozen=True)
class _Stroke:
    """Samples ``first`` to ``last`` of a move of the command; ``way`` 1 rising, -1 falling."""

    first: int
    last: int
    way: int


def _strokes(seen: _Seen, effects: Sequence[Effect]) -> Iterator[Picture]:
    """The three moves of the command on which the stem lagged most, from the held-out part if it
    has three. For a valve that is slower in one direction, moves in that direction. Where the stem
    nowhere lags much, the largest moves."""
    limit = _limit(effects)
    direction = 0
    if limit is not None and limit.rising != limit.falling:
        direction = 1 if limit.rising < limit.falling else -1
    command = {1: "a rising command", -1: "a falling command", 0: "the command"}[direction]
    heldout = seen.runs.heldout_from
    unseen = ", in the part that neither model was fitted to"
    behind, largest = (
        f"on which the stem stayed farthest behind {command}",
        "with the largest moves",
    )
    candidates = [
        (moves(seen, direction, begin), f"{caption}{part}.")
        for moves, caption in ((_farthest_behind, behind), (_largest, f"{largest} of {command}"))
        for begin, part in ((heldout, unseen), (0, ""))
    ]
    most_strokes = max(len(strokes) for strokes, _ in candidates)
    strokes, caption = next(
        candidate for candidate in candidates if len(candidate[0]) == most_strokes
    )
    for number, stroke in enumerate(strokes, start=1):
        plot = _stroke(seen, stroke, limit)
        which_stroke = "The only stroke" if most_strokes == 1 else f"One of {most_strokes} strokes"
        yield Picture(title=f"Stroke {number}", plot=plot, caption=f"{which_stroke} {caption}")


def _largest(seen: _Seen, direction: int, begin: int) -> list[_Stroke]:
    """The largest moves of OP after ``begin`` from one turn to the next, in the order of time."""
    finite = np.isfinite(seen.op) & np.isfinite(seen.mv)
    op = np.where(np.isfinite(seen.op), seen.op, np.nanmedian(seen.op))
    turns = reversals(op, max(LEAST_STROKE * swing(seen.op), SMALLEST_STROKE_PERCENT))
    turns = turns[turns >= begin]
    sizes = np.diff(op[turns])
    moves = [
        _Stroke(int(turns[k]), int(turns[k + 1]), 1 if sizes[k] > 0.0 else -1)
        for k in np.argsort(-np.abs(sizes), kind="stable").tolist()
    ]
    fit = [
        move
        for move in moves
        if direction * move.way >= 0 and finite[move.first : move.last + 1].all()
    ][:STROKES]
    return sorted(fit, key=lambda stroke: stroke.first)


def _farthest_behind(seen: _Seen, direction: int, begin: int) -> list[_Stroke]:
    """The moves of OP after ``begin`` on which MV stayed farthest behind, in the order of time.

    ``way`` is 1 for rising ones, -1 for falling ones, 0 for either. A move lasts from where the lag
    first exceeds a fifth of its maximum to where it falls below that again.
    """
    behind = seen.op - seen.mv
    behind = behind - np.nanmedian(behind)
    distance = np.abs(behind) if direction == 0 else direction * behind
    least = max(LEAST_BEHIND * swing(seen.op), SMALLEST_STROKE_PERCENT)
    distance = np.where(
        np.isfinite(distance), distance, np.inf
    )  # a gap ends a move, and is in none
    free = np.isfinite(distance)
    free[:begin] = False
    strokes: list[_Stroke] = []
    while len(strokes) < STROKES:
        peak = int(np.argmax(np.where(free, distance, -np.inf)))
        if not free[peak] or distance[peak] < least:
            break
        within = distance <= NEAR_AGAIN * distance[peak]
        before, after = np.flatnonzero(within[:peak]), np.flatnonzero(within[peak:])
        first = int(before[-1]) if before.size else 0
        last = peak + int(after[0]) if after.size else distance.size - 1
        long_enough = last - first >= SHORTEST_STROKE
        if free[first + 1 : last].all() and before.size and after.size and long_enough:
            strokes.append(_Stroke(first, last, 1 if behind[peak] > 0.0 else -1))
        free[first : last + 1] = False
    return sorted(strokes, key=lambda stroke: stroke.first)


def _stroke(seen: _Seen, stroke: _Stroke, limit: _Slope | None) -> SmallPlot:
    first, last, direction = stroke.first, stroke.last, stroke.way
    length = max(last - first, 4)
    begin = max(first - length // 2 - 2, 0)
    end = min(last + length + 3, seen.op.size)
    sample_index = np.arange(begin, end)
    time = _since(sample_index, first, seen.interval_s)
    lines = [
        PlottedLine("op", "OP", time, seen.op[sample_index]),
        PlottedLine("naive", NAIVE, time, seen.runs.naive[sample_index], dashed=True),
        PlottedLine("extended", EXTENDED, time, seen.runs.extended[sample_index]),
        PlottedLine("mv", f"{seen.position}, recorded", time, seen.mv[sample_index]),
    ]
    notes = []
    if seen.late_s:
        lines.insert(
            1,
            PlottedLine("op", seen.command_name, time, seen.command[sample_index], dashed=True),
        )
    if limit is not None and math.isfinite(limit.of(direction)):
        slope = limit.of(direction)
        # From where the stem turns to where the command ends.
        after = first + np.arange(max(round(seen.late_s / seen.interval_s), 0) + TURNS_WITHIN)
        turn = int(after[np.argmin(direction * seen.mv[after[after < end]])])
        start, start_s = float(seen.mv[turn]), (turn - first) * seen.interval_s
        took = min(abs(float(seen.op[last]) - start) / abs(slope), float(time[-1]) - start_s)
        line = np.array([start_s, start_s + took])
        lines.append(PlottedLine("law", "fitted limit", line, start + slope * (line - start_s)))
        middle = float(line.mean())
        slope_text = f"{figure(abs(slope))} %/s"
        notes.append(
            Note(middle, start + slope * (middle - start_s), f"\N{NO-BREAK SPACE} {slope_text}")
        )
    return SmallPlot(
        x_label="time from the turn of OP, s",
        y_label="percent",
        description=(
            f"A move of OP from {figure(float(seen.op[first]))} to {figure(float(seen.op[last]))} "
            "percent with the recorded position and both models."
        ),
        lines=lines,
        notes=notes,
    )


# OP as the stem had it, over MV


def _shifted(seen: _Seen) -> Iterator[Picture]:
    if not seen.late_s:
        return
    first, last = _stretch(seen)
    sample_index = np.arange(first, last)
    time = _since(sample_index, first, seen.interval_s)
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


def _since(sample_index: NDArray[np.int64], first: int, interval_s: float) -> Floats:
    """Seconds from sample ``first``."""
    return np.asarray((sample_index - first) * interval_s, dtype=np.float64)


def _stretch(seen: _Seen) -> tuple[int, int]:
    stretch = typical_stretch_of(seen.recording, seen.runs.extended, seen.runs.heldout_from)
    if stretch is None:
        return max(0, seen.op.size - LONGEST_STRETCH), seen.op.size
    return stretch.first, min(stretch.last, stretch.first + LONGEST_STRETCH)


# The loop before and after


def _loops(seen: _Seen, stictions: tuple[Stiction, Stiction], scale: float) -> Iterator[Picture]:
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
            title=f"{seen.position[:1].upper()}{seen.position[1:]} against OP: {name}",
            plot=plot,
            caption=(
                f"A typical stretch; one percent is as long along both axes. {_sizes(stiction)}"
            ),
        )


def _band_of(seen: _Seen, part: slice, stiction: Stiction, scale: float) -> tuple[PlottedLine, ...]:
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


def _signature(seen: _Seen, effect: Effect) -> Iterator[Picture]:
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
