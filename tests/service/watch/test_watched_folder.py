"""A watched folder: each export is stored once, only complete files are read, rejected files get a
note."""

from __future__ import annotations

import gzip
import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from stemwatch.connectors.connector import Window
from stemwatch.connectors.historian import HistorianFile, ReadOptions
from stemwatch.models.recording import Role
from stemwatch.models.verdict import Verdict
from stemwatch.service.config import Plant, load_plant
from stemwatch.service.run.plan import Request, make_plan
from stemwatch.service.run.task import screen_tasks
from stemwatch.service.serve.periodic_tasks import remove_old
from stemwatch.service.store.samples.connector import StoredSamples
from stemwatch.service.store.store import Store, open_store
from stemwatch.service.watch import WatchedFolder, take_in

STICKY = "FIC-104"


@pytest.fixture
def watched(plant: Path, export: Path) -> Plant:
    """The small plant, whose exports are dropped into a folder."""
    lines = plant.read_text(encoding="utf-8").splitlines()
    text = "\n".join('folder = "inbox"' if line.startswith("path =") else line for line in lines)
    text += "\n[service]\nkeep_samples_days = 36500\n"  # the export's date lies where it lies
    plant.write_text(text, encoding="utf-8")
    loaded = load_plant(plant, environment={})
    assert loaded.problems == ()
    assert all(loaded.is_live(valve) for valve in loaded.valves)
    return loaded


@pytest.fixture
def store(watched: Plant) -> Iterator[Store]:
    """The plant's store."""
    with open_store(watched.storage) as opened:
        yield opened


@pytest.fixture
def folder(watched: Plant, store: Store) -> WatchedFolder:
    """The watched folder of the plant's only source."""
    (source,) = watched.sources
    return WatchedFolder(watched, source, store, quiet=timedelta(0))


def drop(folder: WatchedFolder, name: str, content: bytes) -> Path:
    folder.folder.mkdir(exist_ok=True)
    path = folder.folder / name
    path.write_bytes(content)
    return path


def twice(folder: WatchedFolder):
    """Two looks: the first one sees a file, the second one that it has not changed."""
    return [*folder.look(), *folder.look()]


def count(store: Store, folder: WatchedFolder) -> int:
    return sum(
        store.samples.read(tag.source, tag.name).at_us.size
        for source in ("historian",)
        for tag in store.samples.tags(source)
    )


def test_an_export_is_taken_in_and_read_back_the_same(
    folder: WatchedFolder, store: Store, watched: Plant, export: Path
) -> None:
    """A valve's recording from the store is the one that the file gives."""
    drop(folder, "monday.csv", export.read_bytes())
    (accepted,) = twice(folder)
    assert accepted.accepted
    assert accepted.samples > 0
    assert [path.name for path in (folder.folder / "done").iterdir()] == ["monday.csv"]
    tags = watched.valve_tags(STICKY)
    (source,) = watched.sources
    stored = StoredSamples(store.samples, source).read(tags)
    options = ReadOptions(**watched.read_options(source))
    read = HistorianFile(export, options).read(tags)
    assert (stored.start, stored.interval_s) == (read.start, read.interval_s)
    for role in (Role.OP, Role.MV):
        np.testing.assert_allclose(stored.get(role).values, read.get(role).values, atol=1e-9)
        np.testing.assert_array_equal(stored.get(role).quality, read.get(role).quality)


def test_a_valve_is_screened_from_the_store(
    folder: WatchedFolder, watched: Plant, export: Path
) -> None:
    """A run over the plant reads such a valve from the store and comes to the same verdict."""
    drop(folder, "monday.csv", export.read_bytes())
    twice(folder)
    tasks = [task for task in make_plan(Request(plant=watched)).tasks if task.tags.valve == STICKY]
    (result,) = screen_tasks(tasks, watched.limits)
    assert result.verdict is Verdict.STICKY
    assert result.provenance.layout == "samples in the store"
    empty = Window(start=datetime(2030, 1, 1, 6, 0, 1, 202485, tzinfo=UTC))
    task = replace(tasks[0], window=empty)
    (nothing,) = screen_tasks([task], watched.limits)
    assert nothing.verdict is Verdict.UNDETERMINED
    window = "2030-01-01 06:00:01 to … UTC"
    assert f"no good sample of the controller output in {window}; the store has" in nothing.reason
    assert str(watched.storage) not in nothing.reason  # pages show it to everybody


