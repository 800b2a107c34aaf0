"""The spool: what is appended comes out once and in order, through crashes and damage."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.connectors.modbus.sample_batch import SampleBatch, joined, one_instant
from stemwatch.service.collector.batch_format import MARK, pack, records
from stemwatch.service.collector.spool import Position, Spool, SpoolError
from tests.own_process import environment

SMALL = {"limit_bytes": 8_000, "segment_bytes": 1_000}


def batch(at_us: int, count: int = 3, source: str = "plc") -> SampleBatch:
    """A batch of one instant, the last sample bad."""
    values = np.arange(count) + at_us / 7
    values[-1] = np.nan
    quality = np.array([0] * (count - 1) + [3], dtype=np.uint8)
    tags = [f"T{i}" for i in range(count)]
    return one_instant(source, tags, at_us, values, quality, [""] * (count - 1) + ["no answer"])


def times(spool: Spool) -> list[int]:
    """The instants of the batches that wait."""
    return [int(item.batch.at_us[0]) for item in spool.waiting()]


@given(
    st.lists(st.text(max_size=8), min_size=0, max_size=5),
    st.text(max_size=5),
    st.integers(0, 2**62),
    st.floats(),
)
def test_a_record_gives_back_what_was_packed(tags, source, at_us, value) -> None:
    """Any tag, any number, no sample at all."""
    count = len(tags)
    reasons = [f"reason {i % 2}" for i in range(count)]
    quality = np.arange(count, dtype=np.uint8)
    written = one_instant(source, tags, at_us, np.full(count, value), quality, reasons)
    (result,) = records(pack(written))
    repeated = result.batch
    clean = [tag.encode("utf-8", "replace").decode() for tag in tags]
    assert (repeated.source, list(repeated.tags)) == (
        source.encode("utf-8", "replace").decode(),
        clean,
    )
    assert repeated.reasons == tuple(reasons)
    for column in ("at_us", "values", "quality"):
        np.testing.assert_array_equal(getattr(repeated, column), getattr(written, column))


@given(st.integers(0, 2), st.data())
def test_damage_costs_its_own_record_only(hit: int, data) -> None:
    """Any byte changed: the two other records are found, and nothing false is."""
    packed = [pack(batch(i)) for i in range(3)]
    place = data.draw(st.integers(0, len(packed[hit]) - 1))
    flip = data.draw(st.integers(1, 255))
    broken = bytearray(packed[hit])
    broken[place] ^= flip
    complete = b"".join([*packed[:hit], bytes(broken), *packed[hit + 1 :]])
    matching = [int(record.batch.at_us[0]) for record in records(complete)]
    assert matching == [i for i in range(3) if i != hit]


@given(st.integers(0, 400))
def test_a_torn_end_hides_nothing_before_it(cut: int) -> None:
    """A record that was being written when the power went."""
    item, two = pack(batch(1)), pack(batch(2))
    as_list = list(records((item + two)[: len(item) + min(cut, len(two) - 1)]))
    assert [int(each.batch.at_us[0]) for each in as_list] == [1]


def test_batches_come_out_in_order_until_they_are_acknowledged(tmp_path: Path) -> None:
    """Across the spool's files, and again after a restart."""
    spool = Spool(tmp_path, **SMALL)
    for i in range(12):
        spool.append(batch(i))
    waiting = list(spool.waiting())
    assert [int(item.batch.at_us[0]) for item in waiting] == list(range(12))
    assert len({item.next.segment for item in waiting}) > 1
    spool.acknowledge(waiting[4].next)
    assert times(spool) == list(range(5, 12))
    spool.close()
    repeated = Spool(tmp_path, **SMALL)
    assert times(repeated) == list(range(5, 12))
    repeated.append(batch(12))
    assert times(repeated) == list(range(5, 13))
    repeated.acknowledge(list(repeated.waiting())[-1].next)
    assert times(repeated) == []
    assert len(list(tmp_path.glob("*.spool"))) == 1
    repeated.close()


def test_what_is_bad_keeps_its_reason(tmp_path: Path) -> None:
    """Values, quality and reasons, not only times."""
    spool = Spool(tmp_path)
    spool.append(batch(5))
    (item,) = spool.waiting()
    assert item.batch.reasons == ("", "", "no answer")
    assert item.batch.quality.tolist() == [0, 0, 3]
    spool.close()


def test_a_full_spool_drops_the_oldest_and_says_how_much(tmp_path: Path, caplog) -> None:
    """An error names the number of samples that were not stored; the count survives a restart."""
    spool = Spool(tmp_path, **SMALL)
    with caplog.at_level(logging.ERROR):
        for i in range(100):
            spool.append(batch(i))
    kept = times(spool)
    assert kept == list(range(kept[0], 100))
    assert spool.lost_samples == 3 * kept[0] > 0
    assert sum(path.stat().st_size for path in tmp_path.glob("*.spool")) <= SMALL["limit_bytes"]
    assert f"{spool.lost_samples} in all" in caplog.text
    assert "THE SPOOL IS FULL" in caplog.text
    spool.close()
    repeated = Spool(tmp_path, **SMALL)
    assert repeated.lost_samples == 3 * kept[0]
    repeated.close()


