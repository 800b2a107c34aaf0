"""Times: day and month, clock changes, offsets, the even grid and what it reports."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from stemwatch.connectors.connector import (
    ConnectorError,
    TagMapping,
    UnreadableSource,
    ValveTags,
    Window,
)
from stemwatch.connectors.historian import ReadOptions
from stemwatch.models.recording import Quality, Recording, Role

OP = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="OP")})
BERLIN = ReadOptions(zone="Europe/Berlin")


def wide(times: list[str], header: str = "Time") -> str:
    rows = "".join(f"{time};{i + 0.5}\n" for i, time in enumerate(times))
    return f"{header};OP\n{rows}"


def local(start: datetime, n: int, minutes: int, form: str = "%Y-%m-%d %H:%M:%S") -> list[str]:
    """Local wall-clock texts of n instants after a UTC start."""
    zone = ZoneInfo("Europe/Berlin")
    steps = [start + timedelta(minutes=minutes * i) for i in range(n)]
    return [step.astimezone(zone).strftime(form) for step in steps]


def said(recording: Recording) -> str:
    return " ".join(recording.provenance.decisions)


def test_autumn_repeated_hour_is_told_apart_by_order(open_text) -> None:
    """The hour that is there twice and in order is read without a gap or a collision."""
    start = datetime(2026, 10, 24, 22, tzinfo=UTC)
    recording = open_text(wide(local(start, 48, 10)), options=BERLIN).read(OP)
    assert recording.start == start
    assert recording.op.values.tolist() == [i + 0.5 for i in range(48)]
    assert recording.clock.gaps == 0
    assert "told apart by their order" in said(recording)


def test_a_file_newest_first_is_reversed_with_its_repeated_hour(open_text) -> None:
    """A file that runs backwards is turned round, the repeated hour too."""
    start = datetime(2026, 10, 24, 22, tzinfo=UTC)
    recording = open_text(wide(local(start, 48, 10)[::-1]), options=BERLIN).read(OP)
    assert recording.start == start
    assert recording.op.values.tolist() == [i + 0.5 for i in range(48)][::-1]
    assert recording.clock.backward_steps == 0


def test_autumn_hour_that_is_there_once_is_left_out_and_said(open_text) -> None:
    """One pass through the repeated hour cannot be placed; the other rows can."""
    times = [f"2026-10-25 0{h}:{m:02d}:00" for h in (0, 1, 2, 3, 4) for m in range(0, 60, 10)]
    recording = open_text(wide(times), options=BERLIN).read(OP)
    assert recording.op.values.tolist()[:12] == [i + 0.5 for i in range(12)]
    assert (recording.op.quality[12:24] == Quality.MISSING).all()
    assert recording.op.values.tolist()[24:] == [i + 0.5 for i in range(18, 30)]
    assert "ambiguous_hour='first' or 'second'" in said(recording)


@pytest.mark.parametrize(("policy", "first_hole"), [("first", 18), ("second", 12)])
def test_the_repeated_hour_follows_the_option(open_text, policy: str, first_hole: int) -> None:
    """Said to be the first or the second pass, the hour is placed there."""
    times = [f"2026-10-25 0{h}:{m:02d}:00" for h in (0, 1, 2, 3, 4) for m in range(0, 60, 10)]
    options = ReadOptions(zone="Europe/Berlin", ambiguous_hour=policy)  # type: ignore[arg-type]
    recording = open_text(wide(times), options=options).read(OP)
    holes = np.flatnonzero(recording.op.quality == Quality.MISSING)
    assert holes.tolist() == list(range(first_hole, first_hole + 6))


def test_autumn_in_a_narrow_file_is_told_apart_per_tag(open_text) -> None:
    """Tags one after the other each pass the repeated hour in order."""
    start = datetime(2026, 10, 24, 23, tzinfo=UTC)
    rows = [
        f"{tag},{time},{i}\n"
        for tag in ("A.OP", "A.PV")
        for i, time in enumerate(local(start, 24, 10))
    ]
    valve = ValveTags(
        valve="A", tags={Role.OP: TagMapping(tag="A.OP"), Role.PV: TagMapping(tag="A.PV")}
    )
    recording = open_text("Tag,Time,Value\n" + "".join(rows), options=BERLIN).read(valve)
    assert recording.op.values.tolist() == [float(i) for i in range(24)]
    assert recording.signals[Role.PV].values.tolist() == [float(i) for i in range(24)]


def test_spring_is_one_step_forward_in_local_time(open_text) -> None:
    """Local times that skip the missing hour are even in UTC."""
    start = datetime(2026, 3, 29, 0, tzinfo=UTC)
    recording = open_text(wide(local(start, 24, 10)), options=BERLIN).read(OP)
    assert (recording.clock.gaps, len(recording)) == (0, 24)


def test_spring_missing_hour_is_shifted_and_said(open_text) -> None:
    """Times that no clock showed are moved forward by an hour, with advice on a fixed zone."""
    times = [f"2026-03-29 0{h}:{m:02d}:00" for h in (1, 2) for m in range(0, 60, 10)]
    recording = open_text(wide(times), options=BERLIN).read(OP)
    assert recording.op.values.tolist() == [i + 0.5 for i in range(12)]
    assert "6 rows have times in the hour that spring skips" in said(recording)
    left = ReadOptions(zone="Europe/Berlin", missing_hour="leave_out")
    assert len(open_text(wide(times), "b.csv", left).read(OP)) == 6
    single = open_text(wide([*times[:6], times[6]]), "c.csv", left).read(OP)
    assert "1 row in the hour that spring skips in Europe/Berlin was left out" in said(single)


def test_the_skipped_half_hour_of_lord_howe_is_shifted_by_half_an_hour(open_text) -> None:
    """Rows are moved by what is skipped there: an hour would put them on the rows after it."""
    times = [f"2026-10-04 0{h}:{m:02d}:00" for h, m in ((1, 30), (1, 40), (1, 50), (2, 0), (2, 10))]
    recording = open_text(wide(times), options=ReadOptions(zone="Australia/Lord_Howe")).read(OP)
    assert (recording.clock.gaps, len(recording)) == (0, 5)
    assert "shifted forward by 30 minutes" in said(recording)


def test_a_clock_that_goes_on_through_the_skipped_hour_is_refused(open_text) -> None:
    """Its rows of the skipped hour belong before those of the next one, and all that follow are an
    hour wrong: shifted, two hours would lie on each other."""
    times = [f"2026-03-29 0{h}:{m:02d}:00" for h in (1, 2, 3) for m in range(0, 60, 10)]
    with pytest.raises(UnreadableSource, match=r"a\.csv: .*keeps standard time.*'Etc/GMT-1'$"):
        open_text(wide(times), "a.csv", BERLIN).read(OP)
    fixed = open_text(wide(times), "a.csv", ReadOptions(zone="Etc/GMT-1")).read(OP)
    assert (fixed.clock.gaps, len(fixed)) == (0, 18)
    put_forward_late = [*times[:12], *(time.replace(" 03:", " 04:") for time in times[12:])]
    late = open_text(wide(put_forward_late), "a.csv", BERLIN).read(OP)
    assert (late.clock.gaps, len(late)) == (0, 18)


def test_a_file_within_the_repeated_hour_says_why_it_has_no_time(open_text) -> None:
    """The form of its times is not at fault."""
    times = [f"2026-10-25 02:{m:02d}:00" for m in range(0, 50, 10)]
    with pytest.raises(UnreadableSource, match="hour that autumn repeats in Europe/Berlin"):
        open_text(wide(times), options=BERLIN).read(OP)
    first = ReadOptions(zone="Europe/Berlin", ambiguous_hour="first")
    assert len(open_text(wide(times), options=first).read(OP)) == 5


def test_mixed_offsets_are_one_clock(open_text) -> None:
    """A file across a clock change with offsets needs no zone."""
    text = wide(
        ["2026-10-25T02:30:00+02:00", "2026-10-25T02:00:00+01:00", "2026-10-25T02:30:00+01:00"]
    )
    recording = open_text(text).read(OP)
    assert recording.start == datetime(2026, 10, 25, 0, 30, tzinfo=UTC)
    assert recording.interval_s == 1800.0


def test_no_zone_keeps_durations_and_hides_the_date(open_text) -> None:
    """Without a zone there is no start, and a window cannot be asked for."""
    source = open_text(wide(["2026-05-01 00:00:00", "2026-05-01 00:00:10"]))
    assert source.read(OP).start is None
    with pytest.raises(ConnectorError, match="give the zone"):
        source.read(OP, Window(start=datetime(2026, 5, 1, tzinfo=UTC)))


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("13/02/2026", "13/02/2026", datetime(2026, 2, 13, tzinfo=UTC)),
        ("02/13/2026", "02/13/2026", datetime(2026, 2, 13, tzinfo=UTC)),
        ("01.02.2026", "01.02.2026", datetime(2026, 2, 1, tzinfo=UTC)),
        ("03/03/2026", "03/03/2026", datetime(2026, 3, 3, tzinfo=UTC)),
        ("28-OKT-26", "28-OKT-26", datetime(2026, 10, 28, tzinfo=UTC)),
        ("28. Mai 2026", "28. Mai 2026", datetime(2026, 5, 28, tzinfo=UTC)),
        ("1-août-2026", "1-août-2026", datetime(2026, 8, 1, tzinfo=UTC)),
        ("05-ene-26", "05-ene-26", datetime(2026, 1, 5, tzinfo=UTC)),
        ("09-gen-2026", "09-gen-2026", datetime(2026, 1, 9, tzinfo=UTC)),
        ("2026年1月9日", "2026年1月9日", datetime(2026, 1, 9, tzinfo=UTC)),
    ],
)
def test_dates_that_tell_their_order(open_text, first: str, second: str, expected) -> None:
    """A number above 12, a point, a name or two equal numbers settle the order of a date."""
    text = wide([f"{first} 00:00:00", f"{second} 00:00:10"])
    assert open_text(text, options=ReadOptions(zone="UTC")).read(OP).start == expected


def test_even_spacing_over_midnight_settles_the_order(open_text) -> None:
    """31 minutes around midnight of 1 to 2 February are even only with the day first."""
    times = [f"01/02/2026 23:{m:02d}" for m in range(45, 60)]
    times += [f"02/02/2026 00:{m:02d}" for m in range(15)]
    recording = open_text(wide(times), options=ReadOptions(zone="UTC")).read(OP)
    assert recording.start == datetime(2026, 2, 1, 23, 45, tzinfo=UTC)
    assert "evenly spaced" in said(recording)


def test_undecidable_dates_are_refused(open_text) -> None:
    """01/02/2026 alone is not guessed; the message says how to tell."""
    text = wide([f"01/02/2026 00:00:{i:02d}" for i in range(10)])
    with pytest.raises(UnreadableSource, match="say day_first=True or day_first=False"):
        open_text(text).tags()
    options = ReadOptions(zone="UTC", day_first=False)
    assert open_text(text, options=options).read(OP).start == datetime(2026, 1, 2, tzinfo=UTC)


def test_twelve_am_is_midnight_and_twelve_pm_is_noon(open_text) -> None:
    """12 AM is midnight and 12 PM noon."""
    times = [
        "1/13/2026 12:00:00 AM",
        "1/13/2026 6:00:00 AM",
        "1/13/2026 12:00:00 PM",
        "1/13/2026 6:00:00 PM",
    ]
    recording = open_text(wide(times), options=ReadOptions(zone="UTC")).read(OP)
    assert (recording.interval_s, len(recording)) == (6 * 3600.0, 4)


def test_a_given_time_format_is_used(open_text) -> None:
    """A format that no grammar knows is read by the one that was given."""
    times = [f"06h{i:02d} on 2026.009" for i in range(4)]
    options = ReadOptions(zone="UTC", time_format="%Hh%M on %Y.%j", time_column="Time")
    recording = open_text(wide(times), options=options).read(OP)
    assert recording.start == datetime(2026, 1, 9, 6, tzinfo=UTC)


@pytest.mark.parametrize("time_format", ["%Q", "%"])
def test_a_time_format_that_is_none_is_said(open_text, time_format: str) -> None:
    """A mistyped format is an error that says what a format looks like."""
    times = local(datetime(2026, 1, 5, tzinfo=UTC), 9, 1)
    source = open_text(wide(times), options=ReadOptions(time_format=time_format))
    with pytest.raises(UnreadableSource, match=r"loop\.csv: time_format = .* expected a format"):
        source.tags()


def test_a_given_format_dates_only_what_it_can(open_text) -> None:
    """Times of day pass midnight and have no date, days without a year have none either, and an
    offset is read where the format has one."""

    def read(times: list[str], time_format: str) -> Recording:
        options = ReadOptions(zone="Europe/Berlin", time_format=time_format, time_column="Time")
        return open_text(wide(times), options=options).read(OP)

    of_day = read([f"{(22 + k // 2) % 24:02d}h{30 * (k % 2):02d}" for k in range(12)], "%Hh%M")
    assert (of_day.start, of_day.interval_s, len(of_day)) == (None, 1800.0, 12)
    assert "past midnight" in said(of_day)
    yearless = read([f"{k + 1:02d}.02. 06:00" for k in range(9)], "%d.%m. %H:%M")
    assert (yearless.start, yearless.interval_s) == (None, 86_400.0)
    assert "The format names no year" in said(yearless)
    offset = read([f"2026-01-05 06:{k:02d}:00+0300" for k in range(9)], "%Y-%m-%d %H:%M:%S%z")
    assert offset.start == datetime(2026, 1, 5, 3, tzinfo=UTC)
    assert "Each time carries its offset from UTC." in said(offset)


def test_an_offset_that_no_zone_has_is_no_time(open_text) -> None:
    """Its row is left out and named; four days would be believed otherwise."""
    times = [f"2026-01-05 06:00:{k:02d}+01:00" for k in range(20)]
    times[7] = times[7].replace("+01:00", "+99:99")
    source = open_text(wide(times))
    assert source.read(OP).start == datetime(2026, 1, 5, 5, tzinfo=UTC)
    assert any("line 9: '2026-01-05 06:00:07+99:99'" in text for text in source.inspect().problems)
    with pytest.raises(UnreadableSource, match="no row"):
        open_text(wide([time[:-6] + "+99:99" for time in times])).tags()


def test_a_sampling_column_without_a_possible_interval_is_not_one(open_text) -> None:
    """1e200 s between rows is damage."""
    rows = "".join(f"1e200,{k % 7},{k % 5}.5\n" for k in range(60))
    with pytest.raises(UnreadableSource, match="nothing tells the interval"):
        open_text("Ts,OP,PV\n" + rows).tags()


@pytest.mark.parametrize("form", ["{}", "{}.0", "+{}", "{:.18e}"])
def test_nanoseconds_since_1970_are_dates_however_they_are_written(open_text, form: str) -> None:
    """With a point, a sign or an exponent too, which tables write for large numbers."""
    first = 1_767_592_800_000_000_000
    texts = [form.format(first + row * 1_000_000_000) for row in range(50)]
    recording = open_text(wide(texts)).read(OP)
    assert recording.start is not None
    assert abs((recording.start - datetime(2026, 1, 5, 6, tzinfo=UTC)).total_seconds()) < 1e-6
    assert (recording.interval_s, len(recording)) == (1.0, 50)


def seconds(times: list[float]) -> str:
    return "t_s,OP\n" + "".join(f"{time},{i}\n" for i, time in enumerate(times))


def test_holes_are_missing_and_counted(open_text) -> None:
    """A gap becomes MISSING samples; nothing is put in between."""
    recording = open_text(seconds([0, 1, 2, 7, 8, 9])).read(OP)
    assert recording.op.quality.tolist() == [0, 0, 0, 3, 3, 3, 3, 0, 0, 0]
    assert (recording.clock.gaps, recording.clock.longest_gap_s) == (1, 5.0)


def test_the_last_of_repeated_times_is_kept_and_faults_counted(open_text) -> None:
    """Of repeated times the last is kept; both faults are counted."""
    recording = open_text(seconds([0, 1, 1, 2, 4, 3, 5, 6])).read(OP)
    assert recording.op.values.tolist() == [0, 2, 3, 5, 4, 6, 7]
    assert (recording.clock.repeated_times, recording.clock.backward_steps) == (1, 1)


def test_row_stamped_early_goes_to_the_empty_instant(open_text) -> None:
    """A repeated time before an empty instant is the row of that instant, and this is said."""
    recording = open_text(seconds([0, 10, 20, 20, 40, 50, 60])).read(OP)
    assert recording.op.values.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert recording.clock.repeated_times == 1
    assert "stamped early" in said(recording)


def test_a_clock_half_an_interval_off_after_a_gap_loses_no_sample(open_text) -> None:
    """After a gap the source goes on off the old grid, with jitter, and loses no sample."""
    after = [330 + 15 + 30 * i + (i % 3 - 1) for i in range(20)]
    recording = open_text(seconds([30.0 * i for i in range(10)] + after)).read(OP)
    assert int(recording.op.usable.sum()) == 30


def test_rounded_steps_do_not_drift(open_text) -> None:
    """Times rounded to milliseconds at three per second fill their grid without holes."""
    times = [round(i / 3, 3) for i in range(3000)]
    recording = open_text(seconds(times)).read(OP)
    assert len(recording) == 3000
    assert bool(recording.op.usable.all())


def test_absurd_grid_is_refused(open_text) -> None:
    """A grid of more than 50 million samples is refused with what to do."""
    text = seconds([0, 0.001, 0.002, 0.003, 90000])
    with pytest.raises(ConnectorError, match="read it in windows or split the file"):
        open_text(text).read(OP)


def test_stray_date_is_left_out(open_text) -> None:
    """One row dated decades away does not stretch the record."""
    times = [f"2026-05-01T00:{i // 60:02d}:{i % 60:02d}Z" for i in range(300)]
    times[100] = "1971-01-01T00:00:00Z"
    source = open_text(wide(times))
    assert len(source.read(OP)) == 300
    assert any("far from all others" in text for text in source.inspect().problems)


def test_window_is_half_open(open_text) -> None:
    """Samples from start (included) to stop (excluded), on the same grid."""
    source = open_text(wide([f"2026-05-01T00:00:{i:02d}Z" for i in range(30)]))
    start = datetime(2026, 5, 1, 0, 0, 5, tzinfo=UTC)
    part = source.read(OP, Window(start=start, stop=start + timedelta(seconds=10)))
    assert part.start == start
    assert part.op.values.tolist() == [i + 0.5 for i in range(5, 15)]
    with pytest.raises(ConnectorError, match="the file covers 2026-05-01 00:00:00 to"):
        source.read(OP, Window(start=datetime(2027, 1, 1, tzinfo=UTC)))


def test_op_reported_by_exception_is_held(open_text) -> None:
    """OP that is stored when it changes is held, and older values are marked as held."""
    gaps = [1, 1, 2, 1, 9, 1, 1, 30, 1, 2, 1, 1, 14, 1, 1, 1, 40, 1, 2, 1]
    times = np.cumsum(gaps)
    rows = "".join(
        f"A.OP,2026-01-05T06:{t // 60:02d}:{t % 60:02d}Z,{i}\n" for i, t in enumerate(times)
    )
    valve = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="A.OP")})
    recording = open_text("Tag,Time,Value\n" + rows).read(valve)
    assert recording.interval_s == 1.0
    assert len(recording) == times[-1] - times[0] + 1
    assert Quality.HELD in recording.op.quality
    assert "is reported when it changes" in said(recording)


def test_a_column_called_utc_holds_utc(open_text) -> None:
    """A column that is called UTC holds UTC."""
    source = open_text(wide(["2026-05-01 00:00:00", "2026-05-01 00:00:10"], "Time (UTC)"))
    assert source.read(OP).start == datetime(2026, 5, 1, tzinfo=UTC)


@pytest.mark.parametrize("first", [0, 17])
@pytest.mark.parametrize("each", [4, 60])
def test_stamps_that_a_spreadsheet_cut_to_the_minute_are_spread_evenly(
    open_text, first: int, each: int
) -> None:
    """Sixty rows a minute are a row each second, also where the first minute is not whole."""
    rows = each * 8 - first % each
    start = datetime(2026, 3, 2, 6, tzinfo=UTC)
    skipped = first % each
    minutes = [(skipped + row) // each for row in range(rows)]
    times = [(start + timedelta(minutes=m)).strftime("%Y-%m-%d %H:%M") for m in minutes]
    recording = open_text(wide(times), options=ReadOptions(zone="UTC")).read(OP)
    assert recording.interval_s == 60 / each
    assert recording.start == start + timedelta(seconds=skipped * 60 / each)
    assert recording.op.values.tolist() == [row + 0.5 for row in range(rows)]
    assert f"gives the same time to {each} rows in a row" in said(recording)


def test_rows_that_stand_twice_in_a_file_are_no_cut_stamps(open_text) -> None:
    """Each row twice is a damaged export: the repeats are dropped, and the clock stays."""
    times = [f"2026-03-02 06:{minute:02d}" for minute in range(40)]
    text = "Time;OP\n" + "".join(f"{time};{i + 0.5}\n" * 2 for i, time in enumerate(times))
    recording = open_text(text, options=ReadOptions(zone="UTC")).read(OP)
    assert recording.interval_s == 60
    assert recording.op.values.tolist() == [i + 0.5 for i in range(40)]


def test_an_interval_that_is_given_is_used_or_said_not_to_be(open_text) -> None:
    """A column that only counts rows gives way to it; dates do not, and that is said."""
    counts = [str(row) for row in range(50)]
    read_options = ReadOptions(interval_s=20.0, zone="UTC")
    recording = open_text(wide(counts), options=read_options).read(OP)
    assert recording.interval_s == 20.0
    assert "20 s apart, as given; column 'Time' only counts them" in said(recording)
    dated = [f"2026-03-02 06:{minute:02d}" for minute in range(50)]
    recording = open_text(wide(dated), options=read_options).read(OP)
    assert recording.interval_s == 60.0
    assert "interval_s = 20 is not used: column 'Time' dates each row" in said(recording)


@pytest.mark.parametrize("seconds", [1.003, 7.0, 0.9, 13.0])
def test_stamps_cut_to_the_minute_at_an_interval_that_does_not_divide_it(
    open_text, seconds: float
) -> None:
    """Minutes with now one row more and now one fewer still tell the spacing."""
    start = datetime(2026, 3, 2, 6, tzinfo=UTC)
    rows = round(1800 / seconds)
    times = [
        (start + timedelta(seconds=17.0 + row * seconds)).strftime("%d.%m.%Y %H:%M")
        for row in range(rows)
    ]
    recording = open_text(wide(times), options=ReadOptions(zone="UTC")).read(OP)
    assert recording.interval_s == pytest.approx(seconds, rel=2e-3)
    assert recording.op.values.size == rows
    assert "in a row, as a spreadsheet does that cuts times" in said(recording)


def test_a_minute_of_sixty_rows_is_a_second(open_text) -> None:
    """What a plant sees most: one second exported, opened in a spreadsheet, saved again."""
    times = [f"2026-03-02 06:{row // 60:02d}" for row in range(1200)]
    recording = open_text(wide(times)).read(OP)
    assert recording.interval_s == 1.0
    assert "gives the same time to 60 rows in a row" in said(recording)
    assert "the rows are taken as 1 s apart" in said(recording)


def test_truncated_stamps_of_a_narrow_export_are_spread_for_each_tag(open_text) -> None:
    """In a narrow export each tag has stamps of its own."""
    rows = [f"2026-03-02 06:{row // 12:02d};{tag};{row + 0.5}"
            for row in range(240) for tag in ("FIC1.OP", "FIC1.PV")]  # fmt: skip
    text = "Timestamp;Tag;Value\n" + "\n".join(rows) + "\n"
    tags = ValveTags(valve="FIC1", tags={Role.OP: TagMapping(tag="FIC1.OP")})
    recording = open_text(text, options=ReadOptions(zone="UTC")).read(tags)
    assert recording.interval_s == 5.0
    assert recording.op.values.tolist() == [row + 0.5 for row in range(240)]
    assert "the same time to 12 rows in a row" in said(recording)


def test_a_given_interval_settles_cut_stamps_or_is_said_not_to(open_text) -> None:
    """The user's interval is used where no stamp contradicts it."""
    times = [f"2026-03-02 06:{row // 60:02d}" for row in range(90)]
    recording = open_text(wide(times), options=ReadOptions(zone="UTC", interval_s=1.0)).read(OP)
    assert recording.interval_s == 1.0
    assert "The rows are 1 s apart, as given; column 'Time' gives the same time" in said(recording)
    times = [f"2026-03-02 06:{row // 60:02d}" for row in range(600)]
    recording = open_text(wide(times), options=ReadOptions(zone="UTC", interval_s=5.0)).read(OP)
    assert recording.interval_s == 1.0
    assert "interval_s = 5 is not used: column 'Time' dates each row" in said(recording)


