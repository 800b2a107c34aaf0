"""The result of a screening in the terminal: its progress, a table in the order of the report, and
lines on the valves without a verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, tzinfo
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

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
from stemwatch.models.words import listed
from stemwatch.service.cli.views import WIDE, err, escape, out

if TYPE_CHECKING:
    from stemwatch.models.estimate import Estimate
    from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
    from stemwatch.models.screening_result import Screening
    from stemwatch.service.report.ranking import RankedValve, Ranking

STYLE = {
    Verdict.STICKY: "bold red",
    Verdict.DEFECTIVE: "bold magenta",
    Verdict.WATCH: "yellow",
    Verdict.UNDETERMINED: "cyan",
    Verdict.HEALTHY: "green",
}
NAMED = 6  # valves that are named for one reason, or whose signals are listed
NARROW, MIDDLE = 76, 100  # below these only what matters most, and what has room beside it
SHOWN = 40  # lines of the summary; the report has all


def _number(estimate: Estimate) -> str:
    if estimate.value is None:
        return "-"
    if estimate.low is None or estimate.high is None:
        return f"{estimate.value:.1f}"
    return f"{estimate.value:.1f} ({estimate.low:.1f}-{estimate.high:.1f})"


def next_sentence(ranking: Ranking) -> str:
    """What to do with the report, and at which valve a planned test would tell what was left open:
    only what there is, for an order or a plan that cannot be made would be looked for in vain."""
    from stemwatch.service.presenter.work_decision import can_be_tested

    text = "open the report"
    if ranking.counts.needs_work or ranking.counts.orders:
        text += "; the PDF and the work orders beside it go to whoever plans the work"
    open_at = list(
        dict.fromkeys(one.screening.valve for one in ranking if can_be_tested(one.screening))
    )
    if not open_at:
        return f"{text}."
    others = f", as it can at {len(open_at) - 1} more" if len(open_at) > 1 else ""
    return (
        f"{text}. `stemwatch plan-test {open_at[0]}` plans the test that tells what was left open "
        f"there{others}."
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
    aside, wide = _add_columns(table, [valve for valve, _ in lines])
    for place, (valve, recording) in enumerate(lines, start=1):
        screening = valve.screening
        shape = screening.shape.value if screening.shape else ""
        named = note_of.get(screening.valve, "")
        note = f"\n{named}" if named and screening.verdict is Verdict.UNDETERMINED else ""
        urgency = f"\npriority {valve.priority.code}" if valve.priority else ""
        side_cells = (f"{valve.decision.state.value}{urgency}", shape, screening.quality.grade)
        table.add_row(
            str(place),
            escape("\n".join(filter(None, (screening.valve, recording)))),
            f"[{STYLE[valve.verdict]}]{valve.verdict.value}[/]{note}",
            _number(screening.S),
            _number(screening.J),
            *side_cells[:aside],
            *([escape(valve.finding.reason)] if wide else []),
        )
    return table


def _add_columns(table: Table, valves: Sequence[RankedValve]) -> tuple[int, bool]:
    """Add the columns that the terminal has room for; how many of maintenance, shape and data there
    are, and whether there is one for the sentence."""
    table.add_column("", justify="right")
    table.add_column("valve", overflow="fold")  # names must not be cut
    table.add_column("verdict", no_wrap=True, min_width=len(Verdict.UNDETERMINED))
    numbers = [
        _number(estimate) for valve in valves for estimate in (valve.screening.S, valve.screening.J)
    ]
    longest = max((len(part) for text in numbers for part in text.split(" ")), default=0)
    for name in ("S, %", "J, %"):  # an interval that is cut is none
        table.add_column(name, justify="right", min_width=longest)
    aside = 0 if out.width < NARROW else 1 if out.width < MIDDLE else 3
    for name in ("maintenance", "shape", "data")[:aside]:
        table.add_column(name, no_wrap=True)
    wide = out.width >= WIDE
    if wide:  # in a narrow terminal the sentence would stand in a column of single words
        table.add_column("why")
    return aside, wide


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
    counts = ranking.recordings_of
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
            or obstacle_kind(screening.no_verdict) == NO_POSITION
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
    return f"[cyan]{answer}[/] [bold]{escape(listed(valves, NAMED))}[/]  {escape(sentence)}"


def signal_lines(screenings: Sequence[Screening]) -> Iterator[str]:
    """What was read of each valve, where the valves are few."""
    from stemwatch.service.presenter.wording import signals_read

    for screening in screenings if len(screenings) <= NAMED else ():
        seen = screening.seen
        if seen is not None:
            tags = {role: tag for role, (tag, _) in seen.tags.items()}
            yield f"[bold]{escape(screening.valve)}[/]  {escape(signals_read(tags))}"


def not_saved_lines(not_saved: Iterable[tuple[str, str]]) -> list[str]:
    """A line for each reason for which results, by their valves, are not in the database: a full
    disk takes most of a run."""
    valves_of: dict[str, list[str]] = {}
    for valve, reason in not_saved:
        valves_of.setdefault(reason, []).append(valve)
    return [
        f"{reason}: {listed(valves, NAMED)}. The report has these results; "
        "later runs will not know of them."
        for reason, valves in valves_of.items()
    ]
