"""Passwords are printed nowhere."""

from __future__ import annotations

import pickle
import traceback

import pytest

from stemwatch.connectors.secret import masked, masked_command
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.store import open_store

WITH_PASSWORD = [
    "postgresql://watch:geheim@db.plant/stemwatch",
    "postgresql+psycopg://watch:geheim@db.plant:5432/stemwatch?sslmode=require",
    "postgresql://watch:ge/geheim@geheim@db.plant/stemwatch",
    "postgresql://watch:geheim?x@db.plant/stemwatch",
    "postgresql://db.plant/stemwatch?user=watch&password=geheim",
    "postgresql:///stemwatch?sslpassword=geheim&user=watch",
    "host=db.plant user=watch password=geheim dbname=stemwatch",
    "password='geheim geheim' host=db.plant",
]


@pytest.mark.parametrize("url", WITH_PASSWORD)
def test_an_address_shows_itself_masked(url: str) -> None:
    """However the address is turned into text, the password is not in it; ``reveal`` has it."""
    address = DatabaseUrl(url)
    for shown in (str(address), repr(address), f"{address:}", f"{[address]}"):
        assert "geheim" not in shown
        assert "***" in shown
    assert url == address.reveal()
    assert address == pickle.loads(pickle.dumps(address))


@pytest.mark.parametrize(
    "url", ["sqlite:///stemwatch.db", "postgresql://watch@db.plant/stemwatch", "sqlite://"]
)
def test_an_address_without_a_password_is_shown_whole(url: str) -> None:
    """Only secrets are hidden."""
    assert url == str(DatabaseUrl(url))


def test_the_masked_form_still_says_which_store_it_is() -> None:
    """User, host and database stay readable."""
    assert "postgresql://watch:***@db.plant/stemwatch" == masked(WITH_PASSWORD[0])


@pytest.mark.parametrize("password", ["ge@heim", "ge/heim", "ge#heim", "ge@he/im#"])
def test_a_password_that_cuts_the_address_is_told_without_a_part_of_it(password: str) -> None:
    """What follows the letter would be taken for the host, and shown in the error of the name that
    is not found."""
    pytest.importorskip("psycopg")
    with pytest.raises(StoreError, match=r"watch:\*\*\*@db\.plant/.*%40 for @.*PGPASSWORD") as told:
        open_store(f"postgresql://watch:{password}@db.plant/stemwatch")
    assert "heim" not in str(told.value)


@pytest.mark.parametrize("url", WITH_PASSWORD[:2])
def test_a_server_that_does_not_answer_is_named_without_its_password(url: str) -> None:
    """The error of a failed connection holds no password, in its text or its traceback."""
    pytest.importorskip("psycopg")
    silent = url.replace("db.plant:5432", "db.plant").replace("db.plant", "127.0.0.1:9")
    with pytest.raises(StoreError, match=r"127\.0\.0\.1:9/.*: opening the store failed") as caught:
        open_store(silent)
    assert "geheim" not in "".join(traceback.format_exception(caught.value))


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["screen", "plant.toml"], "screen plant.toml"),
        (["--url=postgresql://u:geheim@h/d"], "--url=postgresql://u:***@h/d"),
        (["--password", "geheim", "--jobs", "2"], "--password *** --jobs 2"),
        (["--db-password=geheim"], "--db-password=***"),
        (["--token", "--geheim", "x"], "--token *** x"),
    ],
)
def test_a_command_line_loses_its_secrets(words: list[str], expected: str) -> None:
    """URLs and options that carry a secret are masked, the rest is kept word for word."""
    assert expected == masked_command(words)
