"""The columns of CSV and XLSX: one row per valve, the same headers and meanings in both."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime

from stemwatch.models.screening_result import Screening
from stemwatch.service.presenter.false_discoveries import LEVEL_PERCENT
from stemwatch.service.presenter.physics_words import left_out
from stemwatch.service.presenter.urgency import CLASSES_IN_WORDS
from stemwatch.service.presenter.wording import as_sentences, finite, printable
from stemwatch.service.report.ranking import RankedValve
from stemwatch.service.report.report_context import ReportContext

Cell = str | float | int | datetime | None

STATES = (
    "needs work: the stem sticks, or it is defective by an effect beside friction; watch; "
    "cannot be judged; no work"
)
PRIORITY = (
    f"of the work order, from severity and criticality: {CLASSES_IN_WORDS}; empty without one"
)
STEM = "what S and J alone say of the stem; version 1 had this as verdict"
TREND = "rate of S over weeks with its 95 % interval, else the change since the run before"
STANDING = {True: "yes", False: "held back", None: None}
BEYOND_CHANCE = (
    f"yes: of the effects so marked, at most {LEVEL_PERCENT} are expected to be due to chance "
    "(Benjamini-Hochberg over all valves); held back: chance alone may have named it"
)


@dataclass(frozen=True, kw_only=True)
class SpreadsheetColumn:
    """One column. ``digits`` is how many decimals a spreadsheet shows; the value keeps all."""

    header: str
    meaning: str
    read: Callable[[RankedValve], Cell]
    width: int = 12
    digits: int = 2


def columns(context: ReportContext) -> list[SpreadsheetColumn]:
    """Every column, in order; times in the plant's zone, which their headers name."""
    return [
        *_identity_columns(),
        *_finding(),
        *_stiction(),
        *_residuals("stiction", "stick-slip model"),
        *_residuals("narx", "NARX network"),
        *_residuals("baseline", "baseline"),
        *_mismatch(),
        *_without_position(),
        *_recording(context),
    ]


def header_and_rows(
    ranked: Sequence[RankedValve], context: ReportContext
) -> tuple[list[SpreadsheetColumn], Iterator[list[Cell]]]:
    """The columns and, valve by valve as they are asked for, their cells, every text printable."""
    chosen_columns = columns(context)
    return chosen_columns, (
        [clean_cell(column.read(valve)) for column in chosen_columns] for valve in ranked
    )


def clean_cell(cell: Cell) -> Cell:
    """A cell as every table shows it: printable text, a number that is one, or nothing."""
    if isinstance(cell, str):
        return printable(cell)
    return finite(cell) if isinstance(cell, float) else cell


def _text(
    header: str, meaning: str, read: Callable[[RankedValve], Cell], width: int
) -> SpreadsheetColumn:
    return SpreadsheetColumn(header=header, meaning=meaning, read=read, width=width)


def _identity_columns() -> list[SpreadsheetColumn]:
    return [
        _text("rank", "1 is the valve to work on first", lambda v: v.rank, 6),
        _text("valve", "tag", lambda v: v.screening.valve, 18),
        _text("service", "what the valve does", lambda v: v.facts.description, 32),
        _text("site", "ISA-95 site", lambda v: v.facts.site, 12),
        _text("area", "plant area", lambda v: v.facts.area, 14),
        _text("unit", "ISA-95 unit", lambda v: v.facts.unit, 12),
        _text("loop", "control loop", lambda v: v.facts.loop, 14),
        _text("criticality", "as the plant states it", lambda v: v.facts.criticality, 11),
    ]


def _finding() -> list[SpreadsheetColumn]:
    return [
        _text("verdict", "see Verdicts", lambda v: v.verdict.value, 14),
        _text("NE 107", "state by NAMUR NE 107", lambda v: v.decision.ne107 or "", 16),
        _text("maintenance", STATES, lambda v: v.decision.state.value, 16),
        SpreadsheetColumn(
            header="severity (0 to 100)",
            meaning="100 is worst",
            read=lambda v: v.decision.severity,
            digits=0,
        ),
        _text("priority", PRIORITY, _priority, 8),
        SpreadsheetColumn(
            header="confidence (0 to 1)",
            meaning="how sure the verdict is; empty for undetermined and defective",
            read=lambda v: v.decision.confidence,
        ),
        _text("reason", "what was found", lambda v: v.finding.reason, 60),
        _text("advice", "what to do next", lambda v: v.finding.next_step, 60),
        _text(
            "trend",
            TREND,
            lambda v: v.trend.words,
            20,
        ),
        _text("stem verdict", STEM, lambda v: v.screening.verdict.value, 14),
        _text("shape", "form of the OP-MV loop", lambda v: _shape(v.screening), 12),
        _text("data grade", "A clean to D no verdict", lambda v: v.screening.quality.grade, 10),
        _text(
            "data remarks",
            "why it has this grade",
            lambda v: as_sentences(v.screening.quality.reasons),
            40,
        ),
    ]


def _priority(valve: RankedValve) -> int | None:
    return None if valve.priority is None else valve.priority.code


