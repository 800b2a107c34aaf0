"""Every layout for which there is evidence, in small files of the same form."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from stemwatch.connectors.connector import (
    TagMapping,
    UnreadableSource,
    ValveTags,
)
from stemwatch.connectors.historian import HistorianFile, ReadOptions, propose_valves
from stemwatch.models.recording import Quality, Recording, Role


def mapped(op: str, **others: str) -> ValveTags:
    tags = {Role.OP: TagMapping(tag=op)}
    tags |= {Role(role): TagMapping(tag=tag) for role, tag in others.items()}
    return ValveTags(valve="V1", tags=tags)


def op_of(source: HistorianFile, op: str, **others: str) -> list[float]:
    return source.read(mapped(op, **others)).op.values.tolist()


def layout(source: HistorianFile) -> str:
    return source.inspect().layout


PROCESSDATA = (
    "PROCESSDATA\tFIC1 Data\tyyyy-MM-dd HH:mm:ss\r\n"
    "8\t10\t2024-06-09 07:50:00\t4\r\n"
    "tagname\tA#1.FIC1.MV\tA#1.FIC1.PV\tA#1.FIC1.SV\tA#1.FIC1.MODE"
    "\tbOpOFL\tbPvOFL\tbSpOFL\tbAutOFL\r\n"
    "desc\t回炼油_OP\t回炼油_PV\t回炼油_SP\tAut\tbOpOFL\tbPvOFL\tbSpOFL\tbAutOFL\r\n"
    "fsMax=1.3\tfsMin=0\tfsGridNum=10\tfdMax=1.3tfdMin=0\tfdGridNum=10\r\n"
    "2024-06-09 07:50:00\t25.57\t102.2\t102.5\t1\t0\t0\t0\t0\r\n"
    "2024-06-09 07:50:10\t25.58\t102.3\t102.5\t1\t1\t0\t0\t0\r\n"
    "2024-06-09 07:50:20\t25.59\t3.503246E-44\t102.5\t1\t0\t0\t0\t0\r\n"
    "2024-06-09 07:50:30\t25.60\t102.1\t102.5\t1\t0\t0\t1\t0\r\n"
)


def test_processdata_mv_is_the_controller_output(open_text) -> None:
    """In a PROCESSDATA export .MV is proposed as OP, by its description, and never as position."""
    (valve,) = propose_valves(open_text(PROCESSDATA, "x.txt"))
    assert valve.valve == "A#1.FIC1"
    assert {role: m.tag for role, m in valve.tags.items()} == {
        Role.OP: "A#1.FIC1.MV",
        Role.PV: "A#1.FIC1.PV",
        Role.SP: "A#1.FIC1.SV",
        Role.MODE: "A#1.FIC1.MODE",
    }


def test_processdata_flags_hold_their_own_column_only(open_text) -> None:
    """A flag marks its column's sample as held, and a denormal float is a code."""
    source = open_text(PROCESSDATA, "x.txt")
    recording = source.read(propose_valves(source)[0])
    assert recording.interval_s == 10.0
    assert recording.op.quality.tolist() == [0, Quality.HELD, 0, 0]
    assert recording.signals[Role.PV].quality.tolist() == [0, 0, Quality.CODE, 0]
    assert recording.signals[Role.SP].quality.tolist() == [0, 0, 0, Quality.HELD]
    assert recording.start is None
    assert recording.op.values.tolist() == [25.57, 25.58, 25.59, 25.6]


def test_processdata_cut_short_says_so(open_text) -> None:
    """Fewer rows than line 2 promises are a problem that the user is told."""
    source = open_text("\r\n".join(PROCESSDATA.split("\r\n")[:7]) + "\r\n", "x.txt")
    assert any("promises 4 rows, 2 were read" in text for text in source.inspect().problems)


