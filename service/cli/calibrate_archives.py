"""``stemwatch calibrate-archives``: what shows a late clock or a slow archive."""

from __future__ import annotations

from dataclasses import asdict
from math import isnan
from typing import Annotated

import typer

from stemwatch.service.cli import options as o
from stemwatch.service.cli.json_lines import by_lines, rounded


def calibrate_archives(
    seed: o.Seed = 8181,
    valves: Annotated[
        int, typer.Option(min=1, max=2000, help="Sticking valves, and as many healthy ones.")
    ] = 20,
    json_file: o.JsonFile = None,
    workers: o.Workers = None,
) -> None:
    """Print the limits of a late clock and a slow archive beside recordings that have neither.

    Sticking and healthy valves are simulated as `robustness` does, whole and in pieces of five
    minutes, healthy ones also with a noisy PV, and sticking ones of all kinds of loops as `trial`
    does. Kept every second by one clock they are the nulls: at most one of twenty may lie beyond
    all limits that belong together, and each limit must be met by some that meet the others. What
    the limit would have to be for that is printed beside it. Stored 5 s late, every 5 or 10 s or as
    averages the valves show how many each limit finds. What is printed of the stem's lateness is
    what it says without a PV.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.cli.prove_tables import plain_table
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.archive_limits import limits, run_archive_limits

    with views.progress("valves", 8 * valves, transient=True) as advance:
        evidence = run_archive_limits(valves, seed, choose_executor(workers), advance)
    all_limits = list(limits(evidence))
    columns = ("limit", "needed", "nearest null", "nulls beyond it", "late or slow beyond it")
    table = plain_table(f"{valves} sticking and healthy valves, seed {seed}", ("what",), columns)
    for limit in all_limits:
        worst = f"{limit.worst:.2f}" if limit.nulls else "no null"
        needed = "-" if isnan(limit.needed) else f"{limit.needed:.2f}"
        of_nulls = f"{limit.nulls_beyond} of {limit.nulls}, {limit.all_nulls} in all"
        beyond_text = f"{limit.beyond} of {limit.of}"
        table.add_row(limit.name, f"{limit.limit:g}", needed, worst, of_nulls, beyond_text)
    views.out.print(table)
    untold = [limit.name for limit in all_limits if not limit.nulls]
    if untold:
        views.say(f"Draw more valves: no null meets the other limits for {'; '.join(untold)}.")
    exceeded = [limit.name for limit in all_limits if limit.nulls and not limit.holds]
    if exceeded:
        views.say(f"Too many nulls lie beyond: {'; '.join(exceeded)}.")
    if json_file is not None:
        report = {
            "seed": seed,
            "valves": valves,
            "limits": [{**asdict(limit), "holds": limit.holds} for limit in all_limits],
            "recordings": [asdict(recording) for recording in evidence],
        }
        json_file.write_text(by_lines(rounded(report)), encoding="utf-8")
    views.say_read_on("method.md")
