"""Users and their attempts to sign in, changed by several people at once."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from threading import Barrier, BrokenBarrierError

import pytest
from sqlalchemy import event, text
from sqlalchemy.exc import OperationalError

from stemwatch.service.store.accounts.records import User, UserRole
from stemwatch.service.store.accounts.users import LastAdmin
from stemwatch.service.store.store import Store, open_store

NOW = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
Change = Callable[[Store, User], object]


def demote(store: Store, user: User) -> object:
    """Take the rights of an admin."""
    return store.accounts.set_role(user.id, UserRole.VIEWER)


def disable(store: Store, user: User) -> object:
    """Let the user in no more."""
    return store.accounts.disable(user.id, NOW)


@pytest.mark.parametrize("changes", [(demote, demote), (disable, disable), (demote, disable)])
def test_two_admins_who_take_each_others_rights_leave_one(
    store: Store, store_url: str, changes: tuple[Change, Change]
) -> None:
    """Whoever is second is refused, although both saw two admins at the beginning."""
    admins = [
        store.accounts.add(name, UserRole.ADMIN, "hash", added_by="", now=NOW)
        for name in ("Ann", "Ben")
    ]
    both_decided = Barrier(2)

    def wait_for_the_other(_: object) -> None:
        with suppress(BrokenBarrierError):  # the other waits for this one, as it should
            both_decided.wait(timeout=1.0)

    def change(at: int) -> bool:
        with open_store(store_url) as own:
            event.listen(own.transactions.writers, "commit", wait_for_the_other)
            try:
                changes[at](own, admins[at])
            except LastAdmin:
                return False
            return True

    with ThreadPoolExecutor(2) as pool:
        assert sorted(pool.map(change, range(2))) == [False, True]
    left = [user for user in store.accounts.all() if user.role is UserRole.ADMIN]
    assert sum(user.disabled is None for user in left) == 1


@pytest.mark.postgres
def test_attempts_are_locked_in_one_order(new_database: Callable[[str], str]) -> None:
    """A login that ends waits for the address before it touches the name, as one that begins does:
    otherwise each would wait for the other."""
    waits = {"address 192.0.2.1": lambda count: timedelta(0), "name x": lambda count: timedelta(0)}
    with open_store(new_database("postgresql")) as store, ThreadPoolExecutor(1) as pool:
        store.attempts.begin(waits, now=NOW, forget=timedelta(hours=1))
        with store.transactions.readers.connect() as begun:
            begun.execute(text("SELECT * FROM login_attempts WHERE key LIKE 'addr%' FOR UPDATE"))
            ending = pool.submit(store.attempts.succeeded, "name x", ["address 192.0.2.1"])
            with store.transactions.readers.connect() as looking:
                waiting = "SELECT count(*) FROM pg_locks WHERE NOT granted"
                until = time.monotonic() + 30.0
                while not looking.execute(text(waiting)).scalar():
                    assert time.monotonic() < until, "the login that ends waits for nothing"
                    looking.rollback()
            try:
                begun.execute(text("SELECT * FROM login_attempts FOR UPDATE NOWAIT"))
            except OperationalError:
                pytest.fail("the name is locked although the address is waited for")
            finally:
                begun.rollback()
        ending.result(timeout=30.0)