def test_a_promise_of_rows_that_is_no_number_is_none(open_text) -> None:
    """A damaged count is not compared, and costs no row."""
    damaged = PROCESSDATA.replace("\t4\r\n", "\t²\r\n", 1)
    assert damaged != PROCESSDATA
    assert open_text(damaged, "x.txt").inspect().problems == ()
    rows = "".join(f"2026-01-05 06:00:{i:02d},{i}\n" for i in range(20))
    ignition = f"#NAMES\nt_stamp,A/OP\n#TYPES\ndate,D\n#ROWS,²\n{rows}"
    assert open_text(ignition).inspect().problems == ()


def test_processdata_without_tags_names_the_line(open_text) -> None:
    """A broken header names line 3 and what was expected there."""
    with pytest.raises(UnreadableSource, match="line 3: expected 'tagname'"):
        open_text("PROCESSDATA\tA\tB\nx\ny\nz\nw\n1\t2\n", "x.txt").tags()


DELTAV = (
    ",Timestamp,FIC-1/BLOCK1/OUT.CV %,FIC-1/PID1/OUT.CV %,FIC-1/PID1/PV.CV GPM,"
    "FIC-1/PID1/SP.CV GPM,FIT-1/AI1/OUT.CV gal/min,LIC-1/PID1/GAIN.CV No EngUnits,"
    "TE-1/AI1/OUT.CV Â°C\n"
    "7,2025-04-30 14:48:00-04:00,100,100,2.6,1.9,1.96,0.5,22.1\n"
    "8,2025-04-30 14:48:01-04:00,99,100,2.6,1.9,1.97,0.5,22.1\n"
    "9,2025-04-30 14:48:02-04:00,98,100,2.6,1.9,1.98,0.5,22.1\n"
)


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_deltav_header_carries_unit(open_text, mark: bytes) -> None:
    """Units come out of the header in one spelling, with or without byte order mark."""
    source = open_text(mark + DELTAV.encode())
    units = {tag.tag: tag.unit for tag in source.tags()}
    assert units["FIC-1/PID1/PV.CV"] == units["FIT-1/AI1/OUT.CV"] == "gal/min"
    assert units["TE-1/AI1/OUT.CV"] == "°C"
    assert units["LIC-1/PID1/GAIN.CV"] == ""


def test_deltav_prefers_the_block_over_the_controllers_copy(open_text) -> None:
    """OP is the output block's value and PV the transmitter's, not the PID block's copies."""
    source = open_text(DELTAV)
    (valve,) = propose_valves(source)
    assert valve.tags[Role.OP].tag == "FIC-1/BLOCK1/OUT.CV"
    assert valve.tags[Role.PV].tag == "FIT-1/AI1/OUT.CV"
    recording = source.read(valve)
    assert recording.start == datetime(2025, 4, 30, 18, 48, tzinfo=UTC)
    assert recording.op.values.tolist() == [100.0, 99.0, 98.0]


def test_deltav_tag_is_found_with_its_unit(open_text) -> None:
    """A user may copy the whole header, unit included."""
    assert op_of(open_text(DELTAV), "FIC-1/BLOCK1/OUT.CV %") == [100.0, 99.0, 98.0]


DATALINK = (
    "Tag,FIC1.OP,FIC1.PV,P1.RUN,\n"
    "Descriptor,Feed output,Feed flow,Pump running,\n"
    "Unit,%,kg/h,,\n"
    '2025-01-01 오전 12:00,50.1,"11,006.5",ON,\n'
    '2025-01-01 오전 12:01,50.2,"11,007.5",ON,\n'
    "Tag,FIC1.OP,FIC1.PV,P1.RUN,\n"
    "Descriptor,Feed output,Feed flow,Pump running,\n"
    "Unit,%,kg/h,,\n"
    "2025-01-01 오전 12:02,[-11059] No Good Data For Calculation,Bad,OFF,\n"
    '2025-01-01 오후 1:00,50.4,"1,009.5",Resize to show all values,\n'
)