def test_what_the_store_has_is_not_counted_as_lost(tmp_path: Path) -> None:
    """Dropping what is acknowledged loses nothing."""
    spool = Spool(tmp_path, **SMALL)
    for i in range(100):
        spool.append(batch(i))
        spool.acknowledge(list(spool.waiting())[-1].next)
    assert spool.lost_samples == 0
    spool.close()


def test_damage_on_disk_is_reported_once_and_passed(tmp_path: Path, caplog) -> None:
    """The records around it come out; however often they are asked for, it is said once."""
    spool = Spool(tmp_path)
    for i in range(3):
        spool.append(batch(i))
    spool.close()
    (path,) = tmp_path.glob("*.spool")
    data = bytearray(path.read_bytes())
    data[data.index(MARK, 4) + 20] ^= 0xFF
    path.write_bytes(bytes(data))
    repeated = Spool(tmp_path)
    assert [times(repeated), times(repeated)] == [[0, 2], [0, 2]]
    assert caplog.text.count("are no record") == 1
    repeated.close()


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"segment": "x"}', b"\xff"])
def test_a_cursor_that_cannot_be_read_costs_nothing(tmp_path: Path, content: bytes) -> None:
    """Everything is offered again; the store takes nothing twice."""
    spool = Spool(tmp_path)
    spool.append(batch(1))
    spool.close()
    (tmp_path / "cursor").write_bytes(content)
    repeated = Spool(tmp_path)
    assert times(repeated) == [1]
    repeated.close()


def test_two_processes_do_not_share_a_spool(tmp_path: Path) -> None:
    """The second one is told why."""
    spool = Spool(tmp_path)
    with pytest.raises(SpoolError, match="no other service uses"):
        Spool(tmp_path)
    spool.close()
    Spool(tmp_path).close()


@pytest.mark.skipif(os.name == "nt", reason="file sizes are limited the POSIX way")
def test_a_disk_that_takes_no_more_spoils_nothing(tmp_path: Path, caplog) -> None:
    """What was accepted before comes out, half a record does not, and it goes on when it can."""
    import resource

    spool = Spool(tmp_path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    accepted = 0
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (2_000, hard))
        with contextlib.suppress(OSError):
            while accepted < 1000:
                spool.append(batch(accepted))
                accepted += 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert 0 < accepted < 1000
    spool.append(batch(accepted))
    assert times(spool) == list(range(accepted + 1))
    assert "are no record" not in caplog.text
    spool.close()


def test_a_limit_below_two_files_is_refused(tmp_path: Path) -> None:
    """The file that is written to is never dropped."""
    with pytest.raises(ValueError, match="two files"):
        Spool(tmp_path, limit_bytes=1_500, segment_bytes=1_000)


def test_batches_of_two_sources_are_not_joined() -> None:
    """A sample is known by its source."""
    assert len(joined([batch(1), batch(2)])) == 6
    with pytest.raises(ValueError, match="one source"):
        joined([batch(1), batch(2, source="other")])


WRITER = """
import sys
from pathlib import Path
from tests.service.collector.test_spool import batch
from stemwatch.service.collector import Spool
spool = Spool(Path(sys.argv[1]), segment_bytes=4000, limit_bytes=100_000_000)
number = 0
while True:
    spool.append(batch(number))
    print(number, flush=True)
    number += 1
"""


@pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")
def test_what_was_appended_survives_a_kill(tmp_path: Path) -> None:
    """SIGKILL in the middle of writing, three times: all that was reported is there, in order."""
    reported = []
    for round_ in range(3):
        process = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(tmp_path)],
            stdout=subprocess.PIPE,
            encoding="ascii",
            env=environment(),
        )
        lines = []
        for line in process.stdout:
            lines.append(int(line))
            if len(lines) == 50 + 20 * round_:
                process.send_signal(signal.SIGKILL)
                break
        lines += [int(line) for line in process.stdout if line.endswith("\n")]
        process.wait(timeout=20)
        process.stdout.close()
        reported.append(len(lines))
        time.sleep(0.01)
    spool = Spool(tmp_path, segment_bytes=4000, limit_bytes=100_000_000)
    result = times(spool)
    runs = [i for i, number in enumerate(result) if number == 0]
    assert len(runs) == 3
    for start, stop, count in zip(runs, [*runs[1:], len(result)], reported, strict=True):
        assert result[start:stop] == list(range(stop - start))
        assert stop - start >= count
    assert spool._read_cursor() == (Position(), 0)
    spool.close()
