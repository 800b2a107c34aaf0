"""The first user, and users for tests and demonstrations."""

from __future__ import annotations

from datetime import UTC, datetime

from stemwatch.service.access.links import address_of, check_name, make_link
from stemwatch.service.access.passwords import check_password, hash_password
from stemwatch.service.store.accounts.records import OneTimeLinkKind, UserRole
from stemwatch.service.store.store import Store


def first_link(store: Store, base_url: str) -> str | None:
    """A one-time link at which the first admin chooses name and password; ``None`` where somebody
    can sign in already. It holds for 24 hours and takes the place of any before it."""
    if not store.accounts.is_empty():
        return None
    now = datetime.now(UTC)
    secret, _ = make_link(store, OneTimeLinkKind.FIRST, UserRole.ADMIN, by="", now=now)
    return address_of(secret, base_url)


def make_user(store: Store, name: str, password: str, role: str | UserRole) -> None:
    """A user with a password, for tests and demonstrations; people get one-time links instead.

    Raises ``WeakPassword``, ``BadName``, ``NameTaken``, and ``ValueError`` for a role that is none.
    """
    name = check_name(name)
    check_password(password, name)
    now = datetime.now(UTC)
    store.accounts.add(name, UserRole(role), hash_password(password), by="set-up", now=now)
