"""Databases that older versions wrote: they open, and nothing is lost on the way, or back."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest
from sqlalchemy import text

from stemwatch.models.verdict import Verdict
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.migrations.migrate import (
    downgrade,
    newest_revision,
    take_back,
    upgrade,
)
from stemwatch.service.store.store import open_store
from tests.service.store.older_databases import AT_US, REVISIONS, contents, database_at

NEWEST = newest_revision()


@pytest.mark.parametrize("revision", REVISIONS)
def test_a_database_of_an_older_version_opens(store_url: str, revision: str) -> None:
    """Whatever version wrote it: valves, screenings, baselines and samples are read, and what
    comes next gets a number of its own."""
    with database_at(store_url, revision):
        pass
    with open_store(store_url) as store:
        assert [valve.id for valve in store.valves()] == ["FIC-101", "FIC-1ü2"]
        (latest,) = [
            screening for valve in store.valves() for screening in store.screenings(valve.id, 1)
        ]
        assert latest.verdict is Verdict.HEALTHY
        assert latest.provenance.decisions == ("comma", "ü")
        assert store.run(1).counts == {Verdict.STICKY: 1}
        if revision >= "0002":
            assert store.baseline("FIC-101") is not None
        if revision >= "0003":
            (tag,) = store.samples.tags("tags source 1 ü")
            assert store.samples.read(tag.source, tag.name).values.tolist() == [41.25]
        assert store.begin_run(software_version="2") == 3


@pytest.mark.parametrize("revision", REVISIONS)
def test_up_and_down_again_gives_every_value_back(store_url: str, revision: str) -> None:
    """From any older schema to the newest and back: each table is as it was, to the last value."""
    with database_at(store_url, revision) as engine:
        before = contents(engine)
        upgrade(engine, DatabaseUrl(store_url))
        downgrade(engine, revision)
        assert before == contents(engine)


def test_down_and_up_again_keeps_what_the_older_schema_holds(store_url: str) -> None:
    """From the newest schema down and up: nothing is lost but the evidence of windows, what OP and
    PV alone say, why there is no verdict, histograms, what is asked of a window, what people found,
    pictures, oscillations, site, unit and loop of valves, and how many samples of a file were too
    old, which only it has; views and the layout of samples come back."""
    with database_at(store_url, NEWEST) as engine:
        before = contents(engine)
        downgrade(engine, "0004")
        upgrade(engine, DatabaseUrl(store_url))
        after = contents(engine)
    newer_columns = (
        "evidence",
        "without_position",
        "histograms",
        "open_question",
        "position_question",
        "no_verdict",
    )
    for column in newer_columns:
        assert before["screenings"].pop(column) != after["screenings"].pop(column)
    assert before["taken_files"].pop("too_old") != after["taken_files"].pop("too_old")
    for column in ("site", "unit", "loop"):
        assert before["valves"].pop(column) != after["valves"].pop(column)
    for newer in ("feedback", "pictures", "oscillations"):
        assert before.pop(newer) != after.pop(newer)
    assert before == after


def test_a_file_whose_samples_were_too_old_may_come_again_after_the_upgrade(
    store_url: str,
) -> None:
    """Until schema 0012 only the note said that the samples of a file would be removed again."""
    note = "9 samples of 1 tags; all of them are older than keep_samples_days = 30 days, and"
    with database_at(store_url, "0011") as engine, engine.begin() as connection:
        chosen = "(SELECT min(digest) FROM taken_files)"
        connection.execute(
            text(f"UPDATE taken_files SET note = :note, accepted = true WHERE digest = {chosen}"),
            {"note": note},
        )
    with open_store(store_url) as store:
        assert [bool(file.too_old) for file in store.sources.files()].count(True) == 1


@pytest.mark.parametrize(
    ("sentence", "slug"),
    [
        ("Cannot tell: the position reading was frozen for 47 % of the time.", "position_frozen"),
        ("Cannot tell: 62 % of the samples are missing or marked bad.", "bad_samples"),
        ("Cannot tell: something else.", None),
    ],
    ids=["frozen", "bad", "other"],
)
def test_the_sentence_of_an_older_window_still_tells_why_there_is_no_verdict(
    store_url: str, sentence: str, slug: str | None
) -> None:
    """Until schema 0013 only the sentence said it; where it does not tell, nothing is stored."""
    with database_at(store_url, "0012") as engine:
        with engine.begin() as connection:
            connection.execute(
                text("UPDATE screenings SET verdict = 'undetermined', reason = :sentence"),
                {"sentence": sentence},
            )
        upgrade(engine, DatabaseUrl(store_url))
        assert set(contents(engine)["screenings"]["no_verdict"]) == {repr(slug)}


def test_each_table_of_the_newest_schema_has_rows(store_url: str) -> None:
    """The rows that these tests rely on are there: two in each table."""
    with database_at(store_url, NEWEST) as engine:
        result = contents(engine)
    assert {2} == {len(next(iter(columns.values()))) for columns in result.values()}
    assert len(result) > 15


def test_taking_the_schema_back_refuses_what_is_none(store_url: str) -> None:
    """A schema that does not exist, or that is newer than the present one, is named."""
    with database_at(store_url, "0002") as engine:
        with pytest.raises(StoreError, match=r"there is no schema 0999; 0001, 0002"):
            take_back(engine, DatabaseUrl(store_url), "0999")
        with pytest.raises(StoreError, match=r"has schema 0002, which is older already"):
            take_back(engine, DatabaseUrl(store_url), "0003")
        take_back(engine, DatabaseUrl(store_url), "0001")
        assert "networks" not in contents(engine)


def test_the_samples_of_the_fixture_are_of_march() -> None:
    """The instants in the rows are what their comment says."""
    assert datetime.fromtimestamp(AT_US / 1e6, UTC) == datetime(2026, 3, 1, 6, tzinfo=UTC)