def test_pi_datalink_korean_three_headers(open_text) -> None:
    """Korean times, three header rows that return, thousands marks and messages in cells."""
    source = open_text(DATALINK)
    recording = source.read(mapped("FIC1.OP", pv="FIC1.PV"))
    assert layout(source) == "PI DataLink sheet"
    assert len(recording) == 781
    assert recording.op.values[[0, 1, 780]].tolist() == [50.1, 50.2, 50.4]
    assert recording.op.quality[2] == Quality.BAD
    assert recording.signals[Role.PV].values[[0, 780]].tolist() == [11006.5, 1009.5]
    assert {t.tag: (t.unit, t.description) for t in source.tags()}["FIC1.PV"] == (
        "kg/h",
        "Feed flow",
    )


def test_resize_message_says_truncated(open_text) -> None:
    """'Resize to show all values' means that rows are missing, and the provenance says so."""
    recording = open_text(DATALINK).read(mapped("FIC1.OP", pv="P1.RUN"))
    assert any("record is truncated" in text for text in recording.provenance.decisions)


PROFICY = (
    "* exported by someone\n[Tags]\nTagname,Description\nFIC1.OP,Feed\n[Data]\n"
    "Tagname,TimeStamp,Value,DataQuality\n"
    "FIC1.OP,7/20/01 11:07,1.5,Good\nFIC1.OP,7/20/01 11:08,2.5,Good\n"
    "* a remark\nFIC1.OP,7/20/01 11:09,3.5,Bad\nFIC1.OP,7/20/01 11:10,4.5,Good\n"
)


def test_proficy_data_sections_are_read_and_others_skipped(open_text) -> None:
    """Comments and other sections are passed over; US dates; bad quality masks its sample."""
    recording = open_text(PROFICY, options=ReadOptions(zone="UTC")).read(mapped("FIC1.OP"))
    assert recording.start == datetime(2001, 7, 20, 11, 7, tzinfo=UTC)
    assert recording.op.quality.tolist() == [0, 0, Quality.BAD, 0]
    assert recording.op.values[[0, 1, 3]].tolist() == [1.5, 2.5, 4.5]


def test_proficy_without_data_section(open_text) -> None:
    """A Proficy file of tags alone names its sections and what to export."""
    with pytest.raises(UnreadableSource, match=r"no \[Data\] section"):
        open_text("[Tags]\nTagname,Description\nA,B\n").tags()


def test_a_proficy_extract_has_times_and_quality(open_text) -> None:
    """Epoch seconds and nanoseconds apart, GOOD and BAD as quality."""
    text = "".join(
        f"{1601890328 + i}:76000000,FIC1.OP,{40 + i},float,{'BAD' if i == 2 else 'GOOD'}\n"
        for i in range(5)
    )
    recording = open_text(text).read(mapped("FIC1.OP"))
    assert recording.start == datetime(2020, 10, 5, 9, 32, 8, 76000, tzinfo=UTC)
    assert recording.op.quality.tolist() == [0, 0, Quality.BAD, 0, 0]


def test_aveva_history_zero_is_good(open_text) -> None:
    """In the history table QualityDetail decides, and without it Quality 0 is good."""
    rows = [(0, 192, 78), (1, 24, 79), (0, 192, 80), (133, 64, 81)]
    text = "DateTime,TagName,Value,vValue,Quality,QualityDetail\n" + "".join(
        f'"2017-02-17 15:40:0{i}.0000000","T1.OP",{v},{v},{q},{d}\n'
        for i, (q, d, v) in enumerate(rows)
    )
    good = [0, Quality.BAD, 0, Quality.BAD]
    assert open_text(text).read(mapped("T1.OP")).op.quality.tolist() == good
    without = "\n".join(line.rpartition(",")[0] for line in text.splitlines())
    assert open_text(without, "b.csv").read(mapped("T1.OP")).op.quality.tolist() == good


