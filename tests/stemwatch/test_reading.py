"""What a notebook hands over becomes a recording by the rules of every connector, or a sentence."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import stemwatch as sw
from stemwatch.connectors.connector import (
    Connector,
    ConnectorError,
    MappingNeeded,
    TagMapping,
    UnknownTag,
    ValveTags,
    Window,
)
from stemwatch.dataframe import DataFrameSource
from stemwatch.models.recording import Quality, Recording, Role

SAMPLES = 600
OP = 50.0 + 10.0 * np.sin(np.arange(SAMPLES) / 40.0)
MV = np.roll(OP, 3)
TIMES = pd.date_range("2026-03-02 06:00", periods=SAMPLES, freq="s", tz="UTC")


@pytest.fixture
def frame() -> pd.DataFrame:
    """A loop as a historian's client gives it."""
    columns = {"FIC101.OP": OP, "ZT101": MV, "FIC101.PV": OP / 2, "FIC101.SP": 25.0}
    return pd.DataFrame(columns, index=TIMES)


def test_columns_are_taken_by_name(frame: pd.DataFrame) -> None:
    """OP and MV are the columns that were named, bit for bit, on the frame's own clock."""
    recording = sw.read(frame, op="FIC101.OP", mv="ZT101", pv="FIC101.PV")
    assert ("FIC101", 1.0, TIMES[0]) == (recording.valve, recording.interval_s, recording.start)
    assert [Role.OP, Role.MV, Role.PV] == list(recording.signals)
    np.testing.assert_array_equal(OP, recording.op.values)
    assert recording.mv is not None
    np.testing.assert_array_equal(MV, recording.mv.values)


def test_a_frame_is_read_as_the_same_samples_in_a_file(frame: pd.DataFrame, tmp_path: Path) -> None:
    """Holes, NaN, a repeated time and an uneven clock are dealt with as in a CSV export."""
    uneven = frame.drop(frame.index[[5, 6, 200]])
    uneven = pd.concat([uneven, uneven.iloc[[300]]]).sort_index()
    uneven.iloc[40:44, 0] = np.nan
    uneven.index = uneven.index + pd.to_timedelta(np.arange(len(uneven)) % 3 * 0.1, unit="s")
    path = tmp_path / "export.csv"
    uneven.to_csv(path, index_label="Time", date_format="%Y-%m-%dT%H:%M:%S.%f%z")
    of_file = sw.read(path, op="FIC101.OP", mv="ZT101", valve="FIC101")
    of_frame = sw.read(uneven, op="FIC101.OP", mv="ZT101")
    assert (of_file.interval_s, of_file.start) == (of_frame.interval_s, of_frame.start)
    for role, signal in of_file.signals.items():
        np.testing.assert_array_equal(signal.values, of_frame.signals[role].values)
        np.testing.assert_array_equal(signal.quality, of_frame.signals[role].quality)
    assert of_file.clock.gaps == of_frame.clock.gaps > 0
    assert of_file.clock.repeated_times == of_frame.clock.repeated_times


def test_nan_is_missing_and_nothing_is_interpolated(frame: pd.DataFrame) -> None:
    """A hole in the frame is a hole in the recording."""
    frame.iloc[10:15, 1] = np.nan
    recording = sw.read(frame, op="FIC101.OP", mv="ZT101")
    assert recording.mv is not None
    assert [Quality.MISSING] * 5 == list(recording.mv.quality[10:15])
    assert np.isnan(recording.mv.values[10:15]).all()
    assert recording.usable.sum() == SAMPLES - 5


def test_words_in_a_column_are_understood_as_in_a_file(frame: pd.DataFrame) -> None:
    """A status word is a bad sample, not an error."""
    mixed: Any = frame["ZT101"].astype(object)
    mixed.iloc[7] = "Bad Input"
    frame["ZT101"] = mixed
    frame["mode"] = "AUTO"
    recording = sw.read(frame, op="FIC101.OP", mv="ZT101", mode="mode")
    assert recording.mv is not None
    assert Quality.BAD == recording.mv.quality[7]
    assert set(recording.signals[Role.MODE].values) == {1.0}


@pytest.mark.parametrize(
    "columns",
    [{"op": OP, "mv": MV}, {"FIC101.OP": OP, "FIC101.ZT": MV}],
    ids=["called as the arguments", "by their names"],
)
def test_columns_that_leave_no_doubt_need_no_names(columns: dict[str, Any]) -> None:
    """A frame with one valve whose columns say what they are is read as it is."""
    recording = sw.read(pd.DataFrame(columns, index=TIMES))
    assert {Role.OP, Role.MV} == set(recording.signals)


