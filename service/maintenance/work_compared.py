"""Work on a valve with the windows before and after it: S and J of both, and both loops on the same
axes. The valve's page and the maintenance report say and draw it from here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stemwatch.service.maintenance.drawing import (
    Drawing,
    DrawnLine,
    DrawnText,
    Mark,
    Panel,
    span,
)
from stemwatch.service.presenter.wording import span_percent
from stemwatch.service.report.charts.axes import equally_long
from stemwatch.service.report.charts.small_plot import SmallPlot
from stemwatch.service.report.charts.window_pictures import (
    WindowLoop,
    before_and_after,
    unpack_pictures,
)

if TYPE_CHECKING:  # the front door loads no database library
    from stemwatch.service.store.screenings.pictures import AroundWork

MOST_SHOWN = 12  # in one report; the others are on their valves' pages
WIDTH, HEIGHT = 250.0, 150.0
TOP, FOOT, LEFT = 18.0, 24.0, 26.0
BEFORE_DASH = (2.0, 1.5)


@dataclass(frozen=True, kw_only=True)
class WorkCompared:
    """The work and its two windows; ``before`` and ``after`` are the loops of these, ``None`` where
    one of the windows has none."""

    around: AroundWork
    before: WindowLoop | None
    after: WindowLoop | None
    caption: str = (
        "A typical stretch of each window; one percent is as long along both axes. The wider the "
        "loop, the more the stem sticks."
    )

    @property
    def sizes(self) -> tuple[str, str]:
        """S and J, each as "6.25 → 0.31 %"."""
        before, after = self.around.before, self.around.after
        return (
            f"{span_percent(before.S)} → {span_percent(after.S)} %",
            f"{span_percent(before.J)} → {span_percent(after.J)} %",
        )

    @property
    def plot(self) -> SmallPlot | None:
        """Both loops for a screen."""
        if self.before is None or self.after is None:
            return None
        return before_and_after(self.before, self.after)

    @property
    def drawing(self) -> Drawing | None:
        """Both loops for paper: before the work a dashed line, after it a solid one."""
        if self.before is None or self.after is None:
            return None
        inner = WIDTH - LEFT - 4.0, HEIGHT - TOP - FOOT
        ends = (
            span(self.before.op, self.after.op),
            span(self.before.mv, self.after.mv),
        )
        (x0, x1), (y0, y1) = equally_long(*ends, inner[0] / inner[1])
        panel = Panel(
            left=LEFT, top=TOP, width=inner[0], height=inner[1], x0=x0, x1=x1, y0=y0, y1=y1
        )
        marks = [
            *panel.frame("OP, %", "MV, %"),
            *panel.lines(self.before.op, self.before.mv, 0.6, BEFORE_DASH),
            *panel.lines(self.after.op, self.after.mv, 1.1),
            *_legend(),
        ]
        return Drawing(
            width=WIDTH,
            height=HEIGHT,
            marks=tuple(marks),
            caption="MV against OP in the window before the work and in the latest one after it.",
        )


def compare(around: AroundWork) -> WorkCompared:
    """The work with what is kept of its two windows."""
    return WorkCompared(
        around=around,
        before=unpack_pictures(around.before.packed).loop,
        after=unpack_pictures(around.after.packed).loop,
    )


def newest_first(works: Sequence[AroundWork]) -> tuple[WorkCompared, ...]:
    """The ``MOST_SHOWN`` newest, the newest first."""
    ordered = sorted(works, key=lambda work: work.work.at, reverse=True)
    return tuple(compare(around) for around in ordered[:MOST_SHOWN])


def _legend() -> list[Mark]:
    marks: list[Mark] = []
    for x, name, width, dash in (
        (LEFT + 26.0, "before the work", 0.6, BEFORE_DASH),
        (LEFT + 120.0, "after it", 1.1, ()),
    ):
        marks.append(DrawnLine(((x, TOP - 7.0), (x + 20.0, TOP - 7.0)), width, dash))
        marks.append(DrawnText((x + 24.0, TOP - 4.7), name, 7.0))
    return marks
