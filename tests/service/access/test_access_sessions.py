"""Sessions and their end; tokens and theirs."""

from __future__ import annotations

from datetime import timedelta

import pytest

from stemwatch.service.access.permissions import Operation
from stemwatch.service.access.sessions import (
    IDLE,
    LONGEST,
    begin_session,
    form_token_of,
    sessions_of,
    user_of_cookie,
)
from stemwatch.service.access.tokens import (
    BEGINS,
    MOST_OF_USER,
    BadToken,
    make_token,
    user_of_environment,
    user_of_token,
)
from stemwatch.service.store.accounts.records import Scope, User, UserRole
from stemwatch.service.store.store import Store, open_store
from tests.service.access.conftest import NOW

MINUTE = timedelta(minutes=1)


def test_a_session_and_its_forms_outlive_a_restart(store: Store, ann: User) -> None:
    """The store is opened anew: the same cookie is let in, the same form is taken."""
    cookie = begin_session(store, ann.id, now=NOW)
    before = user_of_cookie(store, cookie, NOW)
    with open_store(store.address) as repeated:
        after = user_of_cookie(repeated, cookie, NOW)
    assert before == after
    assert after.form_token == form_token_of(cookie)


def test_the_store_holds_no_cookie_and_no_token(store: Store, ann: User) -> None:
    """Neither a cookie nor an API token nor a form token can be read from the database."""
    cookie = begin_session(store, ann.id, now=NOW)
    token = make_token(store, ann, "script", [Scope.READ], now=NOW)
    (session,) = sessions_of(store, ann.id, NOW)
    (kept,) = store.api_tokens.all()
    assert user_of_cookie(store, session.digest, NOW) is None
    assert cookie not in repr(session)
    assert token not in repr(kept)
    assert token.startswith(kept.begins)
    assert len(token) - len(kept.begins) > 30


def test_a_session_ends_when_it_is_not_used(store: Store, ann: User) -> None:
    """Each use prolongs the session; requests that a page makes by itself do not."""
    cookie = begin_session(store, ann.id, now=NOW)
    later = NOW + IDLE - MINUTE
    assert user_of_cookie(store, cookie, later)
    assert user_of_cookie(store, cookie, later + IDLE - MINUTE, active=False)
    assert user_of_cookie(store, cookie, later + IDLE + MINUTE) is None


def test_a_session_ends_at_last_however_much_it_is_used(store: Store, ann: User) -> None:
    """After a week the password is asked for again."""
    cookie, at = begin_session(store, ann.id, now=NOW), NOW
    while at < NOW + LONGEST:
        assert user_of_cookie(store, cookie, at)
        at += IDLE / 2
    assert user_of_cookie(store, cookie, at) is None


def test_a_new_password_and_a_disabled_user_end_every_session(store: Store, ann: User) -> None:
    """At once, wherever they were begun."""
    for end in (
        lambda: store.accounts.set_password(ann.id, "hash", NOW),
        lambda: store.accounts.disable(ann.id, NOW),
    ):
        cookies = [begin_session(store, ann.id, now=NOW) for _ in range(3)]
        end()
        assert [user_of_cookie(store, cookie, NOW) for cookie in cookies] == [None] * 3
        store.accounts.enable(ann.id)


def test_other_sessions_can_be_ended_and_one_kept(store: Store, ann: User) -> None:
    """Those of other users stay as well."""
    bob = store.accounts.add("Bob", UserRole.VIEWER, "hash", added_by="test", now=NOW)
    kept, removed, his = (begin_session(store, who.id, now=NOW) for who in (ann, ann, bob))
    store.web_sessions.end_others(ann.id, user_of_cookie(store, kept, NOW).session)
    assert user_of_cookie(store, kept, NOW)
    assert user_of_cookie(store, removed, NOW) is None
    assert user_of_cookie(store, his, NOW)


def test_sessions_that_have_ended_are_forgotten(store: Store, ann: User) -> None:
    """The table does not grow for ever."""
    begin_session(store, ann.id, now=NOW)
    kept = begin_session(store, ann.id, now=NOW + IDLE)
    store.web_sessions.remove_ended(now=NOW + IDLE + MINUTE, idle=IDLE)
    (left,) = store.web_sessions.of_user(ann.id, now=NOW, idle=LONGEST)
    assert left.digest == user_of_cookie(store, kept, NOW + IDLE).session


def test_a_token_ends_with_its_time_its_user_and_by_hand(store: Store, ann: User) -> None:
    """Three ways, each at once."""
    token = make_token(store, ann, "script", [Scope.READ], now=NOW, days=7)
    assert user_of_token(store, token, NOW).name == "Ann Berg"
    assert user_of_token(store, token, NOW + timedelta(days=7)) is None
    store.accounts.disable(ann.id, NOW)
    assert user_of_token(store, token, NOW) is None
    store.accounts.enable(ann.id)
    assert user_of_token(store, token, NOW)
    store.api_tokens.revoke(store.api_tokens.all()[0].id, NOW)
    assert user_of_token(store, token, NOW) is None


def test_a_token_is_worth_no_more_than_its_user(store: Store, ann: User) -> None:
    """Neither when it is made nor when the user became less."""
    with pytest.raises(BadToken, match="scopes out of read, act"):
        make_token(store, ann, "script", [Scope.ADMIN], now=NOW)
    with pytest.raises(BadToken, match="scopes out of"):
        make_token(store, ann, "script", [], now=NOW)
    token = make_token(store, ann, "script", [Scope.READ, Scope.ACT], now=NOW)
    assert user_of_token(store, token, NOW).may(Operation.NOTE)
    store.accounts.set_role(ann.id, UserRole.VIEWER)
    assert not user_of_token(store, token, NOW).may(Operation.NOTE)
    assert user_of_token(store, token, NOW).may(Operation.READ)


def test_the_last_use_of_a_token_is_kept(store: Store, ann: User) -> None:
    """To the minute, so that reading does not mean writing each time."""
    token = make_token(store, ann, "script", [Scope.READ], now=NOW)
    user_of_token(store, token, NOW)
    user_of_token(store, token, NOW + timedelta(seconds=20))
    assert store.api_tokens.all()[0].last_used == NOW
    user_of_token(store, token, NOW + 2 * MINUTE)
    assert store.api_tokens.all()[0].last_used == NOW + 2 * MINUTE


def test_a_user_has_a_bounded_number_of_tokens(store: Store, ann: User) -> None:
    """Revoking one makes room again."""
    for number in range(MOST_OF_USER):
        make_token(store, ann, f"script {number}", [Scope.READ], now=NOW)
    with pytest.raises(BadToken, match="revoke one first"):
        make_token(store, ann, "one more", [Scope.READ], now=NOW)
    store.api_tokens.revoke(store.api_tokens.all()[0].id, NOW)
    assert make_token(store, ann, "one more", [Scope.READ], now=NOW).startswith(BEGINS)


def test_an_empty_or_short_environment_token_admits_nobody() -> None:
    """An empty or short one lets nobody in, whatever is sent."""
    for expected in ("", "short"):
        assert user_of_environment(expected, expected) is None
    assert user_of_environment("x" * 16, "x" * 16).role is UserRole.ENGINEER
    assert user_of_environment("x" * 15, "x" * 16) is None