def test_arrays_need_an_interval_and_bear_no_date() -> None:
    """NumPy arrays, lists and Series without times lie ``interval_s`` apart."""
    for op, mv in ((OP, MV), (list(OP), list(MV)), (pd.Series(OP), pd.Series(MV))):
        recording = sw.read(op=op, mv=mv, interval_s=0.5, valve="FIC-101")
        assert ("FIC-101", 0.5, None) == (recording.valve, recording.interval_s, recording.start)
        np.testing.assert_array_equal(OP, recording.op.values)


def test_series_with_times_bring_their_clock() -> None:
    """Series are laid side by side by their times, arrays beside them by their place."""
    later = pd.Series(MV[10:], index=TIMES[10:])
    recording = sw.read(op=pd.Series(OP, index=TIMES), mv=later)
    assert recording.mv is not None
    assert np.isnan(recording.mv.values[:10]).all()
    np.testing.assert_array_equal(MV[10:], recording.mv.values[10:])
    beside = sw.read(op=pd.Series(OP, index=TIMES), mv=MV)
    assert TIMES[0] == beside.start


def test_ranges_turn_other_values_into_percent() -> None:
    """4 to 20 mA and a fraction become percent of span because it was said."""
    ranges = {"op": (4.0, 20.0), "mv": (0.0, 1.0)}
    recording = sw.read(op=4 + 0.16 * OP, mv=MV / 100, interval_s=1.0, ranges=ranges)
    assert recording.mv is not None
    np.testing.assert_allclose(recording.op.values, OP)
    np.testing.assert_allclose(recording.mv.values, MV)


def test_what_looks_like_a_fraction_is_told_and_not_converted() -> None:
    """Nothing is guessed: values between 0 and 1 stay, and a warning says what to say."""
    with pytest.warns(UserWarning, match=r"say ranges=\{'op': \(0, 1\)\}, if it is percent"):
        recording = sw.read(op=OP / 100, interval_s=1.0)
    np.testing.assert_array_equal(OP / 100, recording.op.values)


def test_local_times_need_a_zone_for_a_date(frame: pd.DataFrame) -> None:
    """Without a zone the date is not known; with one it is, through the hour that is skipped."""
    frame.index = TIMES.tz_localize(None)
    assert sw.read(frame, op="FIC101.OP").start is None
    dated = sw.read(frame, op="FIC101.OP", zone="Europe/Berlin")
    assert datetime(2026, 3, 2, 5, tzinfo=UTC) == dated.start


def test_a_window_is_cut(frame: pd.DataFrame) -> None:
    """``start`` is the first instant, ``stop`` the one before which it ends."""
    start, stop = TIMES[100].to_pydatetime(), TIMES[160].to_pydatetime()
    recording = sw.read(frame, op="FIC101.OP", start=start, stop=stop)
    assert (start, 60) == (recording.start, len(recording))
    local = sw.read(frame, op="FIC101.OP", start=datetime(2026, 3, 2, 7, 5), zone="Europe/Berlin")
    assert TIMES[300] == local.start


@pytest.mark.parametrize("index", ["timedelta", "period"])
def test_other_indices_with_times_are_understood(index: str) -> None:
    """Durations since a start, and periods."""
    created: Any = pd.to_timedelta(np.arange(SAMPLES), unit="s")
    if index == "period":
        created = pd.period_range("2026-03-02 06:00", periods=SAMPLES, freq="s")
    recording = sw.read(pd.DataFrame({"op": OP}, index=created))
    assert (SAMPLES, 1.0, None) == (len(recording), recording.interval_s, recording.start)


def test_a_file_with_several_valves_is_asked_for_one(frame: pd.DataFrame, tmp_path: Path) -> None:
    """The names are listed; with one of them the recording comes."""
    other = frame.rename(columns=lambda name: name.replace("101", "102"))
    both = frame.join(other)
    both.to_csv(tmp_path / "export.csv", index_label="Time")
    with pytest.raises(MappingNeeded, match=r"holds 2 valves \('FIC101', 'FIC102'\); say which"):
        sw.read(tmp_path / "export.csv")
    assert "FIC102" == sw.read(tmp_path / "export.csv", valve="FIC102").valve
    with pytest.raises(MappingNeeded, match=r"no valve 'FIC10' among 2 \(did you mean 'FIC10[12]'"):
        sw.read(tmp_path / "export.csv", valve="FIC10")
    with pytest.raises(MappingNeeded, match="DataFrame: holds 2 valves"):
        sw.read(both)
    assert "FIC102" == sw.read(both, valve="FIC102").valve


