"""Output in the terminal: tables, verdict lines, progress."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime, tzinfo
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape as _escape_markup
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from stemwatch.models.verdict import Verdict

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from stemwatch.connectors.historian.inspection import Inspection, TagInspection
    from stemwatch.models.estimate import Estimate
    from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
    from stemwatch.models.screening_result import Screening
    from stemwatch.service.config import Plant
    from stemwatch.service.report import ReportContext
    from stemwatch.service.report.ranking import RankedValve, Ranking
    from stemwatch.service.store.administration.backup_file import TableDigest
    from stemwatch.service.store.administration.check import DatabaseHealth
    from stemwatch.service.store.administration.prune import Pruned
    from stemwatch.service.studies.miswiring import WiringAnswer
    from stemwatch.service.studies.robustness import StudyAnswer

# Seeds that were looked at while the method was made.
DEVELOPED_WITH = (5151, 6161, 7171, 8181, 8383, 9393)

out = Console()
err = Console(stderr=True)

STYLE = {
    Verdict.STICKY: "bold red",
    Verdict.DEFECTIVE: "bold magenta",
    Verdict.WATCH: "yellow",
    Verdict.UNDETERMINED: "cyan",
    Verdict.HEALTHY: "green",
}
WIDE = 130  # columns of a terminal from which the summary has room for sentences
LONGEST_TAG = 24  # characters of a tag that stay on one line
NAMED = 6  # valves that are named for one reason, or whose signals are listed
NARROW, MIDDLE = 76, 100  # below these only what matters most, and what has room beside it
SHOWN = 40  # lines of the summary; the report has all

# Control characters, and the format characters that reverse or hide letters.
_UNPRINTABLE = re.compile(
    "[\x00-\x09\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]"
)


def escape(text: str) -> str:
    """``text`` without markup and without control characters for the terminal."""
    return _escape_markup(_UNPRINTABLE.sub("\N{REPLACEMENT CHARACTER}", text))


def as_toml_escapes(text: str) -> str:
    """TOML with control characters and invisible letters written as escapes."""
    return _UNPRINTABLE.sub(lambda match: f"\\U{ord(match[0]):08x}", text)


def say_error(text: str) -> None:
    """Print an error to standard error."""
    err.print(f"[bold red]stemwatch:[/] {escape(text)}", highlight=False)


def say(text: str) -> None:
    """Print a line of progress to standard error."""
    err.print(escape(text), highlight=False)


def say_if_not_blind(seed: int) -> None:
    """Say so where valves of this seed were looked at while the method was made."""
    if seed in DEVELOPED_WITH:
        say(f"Seed {seed} was looked at while the method was made: this is not blind.")


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file that an option names: replaced whole, or left as it was.

    Raises ``ReportNotWritten`` with the file and what to do.
    """
    from stemwatch.service.report.write_report import put_all

    written = content.encode() if isinstance(content, str) else content
    if path.exists() and not path.is_file():  # /dev/stdout, a pipe
        path.write_bytes(written)
    else:
        put_all({path.resolve(): written})


def write_answers(
    answers: Sequence[WiringAnswer] | Sequence[StudyAnswer], json_file: Path | None
) -> None:
    """The answers of a study, dataclasses with a ``verdict``, as JSON, where a file is named."""
    if json_file is not None:
        objects = [{**asdict(answer), "verdict": answer.verdict.value} for answer in answers]
        write_file(json_file, json.dumps(objects, indent=1) + "\n")


def say_next(text: str) -> None:
    """Print what to do next, to standard error, so that programs that read the output are not
    disturbed."""
    err.print(f"[bold]Next:[/] {escape(text)}", highlight=False, soft_wrap=True)


def say_read_on(page: str) -> None:
    """Print where the counts of a study are explained, and what to do with valves of one's own."""
    say_next(
        f"docs/{page} says what was simulated and how to read these figures; valves of your own: "
        "`stemwatch screen FILE`."
    )


