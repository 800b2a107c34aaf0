"""The Grafana dashboard in ``deploy/``: every query runs on a real database and finds something."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Connection, create_engine, make_url, text

from stemwatch.service.store.store import open_store
from tests.service.web.example_plant import NOW, SOURCE, STICKY, WATCH, fill, write_samples

GRAFANA = Path(__file__).parents[4] / "deploy" / "grafana"
DASHBOARD = json.loads((GRAFANA / "dashboards" / "stemwatch.json").read_text("utf-8"))
PANELS = {panel["title"] + f" ({panel['type']})": panel for panel in DASHBOARD["panels"]}
VARIABLES = {item["name"]: item for item in DASHBOARD["templating"]["list"]}
CHOSEN: dict[str, list[str]] = {
    "area": ["Area 100", "Area 200"],
    "valve": [STICKY, WATCH],
    "indicator": ["S_percent"],
    "source": [SOURCE],
    "tag": [f"{STICKY}.OP"],
}
FROM, TO = NOW - timedelta(days=90), datetime.now(UTC) + timedelta(hours=1)
pytestmark = pytest.mark.postgres


def expand(sql: str) -> str:
    """The query as Grafana's PostgreSQL data source sends it, for the macros used here."""
    for name, values in CHOSEN.items():
        quoted = ",".join("'" + value.replace("'", "''") + "'" for value in values)
        sql = sql.replace(f"${{{name}:sqlstring}}", quoted)
    first, last = (f"'{item:%Y-%m-%dT%H:%M:%SZ}'" for item in (FROM, TO))
    sql = re.sub(r"\$__timeFilter\(([\w.]+)\)", rf"\1 BETWEEN {first} AND {last}", sql)
    sql = re.sub(
        r"\$__timeGroupAlias\(([\w.]+), *'1d'\)",
        r'floor(extract(epoch from \1)/86400)*86400 AS "time"',
        sql,
    )
    sql = sql.replace("$__unixEpochFrom()", str(int(FROM.timestamp())))
    sql = sql.replace("$__unixEpochTo()", str(int(TO.timestamp())))
    sql = sql.replace("$__interval_ms", "60000")
    assert "$" not in sql, f"a macro that this test does not know: {sql}"
    return sql


@pytest.fixture(scope="module")
def plant_url(postgres_server: str) -> Iterator[str]:
    """A database with a plant in it, and the reader that ``reader.sql`` makes."""
    name = "stemwatch_grafana_test"
    admin = create_engine(postgres_server, isolation_level="AUTOCOMMIT")
    with admin.connect() as connection:
        connection.execute(text(f"CREATE DATABASE {name}"))
    url = make_url(postgres_server).set(database=name)
    try:
        with open_store(url.render_as_string(hide_password=False)) as store:
            fill(store)
            write_samples(store)
        owner = create_engine(url, isolation_level="AUTOCOMMIT")
        with owner.connect() as connection:
            for statement in _statements():
                connection.execute(text(statement))
        owner.dispose()
        yield url.set(username="stemwatch_reader").render_as_string(hide_password=False)
    finally:
        with admin.connect() as connection:
            connection.execute(text(f"DROP DATABASE {name} WITH (FORCE)"))
            connection.execute(text("DROP ROLE IF EXISTS stemwatch_reader"))
        admin.dispose()


def _statements() -> list[str]:
    """``reader.sql`` as psql would send it."""
    lines = (GRAFANA / "reader.sql").read_text("utf-8").splitlines()
    sql = "\n".join(line for line in lines if not line.startswith("--"))
    sql = sql.replace(":'password'", "'geheim'")
    return [item for item in sql.split(";") if item.strip()]


@pytest.fixture
def reader(plant_url: str) -> Iterator[Connection]:
    """A connection of the user that Grafana has."""
    engine = create_engine(plant_url)
    with engine.connect() as connection:
        yield connection
    engine.dispose()


def rows_of(reader: Connection, sql: str) -> tuple[list[str], list[dict[str, Any]]]:
    result = reader.exec_driver_sql(expand(sql).replace("%", "%%"))
    return list(result.keys()), [dict(row) for row in result.mappings()]


@pytest.mark.parametrize("title", PANELS)
def test_every_panel_finds_rows(reader: Connection, title: str) -> None:
    """Each query runs as the reader, finds rows, and has the columns that its format needs."""
    (target,) = PANELS[title]["targets"]
    assert target["datasource"]["uid"] == "stemwatch"
    columns, rows = rows_of(reader, target["rawSql"])
    assert rows
    if target["format"] == "time_series":
        assert columns == ["time", "metric", "value"]
        times = [row["time"] for row in rows]
        assert times == sorted(times)
        assert all(isinstance(row["metric"], str) for row in rows)
        assert all(row["value"] is not None for row in rows)


def test_the_panels_show_the_plants_numbers(reader: Connection) -> None:
    """The worst valve stands first with its S; the samples are those of the tag."""
    _, rows = rows_of(reader, PANELS["Worst valves (table)"]["targets"][0]["rawSql"])
    assert (rows[0]["valve"], rows[0]["verdict"], rows[0]["S, %"]) == (STICKY, "sticky", 4.0)
    assert {row["area"] for row in rows} <= set(CHOSEN["area"])
    _, points = rows_of(reader, PANELS["Samples of ${tag} (timeseries)"]["targets"][0]["rawSql"])
    assert 118 <= len(points) <= 122  # two hours by the minute
    assert all(41.9 <= point["value"] <= 58.1 for point in points)


@pytest.mark.parametrize("name", VARIABLES)
def test_every_variable_offers_what_can_be_chosen(reader: Connection, name: str) -> None:
    """The choices of this test are among those that the dashboard would offer."""
    columns, rows = rows_of(reader, VARIABLES[name]["query"])
    assert len(columns) == 1
    assert set(CHOSEN[name]) <= {row[columns[0]] for row in rows}


def test_the_annotations_find_runs(reader: Connection) -> None:
    """Annotations have a time and a text."""
    (item,) = DASHBOARD["annotations"]["list"]
    columns, rows = rows_of(reader, item["target"]["rawSql"])
    assert columns == ["time", "text"]
    assert rows


def test_every_query_asks_only_the_views() -> None:
    """Tables may change; the dashboard must not notice."""
    queries = [panel["targets"][0]["rawSql"] for panel in PANELS.values()]
    queries += [variable["query"] for variable in VARIABLES.values()]
    requested = {
        name for sql in queries for name in re.findall(r"\b(?:FROM|JOIN) +([a-z_0-9]+)", sql)
    }
    assert {name for name in requested if not re.fullmatch(r"stemwatch_[a-z]+_v1", name)} == set()


def test_the_reader_reads_views_and_nothing_else(
    reader: Connection,
) -> None:
    """Tables with names, hashes and networks are closed to it, and it writes nothing."""
    for forbidden in (
        "SELECT * FROM users", "SELECT * FROM networks", "DELETE FROM stemwatch_valves_v1"
    ):  # fmt: skip
        with pytest.raises(Exception, match=r"permission denied|read-only"):
            reader.execute(text(forbidden))
        reader.rollback()
