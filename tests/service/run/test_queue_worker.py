"""A run from the queue to its report, and what becomes of it when things go wrong."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import text

from stemwatch.models.verdict import Verdict
from stemwatch.models.without_position.suspicion import Suspicion
from stemwatch.service.config import Plant
from stemwatch.service.report.charts.window_pictures import pack_pictures, window_pictures
from stemwatch.service.run import queue_worker
from stemwatch.service.run.queue_worker import UNKNOWN, QueueWorker
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store
from tests.service.report.conftest import screening
from tests.service.report.test_without_position import suspected, with_suspected_stem

pytestmark = pytest.mark.early

HEALTHY, STICKY, BLIND = "FIC-107", "FIC-104", "FIC-113"
WORK = """
import sys, threading
from stemwatch.service.run.queue_worker import QueueWorker
from stemwatch.service.config import load_plant
from stemwatch.service.store.store import open_store

if __name__ == "__main__":
    plant = load_plant(sys.argv[1], environment={})
    with open_store(plant.storage) as store:
        QueueWorker(store, plant).once(threading.Event())
"""


def put(store: Store, **wanted) -> int:
    number = store.queue.put(RunToQueue(**wanted), software_version="1")
    assert number is not None
    return number


def work(store: Store, plant: Plant, **how) -> None:
    worker = QueueWorker(store, plant, **how)
    assert worker.once(threading.Event())


def test_a_run_screens_saves_and_reports(
    make_plant, plant_store: Store, caplog: pytest.LogCaptureFixture
) -> None:
    """Every valve has a verdict, a network, a baseline that the next run refers to, and the report
    is there; a run of one valve touches that one only."""
    caplog.set_level("INFO")
    plant = make_plant()
    first = put(plant_store, who="Ann")
    work(plant_store, plant)
    run = plant_store.run(first)
    assert (run.state, run.done, run.total, run.set_aside) == (RunState.DONE, 3, 3, 0)
    verdicts = {latest.valve: latest.verdict for latest in plant_store.latest_screenings()}
    assert verdicts[STICKY] is Verdict.STICKY
    assert verdicts[HEALTHY] is Verdict.HEALTHY
    report = json.loads((Path(run.report) / "valves.json").read_text(encoding="utf-8"))
    assert STICKY in json.dumps(report)
    second = put(plant_store, valves=(STICKY,), who="Ann")
    work(plant_store, plant)
    assert plant_store.run(second).total == 1
    assert f"run {second} is over: 1 valve, 0 set aside" in caplog.text
    (screening,) = plant_store.screenings(STICKY)
    assert screening.run_id == second
    assert screening.baseline_id == plant_store.baseline(STICKY).id
    assert not QueueWorker(plant_store, plant).once(threading.Event())


def test_what_earlier_runs_said_of_a_loop_counts_with_the_newest(
    make_plant, plant_store: Store
) -> None:
    """A scheduled run has what OP and PV alone said in the windows before, and its report shows the
    clearest of them; the same run again gives the same."""
    plant = make_plant()
    put(plant_store, who="Ann")
    work(plant_store, plant)
    (first,) = plant_store.screenings(HEALTHY)
    start, end = first.window
    assert start is not None
    assert first.without_position is not None
    assert first.without_position.alone is None
    earlier_run = plant_store.begin_run(software_version="1")
    for days in (1, 2, 3):
        blind = screening(HEALTHY, Verdict.UNDETERMINED, samples=60)
        recording = replace(blind.recording, start=start - timedelta(days=days))
        window = replace(blind, recording=recording)
        window = with_suspected_stem(window, suspected(0.95 + 0.01 * days))
        packed = pack_pictures(window_pictures(window))
        plant_store.save(window, earlier_run, packed_pictures=packed)
    for _ in range(2):
        put(plant_store, valves=(HEALTHY,), who="Ann")
        work(plant_store, plant)
        newest = plant_store.screenings(HEALTHY)[0]
        assert newest.window == (start, end)
        assert newest.without_position is not None
        assert newest.without_position.verdict is Suspicion.SUSPECTED
        assert newest.without_position.recordings == 4
        assert newest.without_position.alone == first.without_position
        report = Path(plant_store.run(newest.run_id).report) / "report.html"
        page = report.read_text(encoding="utf-8")
        shown = page[page.index("What raises the suspicion") :]
        assert f"From the window that ended {end - timedelta(days=3):%Y-%m-%d}" in shown
        assert shown[: shown.index("</section>")].count('class="small-plot"') == 3


def test_a_valve_that_is_not_there_is_set_aside(make_plant, plant_store: Store) -> None:
    """It is named with its reason, and the others are done."""
    plant = make_plant()
    number = put(plant_store, valves=("GONE-1", HEALTHY))
    work(plant_store, plant)
    assert plant_store.run(number).set_aside == 1
    assert plant_store.queue.set_aside(number) == [("GONE-1", UNKNOWN)]


def test_a_schedule_screens_its_area(make_plant, plant_store: Store) -> None:
    """Areas and valves of a schedule are joined; nothing else is screened."""
    plant = make_plant(f'[[schedules]]\nname = "few"\nevery_s = 60\nvalves = ["{STICKY}"]\n')
    plant_store.schedules.take_from_file(plant.schedules)
    number = put(plant_store, schedule="few")
    work(plant_store, plant)
    assert plant_store.queue.valves_done(number) == [STICKY]


def test_a_valve_that_hangs_is_set_aside(make_plant, plant_store: Store, monkeypatch) -> None:
    """No result in its time: it is given up with that reason, and the run is over."""
    # A worker needs longer than a second to start at all.
    monkeypatch.setattr("stemwatch.service.executors.local_processes._FIRST_S", -0.9)
    plant = make_plant("[service]\nworkers = 1\nvalve_timeout_s = 1\n")
    number = put(plant_store, valves=(STICKY,))
    work(plant_store, plant)
    run = plant_store.run(number)
    assert (run.state, run.set_aside) == (RunState.DONE, 1)
    assert "no result after" in plant_store.queue.set_aside(number)[0][1]


def test_a_cancelled_run_ends_and_says_by_whom(make_plant, plant_store: Store) -> None:
    """What was done stays; the run says who ended it."""
    plant = make_plant()
    number = put(plant_store)
    plant_store.queue.ask_to_cancel(number, "Ben")
    assert plant_store.run(number).state is RunState.CANCELLED
    number = put(plant_store)
    worker = QueueWorker(plant_store, plant, heartbeat_s=0.05)
    working = threading.Thread(target=worker.once, args=(threading.Event(),))
    working.start()
    _until(lambda: plant_store.run(number).state is RunState.RUNNING)
    plant_store.queue.ask_to_cancel(number, "Ben")
    working.join(timeout=60)
    run = plant_store.run(number)
    assert run.state is RunState.CANCELLED
    assert "cancelled by Ben after" in run.reason


def test_a_service_that_stops_leaves_its_run_for_the_next(make_plant, plant_store: Store) -> None:
    """Stopped in order, the run lies at once for another process, which finishes it."""
    plant = make_plant()
    number = put(plant_store)
    stop = threading.Event()
    stop.set()
    assert QueueWorker(plant_store, plant).once(stop)
    assert plant_store.run(number).state is RunState.RUNNING
    work(plant_store, plant)
    assert plant_store.run(number).state is RunState.DONE


def test_killed_half_way_the_next_start_finishes(make_plant, plant_store: Store) -> None:
    """SIGKILL in the middle of a run: what was saved is not done again, what was left is, nothing
    is there twice, and the report shows all valves."""
    plant = make_plant("[service]\nworkers = 1\nvalve_timeout_s = 60\n")
    number = put(plant_store)
    script = plant.file.parent / "work.py"
    script.write_text(WORK, encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, str(script), str(plant.file)],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        start_new_session=True,
    )
    try:
        _until(lambda: plant_store.run(number).done >= 1)
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    before = {item.valve: item.id for item in map(_last(plant_store), plant.valves) if item}
    result = plant_store.queue.valves_done(number)
    assert plant_store.run(number).state is RunState.RUNNING
    work(plant_store, plant)  # the dead process was of this machine: nothing to wait for
    run = plant_store.run(number)
    assert (run.state, run.done) == (RunState.DONE, 3)
    assert {valve: _last(plant_store)(valve).id for valve in result} == {
        valve: before[valve] for valve in result
    }
    with plant_store.transactions.reading() as session:
        rows = session.execute(text("SELECT valve, count(*) FROM screenings GROUP BY valve")).all()
    assert dict(rows) == dict.fromkeys(plant.valves, 1)
    loaded = json.loads((Path(run.report) / "valves.json").read_text(encoding="utf-8"))
    assert all(valve in json.dumps(loaded) for valve in plant.valves)


def test_a_run_that_the_database_always_refuses_fails_and_lets_others_begin(
    make_plant, plant_store: Store, monkeypatch
) -> None:
    """Tried again some times while it does not get on, since such an error may pass; then it says
    why, and the queue goes on."""
    monkeypatch.setattr(queue_worker, "_MOST_TRIALS", 3)
    plant = make_plant()
    number = put(plant_store, valves=("GONE-1",))
    with plant_store.transactions.writing("renaming a table") as session:
        session.execute(text("ALTER TABLE alerts RENAME TO alerts_elsewhere"))
    worker = QueueWorker(plant_store, plant)
    got_on, *trials = [worker.once(threading.Event()) for _ in range(4)]
    assert (got_on, trials) == (False, [False, False, True])
    run = plant_store.run(number)
    assert run.state is RunState.FAILED
    assert "no such table" in run.reason
    assert not worker.once(threading.Event())


def test_reports_are_old_by_the_number_of_their_run(tmp_path: Path) -> None:
    """Also from the millionth run on, whose name is longer; nothing else is touched."""
    for name in ("run-000007", "run-999999", "run-1000000", "run-notes", "other"):
        (tmp_path / name).mkdir()
    queue_worker._remove_old(tmp_path, 2)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"run-999999", "run-1000000", "run-notes", "other"}


def _last(store: Store):
    return lambda valve: next(iter(store.screenings(valve)), None)


def _until(there) -> None:
    for _ in range(1200):
        if there():
            return
        time.sleep(0.05)
    pytest.fail("it did not happen within a minute")