def say_result(text: str) -> None:
    """Print a line of the result to standard output."""
    out.print(escape(text), highlight=False)


def _number(estimate: Estimate) -> str:
    if estimate.value is None:
        return "-"
    if estimate.low is None or estimate.high is None:
        return f"{estimate.value:.1f}"
    return f"{estimate.value:.1f} ({estimate.low:.1f}-{estimate.high:.1f})"


def page_context(title: str, plant: Plant | None, zone: str) -> ReportContext:
    """The context of a page: its title, the plant's name, and times in the plant's zone, else in
    ``zone``, else UTC."""
    from stemwatch.connectors.secret import masked_command
    from stemwatch.service.report import ReportContext

    return ReportContext(
        started=datetime.now(UTC),
        title=title,
        plant=plant.name if plant else "",
        zone=(plant.zone if plant else None) or zone or "UTC",
        command=masked_command(("stemwatch", *sys.argv[1:])),
    )


def verdict_line(screening: Screening, zone: tzinfo = UTC) -> str:
    """Verdict, valve, when its recording begins, and the reason on one line."""
    from stemwatch.service.presenter.finding import present
    from stemwatch.service.presenter.wording import instant

    presented = present(screening, stands=None)
    verdict = presented.decision.verdict
    start = screening.window[0]
    begins = "" if start is None else f", {instant(start, zone)}"
    return (
        f"[{STYLE[verdict]}]{verdict.value:12}[/] [bold]{escape(screening.valve)}[/]{begins}  "
        f"{escape(presented.reason)}"
    )


@contextmanager
def progress(
    description: str, total: int, *, transient: bool = False
) -> Iterator[Callable[[int], None]]:
    """A progress bar; yields a function that is called with how many of ``total`` are done. A
    transient bar is removed at its end."""
    with Progress(console=err, transient=transient) as bars:
        bar = bars.add_task(description, total=total)
        yield lambda items_done: bars.update(bar, completed=items_done)


