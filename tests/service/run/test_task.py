"""A task is done or says why not, and travels to another process."""

from __future__ import annotations

import pickle
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian import ReadOptions
from stemwatch.models.limits import Limits
from stemwatch.models.recording import Role
from stemwatch.models.screening.screen import Case
from stemwatch.models.stickslip.stroke_curve import KnownCurve, StrokeCurve
from stemwatch.models.verdict import Verdict
from stemwatch.models.without_position.suspicion import Suspicion
from stemwatch.service.run.batches import SPLIT_UP_TO_BYTES, make_batches
from stemwatch.service.run.task import (
    InStore,
    StoredBaseline,
    Task,
    case_of,
    known_curve,
    open_file,
    screen_tasks,
)
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.screenings.records import EarlierAnswer, EarlierCurve
from tests.service.report.test_without_position import suspected


def task(path: Path, op: str = "FIC-104.OP", **more: Any) -> Task:
    """The sticking valve of the small plant, or a misspelt tag of it."""
    tags = {Role.OP: TagMapping(tag=op), Role.MV: TagMapping(tag="FIC-104.ZT")}
    return Task(path=str(path), tags=ValveTags(valve="FIC-104", tags=tags), **more)


def test_a_worker_makes_no_database(tmp_path: Path) -> None:
    """A worker on another machine sees no SQLite file: it says so and makes none."""
    address = DatabaseUrl(f"sqlite:///{tmp_path / 'stemwatch.db'}")
    stored = InStore(address=address, source="plc-1")
    (result,) = screen_tasks([task(tmp_path / "plc-1", stored=stored)], Limits())
    assert result.verdict is Verdict.UNDETERMINED
    assert f"no database at {tmp_path / 'stemwatch.db'}" in result.reason
    assert "PostgreSQL" in result.reason
    assert list(tmp_path.iterdir()) == []


def test_there_is_a_screening_for_each_task_in_order(one_valve: Path, tmp_path: Path) -> None:
    """Tasks that cannot be read stand between those that can, each with its own reason."""
    header = one_valve.read_bytes().partition(b"\n")[0]
    (tmp_path / "cut.csv").write_bytes(header)
    tasks = (
        task(tmp_path / "gone.csv"),
        task(one_valve),
        task(one_valve, op="FIC-104.OUT"),
        task(one_valve, reason="the archive was away"),
        task(tmp_path / "cut.csv"),
        task(tmp_path),
    )
    result = screen_tasks(tasks, Limits())
    assert [item.verdict for item in result] == [
        Verdict.UNDETERMINED, Verdict.STICKY, *[Verdict.UNDETERMINED] * 4,
    ]  # fmt: skip
    reasons = [item.reason for item in result]
    assert "gone.csv" in reasons[0]
    assert "there is no tag 'FIC-104.OUT'" in reasons[2]
    assert reasons[3] == "Cannot tell: the archive was away"
    assert "cut.csv" in reasons[4]
    assert str(tmp_path) in reasons[5]
    assert [item.recording is None for item in result] == [True, False, True, True, True, True]


def test_an_unread_task_knows_its_source_and_what_to_do(tmp_path: Path) -> None:
    """The screening of a file that is not there still names it and gives a next step."""
    (result,) = screen_tasks([task(tmp_path / "gone.csv")], Limits())
    assert str(tmp_path / "gone.csv") == result.provenance.source
    assert "stemwatch inspect" in result.advice
    assert result.S.value is None
    assert result.S.reason


def test_a_damaged_baseline_is_a_note(one_valve: Path) -> None:
    """Bytes that are no network cost the comparison only, and the note says to set a new one."""
    stored_baseline = StoredBaseline(network=b"no network", note="Baseline: of last year.")
    (result,) = screen_tasks([task(one_valve, baseline=stored_baseline)], Limits())
    assert result.verdict is Verdict.STICKY
    assert result.baseline_note.startswith("Baseline: of last year. It cannot be read (")
    assert result.baseline_note.endswith("set a new one.")


