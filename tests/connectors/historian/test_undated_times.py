"""Times that no date or zone settles, tags with times of their own, and the interval shown."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from stemwatch.connectors.connector import TagMapping, UnreadableSource, ValveTags
from stemwatch.connectors.historian import ReadOptions
from stemwatch.models.recording import Recording, Role

OP = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="OP")})
BOTH = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="OP"), Role.PV: TagMapping(tag="PV")})


def said(recording: Recording) -> str:
    return " ".join(recording.provenance.decisions)


def clock(count: int, step_s: int, form: str = "%H:%M:%S") -> list[str]:
    """Times of day from five minutes before midnight on."""
    begin = datetime(2026, 2, 3, 23, 55)
    return [(begin + timedelta(seconds=step_s * i)).strftime(form) for i in range(count)]


def table(times: list[str], header: str = "Time,OP") -> str:
    rows = "".join(f"{time},{i + 0.5}\n" for i, time in enumerate(times))
    return f"{header}\n{rows}"


@pytest.mark.parametrize("backward", [False, True])
def test_times_of_day_pass_midnight(open_text, backward: bool) -> None:
    """Without a date durations are right, in files that run either way."""
    times = clock(100, 10)
    recording = open_text(table(times[::-1] if backward else times)).read(OP)
    assert (recording.interval_s, len(recording), recording.start) == (10.0, 100, None)
    assert recording.op.usable.all()
    assert "holds the time of day without a date, past midnight" in said(recording)


def test_times_of_day_of_each_tag_pass_midnight_by_themselves(open_text) -> None:
    """Tags one after the other begin again at the first time."""
    rows = [f"{time},{tag},{i}\n" for tag in ("OP", "PV") for i, time in enumerate(clock(100, 10))]
    recording = open_text("Time,Tag,Value\n" + "".join(rows)).read(BOTH)
    assert len(recording) == 100
    assert recording.signals[Role.PV].values.tolist() == [float(i) for i in range(100)]


def test_hours_and_minutes_alone_are_said_and_spread(open_text) -> None:
    """Times of day cut to the minute are spread as dates are."""
    recording = open_text(table(clock(120, 10, "%H:%M"))).read(OP)
    assert (recording.interval_s, len(recording)) == (10.0, 120)
    assert "the time of day (hours and minutes) without a date" in said(recording)


def test_a_zone_does_not_date_a_time_of_day(open_text) -> None:
    """The option is said not to be used."""
    recording = open_text(table(clock(60, 10)), options=ReadOptions(zone="Europe/Berlin")).read(OP)
    assert recording.start is None
    assert "zone = 'Europe/Berlin' is not used: The times have no date" in said(recording)


def autumn(count: int) -> list[str]:
    """Local times every ten minutes over the end of summer time."""
    start, zone = datetime(2026, 10, 24, 23, tzinfo=UTC), ZoneInfo("Europe/Berlin")
    steps = (start + timedelta(minutes=10 * i) for i in range(count))
    return [step.astimezone(zone).strftime("%Y-%m-%d %H:%M:%S") for step in steps]


@pytest.mark.parametrize("order", [1, -1])
def test_both_passes_of_the_repeated_hour_are_kept_without_a_zone(open_text, order: int) -> None:
    """One even step back by an hour is the clock's; the passes do not overwrite each other, also
    where the newest row is the first."""
    recording = open_text(table(autumn(30)[::order])).read(OP)
    assert recording.op.values.tolist() == [i + 0.5 for i in range(30)][::order]
    assert (recording.clock.repeated_times, recording.start) == (0, None)
    assert "the rows after it are taken as an hour later" in said(recording)


def test_both_passes_are_kept_for_each_tag(open_text) -> None:
    """Tags one after the other step back each by themselves."""
    rows = [f"{time},{tag},{i}\n" for tag in ("OP", "PV") for i, time in enumerate(autumn(30))]
    recording = open_text("Time,Tag,Value\n" + "".join(rows)).read(BOTH)
    for signal in recording.signals.values():
        assert signal.values.tolist() == [float(i) for i in range(30)]


def test_two_steps_back_are_no_clock_change(open_text) -> None:
    """Files that were joined out of order are left as they are."""
    times = autumn(24)
    recording = open_text(table([*times, *times[12:]])).read(OP)
    assert "an hour later" not in said(recording)


@pytest.mark.parametrize(
    ("header", "per_second", "digits"), [("Time (min)", 1 / 60, 4), ("t [h]", 1 / 3600, 6)]
)
def test_the_interval_that_is_shown_is_the_one_that_is_used(
    open_text, header: str, per_second: float, digits: int
) -> None:
    """Rounded times: the inspection says the grid's interval, not one of the rounded steps."""
    times = [f"{10 * i * per_second:.{digits}f}" for i in range(900)]
    source = open_text(table(times, f"{header},OP"))
    assert source.read(OP).interval_s == pytest.approx(10.0, rel=1e-9)
    seen = source.inspect()
    assert seen.interval_s == pytest.approx(10.0, rel=1e-9)
    assert [tag.interval_s for tag in seen.tags] == pytest.approx([10.0], rel=1e-9)


