"""``ValveRun``: one run of the queue, worked on from where it stands."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta

from stemwatch.connectors.connector import Window
from stemwatch.models.screening_result import PreviousFinding, Screening
from stemwatch.service.config import Plant
from stemwatch.service.run.chunking import make_chunks
from stemwatch.service.run.engine import keep_network
from stemwatch.service.run.task import StoredBaseline
from stemwatch.service.scheduler.kept import Worst
from stemwatch.service.scheduler.work import ValveJob, job_of, screen_jobs
from stemwatch.service.scheduler.workers import Outcome, WorkerPool
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.runs.queue import SILENT_AFTER
from stemwatch.service.store.screenings.records import RunState, StoredRun, ValveState
from stemwatch.service.store.store import Store

log = logging.getLogger(__name__)

BATCH = 8  # valves whose networks train together
BEAT_S = SILENT_AFTER.total_seconds() / 6
UNKNOWN = "the plant file does not describe this valve (any more)"


@dataclass
class Heart:
    """Says every few seconds that a run is worked on, and hears whether it shall end.

    ``stop`` is set when the run was cancelled, when another process has taken it over, or from
    outside; ``why`` says which.
    """

    store: Store
    run_id: int
    owner: str
    stop: threading.Event
    every_s: float = BEAT_S
    why: str = ""

    def __post_init__(self) -> None:
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._beat, name=f"run {self.run_id}", daemon=True)
        self._thread.start()

    def rest(self) -> None:
        """Say no more."""
        self._over.set()
        self._thread.join()

    def _beat(self) -> None:
        while not self._over.wait(self.every_s):
            try:
                run = self.store.queue.beat(self.run_id, self.owner)
            except StoreError as error:
                about = {"run": self.run_id}
                text = "run %d: no sign of life can be given: %s"
                log.warning(text, self.run_id, error, extra=about)
                continue
            if run is None:
                self.why = "taken"
            elif run.cancel_asked_by is not None:
                self.why = f"cancelled by {run.cancel_asked_by}"
            else:
                continue
            self.stop.set()
            return


class ValveRun:
    """The valves of ``run`` that are left, screened and saved one after the other.

    ``worst`` then holds the screenings for the report, ``previous`` what was found of them before.
    """

    def __init__(self, run: StoredRun, plant: Plant, store: Store) -> None:
        self.run, self.plant, self.store = run, plant, store
        self.worst = Worst(plant.service.report_valves)
        self.previous: dict[str, PreviousFinding | None] = {}
        self._compared: dict[str, int] = {}

    def valves(self) -> list[str]:
        """The valves that the run is about: those asked for, else its schedule's, else all."""
        if self.run.asked:
            return list(self.run.asked)
        kept = {one.schedule.name: one.schedule for one in self.store.schedules.all()}
        schedule = kept.get(self.run.schedule or "")
        if schedule is None or not (schedule.areas or schedule.valves):
            return list(self.plant.valves)
        return [
            valve.id
            for valve in self.plant.valves.values()
            if valve.area in schedule.areas or valve.id in schedule.valves
        ]

    def screen(self, pool: WorkerPool, workers: int, stop: threading.Event) -> None:
        """Screen and save what is left, until ``stop``."""
        self.store.save_valves(self.plant.valves.values())
        left = self.store.queue.plan(self.run.id, self.valves(), self.plant.settings_digest)
        for valve in left:
            if valve not in self.plant.valves:
                self.store.queue.mark(self.run.id, valve, ValveState.SET_ASIDE, UNKNOWN)
        jobs = [self.job(valve) for valve in left if valve in self.plant.valves]
        for outcome in pool.each(screen_jobs, make_chunks(jobs, workers, BATCH), stop):
            self._keep(outcome)

    def job(self, valve: str) -> ValveJob:
        """What a worker is told of one valve."""
        kept = self.store.baseline(valve)
        baseline = None
        if kept is not None:
            self._compared[valve] = kept.id
            baseline = StoredBaseline(
                network=kept.network, note=kept.note, window=kept.window, id=kept.id
            )
        return job_of(self.plant, valve, self._window(valve), baseline)

    def _window(self, valve: str) -> Window:
        """The run's window; where it says none, whole files, and of the store as much as
        ``[service] window_s`` says. The same for every process that works on the run."""
        start, stop = self.run.window
        if not self.plant.is_live(valve):
            return Window() if start is None else Window(start=start, stop=stop)
        stop = stop or self.run.started
        return Window(
            start=start or stop - timedelta(seconds=self.plant.service.window_s), stop=stop
        )

    def _keep(self, outcome: Outcome[ValveJob, list[Screening]]) -> None:
        """Save what was found of one valve, then note it as done: killed in between, it is
        screened and saved again in the same place."""
        valve = outcome.item.valve
        if outcome.result is None:
            about = {"run": self.run.id, "valve": valve}
            text = "run %d: %s is set aside: %s"
            log.warning(text, self.run.id, valve, outcome.reason, extra=about)
            self.store.queue.mark(self.run.id, valve, ValveState.SET_ASIDE, outcome.reason)
            return
        for screening in outcome.result:
            self.previous[valve] = self.store.previous_finding(screening, self.run.started)
            self.store.save(screening, self.run.id, self._compared.get(valve))
            keep_network(screening, self.store)
        self.worst.add(outcome.result)
        self.store.queue.mark(self.run.id, valve, ValveState.DONE)


def missing_pictures(
    valves: Sequence[str], run: ValveRun, pool: WorkerPool, stop: threading.Event
) -> None:
    """Screen again, without saving, valves that an earlier process did before it ended: the report
    needs their samples."""
    jobs = [run.job(valve) for valve in valves if valve in run.plant.valves]
    for outcome in pool.each(screen_jobs, [[job] for job in jobs], stop):
        if outcome.result:
            for screening in outcome.result:
                found = run.store.previous_finding(screening, run.run.started)
                run.previous[screening.valve] = found
            run.worst.add(outcome.result)


def ended(run: StoredRun, why: str) -> tuple[RunState, str] | None:
    """How a run that was stopped ends: ``None`` where it goes on elsewhere or later."""
    if why.startswith("cancelled"):
        return RunState.CANCELLED, f"{why} after {run.done} of {run.total} valves"
    return None
