"""One-time links with which people choose their own passwords."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from urllib.parse import urlencode

from stemwatch.service.access.passwords import check_password, hash_password
from stemwatch.service.access.random_secrets import digest_of, new_secret
from stemwatch.service.store.accounts.records import OneTimeLink, OneTimeLinkKind, User, UserRole
from stemwatch.service.store.storable import clean_text
from stemwatch.service.store.store import Store

PATH = "/welcome"
LIFETIMES = {
    OneTimeLinkKind.FIRST: timedelta(hours=24),
    OneTimeLinkKind.INVITATION: timedelta(days=3),
    OneTimeLinkKind.PASSWORD: timedelta(hours=24),
}
LONGEST_NAME = 80


class InvalidLink(Exception):
    """The one-time link was used or withdrawn, has expired, or is unknown."""

    def __init__(self) -> None:
        super().__init__(
            "This link has been used, has run out or was withdrawn. Ask an admin for a new one."
        )


class BadName(ValueError):
    """The name is not allowed; the text says what is expected."""


def address_of(secret: str, base_url: str) -> str:
    """The link as an address below ``base_url``."""
    return f"{base_url.rstrip('/')}{PATH}?{urlencode({'link': secret})}"


def make_link(
    store: Store,
    kind: OneTimeLinkKind,
    role: UserRole,
    *,
    made_by: str,
    now: datetime,
    user: int | None = None,
    note: str = "",
) -> tuple[str, OneTimeLink]:
    """Store a new one-time link; return its secret, which is not stored, and its record."""
    secret = new_secret()
    expires = now + LIFETIMES[kind]
    link = store.access_links.make(
        digest_of(secret),
        kind,
        role,
        made_by=made_by,
        now=now,
        expires=expires,
        user=user,
        note=note,
    )
    return secret, link


def first_link(store: Store, base_url: str) -> str | None:
    """A one-time link at which the first admin chooses name and password; ``None`` where a user
    exists already. It is valid for 24 hours and replaces any earlier one."""
    if not store.accounts.is_empty():
        return None
    now = datetime.now(UTC)
    secret, _ = make_link(store, OneTimeLinkKind.FIRST, UserRole.ADMIN, made_by="", now=now)
    return address_of(secret, base_url)


def find_link(store: Store, secret: str, now: datetime) -> OneTimeLink:
    """The record of a valid link. Raises ``InvalidLink``."""
    link = store.access_links.find(digest_of(secret)) if secret else None
    first = link is not None and link.kind is OneTimeLinkKind.FIRST
    if link is None or not link.is_open(now) or (first and not store.accounts.is_empty()):
        raise InvalidLink
    return link


def use_link(store: Store, secret: str, name: str, password: str, now: datetime) -> User:
    """Use a link: add a new user, or set a new password of the user it was made for.

    Raises ``InvalidLink``, ``BadName``, ``WeakPassword``, ``NameTaken``; after the last three the
    link remains valid.
    """
    link = find_link(store, secret, now)
    digest = digest_of(secret)
    if link.kind is OneTimeLinkKind.PASSWORD:
        owner = store.accounts.get(link.user_id or 0)
        check_password(password, "" if owner is None else owner.name)
        user = store.accounts.new_password_by_link(digest, hash_password(password), now)
    else:
        name = check_name(name)
        check_password(password, name)
        user = store.accounts.add_by_link(digest, name, hash_password(password), now)
    if user is None:
        raise InvalidLink
    return user


def check_name(name: str) -> str:
    """The name with blanks collapsed. Raises ``BadName``."""
    single_spaced = " ".join(clean_text(name).split())
    if not single_spaced or len(single_spaced) > LONGEST_NAME or not single_spaced.isprintable():
        raise BadName(f"a name of 1 to {LONGEST_NAME} letters is expected")
    return single_spaced
