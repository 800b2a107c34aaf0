"""Cells: decimal marks, status words, codes, dropouts, encodings, bad rows."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from stemwatch.connectors.connector import (
    ConnectorError,
    TagMapping,
    UnknownTag,
    UnreadableSource,
    ValveTags,
)
from stemwatch.connectors.historian import ReadOptions
from stemwatch.connectors.historian.values.numbers import parse_number
from stemwatch.models.recording import Quality, Recording, Role

OP = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="OP")})


def column(cells: list[str], separator: str = ";") -> str:
    rows = "".join(f"{i}{separator}{cell}\n" for i, cell in enumerate(cells))
    return f"t_s{separator}OP\n{rows}"


def said(recording: Recording) -> str:
    return " ".join(recording.provenance.decisions)


@pytest.mark.parametrize(
    ("text", "decimal", "expected"),
    [
        ("1.5", ".", 1.5),
        ("-1.5e-3", ".", -0.0015),
        ("11,006.5", ".", 11006.5),
        ("1,181", ".", 1181.0),
        ("1.181,2", ",", 1181.2),
        ("1 181,2", ",", 1181.2),
        ("1\u00a0181,2", ",", 1181.2),
        ("1'181.2", ".", 1181.2),
        (".5", ".", 0.5),
        ("\u22125", ".", -5.0),
        ("50.1 %", ".", 50.1),
        ("1.5", ",", None),
        ("1_000", ".", None),
        ("١٢", ".", None),
        ("１２", ".", None),
        ("=1+1", ".", None),
        ("0x10", ".", None),
        ("inf", ".", None),
        ("nan", ".", None),
        ("1,2,3", ".", None),
        ("12,34.5", ".", None),
        ("", ".", None),
    ],
)
def test_only_plain_decimal_numbers_are_numbers(
    text: str, decimal: str, expected: float | None
) -> None:
    """Plain decimal numbers, with thousands marks in threes; nothing that only looks like one."""
    assert parse_number(text, decimal) == expected


def test_one_bad_cell_does_not_decide_for_its_column(open_text) -> None:
    """A status word among decimal commas is bad by itself; the others are numbers."""
    recording = open_text(column(["1,5", "Bad", "1.181,2", "2,5"])).read(OP)
    assert recording.op.values[[0, 2, 3]].tolist() == [1.5, 1181.2, 2.5]
    assert recording.op.quality.tolist() == [0, Quality.BAD, 0, 0]
    assert "'Bad' 1" in said(recording)


@pytest.mark.parametrize("word", ["I/O Timeout", "#VALUE!", "ON", "[-11059] No Good Data", "GATED"])
def test_status_words_are_bad(open_text, word: str) -> None:
    """Status words are bad quality, never numbers."""
    assert open_text(column(["1", "2", word, "4"])).read(OP).op.quality[2] == Quality.BAD


@pytest.mark.parametrize("word", ["", "NaN", "null", "NA", "---"])
def test_empty_words_are_missing(open_text, word: str) -> None:
    """Cells that say nothing are missing samples."""
    assert open_text(column(["1", "2", word, "4"])).read(OP).op.quality[2] == Quality.MISSING


def test_a_cell_with_a_lost_byte_is_no_number(open_text) -> None:
    """12, a lost byte, 977 is not 12977: the cell is bad and its line is named."""
    recording = open_text(column(["1", "12\x00977", "\x003", "4\x00", "5"])).read(OP)
    bad = Quality.BAD
    assert recording.op.quality.tolist() == [0, bad, bad, bad, 0]
    assert "line 3: a cell that lost bytes; it is unreadable" in said(recording)


def test_a_line_of_lost_bytes_is_blank(open_text) -> None:
    """A block of NULs that a power cut left between two lines costs no row beside it."""
    text = column(["1", "2", "3", "4"]).replace("2;3", "\0" * 400 + "\n2;3")
    recording = open_text(text).read(OP)
    assert recording.op.values.tolist() == [1, 2, 3, 4]
    assert "line 4: only lost bytes" in said(recording)


@pytest.mark.parametrize("cell", ["41 435", "41\u00a0435", "41'435", "41 435 %", "41,435"])
@pytest.mark.parametrize("times", [1, 2])
def test_a_lone_mark_for_thousands_is_not_believed(open_text, cell: str, times: int) -> None:
    """41 435 among numbers such as 41.2 may be 41.435 or two numbers: bad, with its line."""
    cells = [f"{41 + i / 100:.2f}" for i in range(40)]
    for i in range(times):
        cells[7 + i] = cell
    recording = open_text(column(cells)).read(OP)
    assert recording.op.quality[7] == Quality.BAD
    assert f"OP: line 9: {cell!r} is left out" in said(recording)
    assert np.isfinite(recording.op.values).sum() == 40 - times


def test_a_habit_of_marks_for_thousands_is_believed(open_text) -> None:
    """Where the column writes its thousands so, or goes up to them, they are numbers."""
    mixed = [f"{900 + 10 * i}" if i < 10 else f"1 {10 * (i - 10):03d}" for i in range(20)]
    assert open_text(column(mixed)).read(OP).op.values.tolist() == [900 + 10 * i for i in range(20)]
    rare = ["998.5"] * 60 + ["1 000.5", "1 001.5"]
    assert open_text(column(rare)).read(OP).op.values[-2:].tolist() == [1000.5, 1001.5]


def test_marks_for_thousands_beside_plain_ten_thousands_are_not_believed(open_text) -> None:
    """A column that writes 41434 does not write 41 435."""
    recording = open_text(column(["41434", "41 435", "41 436", "41437"])).read(OP)
    assert recording.op.quality.tolist() == [0, Quality.BAD, Quality.BAD, 0]


def test_an_undecidable_decimal_mark_is_refused(open_text) -> None:
    """1,234 alone between tabs is not guessed."""
    text = column(["1,234", "2,345"], "\t")
    with pytest.raises(UnreadableSource, match=r"say decimal=',' or decimal='\.'"):
        open_text(text).tags()
    assert open_text(text, options=ReadOptions(decimal=",")).read(OP).op.values[0] == 1.234


def test_pi_states_far_outside_the_range_are_codes(open_text) -> None:
    """246 among 40 to 60 is a system state; among 180 to 300 it is a value."""
    low = [f"{40 + i % 20}.5" for i in range(40)]
    low[7] = "246"
    recording = open_text(column(low)).read(OP)
    assert recording.op.quality[7] == Quality.CODE
    assert "OP: 1 sample left out (246): as PI system states are numbered" in said(recording)
    high = [f"{180 + 3 * i}.5" for i in range(40)]
    high[7] = "246"
    assert open_text(column(high), "b.csv").read(OP).op.quality[7] == Quality.GOOD


def test_isolated_zeros_far_from_the_values_are_dropouts(open_text) -> None:
    """Isolated zeros between tight values far away are dropouts; a level at 0 is not."""
    rng = np.random.default_rng(1)
    values = 12 + 0.01 * rng.integers(-6, 7, 400)
    cells = [f"{v:.2f}" for v in values]
    cells[50:54] = ["0.00"] * 4
    recording = open_text(column(cells)).read(OP)
    assert np.flatnonzero(recording.op.quality == Quality.RANGE).tolist() == [50, 51, 52, 53]
    assert "OP: 4 samples left out (0): exactly 0 for a moment" in said(recording)
    steps = [f"{max(0, 8 - i % 12)}" for i in range(400)]
    assert open_text(column(steps), "b.csv").read(OP).op.usable.all()


def test_largest_floats_are_no_values(open_text) -> None:
    """1e308 is a number in the text and no measurement."""
    assert open_text(column(["1", "1e308", "3"])).read(OP).op.quality[1] == Quality.RANGE


def quality_file(codes: list[str], values: list[str] | None = None) -> str:
    values = values or [str(i) for i in range(len(codes))]
    rows = "".join(
        f"A,2026-01-05T06:00:{i:02d}Z,{v},{c}\n"
        for i, (c, v) in enumerate(zip(codes, values, strict=True))
    )
    return "Tag,Time,Value,Quality\n" + rows


A = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="A")})


@pytest.mark.parametrize("sign", ["²", "9" * 5000])
def test_a_sign_that_is_only_like_a_number_is_no_quality_code(open_text, sign: str) -> None:
    """A raised digit, or more digits than any code has, is bad beside a value; the rest is read."""
    codes = ("good", sign) * 15
    rows = (f"2026-01-13T06:00:{i:02d}Z,{i},{code}\n" for i, code in enumerate(codes))
    source = open_text("Time,A,A_status\n" + "".join(rows))
    assert source.read(A).op.quality.tolist() == [Quality.GOOD, Quality.BAD] * 15


def test_bare_quality_of_small_codes_is_not_guessed(open_text) -> None:
    """0 and 1 with values beside both are refused, with the option that settles it."""
    text = quality_file(["0", "1", "0", "1"])
    with pytest.raises(ConnectorError, match="good_quality"):
        open_text(text).read(A)
    options = ReadOptions(good_quality=("0",))
    assert open_text(text, options=options).read(A).op.quality.tolist() == [0, 2, 0, 2]


@pytest.mark.parametrize(
    ("header", "bad", "good"), [("CONFIDENCE", "0", "100"), ("Validity", "0", "1")]
)
def test_a_quality_column_whose_name_says_what_is_good(open_text, header, bad, good) -> None:
    """A confidence is the share of good samples, and 1 is valid."""
    rows = (f"F1.OP,2026-01-13T06:00:{i:02d}Z,{i},{bad if i == 3 else good}\n" for i in range(20))
    source = open_text(f"TAGNAME,TIMESTAMP,VALUE,{header}\n" + "".join(rows))
    op = source.read(ValveTags(valve="A", tags={Role.OP: TagMapping(tag="F1.OP")})).op
    assert np.flatnonzero(op.quality == Quality.BAD).tolist() == [3]


@pytest.mark.parametrize("unit", ["0-1", "0..1", "fraction"])
def test_a_share_of_span_is_read_in_percent(open_text, unit: str) -> None:
    """OP and position whose unit says 0 to 1, but for a range that is given."""
    source = open_text(f"t_s,OP [{unit}]\n0,0.4\n1,0.5\n2,0.6\n")
    assert source.read(OP).op.values.tolist() == pytest.approx([40.0, 50.0, 60.0])
    assert source.read(OP).op.unit == "%"
    mapping = TagMapping(tag="OP", low=0.0, high=2.0)
    given = source.read(ValveTags(valve="A", tags={Role.OP: mapping}))
    assert given.op.values.tolist() == pytest.approx([20.0, 25.0, 30.0])


def test_a_code_whose_rows_have_no_value_is_bad(open_text) -> None:
    """A code whose rows never have a value is bad."""
    text = quality_file(["0", "1", "0", "0"], ["1", "Bad", "3", "4"])
    assert open_text(text).read(A).op.quality.tolist() == [0, Quality.BAD, 0, 0]


def test_opc_codes_from_192_up_are_good(open_text) -> None:
    """192 and 216 are good, 64 and 24 are not."""
    text = quality_file(["192", "216", "64", "24", "192"])
    assert open_text(text).read(A).op.quality.tolist() == [0, 0, 2, 2, 0]


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"]
)
def test_usual_encodings_are_recognised(open_text, encoding: str) -> None:
    """The usual encodings are found without being said."""
    text = "Zeit;Füllstand °C\n" + "".join(f"2026-01-13 06:00:{i:02d};{i},5\n" for i in range(9))
    tags = open_text(text.encode(encoding)).tags()
    assert [tag.tag for tag in tags] == ["Füllstand °C"]


def test_gbk_is_recognised_by_its_byte_pairs(open_text) -> None:
    """GBK is told from cp1252 by its byte pairs."""
    text = "时间,回炼油返塔流量,液位\n" + "".join(
        f"2026-01-13 06:00:{i:02d},{i},1\n" for i in range(9)
    )
    source = open_text(text.encode("gbk"))
    assert [tag.tag for tag in source.tags()] == ["回炼油返塔流量", "液位"]


def test_another_code_page_is_read_by_option(open_text) -> None:
    """A code page that cannot be found is read by option."""
    text = "Время,Клапан\n" + "".join(f"2026-01-13 06:00:{i:02d},{i}\n" for i in range(9))
    options = ReadOptions(encoding="cp1251", time_column="Время")
    assert open_text(text.encode("cp1251"), options=options).tags()[0].tag == "Клапан"


def test_gzip_is_unpacked_and_a_cut_one_read_as_far_as_possible(open_text) -> None:
    """A packed file is read by its first bytes; of a cut one the start, with a problem."""
    packed = gzip.compress(column([str(i % 97) for i in range(5000)]).encode())
    assert len(open_text(packed, "a.bin").read(OP)) == 5000
    cut = open_text(packed[: len(packed) // 2], "b.csv.gz")
    assert 0 < len(cut.read(OP)) < 5000
    assert any("gzip archive is damaged" in text for text in cut.inspect().problems)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "the file is empty"),
        (b"PK\x03\x04rest", "Excel workbook"),
        (bytes(range(256)) * 20, "is not text"),
        (b"a,b,c\n", "no row of numbers was found in its only row; "),
        (b"a,b,c\nd,e,f\n", "no row of numbers was found in the first 2 rows"),
    ],
)
def test_each_unreadable_file_has_its_sentence(open_text, content: bytes, expected: str) -> None:
    """Each kind of unreadable file has its sentence."""
    with pytest.raises(UnreadableSource, match=expected):
        open_text(content).tags()


def test_a_missing_file_is_named(tmp_path) -> None:
    """A path that is not there is named."""
    from stemwatch.connectors.historian import HistorianFile

    with pytest.raises(UnreadableSource, match=r"nowhere\.csv: cannot be opened"):
        HistorianFile(tmp_path / "nowhere.csv").tags()


def test_ragged_rows_are_reported_and_the_rest_is_read(open_text) -> None:
    """A row with a cell too few or too many is named by its line and left out."""
    text = "t_s,OP,PV\n0,1,2\n1,1\n2,1,2\n3,1,2,9\n4,1,2,\n5,1,2\n6,1,2\n7,1,2\n"
    source = open_text(text)
    assert source.read(OP).op.quality.tolist() == [0, 3, 0, 3, 0, 0, 0, 0]
    problems = source.inspect().problems
    assert [text.split(":")[0] for text in problems] == ["line 3", "line 5"]


def test_stray_quote_spoils_its_own_line_only(open_text) -> None:
    """A quotation mark that is never closed does not swallow the rest of the file."""
    text = "t_s,OP\n" + "".join(f"{i},{chr(34) if i == 3 else ''}{i}\n" for i in range(9))
    source = open_text(text)
    assert source.read(OP).op.values.tolist() == [float(i) for i in range(9)]
    assert any("line 5: a quotation mark is never closed" in p for p in source.inspect().problems)


def test_quoted_line_end_in_a_header(open_text) -> None:
    """A header cell over two lines is one cell, and line numbers stay those of the file."""
    source = open_text('t_s,"OP\nof valve",PV\n0,1,2\n1,1\n2,1,2\n3,1,2\n')
    assert len(source.tags()) == 2
    assert source.inspect().problems[0].startswith("line 4: 2 cells where 3 were expected")


def test_one_row_is_not_enough(open_text) -> None:
    """A single row of data is refused by that reason."""
    with pytest.raises(UnreadableSource, match="only one row of data"):
        open_text("t_s,OP\n0,1\n").tags()


def test_excel_day_numbers_keep_their_durations(open_text) -> None:
    """Times as Excel day numbers keep their durations."""
    rows = "".join(f"{46035 + i / 1440:.9f},{i}\n" for i in range(9))
    assert open_text("Time,OP\n" + rows).read(OP).interval_s == pytest.approx(60.0)


def test_duplicated_tags_stay_apart(open_text) -> None:
    """Two columns of one name are two tags, and this is said."""
    source = open_text("t_s,OP,OP\n0,1,5\n1,2,6\n")
    assert [tag.tag for tag in source.tags()] == ["OP", "OP (2)"]


def test_unknown_tag_lists_the_nearest(open_text) -> None:
    """A misspelt tag is answered with the nearest ones."""
    valve = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="FIC102.OP")})
    with pytest.raises(
        UnknownTag, match=r"no tag 'FIC102.OP' among 2; the nearest are 'FIC101.OP'"
    ):
        open_text("t_s,FIC101.OP,T7\n0,1,2\n1,1,2\n").read(valve)


def test_same_tag_for_op_and_mv_is_refused(open_text) -> None:
    """One tag as both command and position is refused: such a valve looks perfect."""
    both = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="OP"), Role.MV: TagMapping(tag="op")})
    with pytest.raises(ConnectorError, match="given for both OP and MV"):
        open_text(column(["1", "2"])).read(both)


def test_position_that_is_the_command_is_said(open_text) -> None:
    """A position that equals OP sample for sample is named in the decisions."""
    text = "t_s,OP,ZT\n" + "".join(f"{i},{i % 7}.5,{i % 7}.5\n" for i in range(40))
    valve = ValveTags(
        valve="A", tags={Role.OP: TagMapping(tag="OP"), Role.MV: TagMapping(tag="ZT")}
    )
    assert "command under another name" in said(open_text(text).read(valve))


def test_ranges_become_percent(open_text) -> None:
    """Engineering values are percent of the given range; without one they keep their unit."""
    text = "Time,OP [mA],PV [t/h]\n" + "".join(
        f"2026-01-05T06:00:0{i}Z,{4 + 4 * i},{10 * i}\n" for i in range(5)
    )
    valve = ValveTags(
        valve="A",
        tags={
            Role.OP: TagMapping(tag="OP", low=4.0, high=20.0),
            Role.PV: TagMapping(tag="PV"),
        },
    )
    recording = open_text(text).read(valve)
    assert (recording.op.unit, recording.op.values.tolist()) == ("%", [0, 25, 50, 75, 100])
    assert recording.signals[Role.PV].unit == "t/h"


def test_empty_range_is_refused(open_text) -> None:
    """A range without width cannot make percent."""
    valve = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="OP", low=5.0, high=5.0)})
    with pytest.raises(ConnectorError, match=r"loop\.csv: A: OP: low 5 and high 5 give no range"):
        open_text(column(["1", "2"])).read(valve)


def test_op_far_from_percent_is_not_called_percent(open_text) -> None:
    """An OP of 389 to 396 without unit stays what it is."""
    recording = open_text(column([f"{389 + i % 7}.5" for i in range(30)])).read(OP)
    assert recording.op.unit == ""
    assert "are no percent" in said(recording)


def test_mode_words_become_automatic_manual_or_masked(open_text) -> None:
    """AUTO and CAS are 1, MAN is 0, and what is neither is masked."""
    text = "t_s,A.OP,A.MODE\n0,1,AUTO\n1,2,MAN\n2,3,CAS\n3,4,Bad\n"
    valve = ValveTags(
        valve="A", tags={Role.OP: TagMapping(tag="A.OP"), Role.MODE: TagMapping(tag="A.MODE")}
    )
    recording = open_text(text).read(valve)
    mode = recording.signals[Role.MODE]
    decisions = recording.provenance.decisions
    assert [said for said in decisions if "no measurement" in said] == [
        "A.MODE: left out as no measurement: 'Bad' 1."
    ]
    assert mode.values[:3].tolist() == [1.0, 0.0, 1.0]
    assert mode.quality[3] == Quality.BAD


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        (
            "zone",
            "Europe/Berln",
            r"is not known; expected an IANA .* \(did you mean 'Europe/Berlin'",
        ),
        ("zone", "CEST", "is not known; expected an IANA time zone such as Europe/Berlin$"),
        ("encoding", "klingon", "is not known; expected an encoding"),
        ("encoding", "rot13", "is not known; expected an encoding"),
        ("encoding", "undefined", "is not known; expected an encoding"),
        ("separator", ";;", "one character"),
        ("interval_s", 0.0, "must be positive"),
        ("interval_s", 1e300, "must be positive, 1e-09 to"),
        ("ambiguous_hour", "guess", "must be one of"),
    ],
)
def test_options_are_checked(field: str, value: object, expected: str) -> None:
    """A wrong option is refused where it is made, with what was expected."""
    with pytest.raises(ValueError, match=expected):
        ReadOptions(**{field: value})  # type: ignore[arg-type]