def _shape(screening: Screening) -> str:
    return "" if screening.shape is None else screening.shape.value


def _stiction() -> list[SpreadsheetColumn]:
    meanings = {
        "S": "dead band plus stick band, percent of OP span",
        "J": "slip jump, percent of OP span",
    }
    columns = []
    for name, meaning in meanings.items():
        for part, note in (("value", meaning), ("low", "95 % interval"), ("high", "95 % interval")):
            header = f"{name} (%)" if part == "value" else f"{name} {part} (%)"
            columns.append(
                SpreadsheetColumn(header=header, meaning=note, read=_estimate(name, part), width=10)
            )
        reason = f"why there is no {name}"
        columns.append(_text(f"{name} remark", reason, _estimate(name, "reason"), 24))
    return columns


def _estimate(name: str, part: str) -> Callable[[RankedValve], Cell]:
    def read(valve: RankedValve) -> Cell:
        cell: Cell = getattr(getattr(valve.screening, name), part)
        return cell

    return read


def _residuals(model: str, label: str) -> list[SpreadsheetColumn]:
    def read(part: str) -> Callable[[RankedValve], Cell]:
        return lambda valve: getattr(valve.screening.residuals.get(model), part, None)

    rmse = "root mean square residual on samples not fitted"
    return [
        SpreadsheetColumn(header=f"{label} rmse (% of span)", meaning=rmse, read=read("rmse")),
        SpreadsheetColumn(
            header=f"{label} fit (%)", meaning="100 is perfect", read=read("fit_percent")
        ),
    ]


def _mismatch() -> list[SpreadsheetColumn]:
    def fit(part: str) -> Callable[[RankedValve], Cell]:
        def read(valve: RankedValve) -> Cell:
            mismatch = valve.screening.mismatch
            return None if mismatch is None else getattr(mismatch.heldout, part)

        return read

    heldout = "100 (1 - rmse / std(MV)) on samples not fitted"
    return [
        _text("mismatch", "what came of looking for what S and J leave out", _mismatch_word, 14),
        _text(
            "left out", "what was named, in order of work; | where not told apart", _left_out, 28
        ),
        _text("beyond chance", BEYOND_CHANCE, lambda v: STANDING[v.stands], 14),
        SpreadsheetColumn(
            header="p value",
            meaning="how probable an effect as strong as this is on a valve with nothing hidden",
            read=_p_value,
            digits=4,
        ),
        SpreadsheetColumn(header="fit of S and J (%)", meaning=heldout, read=fit("fit_naive")),
        SpreadsheetColumn(
            header="fit with what was left out (%)", meaning=heldout, read=fit("fit_extended")
        ),
    ]


def _mismatch_word(valve: RankedValve) -> Cell:
    mismatch = valve.screening.mismatch
    return None if mismatch is None else mismatch.finding.value


def _left_out(valve: RankedValve) -> Cell:
    mismatch = valve.screening.mismatch
    return None if mismatch is None else left_out(mismatch)


def _p_value(valve: RankedValve) -> Cell:
    mismatch = valve.screening.mismatch
    return None if mismatch is None else mismatch.p_value


def _without_position() -> list[SpreadsheetColumn]:
    def read(part: str) -> Callable[[RankedValve], Cell]:
        return lambda valve: getattr(valve.screening.without_position, part, None)

    def apparent_S(valve: RankedValve) -> Cell:
        suspicion = valve.screening.without_position
        return None if suspicion is None else suspicion.apparent_S.value

    return [
        _text("OP and PV alone", "whether they suggest sticking; not a verdict", _suspicion, 14),
        SpreadsheetColumn(
            header="sticking score (0 to 1)", meaning="by OP and PV alone", read=read("score")
        ),
        SpreadsheetColumn(
            header="apparent S", meaning="where suspected, in the unit of OP", read=apparent_S
        ),
    ]


def _suspicion(valve: RankedValve) -> Cell:
    suspicion = valve.screening.without_position
    return None if suspicion is None else suspicion.verdict.value.replace("_", " ")


def _recording(context: ReportContext) -> list[SpreadsheetColumn]:
    def local(end: int) -> Callable[[RankedValve], Cell]:
        def read(valve: RankedValve) -> Cell:
            when = valve.screening.window[end]
            return None if when is None else when.astimezone(context.tz)

        return read

    return [
        _text(f"from ({context.zone})", "first sample", local(0), 18),
        _text(f"to ({context.zone})", "just after the last sample", local(1), 18),
        _text("interval (s)", "seconds between samples", lambda v: _interval(v.screening), 11),
        _text("samples", "in the window, missing ones too", lambda v: _samples(v.screening), 10),
        _text(
            "recording",
            "path or address, as it was given",
            lambda v: v.screening.provenance.source,
            40,
        ),
        _text("digest", "sha256 of the source", lambda v: v.screening.provenance.digest, 20),
    ]


def _interval(screening: Screening) -> Cell:
    return None if screening.seen is None else screening.seen.interval_s


def _samples(screening: Screening) -> Cell:
    return None if screening.seen is None else screening.seen.samples
