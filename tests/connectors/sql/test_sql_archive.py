"""A history in SQLite and in PostgreSQL: the same recording, never a write, never a secret."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text

from stemwatch.connectors.connector import (
    ConnectorError,
    TagInfo,
    TagMapping,
    UnknownTag,
    UnreadableSource,
    ValveTags,
    Window,
)
from stemwatch.connectors.historian import HistorianFile, ReadOptions
from stemwatch.connectors.secret import Secret
from stemwatch.connectors.sql.database import Database
from stemwatch.connectors.sql.query_rows import mistake_in
from stemwatch.models.recording import Role
from tests.connectors import example_archives as made
from tests.connectors.sql.conftest import QUERY, address

HOUR = Window(start=made.START, stop=made.START + timedelta(hours=1))


def test_it_gives_what_the_text_export_gives(history_url: str, tmp_path: Path) -> None:
    """The whole history and a window of it, in chunks of any size."""
    from_csv = HistorianFile(made.write_csv(tmp_path / "export.csv")).read(made.valve())
    for chunk in (7, 20_000):
        archive = address(history_url, chunk=chunk).open()
        made.same(from_csv, archive.read(made.valve()))
        made.same(from_csv, archive.read(made.valve(), HOUR))


def test_text_values_are_read_as_in_a_text_export(tmp_path: Path) -> None:
    """A column of texts with words between its numbers is read as a text export is."""
    url = f"sqlite:///{tmp_path / 'texts.db'}"
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text("CREATE TABLE history (tag, time, value, quality)"))
        into = text("INSERT INTO history VALUES ('A.OP', :time, :value, NULL)")
        rows = [
            {
                "time": (made.START + timedelta(seconds=i)).isoformat(sep=" "),
                "value": "Bad" if i == 3 else (float(i % 9) if i < 5 else str(i % 9)),
            }
            for i in range(300)
        ]
        connection.execute(into, rows)
    engine.dispose()
    op = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="A.OP")})
    recording = address(url).open().read(op)
    assert recording.op.quality[:6].tolist() == [0, 0, 0, 2, 0, 0]
    assert recording.op.values[[0, 4, 8, 9]].tolist() == [0.0, 4.0, 8.0, 0.0]


def test_optional_tags_that_are_not_archived_are_left_out(history_url: str) -> None:
    """A set point that was never archived is no reason to read nothing; a position is."""
    tags = dict(made.valve().tags) | {Role.SP: TagMapping(tag="FIC1.SP")}
    archive = address(history_url).open()
    valve = ValveTags(valve="FIC1", tags=tags)
    assert set(archive.present(valve).tags) == {Role.OP, Role.MV, Role.PV}
    with pytest.raises(UnknownTag, match=r"no sample of 'FIC1\.SP' at any time.*'FIC1\.OP'"):
        archive.read(valve)


@pytest.mark.parametrize(
    "statement",
    ["DELETE FROM history", "UPDATE history SET value = 0", "CREATE TABLE other (a int)"],
)
def test_the_engine_itself_refuses_to_write(history_url: str, statement: str) -> None:
    """Even a statement that got past the template changes nothing."""
    database = Database(Secret(text=history_url), "historian", 60.0)
    assert database.only_reads
    with (
        pytest.raises(ConnectorError, match=r"read-only|readonly"),
        database.reading() as connection,
    ):
        connection.execute(text(statement))
    engine = create_engine(history_url)
    with engine.connect() as connection:
        assert connection.execute(text("SELECT COUNT(*) FROM history")).scalar() == 3 * 599
    engine.dispose()


def test_a_tag_is_bound_and_never_part_of_the_text(history_url: str) -> None:
    """A tag that tries to end the statement is a tag that is not there."""
    evil = "FIC1.OP'; DROP TABLE history; --"
    valve = ValveTags(valve="A", tags={Role.OP: TagMapping(tag=evil)})
    archive = address(history_url).open()
    with pytest.raises(UnknownTag):
        archive.read(valve)
    assert len(archive.read(made.valve())) == made.COUNT


@pytest.mark.parametrize(
    ("query", "result"),
    [
        ("DELETE FROM history", "begins with 'delete'"),
        (QUERY + "; DROP TABLE history", "several statements"),
        ("WITH gone AS (DELETE FROM history RETURNING *) " + QUERY, "the word 'delete'"),
        (QUERY.replace("SELECT", "SELECT nextval('a'),"), "the word 'nextval'"),
        (QUERY.replace(" FROM", " INTO other FROM"), "the word 'into'"),
        (QUERY + " FOR UPDATE", "the word 'update'"),
        (QUERY + " FOR SHARE", "a lock"),
        (QUERY.replace(":tag", "':tag'"), "the parameters :end, :start"),
        (QUERY.replace(":end", ":stop"), "the parameters :start, :stop, :tag"),
        ("", "begins with nothing"),
        (QUERY + " -- ; DROP", ""),
        (QUERY.replace(":tag", ":tag AND note <> 'drop; delete'"), ""),
        (QUERY.replace("value,", "value::float AS value,"), ""),
        ("/* for trends */ " + QUERY + ";", ""),
        (QUERY.replace("quality", '"update"'), ""),
    ],
)
def test_only_one_select_with_the_three_parameters_is_accepted(query: str, result: str) -> None:
    """One SELECT with the three parameters; words in quotes and comments are no statement."""
    fault = mistake_in(query)
    assert (fault is None) if not result else (fault is not None and result in fault.found)
    if result:
        with pytest.raises(UnreadableSource, match="the query cannot be used"):
            address("sqlite://", query=query or " ").open()


def test_local_times_use_the_given_zone_and_need_one_for_a_window(tmp_path: Path) -> None:
    """Local times count in the stated zone; without one a window cannot be placed."""
    from tests.connectors.sql.conftest import fill

    url = f"sqlite:///{tmp_path / 'local.db'}"
    fill(url)
    berlin = address(url, options=ReadOptions(zone="Europe/Berlin")).open()
    assert berlin.read(made.valve()).start == made.START - timedelta(hours=1)
    none = address(url, options=ReadOptions()).open()
    assert none.read(made.valve()).start is None
    with pytest.raises(ConnectorError, match="no zone"):
        none.read(made.valve(), HOUR)


@pytest.mark.postgres
def test_a_window_is_one_of_the_given_zone_whatever_the_clock_of_the_server(
    empty_postgres: str,
) -> None:
    """PostgreSQL would take a column without a zone for times of its own."""
    from tests.connectors.sql.conftest import fill

    fill(empty_postgres, "timestamp")
    own_zone = f"{empty_postgres}&options=-c%20TimeZone%3DAsia/Tokyo"
    berlin = address(own_zone, options=ReadOptions(zone="Europe/Berlin")).open()
    whole = berlin.read(made.valve())
    hour = Window(start=whole.start, stop=whole.start + timedelta(hours=1))
    made.same(whole, berlin.read(made.valve(), hour))


@pytest.mark.parametrize("columns", ["reading, time", "time, time"])
def test_what_is_no_sample_is_said_with_an_example(history_url: str, columns: str) -> None:
    """The columns in another order, or a value that is a time."""
    query = QUERY.replace("time, value, quality", columns.replace("reading", "value AS reading"))
    if history_url.startswith("sqlite"):
        query = query.replace("time FROM", "x'00ff' AS moment FROM")
    archive = address(history_url, query=query.replace("SELECT time,", "SELECT time AS t,")).open()
    with pytest.raises(ConnectorError, match=r"neither a number nor a text.*expected time, value"):
        archive.read(made.valve())


def listed(folder: Path, columns: str, rows: str) -> Sequence[TagInfo]:
    """What an archive lists whose query asks a table with these ``columns`` and ``rows``."""
    url = f"sqlite:///{folder / 'tags.db'}"
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text(f"CREATE TABLE tags ({columns})"))
        connection.execute(text(f"INSERT INTO tags VALUES {rows}"))
    engine.dispose()
    return address(url, tags_query=f"SELECT {columns} FROM tags").open().tags()


def test_a_list_of_tags_may_have_gaps(tmp_path: Path) -> None:
    """A row without a name is no tag, and what is no count counts nothing."""
    tags = listed(tmp_path, "tag, samples", "('A', 'many'), (NULL, 3), ('B', 7)")
    assert [(info.tag, info.samples) for info in tags] == [("A", 0), ("B", 7)]


def test_roles_and_valves_are_proposed_from_the_names_that_the_query_lists(tmp_path: Path) -> None:
    """As every other archive proposes them."""
    tags = listed(tmp_path, "tag, unit", "('FIC1.OP', '%'), ('FIC1.ZT', NULL)")
    assert [(info.tag, info.unit, info.proposed_role, info.proposed_valve) for info in tags] == [
        ("FIC1.OP", "%", Role.OP, "FIC1"),
        ("FIC1.ZT", "", Role.MV, "FIC1"),
    ]


def test_texts_are_compared_as_they_are_written(tmp_path: Path) -> None:
    """Texts with a T are not compared with bounds without one: rows would be lost in silence."""
    url = f"sqlite:///{tmp_path / 'iso.db'}"
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text("CREATE TABLE history (tag, time, value, quality)"))
        into = text("INSERT INTO history VALUES ('A.OP', :time, 1.0, 'Good')")
        times = [(made.START + timedelta(seconds=i)).isoformat() for i in range(300)]
        connection.execute(into, [{"time": time} for time in times])
    engine.dispose()
    op = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="A.OP")})
    with pytest.raises(ConnectorError, match=r"rows would be lost.*bounds_format"):
        address(url).open().read(op, HOUR)
    archive = address(url, bounds_format="%Y-%m-%dT%H:%M:%S").open()
    assert len(archive.read(op, HOUR)) == 300


def test_a_password_is_shown_nowhere(tmp_path: Path, monkeypatch) -> None:
    """Not in the address as it is logged, and not where the database cannot be reached."""
    url = "postgresql://reader:geheim@127.0.0.1:1/plant"
    result = address(url)
    assert "geheim" not in repr(result) + str(result)
    with pytest.raises(ConnectorError) as failed:
        result.open().read(made.valve())
    assert "did not answer" in str(failed.value)
    assert "geheim" not in str(failed.value)
    monkeypatch.delenv("HISTORY_URL", raising=False)
    by_name = address("", url=Secret(variable="HISTORY_URL"))
    assert pickle.loads(pickle.dumps(by_name)) == by_name
    with pytest.raises(ConnectorError, match="environment variable HISTORY_URL is not set"):
        by_name.open().read(made.valve())


def test_a_missing_database_or_driver_is_named(tmp_path: Path) -> None:
    """A SQLite file is never made, and a driver that is missing is named."""
    with pytest.raises(UnreadableSource, match=r"no file .*gone\.db"):
        address(f"sqlite:///{tmp_path / 'gone.db'}").open().read(made.valve())
    assert not (tmp_path / "gone.db").exists()
    with pytest.raises(UnreadableSource, match="cannot be used"):
        address("nosuch://host/db").open().read(made.valve())