def test_stamps_that_repeat_unevenly_are_said(open_text) -> None:
    """Where the numbers of rows do not tell the spacing, the loss is a problem with its cure."""
    counts = [60, 3, 17, 60, 2, 41, 60, 9]
    times = [f"2026-03-02 06:{m:02d}" for m, count in enumerate(counts) for _ in range(count)]
    problems = open_text(wide(times)).inspect().problems
    assert any("the time of the row before, and not evenly" in problem for problem in problems)


@pytest.mark.parametrize(
    ("header", "cell", "interval_s"),
    [("ts", "20", 20.0), ("Ts [ms]", "500", 0.5), ("sampling_interval_s", "12", 12.0),
     ("dt", "0,2", 0.2)],
)  # fmt: skip
def test_a_row_counter_beside_a_sampling_column(
    open_text, header: str, cell: str, interval_s: float
) -> None:
    """``Time`` that rises by one beside ``ts`` is no time in seconds; missing rows stay missing."""
    counts = [row for row in range(60) if row not in (30, 31)]
    rows = "".join(f"{row};{cell};{row + 0.25}\n".replace(".", ",") for row in counts)
    source = open_text(f"Time;{header};OP\n" + rows)
    recording = source.read(OP)
    assert recording.interval_s == interval_s
    assert np.isnan(recording.op.values).sum() == 2
    assert f"The rows are {interval_s:g} s apart, as column {header!r} says" in said(recording)
    assert "since a start" not in said(recording)
    assert [tag.tag for tag in source.inspect().tags] == ["OP"]


