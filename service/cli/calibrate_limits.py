"""``stemwatch calibrate-archives`` and ``calibrate-wiring``: the limits of checks, compared with
recordings that must not exceed them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stemwatch.service.cli import options as o
from stemwatch.service.cli.study_json import study_json

if TYPE_CHECKING:
    from stemwatch.service.studies.limit_beside_nulls import Limit


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
    does. Stored every second by one clock they are the nulls: at most one of twenty may lie beyond
    all limits that belong together, and each limit must be met by some that meet the others. Beside
    each limit stands what it would have to be for that. The same valves stored 5 s late, every 5 or
    10 s or as averages show how many each limit finds. The stem's lateness is printed as it is seen
    without a PV.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.archive_limits import limits, run_archive_limits

    with views.progress("valves", 8 * valves, transient=True) as advance:
        evidence = run_archive_limits(valves, seed, choose_executor(workers), advance)
    all_limits = list(limits(evidence))
    title = f"{valves} sticking and healthy valves, seed {seed}"
    _print(title, "late or slow beyond it", all_limits)
    untold = [limit.name for limit in all_limits if not limit.nulls]
    if untold:
        views.say(f"Draw more valves: no null meets the other limits for {'; '.join(untold)}.")
    _write(json_file, seed, valves, all_limits, evidence)
    views.say_read_on("method.md")


def calibrate_wiring(
    seed: o.Seed = 8181,
    valves: Annotated[
        int,
        typer.Option(min=1, max=2000, help="Valves to mix up, and as many with hidden effects."),
    ] = 20,
    json_file: o.JsonFile = None,
    workers: o.Workers = None,
) -> None:
    """Print the limits of the wiring checks beside recordings whose tags and ranges are right.

    Valves are simulated as `miswiring` does, sticking and healthy in turn, and as many with hidden
    effects. Those with the right tags, whole and in pieces, behind curves, late and stored slowly,
    are the nulls: none may lie beyond all limits of a check, or a valve would lose its verdict by
    it. Beside each limit stands how near they come, and how many of the same valves lie beyond it
    with tags or ranges mixed up.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.wiring_limits import run_wiring_limits, wiring_limits

    with views.progress("valves", 2 * valves, transient=True) as advance:
        seen = run_wiring_limits(valves, seed, choose_executor(workers), advance)
    all_limits = list(wiring_limits(seen))
    _print(f"{valves} valves, seed {seed}", "mixed up beyond it", all_limits)
    _write(json_file, seed, valves, all_limits, seen)
    views.say_read_on("miswiring.md")


def _print(title: str, found: str, limits: Sequence[Limit]) -> None:
    """The table of limits, and which too many nulls lie beyond."""
    from stemwatch.service.cli import views
    from stemwatch.service.cli.views import plain_table

    columns = ("limit", "needed", "nearest null", "nulls beyond it", found)
    table = plain_table(title, ("what",), columns)
    for limit in limits:
        worst = f"{limit.worst:.2f}" if limit.nulls else "no null"
        needed = f"{limit.needed:.2f}" if isfinite(limit.needed) else "-"
        of_nulls = f"{limit.nulls_beyond} of {limit.nulls}, {limit.all_nulls} in all"
        beyond_text = f"{limit.beyond} of {limit.of}"
        table.add_row(limit.name, f"{limit.limit:g}", needed, worst, of_nulls, beyond_text)
    views.out.print(table)
    exceeded = [limit.name for limit in limits if limit.nulls and not limit.holds]
    if exceeded:
        views.say(f"Too many nulls lie beyond: {'; '.join(exceeded)}.")


def _write(
    json_file: Path | None,
    seed: int,
    valves: int,
    limits: Sequence[Limit],
    recordings: Sequence[Any],
) -> None:
    if json_file is None:
        return
    from stemwatch.service.cli import views

    report = {
        "seed": seed,
        "valves": valves,
        "limits": [asdict(limit) for limit in limits],
        "recordings": [asdict(recording) for recording in recordings],
    }
    views.write_file(json_file, study_json(report))
