"""What is asked of a password, and how it is kept."""

from __future__ import annotations

from unittest.mock import Mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.service.access import passwords
from stemwatch.service.access.passwords import (
    SHORTEST,
    UNUSED_HASH,
    WeakPassword,
    check_password,
    hash_password,
    matches,
    needs_rehash,
)
from stemwatch.service.web.auth.proxy_user import NO_PASSWORD
from tests.service.access.conftest import PASSWORD


@pytest.fixture
def hashed(real_passwords: None) -> str:
    """The hash of ``PASSWORD`` as the product makes it."""
    return hash_password(PASSWORD)


@pytest.mark.parametrize(
    ("password", "text"),
    [
        ("short", "12 to 200 characters"),
        ("x" * 201, "12 to 200 characters"),
        ("aaaaaaaaaaaaaa", "easily guessed"),
        ("Password123456", "easily guessed"),
        ("stemwatch1234", "easily guessed"),
        ("Karl Berg Karl Berg", "easily guessed"),
        ("karl berg 2026", "easily guessed"),
    ],
)
def test_a_weak_password_is_refused_with_what_is_expected(password: str, text: str) -> None:
    """Too short, too long, a name, a usual word, or one sign again and again."""
    with pytest.raises(WeakPassword, match=text):
        check_password(password, "Karl Berg")


@pytest.mark.parametrize(
    "password", [PASSWORD, "Föhn über dem Kühlturm", "猫が弁の上で眠っている夜です"]
)
def test_several_words_are_taken_in_any_script(password: str) -> None:
    """No rule about capitals, digits or special characters."""
    check_password(password, "Karl Berg")
    with pytest.raises(WeakPassword):
        check_password(password[: SHORTEST - 1], "Karl Berg")


@given(st.text(max_size=SHORTEST - 1))
def test_every_short_password_is_refused(password: str) -> None:
    """Whatever its characters."""
    with pytest.raises(WeakPassword):
        check_password(password, "")


def test_a_password_matches_its_own_hash_alone(hashed: str) -> None:
    """However it was typed (composed or not), and no other one does; the hash does not show it."""
    assert matches(PASSWORD, hashed)
    assert not matches(PASSWORD + " ", hashed)
    assert PASSWORD not in hashed
    assert hashed.startswith("$argon2id$v=19$m=65536,t=3,p=4$")
    composed, apart = "Bo\u0308schung am Su\u0308dtor", "B\u00f6schung am S\u00fcdtor"
    assert matches(composed, hash_password(apart))


def test_the_hash_for_unknown_names_takes_as_long_as_a_real_one(hashed: str) -> None:
    """Same parameters and lengths, so that a name that is unknown cannot be told by the time."""
    assert not needs_rehash(UNUSED_HASH)
    assert len(UNUSED_HASH) == len(hashed)
    assert not matches(PASSWORD, None)


@pytest.mark.parametrize("stored", ["damaged", NO_PASSWORD, None])
def test_who_has_no_password_cannot_be_told_from_a_wrong_one(stored, monkeypatch) -> None:
    """Nobody is let in, without an error, and a hash is worked out all the same."""
    hasher = Mock(wraps=passwords._HASHER)
    monkeypatch.setattr(passwords, "_HASHER", hasher)
    assert not matches(PASSWORD, stored)
    hasher.verify.assert_called_once_with(passwords.UNUSED_HASH, PASSWORD)
