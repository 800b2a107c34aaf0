"""``stemwatch study-twin``: how well the twin of a loop predicts the effect of a change."""

from __future__ import annotations

from typing import Annotated

import typer

from stemwatch.service.cli import options as o


def study_twin(
    loops: Annotated[int, typer.Option(min=4, max=10_000, help="Loops, all sticking.")] = 80,
    seed: o.Seed = 2082,
) -> None:
    """Compare what twins of simulated loops predict with the same plant after the change.

    Repair, half the friction, half the gain and twice the reset time; the same loads and noise. The
    median error of each figure as a share of the truth, and how many of the 90 % intervals hold it.
    """
    from collections import Counter

    from stemwatch.service.cli import views
    from stemwatch.service.studies.twin import figure_rows, run_twin_study

    judged = list(run_twin_study(loops, seed))
    twins = [twin for twin in judged if not twin.reason]
    columns = ("figures", "median error", "interval holds")
    title = f"Twins of {len(twins)} of {len(judged)} sticking loops, seed {seed}"
    table = views.plain_table(title, ("change", "figure"), columns)
    for row in figure_rows(twins):
        error = "–" if row.error is None else f"{100.0 * row.error:.0f} %"
        holds = f"{row.holds} of {row.of}"
        table.add_row(row.change, row.figure, str(row.figures), error, holds)
    views.out.print(table)
    for reason, count in Counter(twin.reason for twin in judged if twin.reason).most_common(5):
        views.out.print(f"no twin of {count}: {reason}", highlight=False, markup=False)
    views.say_read_on("twin.md")