def test_aveva_insight_any_order(open_text) -> None:
    """Columns in any order, optional ones missing, UTC milliseconds."""
    text = (
        "DateTime,Value,TagName,OpcQuality\n"
        "2019-05-16T00:13:37.661Z,50.1,R3.OP,192\n2019-05-16T00:13:38.661Z,50.2,R3.OP,0\n"
        "2019-05-16T00:13:39.661Z,50.3,R3.OP,216\n"
    )
    recording = open_text(text).read(mapped("R3.OP"))
    assert recording.start == datetime(2019, 5, 16, 0, 13, 37, 661000, tzinfo=UTC)
    assert recording.op.quality.tolist() == [0, Quality.BAD, 0]


@pytest.mark.parametrize(
    "text",
    [
        '#NAMES\n"t_stamp","FIC101/OP"\n#TYPES\n"date","D"\n#ROWS,2\n'
        '"2026-10-28 06:00:00","50.1"\n"2026-10-28 06:00:10","50.2"\n',
        "t_stamp,FIC101/OP\n2026-10-28 06:00:00,50.1\n2026-10-28 06:00:10,50.2\n",
    ],
    ids=["names", "plain"],
)
def test_both_forms_of_ignition_exports_are_read(open_text, text: str) -> None:
    """Both forms of Ignition's export, quoted and not."""
    source = open_text(text)
    assert op_of(source, "FIC101/OP") == [50.1, 50.2]
    assert propose_valves(source)[0].valve == "FIC101"
    assert layout(source).startswith("Ignition")


def test_annotated_influx_tables_of_one_file_are_read(open_text) -> None:
    """Annotations return before each table; the tag is measurement and field."""
    head = (
        "#group,false,false,true,true,false,false,true,true\r\n"
        "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string,"
        "string\r\n#default,_result,,,,,,,\r\n"
        ",result,table,_start,_stop,_time,_value,_field,_measurement\r\n"
    )
    rows = [
        "".join(
            f",,{k},2026-10-28T05:00:00Z,2026-10-28T06:00:00Z,2026-10-28T05:00:{10 * i:02d}Z,"
            f"{v + i},{name},FIC101\r\n"
            for i in range(3)
        )
        for k, (name, v) in enumerate((("OP", 50.5), ("PV", 7.25)))
    ]
    recording = open_text(head + rows[0] + "\r\n" + head + rows[1]).read(
        mapped("FIC101/OP", pv="FIC101/PV")
    )
    assert recording.op.values.tolist() == [50.5, 51.5, 52.5]
    assert recording.signals[Role.PV].values.tolist() == [7.25, 8.25, 9.25]
    assert recording.start == datetime(2026, 10, 28, 5, tzinfo=UTC)


def test_citect_adds_milliseconds(open_text) -> None:
    """The milliseconds of their own column are part of the time; NA and GATED are no values."""
    text = "Time,Milliseconds,P1.OP,P1.PV\n" + "".join(
        f'"15/06/2004 01:17:{25 + i // 10}",{100 * (i % 10)},{"GATED" if i == 3 else i},NA\n'
        for i in range(1, 20)
    )
    recording = open_text(text).read(mapped("P1.OP", pv="P1.PV"))
    assert recording.interval_s == pytest.approx(0.1)
    assert recording.op.quality[2] == Quality.BAD
    assert not np.isfinite(recording.signals[Role.PV].values).any()


def test_ip21_columns_and_status_words_are_read(open_text) -> None:
    """IP.21's columns, month names and status words."""
    text = "NAME,IP_TREND_TIME,IP_TREND_VALUE,IP_TREND_QSTATUS\n" + "".join(
        f"FC1.OP,28-OCT-26 06:00:0{i}.0,{i + 0.5},{'Bad' if i == 1 else 'Good'}\n" for i in range(4)
    )
    recording = open_text(text, options=ReadOptions(zone="UTC")).read(mapped("FC1.OP"))
    assert recording.start == datetime(2026, 10, 28, 6, tzinfo=UTC)
    assert recording.op.quality.tolist() == [0, Quality.BAD, 0, 0]


