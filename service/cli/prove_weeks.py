"""``stemwatch prove-weeks``: what windows of weeks confirm on simulated valves, right and wrong."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from stemwatch.service.studies.weeks import FollowedValve


def prove_weeks(
    nulls: Annotated[int, typer.Option(min=0, max=2000, help="Valves with nothing hidden.")] = 10,
    days: Annotated[int, typer.Option(min=2, max=365, help="Daily windows of each of them.")] = 10,
    valves: Annotated[int, typer.Option(min=0, max=100, help="Valves with each effect.")] = 1,
    windows: Annotated[int, typer.Option(min=2, max=60, help="Windows of each of them.")] = 4,
    effect: Annotated[
        list[str] | None, typer.Option(help="Only this effect; may be given several times.")
    ] = None,
    concealment: Annotated[
        str | None, typer.Option(help="How every record is concealed; default: all ways in turn.")
    ] = None,
    seed: o.Seed = 2042,
    workers: o.Workers = None,
    json_file: o.JsonFile = None,
    keep: Annotated[
        Path | None,
        typer.Option(help="Keep what each window says in this folder, and go on from there."),
    ] = None,
) -> None:
    """Count what windows of weeks confirm on simulated valves, rightly and wrongly.

    Valves with nothing hidden over daily windows, and valves with each effect of the catalogue over
    some windows. The defaults are a quick look; --nulls 100 --days 30 --valves 4 --windows 8 is the
    study of docs/proof.md and takes half an hour on two cores: with --keep it may be stopped, and
    goes on when it is called again, with fewer valves or more. A folder belongs to one version of
    the program.
    """
    from stemwatch.models.studies.simulator.hidden import CONCEALMENTS, PHYSICS
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.weeks import follow

    if unknown := sorted(set(effect or ()) - set(PHYSICS)):
        raise typer.BadParameter(
            f"no effect {', '.join(unknown)}; there are: {', '.join(PHYSICS)}",
            param_hint="--effect",
        )
    if concealment not in (None, *CONCEALMENTS):
        raise typer.BadParameter(
            f"no concealment {concealment}; there are: {', '.join(CONCEALMENTS)}",
            param_hint="--concealment",
        )
    views.say_if_not_blind(seed)
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
    slugs = tuple(effect or PHYSICS)
    with views.progress("valves", nulls + valves * len(slugs)) as advance:
        followed = follow(
            nulls,
            days,
            valves,
            windows,
            seed,
            choose_executor(workers),
            advance,
            slugs,
            keep,
            concealment,
        )
    _print(followed, days, windows)
    _print_each(followed, windows)
    if json_file is not None:
        _write(followed, json_file)
    views.say_read_on("proof.md")


def _print(followed: list[FollowedValve], days: int, windows: int) -> None:
    from rich.table import Table

    from stemwatch.service.cli import views
    from stemwatch.service.studies.weeks import count_over, size_errors

    table = Table(title="Confirmed by windows", title_justify="left")
    for name in ("windows", "nothing hidden", "effect found, by class", "right when confirmed"):
        table.add_column(name, justify="right")
    for window_count in sorted({1, 2, 4, 8, windows, days}):
        counts = count_over(followed, window_count)
        table.add_row(
            str(window_count),
            f"{counts.false} of {counts.nulls} false" if counts.nulls else "",
            f"{counts.found} of {counts.valves}" if window_count <= windows else "",
            f"{counts.right} of {counts.named}" if window_count <= windows else "",
        )
    views.out.print(table)
    for line in size_errors(followed):
        if line.of:
            views.out.print(
                f"S and J restated, {line.name}: median error {line.median:.3f} % of span; the "
                f"interval holds the truth in {line.holds} of {line.of}",
                highlight=False,
            )
    silent = sum(bool(valve.hidden) and valve.testable < 2 for valve in followed)
    if silent:
        views.out.print(
            f"{silent} valves do not count: fewer than two of their windows could have shown "
            "the effect",
            highlight=False,
        )


def _print_each(followed: list[FollowedValve], windows: int) -> None:
    """Found of all by effect and by concealment, after all windows."""
    from rich.table import Table

    from stemwatch.service.cli import views
    from stemwatch.service.studies.weeks import count_over, counted

    valves = counted(followed)
    by_effect = [(valve.hidden[0], valve) for valve in valves]
    by_concealment = [(valve.concealment, valve) for valve in valves]
    for title, pairs in (("effect", by_effect), ("record", by_concealment)):
        table = Table(title=f"After {windows} windows, by {title}", title_justify="left")
        for name in (title, "found, by class", "right when confirmed"):
            table.add_column(name, justify="left" if name == title else "right")
        for key in sorted({key for key, _ in pairs}):
            counts = count_over([valve for of, valve in pairs if of == key], windows)
            table.add_row(
                key, f"{counts.found} of {counts.valves}", f"{counts.right} of {counts.named}"
            )
        views.out.print(table)


def _write(followed: list[FollowedValve], json_file: Path) -> None:
    from stemwatch.service.cli import views

    objects = [
        {
            "hidden": list(valve.hidden),
            "concealment": valve.concealment,
            "S": valve.S,
            "J": valve.J,
            "testable": valve.testable,
            "windows": [
                {
                    "named": [list(members) for members in window.named],
                    "scores": [asdict(score) for score in window.scores],
                    "S": None if window.S is None else asdict(window.S),
                    "J": None if window.J is None else asdict(window.J),
                }
                for window in valve.windows
            ],
        }
        for valve in followed
    ]
    views.write_file(json_file, json.dumps(objects) + "\n")
