"""The tables that ``stemwatch prove`` prints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rich.table import Table

from stemwatch.service.cli.views import escape, plain_table
from stemwatch.service.studies.proof import figures
from stemwatch.service.studies.proof.rates import (
    Rate,
    Tally,
    by_concealment,
    by_effect,
    confusions,
    headline,
    record_rates,
    without_verdict,
)
from stemwatch.service.studies.proof.truth import CaseKind

if TYPE_CHECKING:
    from stemwatch.service.studies.proof.marks import CaseMark

MOST_REASONS = 5
_STATE = {True: "[green]reached[/]", False: "[red]short[/]", None: ""}


def tables(marks: Sequence[CaseMark]) -> Iterator[Table]:
    """Rates against targets, by effect, by concealment, record effects, confusions."""
    yield _rates("What was right and what was wrong", headline(marks))
    yield _tallies("One effect, excited, by effect (right by class)", by_effect(marks))
    yield _tallies("One effect, excited, by concealment (right by class)", by_concealment(marks))
    yield _rates("Effects of the record", record_rates(marks))
    yield _confusions(marks)


def figures_lines(marks: Sequence[CaseMark]) -> Iterator[str]:
    """Held-out improvement, errors of S and J, time, and why there was no verdict: a line each."""
    fit = figures.heldout(marks)
    if fit is not None:
        yield (
            f"On data that no fit saw ({fit.of} hidden and excited, medians): fit "
            f"{fit.fit_naive:.1f} % -> {fit.fit_extended:.1f} %, error {fit.rmse_naive:.2f} -> "
            f"{fit.rmse_extended:.2f} % of span"
        )
    for bias in figures.stiction_errors(marks):
        yield (
            f"{bias.name} where the effect biases it ({bias.of}): median error {bias.naive:.2f} "
            f"naive, {bias.restated:.2f} restated, {bias.ratio:.0%} of it "
            f"({bias.low:.0%} to {bias.high:.0%}; at most {figures.QUARTER:.0%}: "
            f"{_STATE[bias.reached]})"
        )
    time = figures.seconds(marks)
    if time is not None:
        yield (
            f"{time.median:.2f} s a valve of an hour (median of {time.of}; 95 % within "
            f"{time.p95:.2f} s; at most {figures.MOST_SECONDS:.1f} s: {_STATE[time.reached]})"
        )
    for reason, count in without_verdict(marks)[:MOST_REASONS]:
        yield f"[yellow]no verdict[/] on {count}: {escape(reason)}"


def _rates(title: str, rates: Sequence[Rate]) -> Table:
    """Each group's name on a line of its own above its rates; empty groups are left out."""
    table = plain_table(title, ("rate",), ("count", "share", "95 %", "to reach", ""))
    group = ""
    for rate in rates:
        if not rate.of:
            continue
        if rate.group != group:
            group = rate.group
            table.add_row(f"[bold]{escape(group)}[/]")
        low, high = rate.interval
        table.add_row(
            f"  {rate.name}",
            f"{rate.hits} of {rate.of}",
            f"{rate.hits / rate.of:.1%}",
            f"{low:.1%} to {high:.1%}",
            _target(rate),
            _STATE[rate.reached],
        )
    return table


def _target(rate: Rate) -> str:
    if rate.target is None:
        return ""
    return f"{'<=' if rate.at_most else '>='} {rate.target:.0%}"


def _tallies(title: str, tallies: Sequence[Tally]) -> Table:
    names = ("cases", "exact", "class", "95 %", "wrong", "missed", "not\nexcited")
    table = plain_table(title, ("hidden",), names)
    for tally in tallies:
        low, high = tally.interval
        table.add_row(
            escape(tally.group),
            *(str(number) for number in (tally.of, tally.exact, tally.by_class)),
            f"{low:.0%} to {high:.0%}" if tally.of else "",
            *(str(number or "") for number in (tally.wrong, tally.missed, tally.unexcited)),
        )
    return table


def _confusions(marks: Sequence[CaseMark]) -> Table:
    """For each hidden effect, the wrong answers and their number."""
    table = plain_table("What else was said", ("hidden", "said"), ("cases",))
    last = ""
    for truth, answer, count in confusions([m for m in marks if m.truth.kind is not CaseKind.PAIR]):
        if truth != answer:
            table.add_row("" if truth == last else escape(truth), escape(answer), str(count))
            last = truth
    return table