def test_tasks_and_their_screenings_can_travel(one_valve: Path) -> None:
    """Task and result survive the way to another process and back, recording and network too."""
    tasks = [task(one_valve)]
    assert tasks == pickle.loads(pickle.dumps(tasks))
    (result,) = screen_tasks(tasks, Limits())
    repeated = pickle.loads(pickle.dumps(result))
    assert (result.S, result.J, result.reason) == (repeated.S, repeated.J, repeated.reason)
    assert result.recording is not None
    assert len(result.recording) == len(repeated.recording)
    assert result.network is not None
    assert result.network.to_bytes() == repeated.network.to_bytes()


def test_the_curve_of_the_window_before_is_known(one_valve: Path) -> None:
    """The curve of the last window that ended no later, and not that of the same window screened
    before."""
    recording = open_file(str(one_valve), ReadOptions()).read(task(one_valve).tags)
    curve, day = StrokeCurve(op=(50.0, 100.0), travel=(0.0, 100.0)), timedelta(days=1)

    def earlier(days: int, result: StrokeCurve | None) -> EarlierCurve:
        start, end = recording.start, recording.end
        return EarlierCurve(start=start - days * day, end=end - days * day, curve=result)

    kept = (earlier(-1, None), earlier(0, None), earlier(1, curve), earlier(2, None))
    requested = task(one_valve, earlier_curves=kept)
    assert known_curve(requested, recording) == KnownCurve(curve)
    case = case_of(requested)
    assert isinstance(case, Case)
    assert case.known_curve == KnownCurve(curve)
    result = KnownCurve(None, given=True)
    assert known_curve(replace(requested, given_curve=result), recording) == result
    assert known_curve(replace(requested, earlier_curves=kept[:2]), recording) is None
    assert known_curve(requested, replace(recording, start=None)) is None


def test_windows_before_this_one_count_in_what_op_and_pv_say(one_valve: Path) -> None:
    """Those that ended before it begins; of a recording that shares samples none does."""
    recording = open_file(str(one_valve), ReadOptions()).read(task(one_valve).tags)
    assert recording.start is not None
    day = timedelta(days=1)

    def before(days: int) -> EarlierAnswer:
        start, end = recording.start - days * day, recording.end - days * day
        return EarlierAnswer(screening=days, start=start, end=end, answer=suspected(0.97))

    (result,) = screen_tasks([task(one_valve, earlier_answers=(before(1), before(2)))], Limits())
    assert result.without_position is not None
    assert result.without_position.verdict is Suspicion.SUSPECTED
    assert result.without_position.recordings == 3
    assert result.without_position.alone is not None
    assert "PV is not in this recording" in result.without_position.alone.reason
    (alone,) = screen_tasks([task(one_valve, earlier_answers=(before(0), before(-1)))], Limits())
    assert alone.without_position is not None
    assert alone.without_position.verdict is Suspicion.CANNOT_TELL
    assert alone.without_position.recordings == 1


def test_valves_of_one_small_file_are_dealt_to_all_workers(tmp_path: Path) -> None:
    """One file is parsed by each worker that would have nothing to do else, if it is small and has
    many valves; fewer valves, a large file and a missing one stay together."""
    file = tmp_path / "wide.csv"
    file.write_bytes(b"x")
    assert [len(batch) for batch in make_batches([task(file)] * 15, 2)][:3] == [3, 2, 2]
    assert [len(batch) for batch in make_batches([task(file)] * 7, 2)] == [7]
    assert [len(batch) for batch in make_batches([task(file)] * 15, 1)] == [15]
    assert [len(batch) for batch in make_batches([task(tmp_path / "gone")] * 15, 2)] == [15]
    with file.open("r+b") as large:
        large.truncate(SPLIT_UP_TO_BYTES + 1)
    assert [len(batch) for batch in make_batches([task(file)] * 15, 2)] == [15]
    files = [tmp_path / name for name in ("a.csv", "b.csv")]
    for each in files:
        each.write_bytes(b"x")
    tasks = [task(each) for each in files for _ in range(8)]
    assert [len(batch) for batch in make_batches(tasks, 2)] == [8, 8]