def test_a_file_without_times_says_who_gave_the_interval(open_text) -> None:
    """A column, or the user, and where both do, that they differ."""
    text = "Sampling time (s),OP\n" + "".join(f"12,{i + 0.5}\n" for i in range(60))
    by_file = open_text(text).read(OP)
    assert "12 s apart, as column 'Sampling time (s)' says" in said(by_file)
    given = open_text(text, "b.csv", ReadOptions(interval_s=10.0)).read(OP)
    assert "10 s apart, as given" in said(given)
    assert "column 'Sampling time (s)' says 12 s between rows, interval_s 10 s" in said(given)


HEADS = ["Time,OP,Time,PV", "Time,OP,Time.1,PV", "OP,,PV,"]


@pytest.mark.parametrize("heads", HEADS)
def test_tags_with_times_of_their_own(open_text, heads: str) -> None:
    """Each tag has the times to its left, and as many as it has; headings may stand over times."""
    begin = datetime(2026, 2, 17, 8)
    rows = []
    for i in range(100):
        at = begin + timedelta(seconds=10 * i)
        pv = f"{at + timedelta(seconds=20)},{i + 0.25}" if i < 90 else ","
        rows.append(f"{at},{i + 0.5},{pv}\n")
    recording = open_text(f"{heads}\n" + "".join(rows)).read(BOTH)
    assert recording.op.values.tolist() == [i + 0.5 for i in range(100)]
    pv = recording.signals[Role.PV].values
    assert pv[2:92].tolist() == [i + 0.25 for i in range(90)]
    assert np.isnan(pv[:2]).all()
    assert "each tag has the times of the one to its left" in said(recording)


def test_a_second_stamp_of_each_row_times_no_tag(open_text) -> None:
    """The time at which a server stored the row is not the value's."""
    rows = [
        f"2026-02-17 08:{i:02d}:00,2026-02-17 08:{i:02d}:30,{i + 0.5},2026-02-17 09:00:00,{i}\n"
        for i in range(60)
    ]
    recording = open_text("Time,Stored,OP,Changed,PV\n" + "".join(rows)).read(BOTH)
    assert recording.signals[Role.PV].values.tolist() == [float(i) for i in range(60)]
    assert "time columns" not in said(recording)


def test_quoted_commas_alone_are_not_taken_for_thousands(open_text) -> None:
    """44,532 in every cell may be a decimal comma; beside whole numbers it counts thousands."""
    rows = "".join(f'2026-02-17 08:{i:02d},"44,{500 + i}"\n' for i in range(60))
    with pytest.raises(UnreadableSource, match="say decimal="):
        open_text("Time,OP\n" + rows).read(OP)
    beside = "".join(f'2026-02-17 08:{i:02d},"44,{500 + i}",{900 + i}\n' for i in range(60))
    recording = open_text("Time,OP,PV\n" + beside, "b.csv").read(OP)
    assert recording.op.values[0] == 44500.0


def test_a_tag_with_attributes_is_several_tags(open_text) -> None:
    """OP and PV of one controller stand below each other under its name."""
    rows = [
        f"FIC1,2026-02-17 08:{i:02d}:00,{name},{i + add}\n"
        for i in range(60)
        for name, add in (("OP", 0.5), ("PV", 100.25))
    ]
    source = open_text("TagName,DateTime,Attribute,Value\n" + "".join(rows))
    assert [tag.tag for tag in source.inspect().tags] == ["FIC1.OP", "FIC1.PV"]
    tags = {Role.OP: TagMapping(tag="FIC1.OP"), Role.PV: TagMapping(tag="FIC1.PV")}
    recording = source.read(ValveTags(valve="FIC1", tags=tags))
    assert recording.interval_s == 60.0
    assert recording.signals[Role.PV].values.tolist() == [i + 100.25 for i in range(60)]


def test_a_turned_table_says_so(open_text) -> None:
    """Times beside each other in the first line."""
    times = [f"2026-02-17 08:{i:02d}" for i in range(50)]
    text = f"Time,{','.join(times)}\nOP,{','.join(map(str, range(50)))}\n"
    with pytest.raises(UnreadableSource, match="Turn the table"):
        open_text(text).read(OP)


def test_times_of_an_unknown_form_ask_for_it(open_text) -> None:
    """A zone that nobody knows; with the form they are read. A text mark is no part of a time."""
    times = [f"2026-02-17 08:{i:02d}:00" for i in range(60)]
    text = table([f"{time} EST" for time in times])
    with pytest.raises(UnreadableSource, match=r"'2026-02-17 08:00:00 EST' is no time .*format"):
        open_text(text).read(OP)
    options = ReadOptions(time_column="Time", time_format="%Y-%m-%d %H:%M:%S EST")
    assert open_text(text, "b.csv", options).read(OP).interval_s == 60.0
    assert open_text(table([f"'{time}" for time in times]), "c.csv").read(OP).interval_s == 60.0