@contextmanager
def screening_progress(zone_name: str) -> Iterator[Callable[[Screening, int, int], None]]:
    """A progress bar with rate and time left, and a line for each recording of a sticky or watched
    valve, with its time in the zone."""
    zone = ZoneInfo(zone_name)
    columns = (
        TextColumn("screening"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("recordings"),
        TaskProgressColumn(
            show_speed=True, text_format="[progress.percentage]{task.percentage:.0f} %"
        ),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err) as bars:
        bar = bars.add_task("screening", total=0, rate="")

        def on_screened(screening: Screening, finished: int, total: int) -> None:
            elapsed = bars.tasks[0].elapsed or 1e-9
            bars.update(bar, completed=finished, total=total, rate=f"{finished / elapsed:.1f}/s")
            if is_final(screening) and screening.verdict in (Verdict.STICKY, Verdict.WATCH):
                bars.console.print(verdict_line(screening, zone), highlight=False)

        yield on_screened


def is_final(screening: Screening) -> bool:
    """Whether the verdict is final before all valves of the run are screened. One that rests on an
    effect beside friction is not, since false-discovery control may still hold the effect back."""
    from stemwatch.service.presenter.work_decision import decide

    return decide(screening, stands=None).verdict is decide(screening, stands=False).verdict


def summary(ranking: Ranking) -> Table:
    """The ranking in the order and the words of the report."""
    from stemwatch.service.presenter.suspicion_words import (
        NO_SIGN_NOTE,
        SUSPECTED_NOTE,
        answers_sentence,
        loops_to_test,
        loops_without_sign,
    )

    lines = _lines_of_ranking(ranking)
    is_cut = len(lines) == SHOWN < len(ranking)
    worst_shown = f", the first {SHOWN} shown" if is_cut else ""
    table = Table(
        title=f"{ranking.counts.sentence.rstrip('.')}{worst_shown}.", title_justify="left"
    )
    note_of = dict.fromkeys(loops_to_test(ranking.next_steps), SUSPECTED_NOTE)
    note_of |= dict.fromkeys(loops_without_sign(ranking.next_steps), NO_SIGN_NOTE)
    first = answers_sentence(ranking.next_steps)
    table.caption, table.caption_justify = (
        "\n".join(filter(None, (_verdicts(ranking), escape(first)))),
        "left",
    )
    narrow, wide = out.width < NARROW, out.width >= WIDE
    table.add_column("", justify="right")
    table.add_column("valve", overflow="fold")  # names must not be cut
    table.add_column("verdict", no_wrap=True, min_width=len(Verdict.UNDETERMINED))
    numbers = [
        _number(estimate)
        for valve, _ in lines
        for estimate in (valve.screening.S, valve.screening.J)
    ]
    longest = max((len(part) for text in numbers for part in text.split(" ")), default=0)
    for name in ("S, %", "J, %"):  # an interval that is cut is none
        table.add_column(name, justify="right", min_width=longest)
    aside = () if narrow else ("maintenance", "shape", "data")[: 1 if out.width < MIDDLE else 3]
    for name in aside:
        table.add_column(name, no_wrap=True)
    if wide:  # in a narrow terminal the sentence would stand in a column of single words
        table.add_column("why")
    for valve, recording in lines:
        screening = valve.screening
        shape = screening.shape.value if screening.shape else ""
        named = note_of.get(screening.valve, "")
        note = f"\n{named}" if named and screening.verdict is Verdict.UNDETERMINED else ""
        urgency = f"\npriority {valve.priority.code}" if valve.priority else ""
        side_cells = (f"{valve.decision.state.value}{urgency}", shape, screening.quality.grade)[
            : len(aside)
        ]
        table.add_row(
            str(valve.rank),
            escape("\n".join(filter(None, (screening.valve, recording)))),
            f"[{STYLE[valve.verdict]}]{valve.verdict.value}[/]{note}",
            _number(screening.S),
            _number(screening.J),
            *side_cells,
            *([escape(valve.finding.reason)] if wide else []),
        )
    return table


def _lines_of_ranking(ranking: Ranking) -> list[tuple[RankedValve, str]]:
    """The first lines of the table, each with the recording that it is of. Where nothing has a
    verdict, a valve has one line and the number of its recordings: the others would say the same.
    """
    if set(ranking.verdicts) != {Verdict.UNDETERMINED}:
        shown = ranking[:SHOWN]
        if out.width < MIDDLE and _begin_apart(shown):
            # In a narrow column the file's name would take up many lines.
            return [(valve, valve.begins if valve.recording else "") for valve in shown]
        return [(valve, valve.recording) for valve in shown]
    lines: dict[str, tuple[RankedValve, str]] = {}
    for valve in ranking:
        recordings = f"{valve.recordings} recordings" if valve.recordings > 1 else ""
        lines.setdefault(valve.screening.valve, (valve, recordings))
        if len(lines) == SHOWN:
            break
    return list(lines.values())


def _begin_apart(valves: Sequence[RankedValve]) -> bool:
    """Whether the recordings of every valve are told apart by when they begin."""
    known = [(valve.screening.valve, valve.begins) for valve in valves if valve.recording]
    return all(begins for _, begins in known) and len(set(known)) == len(known)


def _verdicts(ranking: Ranking) -> str:
    """How many recordings there are of each verdict."""
    from stemwatch.service.report.ranking import count_verdicts

    counts = count_verdicts(ranking)
    said = ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count)
    return (
        f"Of the recordings: {said}" if ranking.counts.recordings > ranking.counts.valves else said
    )


