"""One-time links: the first admin, invitations, new passwords; each used once or never."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from urllib.parse import parse_qs, urlsplit

import pytest

from stemwatch.service.access.links import (
    BadName,
    InvalidLink,
    find_link,
    first_link,
    make_link,
    use_link,
)
from stemwatch.service.access.login import check
from stemwatch.service.access.passwords import WeakPassword
from stemwatch.service.access.sessions import begin_session, user_of_cookie
from stemwatch.service.store.accounts.records import OneTimeLinkKind, User, UserRole
from stemwatch.service.store.accounts.users import LastAdmin, NameTaken
from stemwatch.service.store.store import Store
from tests.service.access.conftest import NOW, PASSWORD
from tests.service.example_user import make_user

PAGES = "http://127.0.0.1:8300/"


def secret_of(link: str) -> str:
    """What a link holds."""
    return parse_qs(urlsplit(link).query)["link"][0]


def test_the_first_link_makes_the_first_admin_once(store: Store) -> None:
    """With name and password of their own; afterwards there is no such link any more."""
    link = first_link(store, PAGES)
    assert link.startswith("http://127.0.0.1:8300/welcome?link=")
    now = datetime.now(UTC)
    user = use_link(store, secret_of(link), "Karl Berg", PASSWORD, now)
    assert (user.name, user.role) == ("Karl Berg", UserRole.ADMIN)
    assert check(store, "Karl Berg", PASSWORD, now) is not None
    assert first_link(store, PAGES) is None
    with pytest.raises(InvalidLink):
        use_link(store, secret_of(link), "Second", PASSWORD, now)


def test_only_the_newest_first_link_lets_in_and_only_while_nobody_can(store: Store) -> None:
    """A link from an old log is worthless after a restart, or once there is a user."""
    old, new = first_link(store, PAGES), first_link(store, PAGES)
    now = datetime.now(UTC)
    with pytest.raises(InvalidLink):
        find_link(store, secret_of(old), now)
    assert find_link(store, secret_of(new), now).kind is OneTimeLinkKind.FIRST
    make_user(store, "Ann", PASSWORD, "viewer")
    with pytest.raises(InvalidLink):
        use_link(store, secret_of(new), "Karl", PASSWORD, now)


def test_a_link_opened_by_many_at_once_admits_one(store: Store) -> None:
    """Many threads use one link in the same instant under different names; exactly one succeeds."""
    secret = secret_of(first_link(store, PAGES))

    def open_it(number: int) -> bool:
        try:
            use_link(store, secret, f"Somebody {number}", PASSWORD, datetime.now(UTC))
        except InvalidLink:
            return False
        return True

    with ThreadPoolExecutor(4) as pool:
        assert sum(pool.map(open_it, range(4))) == 1
    assert len(store.accounts.all()) == 1


@pytest.mark.parametrize("after", [timedelta(days=3), timedelta(days=300)])
def test_an_invitation_runs_out(store: Store, ann: User, after: timedelta) -> None:
    """It holds for three days and gives the role that it was made with."""
    secret, _ = make_link(
        store, OneTimeLinkKind.INVITATION, UserRole.VIEWER, made_by="Ann", now=NOW
    )
    with pytest.raises(InvalidLink, match="Ask an admin"):
        use_link(store, secret, "Bob", PASSWORD, NOW + after)
    user = use_link(store, secret, "Bob", PASSWORD, NOW + timedelta(days=2))
    assert (user.role, user.created_by) == (UserRole.VIEWER, "Ann")


def test_an_invitation_can_be_withdrawn(store: Store, ann: User) -> None:
    """Withdrawing succeeds once; the second time there is no valid link."""
    secret, link = make_link(
        store, OneTimeLinkKind.INVITATION, UserRole.VIEWER, made_by="Ann", now=NOW
    )
    assert [access_link.id for access_link in store.access_links.open(NOW)] == [link.id]
    assert store.access_links.revoke(link.id, NOW)
    assert not store.access_links.revoke(link.id, NOW)
    with pytest.raises(InvalidLink):
        use_link(store, secret, "Bob", PASSWORD, NOW)


@pytest.mark.parametrize("name", ["ann berg", " ANN  BERG ", "Ann Berg"])
def test_a_name_is_taken_whatever_its_capitals(store: Store, ann: User, name: str) -> None:
    """And the link is as good as before, for another name."""
    secret, _ = make_link(
        store, OneTimeLinkKind.INVITATION, UserRole.VIEWER, made_by="Ann", now=NOW
    )
    with pytest.raises(NameTaken, match="choose another name"):
        use_link(store, secret, name, PASSWORD, NOW)
    assert use_link(store, secret, "Bob", PASSWORD, NOW).name == "Bob"


@pytest.mark.parametrize(
    ("name", "password", "error"),
    [
        ("", PASSWORD, BadName),
        ("x" * 81, PASSWORD, BadName),
        ("a\u202eb", PASSWORD, BadName),
        ("Bob", "short", WeakPassword),
    ],
)
def test_a_refused_name_or_password_leaves_the_link_valid(
    store: Store, ann: User, name, password, error
) -> None:
    """The refusal is a sentence, and the link can be used again."""
    secret, _ = make_link(
        store, OneTimeLinkKind.INVITATION, UserRole.VIEWER, made_by="Ann", now=NOW
    )
    with pytest.raises(error):
        use_link(store, secret, name, password, NOW)
    assert find_link(store, secret, NOW).is_open(NOW)


def test_a_link_for_a_password_changes_that_and_nothing_else(store: Store, ann: User) -> None:
    """The role stays, whatever name is sent; every session ends, and only the last link works."""
    cookie = begin_session(store, ann.id, now=NOW)
    created = [
        make_link(
            store, OneTimeLinkKind.PASSWORD, UserRole.ADMIN, made_by="A", now=NOW, user=ann.id
        )[0]
        for _ in range(2)
    ]
    with pytest.raises(InvalidLink):
        use_link(store, created[0], "Karl", "quite another phrase", NOW)
    user = use_link(store, created[1], "Karl", "quite another phrase", NOW)
    assert (user.name, user.role) == ("Ann Berg", UserRole.ENGINEER)
    assert check(store, "Ann Berg", PASSWORD, NOW) is None
    assert check(store, "Ann Berg", "quite another phrase", NOW) is not None
    assert user_of_cookie(store, cookie, NOW) is None


@pytest.mark.parametrize("secret", ["", "x", "x" * 43, "\ud800", "\x00", "' OR 1=1 --"])
def test_an_unknown_link_is_refused_like_a_used_one(store: Store, ann: User, secret: str) -> None:
    """The same sentence as for one that was used."""
    with pytest.raises(InvalidLink):
        find_link(store, secret, NOW)


def test_there_is_always_an_admin(store: Store, ann: User) -> None:
    """The last one can be neither disabled nor made less."""
    first = store.accounts.add("Karl", UserRole.ADMIN, "hash", added_by="test", now=NOW)
    for change in (
        lambda: store.accounts.disable(first.id, NOW),
        lambda: store.accounts.set_role(first.id, UserRole.VIEWER),
    ):
        with pytest.raises(LastAdmin, match="Karl is the only admin"):
            change()
    store.accounts.set_role(ann.id, UserRole.ADMIN)
    assert store.accounts.disable(first.id, NOW).disabled == NOW