def test_the_same_bytes_are_taken_once_whatever_their_name(
    folder: WatchedFolder, store: Store, export: Path
) -> None:
    """A copy goes to done with a note, and the store does not change."""
    drop(folder, "a.csv", export.read_bytes())
    twice(folder)
    before = count(store, folder)
    drop(folder, "a.csv", export.read_bytes())
    twice(folder)
    in_order = sorted(path.name for path in (folder.folder / "done").iterdir())
    assert in_order == ["a-2.csv", "a-2.csv.why.txt", "a.csv"]
    assert count(store, folder) == before
    assert len(store.sources.files()) == 1


def test_a_file_that_grows_waits(folder: WatchedFolder, export: Path) -> None:
    """Nothing is taken in while somebody still writes, nor before it has rested."""
    content = export.read_bytes()
    half = drop(folder, "slow.csv", content[: len(content) // 2])
    assert folder.look() == []
    half.write_bytes(content)
    assert folder.look() == []
    assert [item.name for item in folder.look()] == ["slow.csv"]


def test_a_fresh_file_rests_first(watched: Plant, store: Store, export: Path) -> None:
    """A file that changed a moment ago may go on changing."""
    (source,) = watched.sources
    patient = WatchedFolder(watched, source, store, quiet=timedelta(hours=1))
    path = drop(patient, "fresh.csv", export.read_bytes())
    assert twice(patient) == []
    old = (datetime.now(UTC) - timedelta(hours=2)).timestamp()
    os.utime(path, (old, old))
    assert len(twice(patient)) == 1


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "empty"),
        (b"\x00\x01\x02" * 100, ""),
        (b"%PDF-1.7 a report", ""),
        (b"Time;OTHER.OP\n2026-03-02 06:00:00;1,5\n2026-03-02 06:00:01;1,6\n", "OTHER.OP"),
    ],
)
def test_what_cannot_be_taken_is_rejected_with_its_reason(
    folder: WatchedFolder, store: Store, content: bytes, text: str
) -> None:
    """The file lies in rejected beside a note, and the others are taken in all the same."""
    drop(folder, "bad.csv", content)
    (file,) = twice(folder)
    assert not file.accepted
    rejected = folder.folder / "rejected"
    note = (rejected / "bad.csv.why.txt").read_text(encoding="utf-8")
    assert note.strip() == file.note
    assert text in note
    assert len(note) > 20
    assert (rejected / "bad.csv").read_bytes() == content
    assert store.sources.taken(file.digest).note == file.note


def test_a_rejected_file_may_come_again(
    folder: WatchedFolder, store: Store, watched: Plant, export: Path
) -> None:
    """What was rejected is looked at again when it is dropped again: the plant file may have been
    mended meanwhile."""
    content = b"Time;OTHER.OP\n2026-03-02 06:00:00;1,5\n2026-03-02 06:00:01;1,6\n"
    for _ in range(2):
        drop(folder, "bad.csv", content)
        assert [item.accepted for item in twice(folder)] == [False]
    assert len(list((folder.folder / "rejected").glob("bad*.csv"))) == 2


def test_hidden_files_links_and_folders_are_left_alone(
    folder: WatchedFolder, export: Path, tmp_path: Path
) -> None:
    """Office programs, copying tools and people leave things behind that are no exports."""
    drop(folder, ".partial.csv", export.read_bytes())
    drop(folder, "~$lock.csv", b"x")
    (folder.folder / "sub").mkdir()
    (folder.folder / "link.csv").symlink_to(export)
    assert twice(folder) == []
    assert export.exists()


def test_the_folders_state_is_shown(
    watched: Plant, folder: WatchedFolder, store: Store, export: Path
) -> None:
    """Pages see how many files came, and a folder that is not there. When the last one came is
    known after a restart too; what is counted begins anew."""
    drop(folder, "a.csv", export.read_bytes())
    twice(folder)
    (state,) = store.sources.states()
    assert (state.kind, state.connected) == ("folder", True)
    assert (state.figures["taken"], state.figures["rejected"]) == (1, 0)
    drop(folder, "b.csv", b"no export")
    WatchedFolder(watched, state.source, store, quiet=timedelta(0)).look()
    (taken_in,) = (file.taken for file in store.sources.files() if file.accepted)
    (again,) = store.sources.states()
    assert (again.last_good, again.figures["taken"]) == (taken_in, 0)


