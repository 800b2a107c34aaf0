"""Signing in: the right password, every wrong one, and too many of them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta

import pytest
from argon2 import PasswordHasher
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.service.access import login
from stemwatch.service.access.known_browser import (
    KNOWN_FOR,
    key_of_browser,
    remember_browser,
)
from stemwatch.service.access.login import WRONG, LoginRefused, TooMany, confirm, sign_in
from stemwatch.service.access.sessions import user_of_cookie
from stemwatch.service.store.accounts.audit import AuditFilter
from stemwatch.service.store.accounts.records import User, UserRole
from stemwatch.service.store.store import Store
from tests.service.access.conftest import NOW, PASSWORD

HERE = "192.0.2.7"


def test_name_and_password_open_a_session(store: Store, ann: User) -> None:
    """Capitals and blanks of the name do not matter; the cookie finds the user again."""
    user, cookie = sign_in(store, "  ann BERG ", PASSWORD, now=NOW, address=HERE)
    assert (user.name, user.role) == ("Ann Berg", UserRole.ENGINEER)
    current_user = user_of_cookie(store, cookie, NOW)
    assert (current_user.name, current_user.role, current_user.signed_in_by) == (
        "Ann Berg",
        UserRole.ENGINEER,
        "session",
    )
    assert store.accounts.find("Ann Berg").last_login == NOW


def test_every_refusal_says_the_same(store: Store, ann: User) -> None:
    """A wrong password, a name that nobody has, a user who is disabled: one sentence."""
    store.accounts.add("Off", UserRole.VIEWER, "no hash", added_by="test", now=NOW)
    store.accounts.disable(store.accounts.find("Off").id, NOW)
    distinct = set()
    for name, password in (("Ann Berg", "x"), ("nobody", PASSWORD), ("Off", "x"), ("", "")):
        with pytest.raises(LoginRefused) as refused:
            sign_in(store, name, password, now=NOW, address=HERE)
        distinct.add(str(refused.value))
    assert distinct == {WRONG}


def test_who_is_disabled_is_refused_with_the_right_password_too(store: Store, ann: User) -> None:
    """And let in again once enabled."""
    store.accounts.disable(ann.id, NOW)
    with pytest.raises(LoginRefused, match=WRONG):
        sign_in(store, ann.name, PASSWORD, now=NOW, address=HERE)
    store.accounts.enable(ann.id)
    assert sign_in(store, ann.name, PASSWORD, now=NOW, address=HERE)


def fail(store: Store, name: str, times: int, address: str = HERE, at=NOW) -> list[int]:
    """The waits in seconds that so many wrong attempts came to; 0 where the password was tried."""
    waits = []
    for _ in range(times):
        try:
            sign_in(store, name, "wrong", now=at, address=address)
        except TooMany as error:
            waits.append(error.wait_s)
        except LoginRefused:
            waits.append(0)
    return waits


@pytest.mark.parametrize("name", ["Ann Berg", "nobody"])
def test_a_name_is_throttled_whether_or_not_somebody_has_it(
    store: Store, ann: User, name: str
) -> None:
    """After five attempts from any address, even the right password has to wait."""
    assert fail(store, name, 4) == [0, 0, 0, 0]
    assert fail(store, name, 2, "198.51.100.9") == [0, 1]
    if name == ann.name:
        with pytest.raises(TooMany):
            sign_in(store, name, PASSWORD, now=NOW, address=HERE)
        assert sign_in(store, name, PASSWORD, now=NOW + timedelta(seconds=2), address=HERE)
        assert fail(store, name, 4, at=NOW + timedelta(seconds=2)) == [0, 0, 0, 0]


def test_an_address_is_throttled_whatever_names_it_tries(store: Store, ann: User, monkeypatch):
    """And a name that is not tried from there is not kept out elsewhere."""
    monkeypatch.setattr(login, "FREE_OF_ADDRESS", 3)
    tried = [fail(store, f"name {number}", 1)[0] for number in range(5)]
    assert tried == [0, 0, 0, 1, 1]
    assert sign_in(store, ann.name, PASSWORD, now=NOW, address="198.51.100.9")


def test_many_attempts_at_once_are_many_attempts(store: Store, ann: User) -> None:
    """Of twelve in the same instant no more passwords are tried than one after the other."""
    with ThreadPoolExecutor(12) as pool:
        waits = list(pool.map(lambda _: fail(store, ann.name, 1)[0], range(12)))
    assert waits.count(0) == login.FREE_OF_NAME


@given(st.integers(0, 10_000))
def test_the_wait_grows_up_to_a_bound(count: int) -> None:
    """Never negative, never less after more, never beyond the bound."""
    for wait, longest in (
        (login.wait_for_name, login.LONGEST_OF_NAME),
        (login.wait_for_address, login.LONGEST_OF_ADDRESS),
    ):
        assert timedelta(0) <= wait(count) <= wait(count + 1) <= longest


@pytest.mark.parametrize(
    ("item", "other", "same"),
    [
        ("192.0.2.1", "192.0.2.2", False),
        ("2001:db8::1", "2001:db8::ffff", True),
        ("2001:db8:0:1::1", "2001:db8:0:2::1", False),
        ("::ffff:192.0.2.1", "192.0.2.1", True),
        ("fe80::1%eth0", "fe80::1", True),
        ("testclient", "other", False),
    ],
)
def test_ipv6_addresses_of_one_network_count_as_one(item: str, other: str, same: bool) -> None:
    """Of IPv6 the whole network that a machine may pick from."""
    assert (login.key_of_address(item) == login.key_of_address(other)) is same


def test_the_store_keeps_no_name_that_was_tried(store: Store) -> None:
    """A password typed into the field of the name is in no table."""
    fail(store, "my secret password", 1)
    assert "secret" not in login.key_of_name("my secret password")
    (entry,) = store.audit.read(AuditFilter())
    assert (entry.who, entry.about) == ("", "a name that nobody has")
    assert entry.outcome.value == "refused"


def test_good_and_bad_logins_are_in_the_audit_log(store: Store, ann: User) -> None:
    """With name, address and outcome."""
    fail(store, ann.name, 1)
    sign_in(store, ann.name, PASSWORD, now=NOW, address="198.51.100.9")
    matching = [
        (item.who, item.address, item.outcome.value) for item in store.audit.read(AuditFilter())
    ]
    assert matching == [("Ann Berg", "198.51.100.9", "done"), ("Ann Berg", HERE, "refused")]


def test_a_dated_hash_is_renewed_by_a_login(store: Store, real_passwords: None) -> None:
    """Parameters can be raised without anybody choosing a new password."""
    weak = PasswordHasher(time_cost=1, memory_cost=64, parallelism=1).hash(PASSWORD)
    store.accounts.add("Old", UserRole.VIEWER, weak, added_by="test", now=NOW)
    sign_in(store, "Old", PASSWORD, now=NOW, address=HERE)
    assert store.accounts.password_of("Old")[1].startswith("$argon2id$v=19$m=65536,t=3,p=4$")
    assert sign_in(store, "Old", PASSWORD, now=NOW, address=HERE)


def test_confirming_a_password_is_throttled_as_a_login_is(store: Store, ann: User) -> None:
    """A person at an unattended browser cannot guess the password without limit."""
    assert confirm(store, ann, PASSWORD, now=NOW, address=HERE)
    for _ in range(5):
        assert not confirm(store, ann, "wrong", now=NOW, address=HERE)
    with pytest.raises(TooMany):
        confirm(store, ann, PASSWORD, now=NOW, address=HERE)


def test_a_known_browser_is_not_locked_out_by_those_who_guess(store: Store, ann: User) -> None:
    """Whatever others try under the name and from the address, the owner's browser gets in at
    once; a browser of somebody else, or of a password before, waits as all do."""
    hashed = store.accounts.password_of(ann.name)[1]
    known = remember_browser("", hashed, NOW)
    others = remember_browser("", "the hash of another", NOW)
    assert fail(store, ann.name, 12).count(0) == 5
    for browser in ("", others, "rubbish", "a~1~b", f"{known}x", "~".join(["x", "9" * 400, "y"])):
        with pytest.raises(TooMany):
            sign_in(store, ann.name, PASSWORD, now=NOW, address=HERE, browser=browser)
    assert sign_in(store, ann.name, PASSWORD, now=NOW, address=HERE, browser=known)
    later = NOW + KNOWN_FOR
    assert key_of_browser(known, hashed, later - timedelta(seconds=2)) is not None
    assert key_of_browser(known, hashed, later) is None
    assert key_of_browser(known, "a new password's hash", NOW) is None


def test_guesses_in_a_known_browser_wait_too(store: Store, ann: User) -> None:
    """They are counted separately: they delay neither name nor address, and are not delayed by
    them."""
    known = remember_browser("", store.accounts.password_of(ann.name)[1], NOW)
    for _ in range(5):
        with pytest.raises(LoginRefused, match=WRONG):
            sign_in(store, ann.name, "wrong", now=NOW, address=HERE, browser=known)
    with pytest.raises(TooMany):
        sign_in(store, ann.name, PASSWORD, now=NOW, address=HERE, browser=known)
    assert sign_in(store, ann.name, PASSWORD, now=NOW, address=HERE)


def test_a_browser_knows_several_users() -> None:
    """A control room's machine: the newest eight, each once."""
    cookie = ""
    for number in [*range(10), 9, 9]:
        cookie = remember_browser(cookie, f"hash {number}", NOW)
    known = [n for n in range(10) if key_of_browser(cookie, f"hash {n}", NOW) is not None]
    assert known == list(range(2, 10))
    assert len(cookie.split(".")) == 8


def test_refused_guesses_are_one_entry_a_minute(store: Store, ann: User) -> None:
    """The entry has their number, so that a thousand guesses are visible and do not fill the
    log."""
    fail(store, ann.name, 45)
    fail(store, ann.name, 2, at=NOW + timedelta(seconds=62))
    entries = [item for item in store.audit.read(AuditFilter()) if "not tried" in item.detail]
    assert [entry.detail.split(" not tried")[0] for entry in entries] == [
        "40 attempts",
        "1 attempt",
    ]
    assert {(entry.who, entry.outcome.value) for entry in entries} == {(ann.name, "refused")}
