"""The maintenance report of what is stored: of a run, or of each valve's latest screening."""

from __future__ import annotations

from collections.abc import Collection
from datetime import UTC, datetime
from pathlib import Path

from stemwatch.service.config import Plant
from stemwatch.service.maintenance.stored import (
    background_of,
    facts_of,
)
from stemwatch.service.maintenance.write_maintenance import MaintenanceFiles, write_maintenance
from stemwatch.service.presenter.false_discoveries import tested
from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.screenings.restored import Restored
from stemwatch.service.store.store import Store


def report_of_store(
    store: Store,
    out_dir: Path,
    *,
    plant: Plant | None = None,
    run: int | None = None,
    valves: Collection[str] = (),
    zone: str = "",
    everything: bool = False,
) -> MaintenanceFiles:
    """Write the report of ``run``, or without one of each valve's latest screening, into
    ``out_dir``; of ``valves`` only, where some are named.

    What stands beside friction is decided over all valves either way. Raises ``StoreError`` where
    there is no such run, or none of a valve that was named.
    """
    every = store.latest_screenings() if run is None else store.screenings_of_run(run)
    known = {one.valve for one in every}
    if unknown := sorted(set(valves) - known):
        where = "the store" if run is None else f"run {run}"
        raise StoreError(
            f"{store.address}: {where} has no screening of {', '.join(map(repr, unknown))}; "
            f"it has {len(known)} valves, such as {', '.join(sorted(known)[:5]) or 'none'}"
        )
    chosen = [one for one in every if not valves or one.valve in valves]
    context = ReportContext(
        started=datetime.now(UTC) if run is None else store.run(run).started,
        plant=plant.name if plant is not None else "",
        zone=zone or (plant.zone if plant is not None else None) or "UTC",
        valves=facts_of(store, plant, chosen),
        p_elsewhere=_p_elsewhere(every, valves),
    )
    background = background_of(store, plant, run)
    return write_maintenance(chosen, context, out_dir, background, everything=everything)


def _p_elsewhere(every: list[Restored], valves: Collection[str]) -> tuple[float | None, ...]:
    """The p values of the valves that were tested and are not in the report."""
    others = [one.mismatch for one in every if valves and one.valve not in valves]
    return tuple(one.p_value for one in others if tested(one))
