"""The results of ``screen`` and ``explain``, with their display in terminals and notebooks."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

from stemwatch.connectors.settings import nearest
from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.models.recording import Recording
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.explain.explain_json import to_object
from stemwatch.service.explain.explain_recording import Explained
from stemwatch.service.presenter.false_discoveries import Discoveries, discoveries
from stemwatch.service.presenter.finding import PresentedFinding, present
from stemwatch.service.presenter.physics_words import finding_title
from stemwatch.service.presenter.wording import VERDICT_SYMBOL, finite, printable, share
from stemwatch.service.report.json_contract import to_contract
from stemwatch.service.report.ranking import Ranking, rank_valves
from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.report.spreadsheet_columns import header_and_rows

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_WIDTH = 96
_MOST_LISTED = 20


@dataclass(frozen=True, repr=False)
class ScreenedValve:
    """One valve, screened: what ``stemwatch.screen`` gives for one recording.

    A notebook shows it with its picture; ``print`` gives a few lines. ``screening`` holds all that
    was found, with its arrays.
    """

    screening: Screening
    stands: bool | None = None
    """Whether its named effects stand among all valves of the call; ``None`` where none was
    named."""
    remark: str = ""
    """Why they do not stand, in a sentence; empty where they do."""

    @cached_property
    def _finding(self) -> PresentedFinding:
        return present(self.screening, stands=self.stands)

    @property
    def valve(self) -> str:
        """The valve's name."""
        return self.screening.valve

    @property
    def verdict(self) -> Verdict:
        """``sticky``, ``defective``, ``watch``, ``undetermined`` or ``healthy``; equal to its
        text."""
        return self._finding.decision.verdict

    @property
    def reason(self) -> str:
        """What was found, a sentence or two."""
        return self._finding.reason

    @property
    def advice(self) -> str:
        """What to do next, one sentence."""
        return self._finding.next_step

    @property
    def S(self) -> Estimate:
        """Dead band plus stick band, percent of OP span, with its 95 % interval or a reason."""
        return self.screening.S

    @property
    def J(self) -> Estimate:
        """Slip jump, percent of OP span, with its 95 % interval or a reason."""
        return self.screening.J

    @property
    def shape(self) -> Shape | None:
        """The form of the OP-MV loop; ``None`` where S and J are not known."""
        return self.screening.shape

    @property
    def severity(self) -> float:
        """0 to 100, for ranking."""
        return self._finding.decision.severity

    @property
    def confidence(self) -> float | None:
        """0 to 1; ``None`` where the verdict is ``undetermined`` or ``defective``."""
        return self._finding.decision.confidence

    @property
    def mismatch(self) -> Mismatch | None:
        """Effects beside S and J; ``None`` where nothing was fitted."""
        return self.screening.mismatch

    @property
    def recording(self) -> Recording | None:
        """The samples; ``None`` where none could be read."""
        return self.screening.recording

    def to_dict(self) -> dict[str, Any]:
        """The JSON contract, version 2: one object of ``valves.json`` (docs/json.md)."""
        return to_contract(self.screening, stands=self.stands)

    def plot(self) -> Figure:
        """OP, MV and the model over time, and MV against OP with the stick band of S and J.

        Returns a matplotlib ``Figure``. Raises ``ModuleNotFoundError`` without matplotlib (extra
        ``notebook``) and ``ValueError`` where there are no samples to draw.
        """
        from stemwatch.plots import screening_figure

        return screening_figure(self.screening, self.verdict)

    def __repr__(self) -> str:
        screening, confidence = self.screening, finite(self.confidence)
        numbers = f"severity {self.severity:.0f} of 100"
        if confidence is not None:
            numbers += f", confidence {share(confidence)}"
        verdict = f"{VERDICT_SYMBOL[self.verdict]} {self.verdict.value}"
        lines = [f"{printable(screening.valve)}: {verdict}"]
        lines[0] += f" ({numbers})"
        lines += _wrapped(self.reason) + _wrapped(self.advice)
        if screening.S.value is not None:
            lines.append(f"  S {screening.S}, J {screening.J} of OP span")
        return "\n".join(lines + _mismatch_lines(screening.mismatch, self.remark))

    def _repr_html_(self) -> str:
        from stemwatch.html import screened_card

        return screened_card(self.screening, self._finding, self.remark)