def test_a_sampling_column_that_contradicts_the_dates_is_said(open_text) -> None:
    """Dates are times; what a column says otherwise is a problem to look at."""
    rows = "".join(f"2026-03-02 06:{m:02d};20;{m + 0.5}\n" for m in range(50))
    source = open_text("Time;ts;OP\n" + rows)
    assert source.read(OP).interval_s == 60.0
    (problem,) = source.inspect().problems
    assert problem.endswith("'ts' says 20 s between rows, column 'Time' 60 s; the times were taken")


def test_a_given_interval_that_a_sampling_column_contradicts_is_not_asked_for_again(
    open_text,
) -> None:
    """It was taken, and that is said."""
    rows = "".join(f"{row};20;{row + 0.5}\n" for row in range(50))
    source = open_text("Time;ts;OP\n" + rows, options=ReadOptions(interval_s=5.0))
    assert source.read(OP).interval_s == 5.0
    (problem,) = source.inspect().problems
    assert problem == ("column 'ts' says 20 s between rows, interval_s 5 s; interval_s was taken")


def test_seconds_stay_seconds_beside_a_sampling_column(open_text) -> None:
    """Times in steps of the sampling column's interval agree with it, gaps and all."""
    seconds = [20 * row for row in range(60) if row not in (30, 31)]
    rows = "".join(f"{time};20;{time + 0.5}\n" for time in seconds)
    recording = open_text("Time;ts;OP\n" + rows, options=ReadOptions(interval_s=20.0)).read(OP)
    assert recording.interval_s == 20.0
    assert np.isnan(recording.op.values).sum() == 2


def test_a_lone_row_counter_counts_as_seconds_and_says_so(open_text) -> None:
    """Seconds are assumed, and said with what to do if they are not."""
    recording = open_text(wide([str(row) for row in range(50)])).read(OP)
    assert recording.interval_s == 1.0
    assert "If it only counts rows, say interval_s" in said(recording)


def test_excel_days_in_a_given_zone_are_dates(open_text) -> None:
    """The zone is used for day numbers as for any other local time."""
    days = [f"{46083 + row / 1440:.8f}" for row in range(50)]
    text = "Date;OP\n" + "".join(f"{day};{row}\n" for row, day in enumerate(days))
    recording = open_text(text, options=ReadOptions(zone="Europe/Berlin")).read(OP)
    assert recording.start == datetime(2026, 3, 1, 23, tzinfo=UTC)
