"""What follows a finding: the twin of a loop, run again with a change, and the test that would tell
what a recording left open."""

from __future__ import annotations

import os
import textwrap
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stemwatch.models.closed_loop.fitted_loop import FittedLoop, Knocker
from stemwatch.models.closed_loop.what_if import LoopChange, Prediction
from stemwatch.models.estimate import Estimate
from stemwatch.models.field_test.plan import PlanKind
from stemwatch.service.field_test import sheet as field_sheet
from stemwatch.service.field_test.sheet import TestSheet
from stemwatch.service.presenter.wording import finite, printable
from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.twin import loop_twin as twins

if TYPE_CHECKING:
    import pandas as pd

_WIDTH = 96
_COLUMNS = [
    "error_std",
    "error_std_low",
    "error_std_high",
    "variance_saved_percent",
    "variance_saved_percent_low",
    "variance_saved_percent_high",
    "amplitude",
    "period_s",
]


@dataclass(frozen=True, repr=False)
class LoopTwin:
    """The loop around a valve, fitted, to be run again as it might be: from ``stemwatch.twin``.

    ``loop`` holds what was fitted: ``law``, ``valve``, ``process``, ``recorded``.
    """

    valve: str
    loop: FittedLoop

    @cached_property
    def usual(self) -> list[twins.WhatIf]:
        """What an engineer tries first, each with its prediction: repair, half the friction, two
        other tunings, a knocker."""
        return twins.what_ifs(self.loop, twins.usual_changes(self.loop))

    def what_if(
        self,
        *,
        S: float | None = None,
        J: float | None = None,
        gain_times: float = 1.0,
        reset_times: float = 1.0,
        knocker: tuple[float, float, float] | None = None,
    ) -> Prediction:
        """The loop with another valve, another tuning or a knocker, on the same day.

        Args:
            S: Another S, percent of OP span; ``None`` leaves the fitted one. J falls with it.
            J: Another J, likewise.
            gain_times: Controller gain, times the present one.
            reset_times: Reset time, times the present one.
            knocker: Height in percent of OP, seconds from pulse to pulse, seconds of a pulse.

        Returns:
            A ``Prediction``: ``predicted["error_std"]`` and the other figures with 90 % intervals,
            beside those ``recorded`` and of the loop run ``as_it_is``; ``fall("error_std",
            squared=True)`` is the percent of variance saved.

        Raises:
            ValueError: A number that no loop can have.
        """
        for name, value in (("S", S), ("J", J)):
            if value is not None and not value >= 0.0:
                raise ValueError(f"{name} must not be negative, received {value:g}")
        for name, times in (("gain_times", gain_times), ("reset_times", reset_times)):
            if not 0.01 <= times <= 100.0:
                raise ValueError(f"{name}: 0.01 to 100 is expected, received {times:g}")
        change = LoopChange(
            S=S,
            J=J,
            gain_times=gain_times,
            reset_times=reset_times,
            knocker=None if knocker is None else _knocker(*knocker),
        )
        (row,) = twins.what_ifs(self.loop, [("as asked", change)])
        return row.prediction

    def to_frame(self) -> pd.DataFrame:
        """A row for the recording, the loop run as it is, and each usual change.

        Of SP - PV: standard deviation (``error_std``) and amplitude in PV's unit, and the percent
        of its variance that is saved; the period in seconds, NaN where there is no regular one.
        ``_low`` and ``_high`` are the ends of 90 % intervals.
        """
        import pandas as pd

        first = self.usual[0].prediction
        rows: dict[str, dict[str, float | None]] = {
            name: {
                "error_std": seen.error_std,
                "amplitude": seen.amplitude,
                "period_s": seen.period_s,
            }
            for name, seen in (("recorded", first.recorded), ("run as it is", first.as_it_is))
        }
        for row in self.usual:
            predicted = row.prediction.predicted
            saved = row.prediction.fall("error_std", squared=True)
            rows[row.name] = {
                **_with_ends("error_std", predicted["error_std"]),
                **_with_ends("variance_saved_percent", saved),
                "amplitude": finite(predicted["amplitude"].value),
                "period_s": finite(predicted["period_s"].value),
            }
        return pd.DataFrame.from_dict(rows, orient="index")[_COLUMNS].astype(float)

    def to_dict(self) -> dict[str, Any]:
        """What ``stemwatch twin --json`` writes: controller, process, and the usual changes."""
        return twins.to_object(self.loop, self.usual)

    def __repr__(self) -> str:
        lines = [f"Twin of {printable(self.valve)}", *_wrapped(twins.settings_in_words(self.loop))]
        width = max(len(row.name) for row in self.usual)
        lines.append(f"  {'recorded'.ljust(width)}  std of SP - PV {self._recorded()}")
        for row in self.usual:
            error = row.prediction.predicted["error_std"]
            saved = row.prediction.fall("error_std", squared=True)
            told = f"{error}" if saved.value is None else f"{error}, variance saved {saved}"
            lines.append(f"  {row.name.ljust(width)}  {told}")
        return "\n".join(lines)

    def _recorded(self) -> str:
        return f"{self.usual[0].prediction.recorded.error_std:.3g} {self.loop.unit}".rstrip()

    def _repr_html_(self) -> str:
        from stemwatch.html import twin_card

        return twin_card(self.valve, self.loop, self.usual)