def test_a_named_valve_of_a_path_is_the_only_one_screened(
    frame: pd.DataFrame, tmp_path: Path
) -> None:
    """As ``read`` does; a name that no valve has is an error, and not all of them."""
    path = tmp_path / "export.csv"
    other = frame.rename(columns=lambda name: name.replace("101", "102"))
    frame.join(other).to_csv(path, index_label="Time")
    bare = {"narx": False, "mismatch": False}
    assert [one.valve for one in sw.screen(path, valve="FIC102", **bare)] == ["FIC102"]
    for call in (sw.screen, sw.explain):
        with pytest.raises(MappingNeeded, match=r"no valve 'FIC999' among 2"):
            call(path, valve="FIC999", narx=False)


def test_pv_and_set_point_are_read_like_op_and_mv() -> None:
    """A recording has all four by name; those that were not recorded are None."""
    loop = sw.simulate(minutes=1)
    assert loop.pv is loop.signals[Role.PV]
    assert loop.sp is loop.signals[Role.SP]
    bare = sw.read(op=OP, interval_s=1.0)
    assert (bare.mv, bare.pv, bare.sp) == (None, None, None)


def test_a_file_is_written_as_the_options_say(frame: pd.DataFrame, tmp_path: Path) -> None:
    """Options of reading reach the reader; one that does not exist is named with the nearest."""
    frame.to_csv(tmp_path / "e.csv", sep=";", decimal=",", index_label="Zeit")
    recording = sw.read(tmp_path / "e.csv", op="FIC101.OP", separator=";", decimal=",")
    np.testing.assert_allclose(recording.op.values, OP)
    wrong: Any = {"seperator": ";"}
    with pytest.raises(TypeError, match=r"'seperator' is no option .*did you mean 'separator'"):
        sw.read(tmp_path / "e.csv", op="FIC101.OP", **wrong)


def test_a_recording_is_taken_as_it_is(frame: pd.DataFrame) -> None:
    """What was read once is not read again."""
    recording = sw.read(frame, op="FIC101.OP")
    assert sw.read(recording) is recording
    with pytest.raises(ValueError, match="a Recording has its signals and its clock"):
        sw.read(recording, op="FIC101.OP")


