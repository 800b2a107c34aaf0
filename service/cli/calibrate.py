"""``stemwatch calibrate-mismatch``: how high chance alone carries each term of the catalogue."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from rich.table import Table

    from stemwatch.service.studies.proof.nulls import TermNulls

SHOWN_FROM = 0.95  # the lowest quantile of the table


def calibrate_mismatch(
    seed: o.Seed = 4000,
    cases: Annotated[int, typer.Option(min=4, max=20_000, help="Nulls to draw.")] = 200,
    share: Annotated[
        float, typer.Option(min=0.001, max=0.5, help="Valves that chance may name.")
    ] = 0.03,
    t: Annotated[float, typer.Option(help="Limit of the t-like value.")] = 2.4,
    json_file: o.JsonFile = None,
    workers: o.Workers = None,
) -> None:
    """Score every term of `explain` on valves with nothing hidden, and print the limits.

    Half of the nulls have 5 % breakaway scatter and half 12 %. A term is named where its advantage
    on blocks of time that it was not fitted to is beyond what these ever show; the limits that are
    printed let through at most --share of valves, whatever the term. Seeds 4000 to 4099 are kept
    for this, so that `stemwatch prove` is blind.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.proof.draw import CALIBRATED_WITH
    from stemwatch.service.studies.proof.nulls import calibrate, common_limit, term_nulls

    if seed not in CALIBRATED_WITH:
        views.say(f"Seed {seed} is not one that is kept for calibration; do not prove with it.")
    with views.progress("nulls", cases, transient=True) as advance:
        scores = calibrate(cases, seed, choose_executor(workers), advance)
    rows, common = term_nulls(scores, t, share), common_limit(scores, t, share)
    views.out.print(_table(rows))
    views.out.print(
        f"One limit for all terms: mean {common.mean_limit:.2f} with t {common.t_limit:.1f} "
        f"lets through {common.passing} of {common.of} nulls (at most {common.share:.1%})",
        highlight=False,
    )
    if json_file is not None:
        limits = {
            "seed": seed,
            "common": asdict(common),
            "terms": [asdict(row) for row in rows],
            "scores": scores,
        }
        json_file.write_text(json.dumps(limits, indent=1) + "\n", encoding="utf-8")
    views.say_read_on("method.md")


def _table(rows: Sequence[TermNulls]) -> Table:
    """The upper quantiles that fit into a terminal; the JSON has all."""
    from stemwatch.service.cli.prove_tables import plain_table
    from stemwatch.service.studies.proof.nulls import QUANTILES

    columns = [index for index, quantile in enumerate(QUANTILES) if quantile >= SHOWN_FROM]
    names = [f"{QUANTILES[index]:.0%}" for index in columns]
    title = "Advantage on nulls, mean (t), and the limit of the mean"
    table = plain_table(title, ("term",), (*names, "limit"))
    for row in rows:
        cells = [f"{row.mean[index]:.2f} ({row.t[index]:.1f})" for index in columns]
        table.add_row(row.slug, *cells, f"{row.limit:.2f}")
    return table
