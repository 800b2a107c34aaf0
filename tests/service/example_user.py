"""Users with a known password, for tests; people get one-time links instead."""

from __future__ import annotations

from datetime import UTC, datetime

from stemwatch.service.access.links import check_name
from stemwatch.service.access.passwords import check_password, hash_password
from stemwatch.service.store.accounts.records import UserRole
from stemwatch.service.store.store import Store


def make_user(store: Store, name: str, password: str, role: str | UserRole) -> None:
    """Add a user with a password, which is checked as the pages do."""
    name = check_name(name)
    check_password(password, name)
    now = datetime.now(UTC)
    store.accounts.add(name, UserRole(role), hash_password(password), added_by="set-up", now=now)
