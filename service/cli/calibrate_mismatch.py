"""``stemwatch calibrate-mismatch``: how high chance alone carries each term of the catalogue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o
from stemwatch.service.cli.study_json import study_json

if TYPE_CHECKING:
    from rich.table import Table

    from stemwatch.service.studies.proof.nulls import DerivedLimit, NullGroup, TermNulls

# What the file keeps of each valve, beside its record and its friction.
KEPT = "strongest", "pair", "named", "left", "noise", "likelihood"
SHOWN_FROM = 0.95  # the lowest quantile of the table


def calibrate_mismatch(
    seed: o.Seed = 4000,
    cases: Annotated[
        int, typer.Option(min=4, max=20_000, help="Valves to draw, with nothing hidden.")
    ] = 200,
    share: Annotated[
        float, typer.Option(min=0.001, max=0.5, help="Share of valves that chance may name.")
    ] = 0.03,
    t: Annotated[float, typer.Option(help="Limit of the t-like value.")] = 2.4,
    json_file: o.JsonFile = None,
    workers: o.Workers = None,
) -> None:
    """Score every term of `explain`, and pairs of them, on valves with nothing hidden.

    Half of the valves have 5 % breakaway scatter and half 12 %. A term is named where its advantage
    on blocks of time that it was not fitted to is beyond what these ever show; the limits that are
    printed let through at most --share of valves, whatever the term. Seeds 4000 to 4099 are kept
    for this, so that `stemwatch prove` is blind.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.proof.nulls import (
        QUANTILES,
        calibrate,
        common_limit,
        derived_limits,
        groups,
        scores_of,
        term_nulls,
    )
    from stemwatch.service.studies.seeds import LIMITS_CALIBRATED_WITH

    if seed not in LIMITS_CALIBRATED_WITH:
        views.say(f"Seed {seed} is not one that is kept for calibration; do not prove with it.")
    with views.progress("nulls", cases, transient=True) as advance:
        valves = calibrate(cases, seed, choose_executor(workers), advance)
    scores = scores_of(valves)
    rows, common = term_nulls(scores, t, share), common_limit(scores, t, share)
    views.out.print(_table(rows))
    views.out.print(
        f"One limit for all terms: mean {common.mean_limit:.2f} with t {common.t_limit:.1f} "
        f"lets through {common.passing} of {common.of} nulls (at most {common.share:.1%})",
        highlight=False,
    )
    by_kind = groups(valves)
    views.out.print(_beyond(by_kind))
    derived = derived_limits(valves)
    views.out.print(_derived(derived))
    if json_file is not None:
        limits = {
            "seed": seed,
            "cases": cases,
            "quantiles": QUANTILES,
            "limits": _in_use(),
            "derived": [asdict(limit) for limit in derived],
            "common": asdict(common),
            "groups": [asdict(group) for group in by_kind],
            "terms": [asdict(row) for row in rows],
            "scores": scores,
            "valves": [
                [v.concealment, v.friction, *(getattr(v, name) for name in KEPT)] for v in valves
            ],
        }
        views.write_file(json_file, study_json(limits))
    views.say_read_on("method.md")


def _in_use() -> dict[str, float]:
    """The limits of the product."""
    from stemwatch.models.mismatch import acceptance_limits as limits
    from stemwatch.models.mismatch.likelihood import likelihood_evidence as likelihood

    return {
        "mean": limits.MEAN,
        "t": limits.T,
        "mean times t": limits.PRODUCT,
        "later": limits.LATER,
        "pair": limits.LEAST_OF_A_PAIR,
        "null rate": limits.NULL_RATE,
        "gain of likelihood": likelihood.LEAST_GAIN,
        "t of likelihood": likelihood.LEAST_T,
        "likelihood: gain times t": likelihood.LEAST_PRODUCT,
    }


def _derived(limits: Sequence[DerivedLimit]) -> Table:
    """Each limit beside the least one that follows the rule."""
    from stemwatch.service.cli.views import plain_table
    from stemwatch.service.studies.proof.nulls import RATE

    title = f"Limits beside what at most {RATE:.0%} of the nulls exceed"
    table = plain_table(title, ("limit", "rule"), ("derived", "in use", "nulls beyond"))
    for limit in limits:
        numbers = (f"{limit.derived:.2f}", f"{limit.in_use:.2f}", str(limit.beyond))
        table.add_row(limit.name, limit.rule, *numbers)
    return table


def _beyond(by_kind: Sequence[NullGroup]) -> Table:
    """How many nulls of each kind a term or a pair would pass, and how far the rest stay below."""
    from stemwatch.service.cli.views import plain_table

    title = "Nulls beyond the limits in use (strength 1 is the limit of a term)"
    columns = ("nulls", "a term", "a pair", "strongest, 95 %", "pair, 95 %", "pair, most")
    table = plain_table(title, ("kind",), columns)
    for group in by_kind:
        strengths = (group.strongest[2], group.pair[2], group.pair[-1])
        counts = (group.of, group.passing, group.pairs)
        table.add_row(group.kind, *map(str, counts), *(f"{x:.2f}" for x in strengths))
    return table


def _table(rows: Sequence[TermNulls]) -> Table:
    """The upper quantiles that fit into a terminal; the JSON has all."""
    from stemwatch.service.cli.views import plain_table
    from stemwatch.service.studies.proof.nulls import QUANTILES

    columns = [index for index, quantile in enumerate(QUANTILES) if quantile >= SHOWN_FROM]
    names = [f"{QUANTILES[index]:.0%}" for index in columns]
    title = "Advantage on nulls, mean (t), and the limit of the mean"
    table = plain_table(title, ("term",), (*names, "limit"))
    for row in rows:
        cells = [f"{row.mean[index]:.2f} ({row.t[index]:.1f})" for index in columns]
        table.add_row(row.slug, *cells, f"{row.limit:.2f}")
    return table
