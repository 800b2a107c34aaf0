"""``stemwatch alert-trial``: months of a simulated plant through schedule, run, store, alerts."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from stemwatch.service.studies.alert_trial import Played


def alert_trial(
    days: Annotated[int, typer.Option(min=2, max=366, help="Days, a window each.")] = 90,
    valves: Annotated[int, typer.Option(min=1, max=500, help="Valves.")] = 48,
    window_s: Annotated[
        float, typer.Option(min=600.0, max=14400.0, help="Seconds recorded of each day.")
    ] = 1800.0,
    seed: o.Seed = 2041,
    networks: Annotated[
        bool, typer.Option("--networks/--no-networks", help="Train the networks, and compare.")
    ] = False,
    workers: o.Workers = None,
    json_file: o.JsonFile = None,
) -> None:
    """Play months of a simulated plant and count its alerts: false, late, doubled, closed.

    Healthy valves under changing set points, loads, seasons and campaigns, with controllers tuned
    anew, transmitters replaced, shutdowns and bad data; valves that wear steadily, in steps, after
    work that did not help; repairs that are recorded and repairs that nobody recorded. Each day
    goes through the schedule, the queue, the run, the store and the rules of the service.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.alert_trial import AlertPlan, play

    views.say_if_not_blind(seed)
    plan = AlertPlan(
        valves=valves,
        days=days,
        window_s=window_s,
        seed=seed,
        networks=networks,
        workers=workers,
    )
    with (
        tempfile.TemporaryDirectory(prefix="stemwatch-alert-trial-") as folder,
        views.progress("days", days) as advance,
    ):
        played = play(plan, Path(folder), choose_executor(workers), advance)
    _print(played)
    if json_file is not None:
        views.write_json(json_file, _as_json(played), allow_nan=True)
    views.say_read_on("alert-trial.md")


def _print(played: Played) -> None:
    from rich.table import Table

    from stemwatch.service.cli import views

    table = Table(title="Alerts", title_justify="left")
    for name in ("what happens to the valve", "valves", "alerts", "without a cause", "closed"):
        table.add_column(name, justify="left" if name.startswith("what") else "right")
    for life in dict.fromkeys(valve_life.life for valve_life in played.lives):
        tags = {valve_life.tag for valve_life in played.lives if valve_life.life is life}
        alerts_of_life = [alert for alert in played.alerts if tags.intersection(alert.valves)]
        table.add_row(
            life.value,
            str(len(tags)),
            str(len(alerts_of_life)),
            str(sum(not alert.has_cause for alert in alerts_of_life)),
            str(sum(alert.closed is not None for alert in alerts_of_life)),
        )
    views.out.print(table)
    for line in played.lines():
        views.out.print(line, highlight=False)


def _as_json(played: Played) -> dict[str, Any]:
    return {
        "seed": played.plan.seed,
        "days": played.plan.days,
        "healthy_months": played.healthy_months,
        "false_by_kind": played.false_by_kind(),
        "delays_days": played.delays(),
        "alerts_per_cause": played.alerts_per_cause(),
        "alerts": [
            {
                "kind": alert.kind.value,
                "valves": list(alert.valves),
                "raised": alert.raised,
                "closed": alert.closed,
                "opened_again": list(alert.opened_again),
                "has_cause": alert.has_cause,
                "text": alert.text,
            }
            for alert in played.alerts
        ],
    }
