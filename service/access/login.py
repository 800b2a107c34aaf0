"""Signing in with name and password.

Neither the answer nor the time it takes tells whether the user exists. Attempts are throttled by
name and address, and recorded in the audit log.
"""

from __future__ import annotations

import ipaddress
import math
from collections.abc import Mapping
from datetime import datetime, timedelta

from stemwatch.service.access.known_browser import key_of_browser
from stemwatch.service.access.passwords import LONGEST, hash_password, matches, needs_rehash
from stemwatch.service.access.random_secrets import digest_of
from stemwatch.service.access.sessions import IDLE, begin_session
from stemwatch.service.store.accounts.login_attempts import Wait
from stemwatch.service.store.accounts.records import AuditEntry, AuditOutcome, User
from stemwatch.service.store.accounts.users import name_key
from stemwatch.service.store.store import Store

ACTION = "sign in"
WRONG = "Name or password is wrong."


class LoginRefused(Exception):
    """The sign-in failed; the text is for the person."""


class TooMany(LoginRefused):
    """Too many attempts; ``wait_s`` says how long to wait."""

    def __init__(self, wait_s: int) -> None:
        self.wait_s = wait_s
        super().__init__(f"Too many attempts to sign in. Try again in {wait_s} s.")


def sign_in(
    store: Store,
    name: str,
    password: str,
    *,
    now: datetime,
    address: str,
    agent: str = "",
    browser: str = "",
) -> tuple[User, str]:
    """Sign in; return the user and a new session's cookie. Raises ``LoginRefused``, ``Busy``.

    ``browser`` is the cookie of ``known_browser``: in a browser in which this user has signed in
    before, failed attempts of others with the name or address cause no wait.
    """
    stored_password = store.accounts.password_of(name) if browser else None
    browser_key = (
        None if stored_password is None else key_of_browser(browser, stored_password[1], now)
    )
    waits = waits_of(name, address) if browser_key is None else {browser_key: wait_for_name}
    _begin(store, name, waits, now, address)
    user = check(store, name, password, now)
    if user is None:
        _note(store, name, now, address, AuditOutcome.REFUSED)
        raise LoginRefused(WRONG)
    if browser_key is None:
        store.attempts.succeeded(key_of_name(name), [key_of_address(address)])
    else:
        store.attempts.succeeded(browser_key, [])
    cookie = begin_session(store, user.id, now=now, address=address, agent=agent)
    _note(store, name, now, address, AuditOutcome.DONE)
    store.web_sessions.remove_ended(now=now, idle=IDLE)
    store.attempts.remove_old(now - 2 * FORGET_AFTER)
    return user, cookie


def _begin(store: Store, name: str, waits: Mapping[str, Wait], now: datetime, address: str) -> None:
    """Count an attempt, or raise ``TooMany`` where it has to wait.

    Refused attempts are recorded in the audit log once in ``NOTED_EVERY``, with their number, so
    that thousands of guesses make one entry a minute.
    """
    until = store.attempts.begin(waits, now=now, forget=FORGET_AFTER)
    if until is None:
        return
    refused = store.attempts.refused(f"refused {key_of_name(name)}", now=now, interval=NOTED_EVERY)
    if refused:
        attempts = "1 attempt" if refused == 1 else f"{refused} attempts"
        detail = f"{attempts} not tried: too many before; noted once a minute"
        _note(store, name, now, address, AuditOutcome.REFUSED, detail)
    raise TooMany(max(1, math.ceil((until - now).total_seconds())))


def check(store: Store, name: str, password: str, now: datetime) -> User | None:
    """The user with this name and password; ``None`` where there is none or the user is disabled.
    Takes the same time in either case. Raises ``Busy``."""
    user_and_hash = store.accounts.password_of(name)
    password = password[: 4 * LONGEST]
    right = matches(password, None if user_and_hash is None else user_and_hash[1])
    if user_and_hash is None or not right or user_and_hash[0].disabled is not None:
        return None
    user, stored = user_and_hash
    store.accounts.note_login(
        user.id, now, hash_password(password) if needs_rehash(stored) else None
    )
    return user


def confirm(store: Store, user: User, password: str, *, now: datetime, address: str) -> bool:
    """Whether this is the password of a signed-in user; throttled as a sign-in is."""
    _begin(store, user.name, waits_of(user.name, address), now, address)
    user_and_hash = store.accounts.password_of(user.name)
    if user_and_hash is None or not matches(password[: 4 * LONGEST], user_and_hash[1]):
        return False
    store.attempts.succeeded(key_of_name(user.name), [key_of_address(address)])
    return True


def _note(
    store: Store,
    name: str,
    now: datetime,
    address: str,
    outcome: AuditOutcome,
    detail: str = "",
) -> None:
    """Add an audit entry; without the typed name where no user has it, as it may be a password."""
    user = store.accounts.find(name)
    store.audit.add(
        AuditEntry(
            at=now,
            who="" if user is None else user.name,
            how="",
            address=address,
            action=ACTION,
            about="" if user is not None else "a name that nobody has",
            outcome=outcome,
            detail="disabled" if user is not None and user.disabled is not None else detail,
        )
    )


NOTED_EVERY = timedelta(minutes=1)
FORGET_AFTER = timedelta(hours=1)  # without an attempt; counts then restart
FREE_OF_NAME, FREE_OF_ADDRESS = 5, 20
LONGEST_OF_NAME, LONGEST_OF_ADDRESS = timedelta(seconds=60), timedelta(seconds=300)
_IPV6_SITE = 64  # bits of the network prefix whose addresses all belong to one machine or site


def wait_after(count: int, free: int, longest: timedelta) -> timedelta:
    """No wait for the first ``free`` attempts, then 1 s, doubled with each, up to ``longest``."""
    if count < free:
        return timedelta(0)
    return min(longest, timedelta(seconds=2.0 ** min(count - free, 30)))


def wait_for_name(count: int) -> timedelta:
    """How long to wait after ``count`` failures with one user name."""
    return wait_after(count, FREE_OF_NAME, LONGEST_OF_NAME)


def wait_for_address(count: int) -> timedelta:
    """How long to wait after ``count`` failures from one address."""
    return wait_after(count, FREE_OF_ADDRESS, LONGEST_OF_ADDRESS)


def key_of_name(name: str) -> str:
    """The key of a name's count: a digest, since people type passwords into the wrong field."""
    return f"name {digest_of(name_key(name))}"


def key_of_address(address: str) -> str:
    """The key of an address's count; for IPv6 that of its /64 network."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return f"address {address}"
    if parsed.version == 6 and parsed.ipv4_mapped is None:
        return f"address {ipaddress.ip_network((parsed, _IPV6_SITE), strict=False)}"
    return f"address {parsed.ipv4_mapped or parsed if parsed.version == 6 else parsed}"


def waits_of(name: str, address: str) -> Mapping[str, Wait]:
    """The keys under which an attempt is counted, each with its rule for the wait after so many."""
    return {key_of_name(name): wait_for_name, key_of_address(address): wait_for_address}