def test_a_folder_that_cannot_be_used_is_said_and_looked_at_again(
    folder: WatchedFolder, store: Store, export: Path
) -> None:
    """A share that is away is a fault of the source, not of the service."""
    folder.folder.write_text("a file where a folder should be", encoding="utf-8")
    assert folder.look() == []
    assert not store.sources.states()[0].connected
    folder.folder.unlink()
    drop(folder, "a.csv", export.read_bytes())
    assert len(twice(folder)) == 1
    assert store.sources.states()[0].connected


def test_a_file_that_cannot_be_read_holds_up_no_other(
    folder: WatchedFolder, store: Store, export: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that belongs to another account is named with what to do, and is taken in once it can be
    read; those beside it are taken in meanwhile."""
    mine, opens = drop(folder, "a.csv", export.read_bytes()), Path.open
    drop(folder, "b.csv", export.read_bytes() + b"\n")

    def refuse(path: Path, *args: object, **kwargs: object) -> object:
        if path == mine:
            raise PermissionError(13, "Permission denied", str(path))
        return opens(path, *args, **kwargs)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", refuse)
        assert [file.name for file in twice(folder)] == ["b.csv"]
    (state,) = store.sources.states()
    assert not state.connected
    assert state.fault.startswith("a.csv: [Errno 13] Permission denied")
    assert "must be able to read the file" in state.fault
    assert [file.name for file in folder.look()] == ["a.csv"]
    assert store.sources.states()[0].connected


def test_files_are_not_read_where_they_could_not_be_moved_away(
    folder: WatchedFolder, store: Store, export: Path
) -> None:
    """Else the same file would be read at each look, and be rejected for it in the end."""
    drop(folder, "a.csv", export.read_bytes())
    hindrance = folder.folder / "done"
    hindrance.write_text("a file where a folder should be", encoding="utf-8")
    assert twice(folder) == []
    assert str(hindrance) in store.sources.states()[0].fault
    assert store.sources.files() == []
    hindrance.unlink()
    assert [file.name for file in folder.look()] == ["a.csv"]


HEAD = b"Time;FIC-104.OP\n"
ROW = b"2026-03-02 06:00:00;1,5\n"


def packed(megabytes: int) -> bytes:
    """A small archive that holds ``megabytes`` of one row."""
    return gzip.compress(HEAD + ROW * (megabytes * 2**20 // len(ROW)))


@pytest.mark.long
def test_an_archive_that_unpacks_beyond_all_measure_is_rejected(
    folder: WatchedFolder, store: Store, export: Path
) -> None:
    """As one that is made to fill the memory does; the next file is taken in."""
    drop(folder, "bomb.csv.gz", packed(260))
    drop(folder, "monday.csv", export.read_bytes())
    bomb, monday = twice(folder)
    assert not bomb.accepted
    assert "unpacks to more than 200 times its size" in bomb.note
    assert monday.accepted


def test_a_file_that_takes_more_memory_than_is_left_is_rejected(
    watched: Plant, store: Store, export: Path
) -> None:
    """It is read in a process that may take no more; this one does not grow by it."""
    (source,) = watched.sources
    folder = WatchedFolder(watched, source, store, quiet=timedelta(0), memory_bytes=150 << 20)
    drop(folder, "large.csv.gz", packed(100))
    drop(folder, "monday.csv", export.read_bytes())
    large, monday = twice(folder)
    assert not large.accepted
    assert "reading it takes more than the 150 MB of memory that are left for it" in large.note
    assert monday.accepted
    assert not list(folder.folder.glob("*.gz"))


SERVICE = """
    import os, signal, sys
    from datetime import timedelta
    from stemwatch.service.config import load_plant
    from stemwatch.service.store.store import open_store
    from stemwatch.service.watch import WatchedFolder, folder as watch

    def dies(path, *given):
        if path.name == "bad.csv":
            os.kill(os.getpid(), signal.SIGKILL)  # what a system does that is out of memory
        return take_in(path, *given)

    take_in, watch.take_in = watch.take_in, dies
    plant = load_plant(sys.argv[1], environment={})
    with open_store(plant.storage) as store:
        folder = WatchedFolder(plant, *plant.sources, store, quiet=timedelta(0))
        print([(file.name, file.accepted) for file in [*folder.look(), *folder.look()]])
"""


@pytest.mark.long
def test_a_file_that_kills_the_service_twice_is_rejected_at_the_third_start(
    folder: WatchedFolder, watched: Plant, export: Path
) -> None:
    """The attempt is noted before it is made; the other files are taken in then."""
    drop(folder, "bad.csv", b"\x00" * 99)
    drop(folder, "monday.csv", export.read_bytes())
    command = [sys.executable, "-c", textwrap.dedent(SERVICE), str(watched.file)]
    starts = [subprocess.run(command, capture_output=True, text=True) for _ in range(3)]
    assert [start.returncode for start in starts] == [-9, -9, 0], starts[2].stderr
    assert starts[2].stdout.strip() == "[('bad.csv', False), ('monday.csv', True)]"
    note = (folder.folder / "rejected" / "bad.csv.why.txt").read_text(encoding="utf-8")
    assert "begun 2 times and the process that read it came to no end" in note


def test_a_reader_that_is_killed_is_tried_once_more(
    folder: WatchedFolder, export: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once is an accident, and the file is taken in; twice is the file."""
    from stemwatch.service.watch import folder as module
    from stemwatch.service.watch.limited_reader import ReaderDied

    deaths = ["it ended with -9"]
    real = take_in

    def killed(*given):
        if deaths:
            raise ReaderDied(deaths.pop())
        return real(*given)

    monkeypatch.setattr(module, "take_in", killed)
    drop(folder, "monday.csv", export.read_bytes())
    assert [*twice(folder)] == []
    (accepted,) = folder.look()
    assert accepted.accepted
    deaths += ["it ended with -9"] * 2
    drop(folder, "other.csv", export.read_bytes() + b"\n")
    assert [*twice(folder)] == []
    (rejected,) = folder.look()
    assert not rejected.accepted
    assert "came to no end" in rejected.note
    assert "it ended with -9" in rejected.note


def test_a_reading_process_that_is_killed_is_noticed(watched: Plant, tmp_path: Path) -> None:
    """Nothing of it is waited for."""
    from stemwatch.service.watch.limited_reader import Export, ReaderDied, limited_reading

    large = tmp_path / "large.csv"
    large.write_bytes(HEAD + ROW * 400_000)
    export = Export(path=large, options=ReadOptions(zone="UTC"), source="s", wanted={"x": False})

    def kill() -> None:
        while not (started := multiprocessing.active_children()):
            time.sleep(0.01)
        os.kill(started[0].pid, signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    with pytest.raises(ReaderDied, match="ended with -9"), limited_reading(export):
        pass
    thread.join()


def test_samples_too_old_to_stay_are_told_and_may_come_again(
    folder: WatchedFolder, store: Store, watched: Plant, export: Path
) -> None:
    """An export of years ago is removed again within the hour, which is told where the file is
    listed; once the plant file keeps samples longer, the same file is taken in when it is dropped
    again. Of one within reach nothing is said."""
    text = watched.file.read_text(encoding="utf-8")
    short = text.replace("keep_samples_days = 36500", "keep_samples_days = 1")
    watched.file.write_text(short, encoding="utf-8")
    (source,) = watched.sources
    hasty = WatchedFolder(load_plant(watched.file), source, store, quiet=timedelta(0))
    drop(hasty, "years.csv", export.read_bytes())
    (file,) = twice(hasty)
    assert file.accepted
    told = "; all of them are older than keep_samples_days = 1 days, and will be removed within"
    assert told in file.note
    stored = store.sources.taken(file.digest)
    assert (stored.note, stored.too_old) == (file.note, file.samples)

    remove_old(store, load_plant(watched.file))
    assert count(store, folder) == 0
    drop(folder, "years.csv", export.read_bytes())
    (again,) = twice(folder)
    assert "keep_samples_days" not in again.note
    assert again.too_old == 0
    assert count(store, folder) == again.samples > 0