def test_german_excel_numbers_dates_and_status_are_read(open_text) -> None:
    """Semicolons, decimal comma with thousands points, day first, cp1252, a status column."""
    text = (
        "Zeitstempel;Zählerstand;Status\n28.10.2026 06:00:00;181,2;Good\n"
        "28.10.2026 06:00:10;1.181,2;Good\n28.10.2026 06:00:20;181,4;Bad\n"
    )
    source = open_text(text.encode("cp1252"))
    recording = source.read(mapped("Zählerstand"))
    assert recording.op.values[:2].tolist() == [181.2, 1181.2]
    assert recording.op.quality.tolist() == [0, 0, Quality.BAD]
    assert (source.inspect().encoding, source.inspect().decimal) == ("cp1252", ",")


PREAMBLE = "Plant export\nInterval,10\n\nTime,FIC1.OP,FIC1.ZT,FIC1.PV\n,%,%,t/h\n"


def test_generic_wide_with_preamble_and_units(open_text) -> None:
    """Preamble rows, a row of units, a position by its word ZT."""
    text = PREAMBLE + "".join(f"2026-01-05 06:00:{i:02d},{i}.5,{i}.25,{i}.75\n" for i in range(20))
    source = open_text(text)
    (valve,) = propose_valves(source)
    assert valve.tags[Role.MV] == TagMapping(tag="FIC1.ZT", unit="%")
    recording = source.read(valve)
    assert recording.op.values.tolist() == [i + 0.5 for i in range(20)]
    assert recording.signals[Role.PV].unit == "t/h"


def test_generic_narrow_holds_slower_tags(open_text) -> None:
    """A tag slower than OP is held at its own rate, and no longer than a few of its intervals."""
    rows = [f"FIC1.OP,2026-01-05T06:00:{i:02d}Z,{50 + i}\n" for i in range(60)]
    rows += [f"FIC1.PV,2026-01-05T06:00:{i:02d}Z,{i}\n" for i in range(0, 30, 5)]
    recording = open_text("Tag,Time,Value\n" + "".join(rows)).read(mapped("FIC1.OP", pv="FIC1.PV"))
    pv = recording.signals[Role.PV]
    assert recording.interval_s == 1.0
    assert pv.values[:10].tolist() == [0.0] * 5 + [5.0] * 5
    assert pv.quality[:30].tolist() == [0] * 30
    assert set(pv.quality[33:46].tolist()) == {Quality.HELD}
    assert set(pv.quality[46:].tolist()) == {Quality.MISSING}


def test_date_and_clock_in_two_columns(open_text) -> None:
    """Date and time of day in two columns are one time."""
    text = "Date;Time;A.OP\n" + "".join(f"13.01.2026;06:00:{i:02d};{i},5\n" for i in range(5))
    recording = open_text(text, options=ReadOptions(zone="UTC")).read(mapped("A.OP"))
    assert recording.start == datetime(2026, 1, 13, 6, tzinfo=UTC)
    assert recording.op.values.tolist() == [0.5, 1.5, 2.5, 3.5, 4.5]


def test_quality_columns_beside_wide_tags(open_text) -> None:
    """A status column belongs to the tag whose name it carries, or to the one before it."""
    text = "Time,A.OP,A.PV,A.OP_Status,Status\n" + "".join(
        f"2026-01-13T06:00:{i:02d}Z,{i},{i},{'Bad' if i == 1 else 'Good'},Good\n" for i in range(4)
    )
    source = open_text(text)
    assert [tag.tag for tag in source.tags()] == ["A.OP", "A.PV"]
    assert source.read(mapped("A.OP")).op.quality.tolist() == [0, Quality.BAD, 0, 0]


def test_plain_columns_are_named_after_the_file(open_text) -> None:
    """t_s, SP, PV, OP: relative seconds, no date, the valve called like the file."""
    source = open_text("t_s,SP,PV,OP\n0,1,2,3\n0.5,1,2,4\n1.0,1,2,5\n", "CHEM99.csv")
    (valve,) = propose_valves(source)
    recording = source.read(valve)
    assert (valve.valve, recording.interval_s, recording.start) == ("CHEM99", 0.5, None)


