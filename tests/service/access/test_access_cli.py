"""``stemwatch accounts``: links and users from the machine itself."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

import pytest

from stemwatch.service.access.links import use_link
from stemwatch.service.store.accounts.audit import AuditFilter
from stemwatch.service.store.accounts.records import UserRole
from stemwatch.service.store.store import open_store
from tests.service.access.conftest import PASSWORD
from tests.service.conftest import stemwatch as stemwatch
from tests.service.example_user import make_user


@pytest.fixture
def url(tmp_path: Path) -> str:
    """Where an empty database is."""
    return f"sqlite:///{tmp_path / 'store.db'}"


def secret_in(text: str) -> str:
    """The secret of the link that a command printed."""
    return re.search(r"/welcome\?link=([\w-]{43})", text)[1]


def test_the_first_admin_gets_a_new_link_until_there_is_one(stemwatch, url: str) -> None:
    """A new link can be printed until an admin exists; afterwards the command refers to another
    one."""
    open_store(url).close()
    outcome = stemwatch("accounts", "first-link", "--db", url, "--address", "https://valves/")
    assert outcome.status == 0
    assert "https://valves/welcome?link=" in outcome.said
    with open_store(url) as store:
        use_link(store, secret_in(outcome.said), "Karl", PASSWORD, datetime.now(UTC))
    outcome = stemwatch("accounts", "first-link", "--db", url)
    assert outcome.status == 2
    assert "accounts reset" in outcome.said


def test_a_link_leads_to_where_the_plant_file_says_the_pages_are(
    stemwatch, url: str, tmp_path: Path
) -> None:
    """Whoever gets it sits at another computer; --address says otherwise, and without either it is
    this machine's."""
    open_store(url).close()
    plant = tmp_path / "plant.toml"
    plant.write_text(
        f'[storage]\nurl = "{url}"\n[service]\naddress = "https://valves.plant.example/"\n'
        '[[sources]]\nname = "h"\npath = "*.csv"\n'
        '[[valves]]\nid = "FIC-1"\nsource = "h"\ntags.op = {tag = "FIC-1.OP"}\n',
        encoding="utf-8",
    )
    for command in (("first-link",), ("add", "Bob")):
        said = stemwatch("accounts", *command, "--plant", plant).said
        assert "https://valves.plant.example/welcome?link=" in said
        other = ("--address", "https://other/")
        assert (
            "https://other/welcome?link="
            in stemwatch("accounts", *command, "--plant", plant, *other).said
        )
        assert (
            "http://127.0.0.1:8300/welcome?link="
            in stemwatch("accounts", *command, "--db", url).said
        )


def test_links_roles_and_the_end_of_access(stemwatch, url: str) -> None:
    """Each command does what its help says, and is in the audit log."""
    with open_store(url) as store:
        make_user(store, "Karl", PASSWORD, UserRole.ADMIN)
        make_user(store, "Ann", PASSWORD, "viewer")
    added = stemwatch("accounts", "add", "Bob", "--role", "engineer", "--db", url)
    with open_store(url) as store:
        bob = use_link(store, secret_in(added.said), "Bob", PASSWORD, datetime.now(UTC))
    assert bob.role is UserRole.ENGINEER
    reset = stemwatch("accounts", "reset", "ann", "--db", url)
    with open_store(url) as store:
        ann = use_link(store, secret_in(reset.said), "", "one more phrase", datetime.now(UTC))
    assert ann.name == "Ann"
    assert stemwatch("accounts", "set-role", "Ann", "admin", "--db", url).status == 0
    assert stemwatch("accounts", "disable", "Bob", "--db", url).status == 0
    text = stemwatch("accounts", "list", "--db", url).said
    assert "Ann: admin" in text
    assert "Bob: engineer, disabled, not signed in with a password yet" in text  # by a link he was
    assert stemwatch("accounts", "enable", "Bob", "--db", url).status == 0
    with open_store(url) as store:
        assert len(store.audit.read(AuditFilter(action="manage users"))) == 5


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("list",), "--plant plant.toml or --db URL"),
        (("reset", "Nobody", "--db", "{url}"), "there is no user 'Nobody'; nearest: 'Karl'"),
        (("add", "--role", "boss", "--db", "{url}"), "viewer, engineer, admin is expected"),
        (("disable", "Karl", "--db", "{url}"), "the only admin"),
    ],
)
def test_a_wrong_command_says_what_is_expected(stemwatch, url: str, words, text: str) -> None:
    """The message says what is expected, and the status is 2."""
    with open_store(url) as store:
        make_user(store, "Karl", PASSWORD, "admin")
    outcome = stemwatch("accounts", *(word.format(url=url) for word in words))
    assert outcome.status == 2
    assert text in outcome.said
