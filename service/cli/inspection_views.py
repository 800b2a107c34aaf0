"""What ``stemwatch inspect`` shows: what was understood of a file, and the plant file proposed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.table import Table

from stemwatch.models.words import counted
from stemwatch.service.cli.views import as_toml_escapes, escape, out

if TYPE_CHECKING:
    from pathlib import Path

    from stemwatch.connectors.historian.inspection import Inspection, TagInspection

LONGEST_TAG = 24  # characters of a tag that stay on one line
NAMED = 6  # tags with the same remark that are named


def inspection_tables(inspection: Inspection) -> Iterator[Table]:
    """What was understood of a file, then of each tag."""
    facts = Table(show_header=False, title=escape(inspection.source), title_justify="left")
    for name, value in _facts(inspection):
        facts.add_row(name, escape(value))
    yield facts
    # Fits 80 columns: the gap between two is one blank, so that evidence has room for its words.
    tags = Table(
        title="Tags", title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False
    )
    tag_width = min(LONGEST_TAG, max((len(tag.tag) for tag in inspection.tags), default=0))
    for name in ("tag", "role", "unit", "valve", "range", "bad", "every, s", "evidence"):
        width = {"tag": tag_width, "evidence": 10}.get(name)
        tags.add_column(name, overflow="fold", min_width=width, no_wrap=name == "range")
    for tag in inspection.tags:
        low_high = "" if tag.low is None or tag.high is None else f"{tag.low:.4g} to {tag.high:.4g}"
        interval_s = tag.own_interval_s or tag.interval_s
        tags.add_row(
            escape(tag.tag),
            tag.role or "?",
            escape(tag.unit),
            escape(tag.valve),
            low_high,
            "text" if tag.role == "mode" and tag.low is None else f"{tag.bad_share:.1%}",
            "" if interval_s is None else f"{interval_s:g}",
            "; ".join(_evidence(tag)),
        )
    yield tags


def show_proposal(toml: str) -> None:
    """Print a part of a plant file that is proposed, to be copied."""
    from rich.syntax import Syntax

    out.print("\n[bold]Proposed for plant.toml[/] (check the roles before you trust it):\n")
    mapping = Syntax("", "toml", background_color="default").highlight(as_toml_escapes(toml))
    out.print(mapping, soft_wrap=True)  # a line cut at the terminal's edge is no TOML


def say_plant_written(file: Path) -> None:
    """Say that a proposed plant file is written, and what comes next."""
    out.print(f"\n{escape(str(file))} is written. Check the roles in it; then")
    out.print(f"  stemwatch screen --plant {escape(str(file))}", soft_wrap=True)


def inspection_remarks(inspection: Inspection) -> Iterator[str]:
    """Remarks on tags and their roles; tags with the same remark share a line."""
    by_remark: dict[str, list[str]] = {}
    for tag in inspection.tags:
        if tag.remark:
            by_remark.setdefault(tag.remark, []).append(tag.tag)
    for remark_text, tags in by_remark.items():
        names = ", ".join(tags[:NAMED]) + (" ..." if len(tags) > NAMED else "")
        yield f"[bold]{escape(names)}[/]  {escape(remark_text)}"


def _facts(inspection: Inspection) -> list[tuple[str, str]]:
    clock = inspection.clock
    separator = {"\t": "tab"}.get(inspection.separator, repr(inspection.separator))
    window = (
        f"{inspection.start} to {inspection.end}"
        if inspection.start
        else "dates not known without a time zone"
    )
    interval = "" if inspection.interval_s is None else f"{inspection.interval_s:g} s"
    return [
        ("layout", inspection.layout),
        (
            "encoding, separator, decimal mark",
            f"{inspection.encoding}, {separator}, {inspection.decimal!r}",
        ),
        ("time", inspection.zone or "counted from a start that the file does not date"),
        ("window", window),
        ("rows", str(inspection.rows)),
        ("sampling interval, jitter", f"{interval}, {clock.jitter_s:.3g} s"),
        (
            "clock",
            f"{counted(clock.gaps, 'gap')} (longest {clock.longest_gap_s:g} s), "
            f"{counted(clock.repeated_times, 'repeated time')}, "
            f"{counted(clock.backward_steps, 'step backward', 'steps backward')}",
        ),
        *[("decided", text) for text in inspection.decisions],
        *[("problem", text) for text in inspection.problems],
    ]


def _evidence(tag: TagInspection) -> list[str]:
    clauses = []
    if tag.compressed:
        clauses.append(f"compressed ({tag.line_share:.0%} on lines)")
    if tag.quantum:
        clauses.append(f"steps of {tag.quantum:.3g}")
    if tag.frozen and tag.role not in ("sp", "mode"):  # set points and modes are meant to rest
        clauses.append(f"frozen up to {tag.longest_repeat_s:g} s")
    return clauses
