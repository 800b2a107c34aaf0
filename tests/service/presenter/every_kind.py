"""A run with valves of every kind, and what a reader finds in its outputs."""

from __future__ import annotations

import csv
import html
import itertools
import json
import re
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import openpyxl

from stemwatch.models.recording import Provenance
from stemwatch.models.screening.screen import failed
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import NoVerdict, Verdict
from stemwatch.service.report import ReportContext
from stemwatch.service.report.ranking import Ranking, rank_valves
from stemwatch.service.run.engine import in_brief
from stemwatch.service.run.finish import hold_back
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.store import Store
from tests.service.maintenance.example_work_list import context, frozen, with_effects
from tests.service.report.conftest import screening
from tests.service.report.test_without_position import cannot_tell, no_sign, suspected

NO_POSITION = (
    "Cannot tell: there is no valve position in this recording, and what OP and PV alone say is "
    "no verdict."
)
BAD = "Cannot tell: 62 % of the samples are missing or marked bad."
IN_MM = "Cannot tell: ZT8 is in mm, so OP and position cannot be compared."
SHORT = "Cannot tell: the recording is too short: 90 usable samples in 1.5 minutes."
SLOW = "Cannot tell: the archive stores the position every 300 s, too seldom to see how it moves."
SLUGS = {NO_POSITION: "no_position", BAD: "bad_samples", IN_MM: "position_unit"}


def blind(valve: str, reason: str) -> Screening:
    """A valve that cannot be judged."""
    result = screening(valve, Verdict.UNDETERMINED, samples=60)
    why = NoVerdict.of(SLUGS.get(reason))
    return replace(result, reason=reason, no_verdict=why, still_seen=(), severity=15.0)


def by_chance(valve: str) -> Screening:
    """A healthy valve on which chance alone may have named an effect."""
    result = with_effects(valve, Verdict.HEALTHY)
    assert result.mismatch is not None
    return replace(result, mismatch=replace(result.mismatch, p_value=0.6))


def as_built(valve: str) -> Screening:
    """A healthy drive whose effects belong to such a machine."""
    result = with_effects(valve, Verdict.HEALTHY)
    assert result.mismatch is not None
    effects = tuple(replace(effect, inherent=True) for effect in result.mismatch.effects)
    return replace(result, mismatch=replace(result.mismatch, effects=effects))


def slightly_off(valve: str) -> Screening:
    """A healthy valve whose position reads high by less than is worth a work order."""
    result = with_effects(valve, Verdict.HEALTHY)
    assert result.mismatch is not None
    (first, *_) = result.mismatch.effects
    zero = replace(first, slug="zero_shift", members=("zero_shift",), inherent=True)
    return replace(result, mismatch=replace(result.mismatch, effects=(zero,)))


def every_kind() -> list[Screening]:
    """Sticky, sticky with an effect, defective, to watch, healthy, and what cannot be judged, for
    each main reason, also where OP and PV alone suggest sticking or show no sign of it."""
    return [*_made_once()]


@cache
def _made_once() -> tuple[Screening, ...]:
    return (
        screening("FIC-1", S=6.0),
        screening("FIC-2", S=2.1, J=0.3),
        with_effects("FIC-3", Verdict.STICKY),
        with_effects("FIC-4", Verdict.HEALTHY),
        with_effects("FIC-5", Verdict.WATCH),
        screening("FIC-6", Verdict.WATCH, S=1.1),
        screening("FIC-7", Verdict.HEALTHY, S=0.3),
        by_chance("FIC-8"),
        as_built("FIC-9"),
        slightly_off("FIC-10"),
        frozen("PIC-1"),
        blind("PIC-2", NO_POSITION),
        blind("PIC-3", BAD),
        failed(
            "PIC-4", "x.csv: the file is empty", "Look at the file.", Provenance(source="x.csv")
        ),
        replace(blind("PIC-5", NO_POSITION), without_position=suspected()),
        replace(blind("PIC-6", NO_POSITION), without_position=no_sign()),
        blind("PIC-7", IN_MM),
        replace(blind("PIC-8", SHORT), without_position=cannot_tell("OP is at its limit")),
        blind("PIC-9", SLOW),
    )


def save_run(store: Store) -> int:
    """The run of every kind into ``store``."""
    facts = needed(every_kind()).valves
    store.save_valves(
        StoredValve(id=valve, criticality=int(facts[valve].criticality)) for valve in facts
    )
    run = store.begin_run(software_version="1")
    for item in every_kind():
        store.save(item.without_samples(), run)
    hold_back(store, run)
    store.finish_run(run)
    return run


def needed(screenings: Iterable[Screening]) -> ReportContext:
    """The plant can least do without one valve, next to without another, by turns, so that the
    order is neither that of severity nor that of tags."""
    made = context(list(screenings))
    levels = itertools.cycle("213")
    return replace(
        made,
        valves={
            valve: replace(facts, criticality=next(levels)) for valve, facts in made.valves.items()
        },
    )


def brief_ranking(screenings: Iterable[Screening]) -> Ranking:
    """As the terminal has it."""
    return rank_valves(brief := [in_brief(item) for item in screenings], needed(brief))


def text_of(page: str) -> str:
    """A page's text with single blanks."""
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", page)).split())


def bare(text: str) -> str:
    """Without blanks, line breaks and what stands for an unprintable letter."""
    return re.sub(r"[\s\N{NO-BREAK SPACE}\ufffd]+", "", html.unescape(text))


def page_text(page: str) -> str:
    """What a reader of a page sees, without blanks."""
    return bare(re.sub(r"<script.*?</script>|<style.*?</style>|<[^>]+>", " ", page, flags=re.S))


def csv_rows(file: Path) -> list[dict[str, str]]:
    """The rows of a table."""
    with file.open(encoding="utf-8-sig", newline="") as table:
        return list(csv.DictReader(table))


def workbook_rows(file: Path, sheet: str = "Ranking") -> list[dict[str, Any]]:
    """The rows of one sheet."""
    header, *rows = openpyxl.load_workbook(file)[sheet].iter_rows(values_only=True)
    return [dict(zip(map(str, header), row, strict=True)) for row in rows]


def json_objects(files: Path) -> list[dict[str, Any]]:
    """The valves of a report's JSON."""
    result: list[dict[str, Any]] = json.loads((files / "valves.json").read_text("utf-8"))
    return result