def undetermined_lines(
    screenings: Sequence[Screening], groups: Sequence[OscillationGroup] = ()
) -> Iterator[str]:
    """What to do at the valves without a verdict: of those without a position one line for each
    answer of OP and PV and its reason, then of the others one for each reason of the verdict."""
    from stemwatch.service.presenter.suspicion_words import next_steps
    from stemwatch.service.presenter.work_decision import NO_POSITION, obstacle_kind

    steps = next_steps(
        [
            screening
            for screening in screenings
            if screening.verdict is not Verdict.UNDETERMINED
            or obstacle_kind(screening.reason) == NO_POSITION
        ],
        groups,
    )
    for step in steps:
        why_and_step = " ".join(filter(None, (step.why, step.step)))
        yield _line_of(step.answer, step.loops, why_and_step)
    told = {valve for step in steps for valve in step.loops}
    by_reason: dict[str, dict[str, None]] = {}
    for screening in screenings:
        if screening.verdict is Verdict.UNDETERMINED and screening.valve not in told:
            by_reason.setdefault(screening.reason, {})[screening.valve] = None
    for reason, tags in by_reason.items():
        yield _line_of(Verdict.UNDETERMINED.value, [*tags], reason)


def oscillation_lines(groups: Sequence[OscillationGroup]) -> Iterator[str]:
    """One line for each group of loops that oscillate together, the likeliest source first."""
    from stemwatch.service.presenter.oscillation_words import headline

    for group in groups:
        loops = [member.loop for member in group.members]
        yield _line_of("oscillation", loops, f"{headline(group)}.")


def _line_of(answer: str, valves: Sequence[str], sentence: str) -> str:
    names = ", ".join(valves[:NAMED])
    and_more = f" and {len(valves) - NAMED} more" if len(valves) > NAMED else ""
    return f"[cyan]{answer}[/] [bold]{escape(names)}{and_more}[/]  {escape(sentence)}"


def signal_lines(screenings: Sequence[Screening]) -> Iterator[str]:
    """What was read of each valve, where the valves are few."""
    from stemwatch.service.presenter.wording import signals_read

    for screening in screenings if len(screenings) <= NAMED else ():
        seen = screening.seen
        if seen is not None:
            tags = {role: tag for role, (tag, _) in seen.tags.items()}
            yield f"[bold]{escape(screening.valve)}[/]  {escape(signals_read(tags))}"


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
            f"{clock.gaps} gaps (longest {clock.longest_gap_s:g} s), {clock.repeated_times} "
            f"repeated times, {clock.backward_steps} steps backward",
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


def health_table(address: str, health: DatabaseHealth) -> Table:
    """Rows and size of each table; the title names the database."""
    layout = f"samples in a {health.layout.value}".replace("a partitions", "partitions")
    title = f"{address}: {health.engine}, schema {health.schema or 'none'}, {layout}"
    table = Table(title=escape(title), title_justify="left")
    table.add_column("table")
    for name in ("rows", "size"):
        table.add_column(name, justify="right")
    for table_size in health.tables:
        size = "" if table_size.size_bytes is None else _size(table_size.size_bytes)
        table.add_row(table_size.name, f"{table_size.rows}", size)
    table.add_row("all", "", _size(health.size_bytes))
    return table


def copied_table(title: str, digests: Mapping[str, TableDigest]) -> Table:
    """The copied rows of each table and the beginning of their digest."""
    table = Table(title=escape(title), title_justify="left")
    table.add_column("table")
    table.add_column("rows", justify="right")
    table.add_column("digest")
    for name, digest in digests.items():
        table.add_row(name, str(digest.rows), digest.digest[:16])
    return table


def pruned_table(address: str, pruned: Pruned, *, done: bool) -> Table:
    """The rows that were removed or would be."""
    verb = "removed from" if done else "would be removed from"
    table = Table(title=escape(f"{verb} {address}"), title_justify="left")
    table.add_column("what")
    table.add_column("rows", justify="right")
    for name in ("samples", "screenings", "runs", "alerts", "messages"):
        table.add_row(name, str(getattr(pruned, name)))
    return table


def _size(size_bytes: int) -> str:
    """A number of bytes with a unit."""
    size, unit = float(size_bytes), "B"
    for unit in ("B", "kB", "MB", "GB", "TB"):
        if size < 1000 or unit == "TB":
            break
        size /= 1000
    return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
