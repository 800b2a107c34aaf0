"""``stemwatch drift``: does the baseline ratio tell growing stiction from a healthy valve?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from stemwatch.service.studies.drift import Followed


def drift(
    valves: Annotated[
        int, typer.Option(min=2, max=2000, help="Loops, each followed through three fates.")
    ] = 120,
    seed: o.Seed = 2026,
    workers: o.Workers = None,
    json_file: o.JsonFile = None,
) -> None:
    """Count how well the baseline ratio tells growing stiction from healthy valves, simulated.

    Each loop is drawn healthy and a network is trained on its first window. Six later windows of
    ten minutes are scored against it, three times: the valve unchanged, unchanged but run
    differently (another opening, disturbance, tuning or set points), and with stiction that grows
    to S = 1.5 to 8 %. The alarm limit is calibrated on healthy valves of the next seed. About a
    minute on two idle cores.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.drift import HEALTHY, ValveFate, as_json, run_drift

    executor = choose_executor(workers)
    with views.progress("valves", valves) as advance:
        followed = run_drift(valves, seed, executor, advance, tuple(ValveFate))
    with views.progress("calibration", valves) as advance:
        calibration = run_drift(valves, seed + 1, executor, advance, HEALTHY)
    show(followed, calibration)
    if json_file is not None:
        report = {"valves": valves, "seed": seed, **as_json(followed, calibration)}
        views.write_json(json_file, report)
    views.say_read_on("networks.md")


def show(followed: Sequence[Followed], calibration: Sequence[Followed]) -> None:
    """Ratios, areas under the curve with the target, and alarms with their intervals."""
    from stemwatch.service.cli import views
    from stemwatch.service.studies.drift import TARGET, areas, limits

    views.out.print(_ratio_table(followed))
    views.out.print(
        "A window is refused where OP leaves the range the network was trained on in more than a "
        "quarter of its samples. A valve is scored by the median of its last three scored windows, "
        "where there are two at least.",
        highlight=False,
    )
    untrained = sum(bool(valve.reason) for valve in followed)
    if untrained:
        views.out.print(
            f"No baseline could be trained for {untrained} of {len(followed)} rows: "
            f"{next(valve.reason for valve in followed if valve.reason)}.",
            highlight=False,
        )
    estimates = areas(followed)
    for name, area in estimates.items():
        views.out.print(f"AUC, growing against {name}: {area}", highlight=False)
    headline = estimates["both"].value
    if headline is not None:
        verdict = "met" if headline >= TARGET else "missed"
        views.out.print(f"Target: {TARGET:g} against both: {verdict}.", highlight=False)
    views.out.print(_alarm_table(followed, limits(calibration)))
    views.out.print(
        "calibrated: the lowest ratio, in tenths, that at most this share of the healthy valves of "
        "the next seed exceed. watch limit: baseline_ratio_watch as it is.",
        highlight=False,
    )


def _ratio_table(followed: Sequence[Followed]) -> Table:
    import numpy as np
    from rich.table import Table

    from stemwatch.service.studies.drift import WINDOWS, ValveFate, scores

    table = Table(title="Ratio to the baseline's reference error", title_justify="left")
    table.add_column("valves")
    for name in ("scored", "windows refused", "lowest", "median", "nine in ten", "highest"):
        table.add_column(name, justify="right")
    for fate in ValveFate:
        group = [valve for valve in followed if valve.fate is fate]
        scores_of_fate = scores(followed, fate)
        refused = sum(followed.refused for followed in group)
        row = [
            fate.value,
            f"{len(scores_of_fate)} of {len(group)}",
            f"{refused} of {WINDOWS * len(group)}",
        ]
        if scores_of_fate:
            row += [f"{number:.2f}" for number in np.quantile(scores_of_fate, [0.0, 0.5, 0.9, 1.0])]
        table.add_row(*row)
    return table


def _alarm_table(followed: Sequence[Followed], named: dict[str, float]) -> Table:
    from rich.table import Table

    from stemwatch.service.studies.detection_rates import wilson
    from stemwatch.service.studies.drift import alarms

    table = Table(title="Alarms", title_justify="left")
    for name in ("limit", "valves"):
        table.add_column(name)
    for name in ("alarms", "share", "95 % interval"):
        table.add_column(name, justify="right")
    for limit_name, limit in named.items():
        for index, (group, count, total) in enumerate(alarms(followed, limit)):
            low, high = wilson(count, total)
            share = f"{count / total:.1%}" if total else "-"
            first = f"{limit_name}: {limit:g}" if index == 0 else ""
            table.add_row(first, group, f"{count} of {total}", share, f"{low:.1%} to {high:.1%}")
        table.add_section()
    return table