def _shifted(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.reset_index(drop=True)


ERRORS: list[tuple[str, Callable[[pd.DataFrame], object], type[Exception], str]] = [
    (
        "column not there",
        lambda frame: sw.read(frame, op="FIC101.OUT"),
        UnknownTag,
        r"no tag 'FIC101.OUT' among 4; the nearest are 'FIC101.OP'",
    ),
    (
        "index without times",
        lambda frame: sw.read(_shifted(frame), op="FIC101.OP"),
        ConnectorError,
        r"no times \(it is a RangeIndex of 600 rows\).*Say interval_s",
    ),
    (
        "times in a column",
        lambda frame: sw.read(frame.reset_index(names="Time"), op="FIC101.OP"),
        ConnectorError,
        r"Column 'Time' holds times: hand over frame.set_index\('Time'\)",
    ),
    (
        "times as texts",
        lambda frame: sw.read(frame.set_axis(frame.index.astype(str)), op="FIC101.OP"),
        ConnectorError,
        r"frame.index = pandas.to_datetime\(frame.index\)",
    ),
    (
        "times and an interval",
        lambda frame: sw.read(frame, op="FIC101.OP", interval_s=1.0),
        ValueError,
        r"interval_s=1 was given, but the index holds times",
    ),
    (
        "no names that tell",
        lambda frame: sw.read(frame.set_axis(list("abcd"), axis="columns")),
        MappingNeeded,
        r"Say op= .*; the columns are 'a', 'b', 'c', 'd'",
    ),
    (
        "one column for both",
        lambda frame: sw.read(frame, op="ZT101", mv="ZT101"),
        ConnectorError,
        "'ZT101' is given for both OP and MV",
    ),
    (
        "no op",
        lambda frame: sw.read(frame, mv="ZT101"),
        ValueError,
        "mv given without op",
    ),
    (
        "two columns of one name",
        lambda frame: sw.read(frame.set_axis(["a", "b", "a", "c"], axis="columns"), op="a"),
        ValueError,
        r"a name of its own; twice: \['a'\]",
    ),
    (
        "arrays without interval",
        lambda _: sw.read(op=OP, mv=MV),
        ValueError,
        "arrays bear no times; say interval_s=",
    ),
    (
        "arrays of two lengths",
        lambda _: sw.read(op=OP, mv=MV[1:], interval_s=1.0),
        ValueError,
        r"arrays of one length expected, received \{'op': 600, 'mv': 599\}",
    ),
    (
        "a table for a signal",
        lambda _: sw.read(op=np.ones((5, 2)), interval_s=1.0),
        ValueError,
        r"op: expected one number for each sample, shape \(n,\); received shape \(5, 2\)",
    ),
    (
        "words for a signal",
        lambda _: sw.read(op=["open", "shut"], interval_s=1.0),
        TypeError,
        "op is a list; expected numbers",
    ),
    (
        "times that repeat",
        lambda _: sw.read(op=pd.Series(OP, TIMES), mv=pd.Series(1.0, TIMES[[0, 0, 1]])),
        ValueError,
        "mv: its times repeat, so that it cannot be laid beside the others",
    ),
    (
        "an array beside a frame",
        lambda frame: sw.read(frame, op=OP),
        ValueError,
        "op: beside a DataFrame expected the name of a column",
    ),
    (
        "a name without a frame",
        lambda _: sw.read(op="FIC101.OP"),
        ValueError,
        "op='FIC101.OP' names a column or a tag, but no frame and no file was given",
    ),
    ("nothing", lambda _: sw.read(), TypeError, "received nothing; expected a pandas DataFrame"),
    (
        "something else",
        lambda _: sw.read(OP),  # type: ignore[arg-type]
        TypeError,
        r"received a numpy.ndarray of shape \(600,\); expected a pandas DataFrame",
    ),
    (
        "a range that is none",
        lambda frame: sw.read(frame, op="FIC101.OP", ranges={"op": (4.0,)}),  # type: ignore[dict-item]
        ValueError,
        r"ranges\['op'\] is \(4.0,\); expected the values at 0 % and at 100 %",
    ),
    (
        "a range of nothing",
        lambda frame: sw.read(frame, op="FIC101.OP", ranges={"OP": (4.0, 20.0)}),
        ValueError,
        "ranges: 'OP' is no signal; expected some of",
    ),
    (
        "a naive window",
        lambda frame: sw.read(frame, op="FIC101.OP", start=datetime(2026, 3, 2, 6)),
        ValueError,
        "start=2026-03-02 06:00:00 has no zone",
    ),
    (
        "a window in no form of time",
        lambda frame: sw.read(frame, op="FIC101.OP", start="2.3.2026"),
        ValueError,
        "start='2.3.2026' is no time; expected ISO text such as '2026-03-02 06:00'",
    ),
    (
        "a list where one valve is read",
        lambda frame: sw.read([frame]),  # type: ignore[arg-type]
        TypeError,
        "received a list of several, and a Recording is of one valve; read each of them, or hand",
    ),
    (
        "an empty window",
        lambda frame: sw.read(frame, op="FIC101.OP", start=datetime(2027, 1, 1, tzinfo=UTC)),
        ConnectorError,
        "no samples between 2027-01-01 .* the frame covers 2026-03-02",
    ),
    (
        "a file that is not there",
        lambda _: sw.read("no/such/file.csv", op="OP"),
        ConnectorError,
        "no/such/file.csv",
    ),
]


@pytest.mark.parametrize(
    ("call", "kind", "says"),
    [case[1:] for case in ERRORS],
    ids=[case[0] for case in ERRORS],
)
def test_an_error_says_what_was_found_and_what_was_expected(
    call: Callable[[pd.DataFrame], object], kind: type[Exception], says: str, frame: pd.DataFrame
) -> None:
    """Each with the cure."""
    with pytest.raises(kind, match=says):
        call(frame)


def test_a_frame_in_memory_keeps_the_contract_of_every_connector(frame: pd.DataFrame) -> None:
    """It lists its tags with proposed roles, and returns only samples inside the window."""
    source = DataFrameSource(frame)
    assert isinstance(source, Connector)
    roles = {info.tag: info.proposed_role for info in source.tags()}
    assert {
        "FIC101.OP": Role.OP, "ZT101": Role.MV, "FIC101.PV": Role.PV, "FIC101.SP": Role.SP
    } == roles  # fmt: skip
    valve = ValveTags(valve="FIC101", tags={Role.OP: TagMapping(tag="fic101.op")})
    window = Window(start=TIMES[60].to_pydatetime(), stop=TIMES[120].to_pydatetime())
    recording = source.read(valve, window)
    assert isinstance(recording, Recording)
    assert (TIMES[60], TIMES[120]) == (recording.start, recording.end)
    with pytest.raises(UnknownTag, match="nearest"):
        source.read(ValveTags(valve="x", tags={Role.OP: TagMapping(tag="LIC9.OP")}))
    before = frame.copy()
    source.read(valve)
    pd.testing.assert_frame_equal(before, frame)


def test_a_window_is_given_as_iso_text_too(frame: pd.DataFrame) -> None:
    """With an offset as it stands, without one in the zone of the call."""
    start = datetime(2026, 3, 2, 6, 2, tzinfo=UTC)
    aware = sw.read(frame, op="FIC101.OP", start=start)
    text = sw.read(frame, op="FIC101.OP", start="2026-03-02T06:02+00:00")
    local = sw.read(frame, op="FIC101.OP", zone="Europe/Berlin", start="2026-03-02 07:02")
    assert aware.start == text.start == local.start == start
