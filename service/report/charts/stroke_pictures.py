"""Pictures of single moves of the command, with the fitted limit of the stem's speed in them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.mismatch.findings import Effect
from stemwatch.models.signals.excitation import reversals, swing
from stemwatch.service.presenter.wording import figure
from stemwatch.service.report.charts.shown_stretch import (
    EXTENDED,
    NAIVE,
    ShownStretch,
    seconds_from,
    value_of,
)
from stemwatch.service.report.charts.small_plot import Note, Picture, PlottedLine, SmallPlot

STROKES = 3
# The least lag of the stem behind OP, and the least size of a move, as shares of OP's swing.
LEAST_BEHIND, LEAST_STROKE = 0.05, 0.25
SMALLEST_STROKE_PERCENT = 0.3
SHORTEST_STROKE = 3  # samples; one wild value of the reading is back after two
NEAR_AGAIN = 0.2  # of the farthest
TURNS_WITHIN = 3  # samples after the command, and the dead time, in which the stem turns


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
            rate = value_of(effect, "rate") or math.inf
            return _Slope(rate, rate)
        if effect.slug == "asymmetric_rate_limit":
            rising, falling = value_of(effect, "rate_rising"), value_of(effect, "rate_falling")
            return _Slope(rising or math.inf, falling or math.inf)
    return None


@dataclass(frozen=True)
class _Stroke:
    """Samples ``first`` to ``last`` of a move of the command; ``way`` 1 rising, -1 falling."""

    first: int
    last: int
    way: int


def stroke_pictures(seen: ShownStretch, effects: Sequence[Effect]) -> Iterator[Picture]:
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


def _largest(seen: ShownStretch, direction: int, begin: int) -> list[_Stroke]:
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


def _farthest_behind(seen: ShownStretch, direction: int, begin: int) -> list[_Stroke]:
    """The moves of OP after ``begin`` on which MV stayed farthest behind, in the order of time.

    ``way`` is 1 for rising ones, -1 for falling ones, 0 for either. A move lasts from where the lag
    first exceeds a fifth of its maximum to where it falls below that again.
    """
    behind = seen.op - seen.mv
    behind = behind - np.nanmedian(behind)
    distance = np.abs(behind) if direction == 0 else direction * behind
    least = max(LEAST_BEHIND * swing(seen.op), SMALLEST_STROKE_PERCENT)
    # A gap ends a move, and is in none.
    distance = np.where(np.isfinite(distance), distance, np.inf)
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


def _stroke(seen: ShownStretch, stroke: _Stroke, limit: _Slope | None) -> SmallPlot:
    first, last, direction = stroke.first, stroke.last, stroke.way
    length = max(last - first, 4)
    begin = max(first - length // 2 - 2, 0)
    end = min(last + length + 3, seen.op.size)
    sample_index = np.arange(begin, end)
    time = seconds_from(sample_index, first, seen.interval_s)
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
