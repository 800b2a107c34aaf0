"""The picture of a planned test: OP as it is set, and MV as each rival would show it."""

from __future__ import annotations

import numpy as np

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
# Width, dash and grey of each rival.
LOOKS_OF_RIVALS: tuple[tuple[float, tuple[float, ...], float], ...] = (
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
    minutes = np.asarray(np.arange(op.size) * test.interval_s / 60.0, dtype=np.float64)
    low, high = span(op, *test.predicted)
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
    marks += panel.lines(minutes, op, 0.6, OP_DASH)
    names: list[Legend] = [("OP", 0.6, OP_DASH, 0.0)]
    for name, predicted, (width, dash, grey) in zip(
        sheet.rivals, test.predicted, LOOKS_OF_RIVALS, strict=False
    ):
        marks += panel.lines(minutes, predicted, width, dash, grey)
        names.append((f"MV, {name}", width, dash, grey))
    for number, look in enumerate(sheet.looks, start=1):
        x = panel.x(look.at_s / 60.0)
        marks.append(
            DrawnLine(((x, panel.top), (x, panel.top + panel.height)), width=0.3, grey=0.6)
        )
        marks.append(DrawnText((x, panel.top - 2.0), str(number), 6.5, "middle", bold=True))
    return Drawing(
        width=WIDTH,
        height=HEIGHT,
        marks=(*marks, *_legend(names)),
        says=f"OP of the test over time, and MV for {', '.join(sheet.rivals)}.",
    )


def _legend(names: list[Legend]) -> list[Mark]:
    marks: list[Mark] = []
    x = LEFT + 16.0
    for name, width, dash, grey in names:
        marks.append(DrawnLine(((x, TOP - 13.0), (x + 20.0, TOP - 13.0)), width, dash, grey))
        marks.append(DrawnText((x + 23.0, TOP - 10.7), name, 6.8))
        x += 32.0 + 3.7 * len(name)
    return marks
