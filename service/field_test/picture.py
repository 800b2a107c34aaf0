"""The pictures of a test: as planned, with OP and the MV that each rival predicts; and as carried
out, with the recorded MV."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.service.field_test.sheet import TestSheet
from stemwatch.service.maintenance.drawing import (
    Drawing,
    DrawnLine,
    DrawnText,
    Mark,
    Panel,
    span,
)

WIDTH, HEIGHT = 515.0, 190.0
LEFT, TOP, FOOT = 26.0, 24.0, 24.0
OP_DASH = (4.0, 2.0)
Legend = tuple[str, float, tuple[float, ...], float]  # name, width, dash, grey
LineStyle = tuple[float, tuple[float, ...], float]  # width, dash, grey
RECORDED: LineStyle = (2.4, (), 0.8)
LINES_OF_RIVALS: tuple[LineStyle, ...] = (
    (1.2, (), 0.0),
    (1.2, (1.0, 1.6), 0.0),
    (1.6, (), 0.55),
    (1.0, (6.0, 1.5, 1.0, 1.5), 0.3),
)


def picture_of_test(sheet: TestSheet) -> Drawing | None:
    """OP dashed, MV of each rival; ``None`` where there is no test."""
    test = sheet.test
    if test is None:
        return None
    op = sheet.plan.op + test.change
    panel, marks = _traces(op, test.interval_s, sheet.rivals, test.predicted)
    for number, reading in enumerate(sheet.readings, start=1):
        x = panel.x(reading.at_s / 60.0)
        marks.append(
            DrawnLine(((x, panel.top), (x, panel.top + panel.height)), width=0.3, grey=0.6)
        )
        marks.append(DrawnText((x, panel.top - 2.0), str(number), 6.5, "middle", bold=True))
    caption = f"OP of the test over time, and MV for {', '.join(sheet.rivals)}."
    return Drawing(width=WIDTH, height=HEIGHT, marks=tuple(marks), caption=caption)


def picture_of_result(
    op: Floats, mv: Floats, interval_s: float, rivals: Sequence[str], followed: Sequence[Floats]
) -> Drawing:
    """OP dashed, the recorded MV in grey, and MV as each rival follows it."""
    _, marks = _traces(op, interval_s, rivals, followed, mv)
    caption = f"OP and MV of the test as recorded, and MV as {', '.join(rivals)} would follow."
    return Drawing(width=WIDTH, height=HEIGHT, marks=tuple(marks), caption=caption)


def _traces(
    op: Floats,
    interval_s: float,
    rivals: Sequence[str],
    runs: Sequence[Floats] | Floats,
    mv: Floats | None = None,
) -> tuple[Panel, list[Mark]]:
    """OP, the recorded MV where there is one, and the run of each rival, with axes and legend."""
    minutes = np.asarray(np.arange(op.size) * interval_s / 60.0, dtype=np.float64)
    low, high = span(op, *runs, *([] if mv is None else [mv]))
    panel = Panel(
        left=LEFT,
        top=TOP,
        width=WIDTH - LEFT - 6.0,
        height=HEIGHT - TOP - FOOT,
        x0=0.0,
        x1=float(minutes[-1]) or 1.0,
        y0=low,
        y1=high,
    )
    marks: list[Mark] = [*panel.frame("minutes from the start", "%")]
    lines: list[tuple[str, Floats, LineStyle]] = [("OP", op, (0.6, OP_DASH, 0.0))]
    if mv is not None:
        lines.append(("MV recorded", mv, RECORDED))
    named = [f"MV, {name}" for name in rivals]
    lines += [*zip(named, runs, LINES_OF_RIVALS, strict=False)]
    names: list[Legend] = []
    for name, values, (width, dash, grey) in lines:
        marks += panel.lines(minutes, values, width, dash, grey)
        names.append((name, width, dash, grey))
    return panel, [*marks, *_legend(names)]


def _legend(names: list[Legend]) -> list[Mark]:
    marks: list[Mark] = []
    x = LEFT + 16.0
    for name, width, dash, grey in names:
        marks.append(DrawnLine(((x, TOP - 13.0), (x + 20.0, TOP - 13.0)), width, dash, grey))
        marks.append(DrawnText((x + 23.0, TOP - 10.7), name, 6.8))
        x += 32.0 + 3.7 * len(name)
    return marks