@pytest.mark.parametrize("scale", [1, 1000, 1_000_000, 1_000_000_000])
def test_epoch_times_in_any_unit_are_utc(open_text, scale: int) -> None:
    """Unix times in seconds, milliseconds, microseconds and nanoseconds are UTC."""
    text = "timestamp,OP\n" + "".join(f"{(1700000000 + i) * scale},{i}\n" for i in range(5))
    recording = open_text(text).read(mapped("OP"))
    assert recording.start == datetime(2023, 11, 14, 22, 13, 20, tzinfo=UTC)
    assert recording.interval_s == 1.0


def test_no_time_column_needs_an_interval(open_text) -> None:
    """Rows without time are read with the interval of Ts or of the options, else refused."""
    body = "1.5,2.5\n1.6,2.6\n1.7,2.7\n"
    with_ts = '"uEst","yEst","Ts",\n1.5,2.5,4,\n1.6,2.6,,\n1.7,2.7,,\n'
    assert open_text(with_ts).read(mapped("uEst")).interval_s == 4.0
    result = open_text("u,y\n" + body, "b.csv", ReadOptions(interval_s=2.0))
    assert result.read(mapped("u")).interval_s == 2.0
    with pytest.raises(UnreadableSource, match="no time column and nothing tells the interval"):
        open_text("u,y\n" + body, "c.csv").tags()


def _of_eight_tags(header: str, rest: str) -> str:
    """Rows of eight tags each second, ``rest`` after time and value."""
    rows = (
        f"F{tag}.OP;07.09.2025 12:{i // 60:02d}:{i % 60:02d};{tag},{i:03d};{rest}\n"
        for i in range(90)
        for tag in range(8)
    )
    return header + "\n" + "".join(rows)


@pytest.mark.parametrize(
    "header", ["VarName;TimeString;VarValue;Validity;Time_ms", "Messpunkt;Zeit;Wert;Gut;Lauf"]
)
def test_tags_below_each_other_with_further_columns_of_numbers(open_text, header: str) -> None:
    """WinCC's archive, and a heading of tags that nobody knows: rows of one time are samples of
    different tags, not of one whose times were cut."""
    source = open_text(_of_eight_tags(header, "1;45907,5"), "wincc.csv")
    assert [tag.tag for tag in source.tags()] == [f"F{i}.OP" for i in range(8)]
    recording = source.read(mapped("F3.OP"))
    assert (recording.interval_s, len(recording)) == (1.0, 90)


def test_one_of_several_columns_of_values_is_asked_for(open_text) -> None:
    """No heading says which column holds the value of the tag: its name is asked for."""
    text = _of_eight_tags("Messpunkt;Zeit;A;B;C", "1;45907,5")
    with pytest.raises(UnreadableSource, match="'Messpunkt', and its value may be in 'A'"):
        open_text(text).tags()
    source = open_text(text, options=ReadOptions(value_column="A"))
    assert source.read(mapped("F3.OP")).op.values[1] == pytest.approx(3.001)


def test_a_list_of_labels_is_no_recording(open_text) -> None:
    """A table of words is refused with a reason that says what it seems to be."""
    text = "file,tag,label,index\n" + "".join(f"f{i}.txt,T{i},stiction,0.{i}\n" for i in range(9))
    with pytest.raises(UnreadableSource, match="probably not a recording"):
        open_text(text).tags()


def test_every_recording_knows_its_layout(open_text) -> None:
    """Provenance carries the digest, the layout and the decisions."""
    recording: Recording = open_text(DELTAV).read(mapped("FIC-1/BLOCK1/OUT.CV"))
    assert len(recording.provenance.digest) == 64
    assert recording.provenance.layout.startswith("DeltaV-like")
    assert "The separator is ','." in recording.provenance.decisions
