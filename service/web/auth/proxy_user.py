"""Sign-in by a header of a trusted proxy (single sign-on): off unless the plant file names the
header and the trusted proxies.

The proxy is recognised by the address of the connection itself, never by headers of the request.
That address is kept before ``X-Forwarded-For`` of a trusted proxy replaces the client's
(``keeping_peer``): afterwards nobody can tell whether the connection came from the proxy. A request
with the user header twice names nobody.
"""

from __future__ import annotations

import ipaddress
import logging
from collections.abc import Sequence
from datetime import datetime, timedelta

from starlette.requests import cookie_parser
from starlette.types import ASGIApp, Receive, Scope, Send

from stemwatch.service.access.links import BadName, check_name
from stemwatch.service.access.permissions import CurrentUser
from stemwatch.service.access.sessions import form_token_of
from stemwatch.service.store.accounts.records import AuditEntry, User, UserRole
from stemwatch.service.store.accounts.users import NameTaken
from stemwatch.service.store.store import Store
from stemwatch.service.web.auth import forms

log = logging.getLogger(__name__)

HOW = "proxy"
NO_PASSWORD = "none: signed in by a proxy"  # no hash, so that no password fits it
NOTED_EVERY = timedelta(hours=1)  # resolution of the last sign-in, to avoid a write per request
_PEER = "stemwatch.peer"  # key of a request's scope


class NotAUser(Exception):
    """The proxy names somebody without access; the text says who and what to do."""


def keeping_peer(app: ASGIApp) -> ASGIApp:
    """``app``, told of each request from which address its connection came."""

    async def with_peer(scope: Scope, receive: Receive, send: Send) -> None:
        client = scope.get("client")
        scope[_PEER] = str(client[0]) if client else ""
        await app(scope, receive, send)

    return with_peer


class ProxySignIn:
    """Signs in the user that ``proxies`` (addresses or networks) name in ``header``.

    ``new_role`` is the role given to people who are not users yet; empty: they are refused.
    """

    def __init__(self, header: str, proxies: Sequence[str], new_role: str = "") -> None:
        self._header = header.lower().encode("ascii")
        self._proxies = tuple(ipaddress.ip_network(text) for text in proxies)
        self._new_role = UserRole(new_role) if new_role else None

    def user(self, store: Store, scope: Scope, now: datetime) -> CurrentUser | None:
        """Whom the proxy names; ``None`` where it names nobody or is no proxy of ours.

        Raises ``NotAUser`` and ``StoreError``.
        """
        named = [value for key, value in scope["headers"] if key.lower() == self._header]
        if not self._header or not named:
            return None
        if not self._trusts(_peer_of(scope)):
            log.warning(
                "%s sends the header %s and is not believed: it is not in trusted_proxies of "
                "[service]",
                _peer_of(scope) or "an unknown address",
                self._header.decode(),
            )
            return None
        if len(named) > 1:
            raise NotAUser(
                "The proxy names two users in one request: it must replace the header "
                f"{self._header.decode()} that comes from outside, not add to it."
            )
        user = self._known_user(store, _text(named[0]), _peer_of(scope), now)
        if user.last_login is None or now - user.last_login >= NOTED_EVERY:
            store.accounts.note_login(user.id, now)
        cookies = b"; ".join(value for key, value in scope["headers"] if key.lower() == b"cookie")
        cookie = cookie_parser(cookies.decode("latin-1")).get(forms.COOKIE, "")
        return CurrentUser(
            name=user.name,
            role=user.role,
            signed_in_by=HOW,
            user=user.id,
            form_token=form_token_of(cookie) if cookie else "",
        )

    def _trusts(self, peer: str) -> bool:
        try:
            address = ipaddress.ip_address(peer.partition("%")[0])
        except ValueError:
            return False
        if isinstance(address, ipaddress.IPv6Address) and address.ipv4_mapped is not None:
            address = address.ipv4_mapped
        return any(address in network for network in self._proxies)

    def _known_user(self, store: Store, name: str, peer: str, now: datetime) -> User:
        try:
            name = check_name(name)
        except BadName as error:
            raise NotAUser(f"The proxy names nobody who could be a user: {error}.") from None
        user = store.accounts.find(name)
        if user is None and self._new_role is not None:
            user = self._added(store, name, self._new_role, peer, now)
        if user is None:
            raise NotAUser(
                f"You are signed in as {name}, who is no user here yet. An admin invites users on "
                "the page Users."
            )
        if user.disabled is not None:
            raise NotAUser(f"You are signed in as {name}, who is disabled here. Ask an admin.")
        return user

    def _added(
        self, store: Store, name: str, role: UserRole, peer: str, now: datetime
    ) -> User | None:
        try:
            user = store.accounts.add(name, role, NO_PASSWORD, added_by=HOW, now=now)
        except NameTaken:  # added by a concurrent request
            return store.accounts.find(name)
        store.audit.add(
            AuditEntry(
                at=now,
                who=name,
                how=HOW,
                address=peer,
                action="become a user",
                about=f"user {name}; role {role}; named by the proxy",
            )
        )
        return user


def _text(value: bytes) -> str:
    """A header as text; what is no UTF-8 is no name."""
    try:
        return value.decode("utf-8").strip()
    except UnicodeDecodeError:
        return ""


def _peer_of(scope: Scope) -> str:
    """The address of the connection; empty where the server did not keep it."""
    return str(scope.get(_PEER, ""))
