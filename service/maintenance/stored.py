"""The maintenance report from the store: the screenings of a run, or the latest of each valve, with
their history."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from stemwatch.connectors.connector import ConnectorError, Window
from stemwatch.models.recording import Recording
from stemwatch.models.screening_result import PreviousFinding, Screening
from stemwatch.models.words import counted
from stemwatch.service.config import Plant
from stemwatch.service.config.in_force import limits_in_force
from stemwatch.service.maintenance.valve_history import LOOK_BACK, ValveHistory
from stemwatch.service.maintenance.write_maintenance import MaintenanceFiles, write_maintenance
from stemwatch.service.plant_path import (
    WHOLE_PLANT,
    PartOfPlant,
    UnknownPart,
    levels_of,
)
from stemwatch.service.presenter.false_discoveries import p_in_run, tested
from stemwatch.service.report.report_context import ReportContext, ValveFacts
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.samples.connector import StoredSamples
from stemwatch.service.store.screenings.records import DescribedValve, StoredValve
from stemwatch.service.store.screenings.restored import Restored
from stemwatch.service.store.store import Store

# Enough for a typical stretch of the picture; a day of three tags at 1 s is a quarter of a million.
LONGEST_READ = timedelta(hours=4)


def background_of(store: Store, plant: Plant | None = None, run: int | None = None) -> ValveHistory:
    """The history of valves from the store, and their samples for pictures where it keeps them."""

    def earlier(screening: Screening) -> Sequence[PreviousFinding]:
        previous = store.previous_findings(screening, limit=LOOK_BACK)
        if screening.window[1] is not None:
            return previous
        # Of recordings of one run whose time nobody knows, none is earlier than another.
        return [finding for finding in previous if finding.run != run]

    def samples(screening: Screening) -> Recording | None:
        if screening.recording is not None:
            return screening.recording
        return read_samples(store, plant, screening)

    return ValveHistory(
        earlier=earlier,
        work=store.maintenance,
        samples=samples,
        compared=lambda valves: store.work_compared(valves, run),
        run=run,
    )


def facts_of(
    store: Store, plant: Plant | None, screenings: Sequence[Screening]
) -> dict[str, ValveFacts]:
    """What plant file and store say of the valves, and what was found of them before."""
    stored_valves = {valve.id: valve for valve in store.valves()}
    valves = [screening.valve for screening in screenings]
    limits = limits_in_force(plant, store.browser_settings.limits())
    weeks, by_window = store.trends(valves, limits), store.evidence(valves)
    return {
        screening.valve: replace(
            plant_facts(
                plant,
                screening.valve,
                store.previous_finding(screening),
                stored_valves.get(screening.valve),
            ),
            weeks=weeks.get(screening.valve),
            by_window=by_window.get(screening.valve),
        )
        for screening in screenings
    }


def plant_facts(
    plant: Plant | None,
    valve: str,
    previous: PreviousFinding | None,
    stored_valve: StoredValve | None = None,
) -> ValveFacts:
    """What the plant file says of the valve, else the store, and its previous result."""
    entry = plant.valves.get(valve) if plant is not None else None
    described = entry or stored_valve
    if described is None:
        return ValveFacts(previous=previous)
    return ValveFacts(
        description=described.description,
        **levels_of(described),
        criticality=str(described.criticality),
        stroke="" if entry is None else entry.stroke or "",
        prices=None if entry is None else entry.prices,
        previous=previous,
    )


def read_samples(store: Store, plant: Plant | None, screening: Screening) -> Recording | None:
    """The end of the screened window, where the store has samples of it."""
    start, end = screening.window
    if plant is None or start is None or end is None or screening.valve not in plant.valves:
        return None
    if not plant.is_live(screening.valve):
        return None
    source = StoredSamples(store.samples, plant.valves[screening.valve].source)
    window = Window(start=max(start, end - LONGEST_READ), stop=end)
    try:
        return source.read(plant.valve_tags(screening.valve), window)
    except (ConnectorError, StoreError):
        return None  # samples were removed meanwhile: the page says that there is no picture


def report_of_store(
    store: Store,
    out_dir: Path,
    *,
    plant: Plant | None = None,
    run: int | None = None,
    valves: Collection[str] = (),
    part: PartOfPlant = WHOLE_PLANT,
    zone: str = "",
    all_valves: bool = False,
) -> MaintenanceFiles:
    """Write the report of ``run``, or without one of each valve's latest screening, into
    ``out_dir``; of ``valves`` only, where some are named, and of a ``part`` of the plant. Valves
    that the plant file does not name any more are left out unless they are named here.

    Which effects beside friction stand is decided over all valves in either case. Raises
    ``StoreError`` where there is no such run, none of a valve that was named, or no such part.
    """
    screenings = store.latest_screenings() if run is None else store.screenings_of_run(run)
    if not screenings and run is None:
        raise StoreError(
            f"{store.address}: no valve was screened into this database yet; `stemwatch screen "
            f"--db {store.address}` does"
        )
    valves_of_run = {screening.valve for screening in screenings}
    if unknown := sorted(set(valves) - valves_of_run):
        origin = "the store" if run is None else f"run {run}"
        raise StoreError(
            f"{store.address}: {origin} has no screening of {', '.join(map(repr, unknown))}; "
            f"it has {counted(len(valves_of_run), 'valve')}, such as "
            f"{', '.join(sorted(valves_of_run)[:5]) or 'none'}"
        )
    gone = _not_named(plant, valves_of_run) if run is None and not valves else set()
    if part:
        valves = _in_part(store, plant, part, valves or valves_of_run)
    elif gone:
        screenings = [screening for screening in screenings if screening.valve not in gone]
    chosen = [screening for screening in screenings if not valves or screening.valve in valves]
    context = ReportContext(
        started=datetime.now(UTC) if run is None else store.run(run).started,
        plant=plant.name if plant is not None else "",
        zone=zone or (plant.zone if plant is not None else None) or "UTC",
        valves=facts_of(store, plant, chosen),
        p_elsewhere=_p_elsewhere(store, screenings, valves),
        currency=plant.currency if plant is not None else "",
    )
    background = background_of(store, plant, run)
    files = write_maintenance(chosen, context, out_dir, background, everything=all_valves)
    return replace(files, left_out=tuple(sorted(gone)))


def _not_named(plant: Plant | None, valves: Collection[str]) -> set[str]:
    """Those of ``valves`` that the plant file does not name any more: work on them would be ordered
    for ever, and twice on one that has another name now. None where the file is of another
    plant."""
    if plant is None or plant.valves.keys().isdisjoint(valves):
        return set()
    return plant.not_named(valves)


def _in_part(
    store: Store, plant: Plant | None, part: PartOfPlant, valves: Collection[str]
) -> set[str]:
    """Those of ``valves`` that are in ``part``: by the plant file, else as the store has them."""
    known: Iterable[DescribedValve] = plant.valves.values() if plant is not None else store.valves()
    try:
        chosen = {valve.id for valve in part.valves(known)}.intersection(valves)
    except UnknownPart as error:
        raise StoreError(f"{store.address}: {error}") from None
    if not chosen:
        asked = ", ".join(name for names in part.asked.values() for name in names)
        raise StoreError(f"{store.address}: no valve of {asked} was screened yet")
    return chosen


def _p_elsewhere(
    store: Store, restored: list[Restored], valves: Collection[str]
) -> tuple[float | None, ...]:
    """The p values of the valves that were tested and are not in the report."""
    others = [screening for screening in restored if valves and screening.valve not in valves]
    by_window = store.evidence([screening.valve for screening in others])
    return tuple(
        p_in_run(
            screening.mismatch.p_value,
            defects=bool(screening.mismatch.defects),
            by_window=by_window.get(screening.valve),
        )
        for screening in others
        if tested(screening.mismatch)
    )
