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

    import numpy as np

    from stemwatch.service.cli import views
    from stemwatch.service.cli.prove_tables import plain_table
    from stemwatch.service.studies.what_if import FIGURES, run_what_if_study

    judged = list(run_what_if_study(loops, seed))
    twins = [twin for twin in judged if not twin.reason]
    figures = [figure for twin in twins for figure in twin.figures]
    columns = ("figures", "median error", "interval holds")
    title = f"Twins of {len(twins)} of {len(judged)} sticking loops, seed {seed}"
    table = plain_table(title, ("change", "figure"), columns)
    for change in dict.fromkeys(figure.change for figure in figures):
        for name in FIGURES:
            chosen = [
                figure for figure in figures if (figure.change, figure.figure) == (change, name)
            ]
            errors = [figure.error for figure in chosen if figure.error is not None]
            holds = [figure.holds for figure in chosen if figure.holds is not None]
            table.add_row(
                change,
                name,
                str(len(errors)),
                f"{100.0 * np.median(errors):.0f} %" if errors else "–",
                f"{sum(holds)} of {len(holds)}",
            )
    views.out.print(table)
    for reason, count in Counter(twin.reason for twin in judged if twin.reason).most_common(5):
        views.out.print(f"no twin of {count}: {reason}", highlight=False, markup=False)
    views.say_read_on("twin.md")