@dataclass(frozen=True, repr=False)
class PlannedTest:
    """The field test that would tell what a recording left open: from ``stemwatch.plan_test``.

    ``sheet`` has every word and number. stemwatch never writes to a plant: a person sets OP.
    """

    sheet: TestSheet

    @property
    def valve(self) -> str:
        """The valve's name."""
        return self.sheet.valve

    @property
    def kind(self) -> PlanKind:
        """``tells``, ``cannot_tell``, ``nothing_left`` or ``bump``; equal to its text."""
        return self.sheet.plan.kind

    @property
    def sentence(self) -> str:
        """What the test tells apart, how surely, and within what; or why there is none."""
        return self.sheet.headline

    @property
    def probability(self) -> float | None:
        """Of finding the right explanation, 0 to 1, if it is among the rivals; ``None`` where there
        is no test."""
        return None if self.sheet.test is None else finite(self.sheet.test.probability)

    def to_frame(self) -> pd.DataFrame:
        """Values of OP to be set: ``at_s``, ``op_percent`` and ``change`` from where OP began."""
        import pandas as pd

        return pd.DataFrame(self.to_dict()["values"], columns=["at_s", "op_percent", "change"])

    def to_dict(self) -> dict[str, Any]:
        """What ``stemwatch plan-test --json`` writes, version 1 (docs/plan-test.md)."""
        return field_sheet.to_object(self.sheet)

    def write(
        self, folder: str | os.PathLike[str], *, plant: str = "", zone: str = "UTC"
    ) -> tuple[Path, Path]:
        """Writes ``test-plan.html`` and ``test-plan.pdf`` into ``folder``, one page each.

        ``plant`` and ``zone`` (IANA) stand at their head. Raises ``ReportNotWritten``.
        """
        from stemwatch.service.field_test.sheet_files import write_sheet

        context = ReportContext(started=datetime.now(UTC), plant=plant, zone=zone)
        return write_sheet(self.sheet, context, Path(folder))

    def __repr__(self) -> str:
        sheet = self.sheet
        moves = [
            f"  {leg.clock:>5}  OP {leg.to:5.1f} % ({leg.shift})  {leg.words}"
            for leg in sheet.moves
        ]
        remarks = [line for remark in sheet.remarks for line in _wrapped(remark)]
        return "\n".join([printable(sheet.title), *_wrapped(sheet.headline), *moves, *remarks])

    def _repr_html_(self) -> str:
        from stemwatch.html import planned_card

        return planned_card(self.sheet)


def _knocker(height: float, every_s: float, for_s: float) -> Knocker:
    if not (height > 0.0 and every_s > for_s > 0.0):
        raise ValueError(
            "knocker: height in percent of OP, seconds from pulse to pulse, seconds of a pulse is "
            f"expected, such as (2, 10, 2); received {(height, every_s, for_s)}"
        )
    return Knocker(height=height, every_s=every_s, for_s=for_s)


def _with_ends(name: str, estimate: Estimate) -> dict[str, float | None]:
    ends = {"": estimate.value, "_low": estimate.low, "_high": estimate.high}
    return {name + ending: finite(value) for ending, value in ends.items()}


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(
        printable(text), _WIDTH, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False
    )


__all__ = ["LoopTwin", "PlannedTest"]
