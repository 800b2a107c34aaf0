"""``stemwatch drift``: does the baseline ratio tell growing stiction from a healthy valve?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from stemwatch.models.estimate import Estimate
    from stemwatch.service.studies.drift import Followed

TARGET = 0.95  # area under the curve that the indicator is meant to reach
FALSE_ALARMS = (0.05, 0.02)  # shares of healthy valves that calibrated limits let raise an alarm
_BANDS = ((1.5, 2.5), (2.5, 4.0), (4.0, float("inf")))  # S in the last window, percent of span


def drift(
    valves: Annotated[
        int, typer.Option(min=2, max=2000, help="Loops, each followed in three ways.")
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
    from stemwatch.service.studies.drift import HEALTHY, ValveFate, run_drift

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


def areas(followed: Sequence[Followed]) -> dict[str, Estimate]:
    """The area under the curve of growing stiction against each kind of healthy valve.

    The last one leaves out nothing: a valve that could not be scored raises no alarm, so it ranks
    below all that were.
    """
    from stemwatch.service.studies.drift import HEALTHY, ValveFate, scores
    from stemwatch.service.studies.roc import area_estimate

    growing = scores(followed, ValveFate.GROWING)
    estimates = {fate.value: area_estimate(growing, scores(followed, fate)) for fate in HEALTHY}
    estimates["both"] = area_estimate(growing, scores(followed, *HEALTHY))
    ranked = [(valve.way, valve.score or 0.0) for valve in followed]
    estimates["both, a refusal being no alarm"] = area_estimate(
        [score for fate, score in ranked if fate is ValveFate.GROWING],
        [score for fate, score in ranked if fate in HEALTHY],
    )
    return estimates


def limits(calibration: Sequence[Followed]) -> dict[str, float]:
    """The limits that alarms are counted with: name, ratio."""
    from stemwatch.models.limits import Limits
    from stemwatch.service.studies.drift import HEALTHY, calibrated_limit, scores

    healthy = scores(calibration, *HEALTHY)
    limits = {
        f"calibrated, {share:.0%}": calibrated_limit(healthy, share) for share in FALSE_ALARMS
    }
    named = {name: limit for name, limit in limits.items() if limit is not None}
    return {**named, "watch limit": Limits().baseline_ratio_watch}


def alarms(followed: Sequence[Followed], limit: float) -> list[tuple[str, int, int]]:
    """Rows of (group of valves, number of alarms, number of scored valves)."""
    from stemwatch.service.studies.drift import ValveFate, scores

    groups = [(fate.value, scores(followed, fate)) for fate in ValveFate]
    grown = [valve for valve in followed if valve.way is ValveFate.GROWING]
    for low, high in _BANDS:
        band = [followed for followed in grown if low <= round(followed.S, 6) < high]
        upto = f"{low:g} to {high:g} %" if high < 100.0 else f"{low:g} % and more"
        groups.append((f"growing, to S of {upto}", scores(band, ValveFate.GROWING)))
    above_limit = [
        (name, sum(score > limit for score in group), len(group)) for name, group in groups
    ]
    everyone = sum((followed.score or 0.0) > limit for followed in grown)
    return [*above_limit, ("growing, with those refused", everyone, len(grown))]


def as_json(followed: Sequence[Followed], calibration: Sequence[Followed]) -> dict[str, Any]:
    """The complete result as JSON."""
    from dataclasses import asdict

    from stemwatch.service.studies.trial import wilson

    return {
        "target_auc": TARGET,
        "auc": {name: asdict(area) for name, area in areas(followed).items()},
        "limits": {
            name: {
                "ratio": limit,
                "alarms": [
                    {
                        "of": group,
                        "alarms": count,
                        "scored": total,
                        "interval": wilson(count, total),
                    }
                    for group, count, total in alarms(followed, limit)
                ],
            }
            for name, limit in limits(calibration).items()
        },
        "followed": [asdict(valve) | {"score": valve.score} for valve in followed],
        "calibration": [asdict(followed) | {"score": followed.score} for followed in calibration],
    }


def show(followed: Sequence[Followed], calibration: Sequence[Followed]) -> None:
    """Ratios, areas under the curve with the target, and alarms with their intervals."""
    from stemwatch.service.cli import views

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
        group = [valve for valve in followed if valve.way is fate]
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

    from stemwatch.service.studies.trial import wilson

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
