"""The real recordings beside the checkout, read as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian import HistorianFile, find_sources, propose_valves
from stemwatch.models.recording import Quality, Recording, Role

pytestmark = pytest.mark.recordings


def only(path: Path) -> Recording:
    """The recording of the one valve that a file proposes."""
    source = HistorianFile(path)
    (valve,) = propose_valves(source)
    return source.read(valve)


@pytest.mark.long
def test_lists_and_notes_are_told_from_recordings(recordings: Path) -> None:
    """Labels and readme are skipped with a reason; everything else is taken."""
    sources = find_sources([recordings])
    assert {path.name for path, _ in sources.skipped} == {
        "labels.csv",
        "README.txt",
        "conditions.csv",
    }
    assert all(HistorianFile(path).inspect().tags for path in sources.paths)


def test_refinery_output_is_mv_by_description(recordings: Path) -> None:
    """All 42 loops propose their .MV as OP, none a position, and have an even clock."""
    files = sorted((recordings / "refinery").glob("*.txt"))
    assert len(files) == 42
    for path in files:
        recording = only(path)
        assert recording.op.tag.endswith(".MV")
        assert set(recording.signals) == {Role.OP, Role.PV, Role.SP, Role.MODE}
        slow = "LIC63001" in path.name
        assert (len(recording), recording.interval_s) == ((126, 60.0) if slow else (751, 10.0))


def test_refinery_code_in_a_value_slot(recordings: Path) -> None:
    """A PV of 3.5e-44 is a code throughout, and rows stamped early fill their instants."""
    for path in (recordings / "refinery").glob("RHT*.txt"):
        recording = only(path)
        pv = recording.signals[Role.PV]
        assert set(pv.quality.tolist()) <= {Quality.CODE, Quality.MISSING}
        assert recording.clock.repeated_times == 25
        assert int(recording.op.usable.sum()) == 750


def test_held_flags_of_the_refinery_files_are_counted(recordings: Path) -> None:
    """The two files of 2025 have 58 and 35 flagged values of OP."""
    held = [
        int((only(path).op.quality == Quality.HELD).sum())
        for path in sorted((recordings / "refinery").glob("*_2025*.txt"))
    ]
    assert held == [58, 35]


def test_uolab_uses_the_quick_columns(recordings: Path) -> None:
    """OP is the output block, PV the transmitter; the gaps of the joined files are gaps."""
    gaps = []
    for path in sorted((recordings / "uolab").glob("*.csv")):
        source = HistorianFile(path)
        for valve in propose_valves(source):
            if valve.valve in ("FIC-400B", "FIC-400C"):
                recording = source.read(valve)
                assert recording.op.tag == f"{valve.valve}/BLOCK1/OUT.CV"
                assert recording.signals[Role.PV].tag == valve.valve.replace("C-", "T-") + (
                    "/AI1/OUT.CV"
                )
                assert recording.start is not None
        gaps.append(recording.clock.longest_gap_s)
    assert gaps == [516.0, 471.0, 0.0, 0.0]


def test_uolab_scanned_copy_is_measured(recordings: Path) -> None:
    """The controller's own copy of OP turns out to be a scan of 10 s."""
    path = next((recordings / "uolab").glob("*400C_Obj1_Rep1.csv"))
    own = {t.tag: dict(t.facts).get("own_interval_s") for t in HistorianFile(path).tags()}
    assert own["FIC-400C/PID1/OUT.CV"] == 10.0
    assert own["FIC-400C/BLOCK1/OUT.CV"] is None


def test_damadics_rod_is_the_position(recordings: Path) -> None:
    """CV in percent beside X is the output, X the position."""
    recording = only(recordings / "damadics" / "lublin_actuator3_one_hour.csv")
    assert (recording.op.tag, len(recording)) == ("LC74_20CV_pct", 3600)
    assert recording.mv is not None
    assert (recording.mv.tag, recording.mv.unit) == ("LC74_20X_pct", "%")
    assert bool(recording.usable.all())


def test_isdb_loops_are_whole(recordings: Path) -> None:
    """Every row of every loop is on the clock, with the interval of the label file."""
    import csv

    with (recordings / "isdb" / "labels.csv").open() as file:
        loops = list(csv.DictReader(file))
    assert len(loops) == 19
    for loop in loops:
        path = recordings / "isdb" / loop["file"]
        recording = only(path)
        rows = sum(bool(line.strip()) for line in path.read_text().splitlines()) - 1
        assert (recording.valve, int(recording.op.usable.sum())) == (loop["loop"], rows)
        assert recording.interval_s == pytest.approx(float(loop["sampling_interval_s"]))


def test_dropouts_and_gaps_of_a_poor_archive_are_masked(recordings: Path) -> None:
    """Dropouts to zero are masked, the gap is a gap, and no sample off the grid is lost."""
    recording = only(recordings / "historian_faults" / "chill_tank_op_pv.csv")
    pv = recording.signals[Role.PV]
    dropped = np.flatnonzero(pv.quality == Quality.RANGE)
    assert dropped[:4].tolist() == [171, 172, 173, 174]
    assert dropped.size == 5
    assert recording.clock.longest_gap_s == 825.0
    assert int(recording.op.usable.sum()) == 2853


def test_a_record_without_times_takes_its_interval_from_ts(recordings: Path) -> None:
    """The interval stands in the first row's Ts; tags can be mapped by a person."""
    source = HistorianFile(recordings / "cascaded_tanks" / "dataBenchmark.csv")
    assert propose_valves(source) == []
    recording = source.read(ValveTags(valve="tank", tags={Role.OP: TagMapping(tag="uEst")}))
    assert (len(recording), recording.interval_s, recording.start) == (1024, 4.0, None)


def test_a_servo_record_has_a_5_ms_clock(recordings: Path) -> None:
    """A file with row numbers and times in float32 has a 5 ms clock."""
    source = HistorianFile(recordings / "emps" / "emps_estimation.csv")
    assert "" not in [tag.tag for tag in source.tags()]
    tags = {Role.OP: TagMapping(tag="u_in"), Role.MV: TagMapping(tag="q_meas")}
    recording = source.read(ValveTags(valve="slide", tags=tags))
    assert recording.interval_s == pytest.approx(0.005, rel=1e-6)
    assert (len(recording), int(recording.usable.sum())) == (4968, 4968)