@dataclass(frozen=True, repr=False)
class ExplainedValve:
    """One valve, explained: the physics that S and J leave out, from ``stemwatch.explain``.

    ``mismatch`` is the complete result; its ``naive`` holds S and J fitted alone, its ``restated``
    those fitted with the named effects.
    """

    explained: Explained
    stands: bool | None = None
    """As ``ScreenedValve.stands``."""
    remark: str = ""
    """As ``ScreenedValve.remark``."""

    @property
    def valve(self) -> str:
        """The valve's name."""
        return self.explained.valve

    @property
    def mismatch(self) -> Mismatch:
        """The comparison of simulation and recording: effects, both fits, S and J restated."""
        return self.explained.mismatch

    @property
    def finding(self) -> Finding:
        """``named``, ``candidates``, ``unknown``, ``none`` or ``not_testable``."""
        return self.explained.mismatch.finding

    @property
    def sentence(self) -> str:
        """The finding in one sentence."""
        return self.explained.mismatch.sentence

    @property
    def effects(self) -> tuple[str, ...]:
        """The slugs of the named effects beside S and J, in order of work."""
        return tuple(effect.slug for effect in self.explained.mismatch.effects)

    @property
    def S(self) -> Estimate:
        """Dead band plus stick band, restated with the named effects, percent of OP span."""
        return self.explained.mismatch.restated.S

    @property
    def J(self) -> Estimate:
        """Slip jump, restated with the named effects, percent of OP span."""
        return self.explained.mismatch.restated.J

    @property
    def recording(self) -> Recording | None:
        """The samples; ``None`` where none could be read."""
        return self.explained.recording

    def to_dict(self) -> dict[str, Any]:
        """One object of ``explain.json``, version 1 (docs/json.md)."""
        return to_object(self.explained, stands=self.stands)

    def plot(self) -> Figure:
        """MV beside the run of S and J alone and the run with what was left out, over time.

        Returns a matplotlib ``Figure``. Raises ``ModuleNotFoundError`` without matplotlib (extra
        ``notebook``) and ``ValueError`` where there are no samples to draw.
        """
        from stemwatch.plots import mismatch_figure

        return mismatch_figure(self.recording, self.mismatch)

    def __repr__(self) -> str:
        lines = [printable(self.valve), *_mismatch_lines(self.mismatch, self.remark)]
        if self.S.value is not None:
            base_fit = self.mismatch.naive
            lines.append(f"  S {self.S}, J {self.J} of OP span")
            if self.mismatch.effects:
                lines.append(f"  with S and J alone: S {base_fit.S}, J {base_fit.J}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        from stemwatch.html import explained_card

        return explained_card(self.valve, self.mismatch, self.remark)


Valve = TypeVar("Valve", bound=ScreenedValve | ExplainedValve)


class _Valves(Sequence[Valve], Generic[Valve]):
    """Several results in the order of the inputs, indexed by position or valve name."""

    def __init__(self, valves: Sequence[Valve], discoveries: Discoveries) -> None:
        self._valves = tuple(valves)
        self.discoveries = discoveries

    def __len__(self) -> int:
        return len(self._valves)

    def __iter__(self) -> Iterator[Valve]:
        return iter(self._valves)

    @overload
    def __getitem__(self, key: int | str) -> Valve: ...

    @overload
    def __getitem__(self, key: slice) -> list[Valve]: ...

    def __getitem__(self, key: int | str | slice) -> Valve | list[Valve]:
        if isinstance(key, slice):
            return list(self._valves[key])
        if isinstance(key, int):
            return self._valves[key]
        for valve in self._valves:
            if valve.valve == key:
                return valve
        names = [valve.valve for valve in self._valves]
        raise KeyError(f"no valve {key!r} among {len(names)}{nearest(key, names)}")


class ScreenedValves(_Valves[ScreenedValve]):
    """Several valves, screened together: what ``stemwatch.screen`` gives for a file or a list.

    ``work[0]`` and ``work["FIC-101"]`` give one valve, iteration all in the order in which they
    were given; ``to_frame()``, ``print`` and a notebook show the most urgent first.
    """

    def __init__(
        self, valves: Sequence[ScreenedValve], discoveries: Discoveries, zone: str | None = None
    ) -> None:
        super().__init__(valves, discoveries)
        self._context = ReportContext(started=datetime.now(UTC), zone=zone or "UTC")

    def ranked(self) -> list[ScreenedValve]:
        """The most urgent first, as in a report."""
        by_id = {id(valve.screening): valve for valve in self}
        return [by_id[id(ranked.screening)] for ranked in self._ranking()]

    def to_frame(self) -> pd.DataFrame:
        """A row for each valve, the most urgent first, with the columns of ``valves.csv``.

        Percent of span, seconds; times are aware, in the zone that the call named (UTC without).
        """
        import pandas as pd

        columns, rows = header_and_rows(self._ranking(), self._context)
        return pd.DataFrame(list(rows), columns=[column.header for column in columns])

    def to_dict(self) -> list[dict[str, Any]]:
        """The objects of ``valves.json``, the most urgent first (docs/json.md)."""
        return [valve.to_dict() for valve in self.ranked()]

    def _ranking(self) -> Ranking:
        return rank_valves([valve.screening for valve in self], self._context)

    def __repr__(self) -> str:
        if len(self) == 1:
            return repr(self[0])
        counts = self._ranking().recordings_of
        verdicts = ", ".join(f"{n} {verdict.value}" for verdict, n in counts.items() if n)
        lines = [f"{len(self)} valves: {verdicts}" if verdicts else f"{len(self)} valves"]
        first_valves = self.ranked()[:_MOST_LISTED]
        width = max((len(valve.valve) for valve in first_valves), default=0)
        for rank, valve in enumerate(first_valves, start=1):
            numbers = f"S {valve.S}, J {valve.J}"
            if valve.S.value is None:
                numbers = textwrap.shorten(printable(valve.reason), _WIDTH - 24, placeholder=" ...")
            symbol = VERDICT_SYMBOL[valve.verdict]
            name = printable(valve.valve).ljust(width)
            lines.append(f"{rank:3} {name}  {symbol} {valve.verdict.value:12}  {numbers}".rstrip())
        if len(self) > len(first_valves):
            lines.append(f"    and {len(self) - len(first_valves)} more: .to_frame() has them all")
        return "\n".join(lines + _wrapped(self.discoveries.sentence))

    def _repr_html_(self) -> str:
        from stemwatch.html import screened_table

        ranked = [(valve.screening, valve._finding, valve.stands) for valve in self.ranked()]
        return screened_table(ranked, self.discoveries.sentence)


class ExplainedValves(_Valves[ExplainedValve]):
    """Several valves, explained together: what ``stemwatch.explain`` gives for a file or a list."""

    def to_dict(self) -> list[dict[str, Any]]:
        """The objects of ``explain.json``, in the order of the inputs."""
        return [valve.to_dict() for valve in self]

    def __repr__(self) -> str:
        lines = [repr(valve) for valve in self[:_MOST_LISTED]]
        if len(self) > _MOST_LISTED:
            lines.append(f"and {len(self) - _MOST_LISTED} more")
        return "\n".join(lines + _wrapped(self.discoveries.sentence))

    def _repr_html_(self) -> str:
        return "\n".join(valve._repr_html_() for valve in self[:_MOST_LISTED])


def screened(screenings: Sequence[Screening]) -> tuple[list[ScreenedValve], Discoveries]:
    """Each screening, with whether its effects stand after false-discovery control over all."""
    of_all = discoveries([screening.mismatch for screening in screenings])
    valves = [
        ScreenedValve(screening, stands, of_all.remark() if stands is False else "")
        for screening, stands in zip(screenings, of_all.standing, strict=True)
    ]
    return valves, of_all


def explained(results: Sequence[Explained]) -> tuple[list[ExplainedValve], Discoveries]:
    """Each explanation, with whether its effects stand after false-discovery control over all."""
    of_all = discoveries([result.mismatch for result in results])
    valves = [
        ExplainedValve(result, stands, of_all.remark() if stands is False else "")
        for result, stands in zip(results, of_all.standing, strict=True)
    ]
    return valves, of_all


def _mismatch_lines(mismatch: Mismatch | None, remark: str) -> list[str]:
    if mismatch is None:
        return []
    title = finding_title(mismatch).capitalize()
    # The sentence of a recording without a verdict begins with what this title already says.
    lines = _wrapped(f"{title}: {mismatch.sentence.removeprefix('Cannot tell: ')}")
    return lines + _wrapped(remark)


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(
        printable(text), _WIDTH, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False
    )


__all__ = [
    "ExplainedValve",
    "ExplainedValves",
    "ScreenedValve",
    "ScreenedValves",
    "explained",
    "screened",
]
