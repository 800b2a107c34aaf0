"""``Authentication``: who sent a request, whether their permissions allow it, and the entry in the
audit log. ``SecurityMiddleware`` calls it before every route.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from datetime import datetime, timedelta
from urllib.parse import parse_qs, urlencode

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.requests import Request, cookie_parser
from starlette.responses import RedirectResponse, Response
from starlette.types import Scope

from stemwatch.service.access.permissions import PERMISSIONS, SCOPE_OF, CurrentUser, Operation
from stemwatch.service.access.sessions import user_of_cookie
from stemwatch.service.access.tokens import user_of_environment, user_of_token
from stemwatch.service.store.accounts.records import AuditEntry, AuditOutcome
from stemwatch.service.store.errors import StoreError
from stemwatch.service.web.auth.current_user import address_of, state_of
from stemwatch.service.web.auth.proxy_user import HOW, NotAUser, ProxySignIn
from stemwatch.service.web.auth.route_permissions import RoutePermissions
from stemwatch.service.web.auth.session_cookie import cookie_name
from stemwatch.service.web.path_prefix import own_path, root_of
from stemwatch.service.web.site import Site

log = logging.getLogger(__name__)

SAFE = ("GET", "HEAD", "OPTIONS")
BY_ITSELF = "x-stemwatch-refresh"  # requests that a page makes without user action
AWAY = "The database does not answer; the page is there again when it does."
NOBODY = "Sign in, or send a token as Authorization: Bearer."
BAD_TOKEN = "This token lets nobody in: it is unknown, has run out or was revoked."
_ONCE_IN = timedelta(minutes=1)
_MOST_ADDRESSES = 1000

# A request, a status and a sentence, as a page or as JSON.
Answer = Callable[[Request, int, str], Response]


class Authentication:
    """Accepts requests to ``site`` or answers them with a refusal."""

    def __init__(self, site: Site, permissions: RoutePermissions, answer: Answer) -> None:
        self._site, self._permits, self._answer = site, permissions, answer
        self._proxy = _proxy_of(site)
        self._said: dict[str, datetime] = {}  # when an unknown client at an address was last logged
        self._lock = threading.Lock()

    async def admit(self, scope: Scope) -> Response | None:
        """``None`` for a request that may go on, else the refusal."""
        operation = self._permits.of(scope)
        scope["state"] = {**scope.get("state", {}), "operation": operation}
        self._look_for_proxy(scope)
        if PERMISSIONS[operation].least is None:
            return None
        request, headers = Request(scope), Headers(scope=scope)
        try:
            current_user = await run_in_threadpool(self._user_of, scope, headers)
        except StoreError as error:
            log.warning("%s %s: %s", scope["method"], scope["path"], error)
            return self._answer(request, 503, AWAY)
        except NotAUser as error:
            await run_in_threadpool(self._note_stranger, scope, str(error))
            return self._answer(request, 403, str(error))
        if current_user is None:
            await run_in_threadpool(self._note_not_signed_in, scope, headers)
            return self._not_signed_in(request, headers)
        state_of(scope)["current_user"] = current_user
        if current_user.may(operation):
            return None
        await self.note(scope, 403)
        return self._answer(request, 403, _lacking(current_user, operation))

    def _look_for_proxy(self, scope: Scope) -> None:
        """Log that a proxy is not trusted: all users behind it are then counted as one address."""
        plant = self._site.plant
        if plant is None or plant.service.trusted_proxies:
            return
        if any(name == b"x-forwarded-for" for name, _ in scope["headers"]):
            log.warning(
                "%s sends X-Forwarded-For and is not believed: name it in trusted_proxies of "
                "[service] if it is your proxy",
                address_of(scope),
            )

    async def note(self, scope: Scope, status: int) -> None:
        """Write the audit log, where the request wanted to change something or was refused."""
        state = state_of(scope)
        current_user: CurrentUser | None = state.get("current_user")
        if (
            current_user is None
            or state.get("noted")
            or (scope["method"] in SAFE and status != 403)
        ):
            return
        state["noted"] = True
        outcome = AuditOutcome.DONE if status < 400 else AuditOutcome.FAILED
        entry = AuditEntry(
            at=self._site.clock(),
            who=current_user.name,
            how=current_user.signed_in_by,
            address=address_of(scope),
            action=state["operation"].value,
            about=_subject_of(scope),
            outcome=AuditOutcome.REFUSED if status == 403 else outcome,
            detail="" if status < 400 else f"answered {status}",
        )
        await run_in_threadpool(self._write, entry)

    def _user_of(self, scope: Scope, headers: Headers) -> CurrentUser | None:
        now = self._site.clock()
        secret = self._token_in(headers)
        if secret is not None:
            return user_of_environment(secret, self._site.token) or user_of_token(
                self._site.store, secret, now
            )
        if self._proxy is not None:
            named = self._proxy.user(self._site.store, scope, now)
            if named is not None:
                return named
        cookie = cookie_parser(headers.get("cookie", "")).get(cookie_name(scope), "")
        if not cookie:
            return None
        active = BY_ITSELF not in headers
        return user_of_cookie(self._site.store, cookie, now, active=active)

    def _token_in(self, headers: Headers) -> str | None:
        """The token that a request shows, empty where it is none; ``None`` where it shows none.

        Where a proxy signs people in, what is not ``Bearer`` (``Basic``, ``Negotiate``) is what it
        was told itself and passes on.
        """
        if "authorization" not in headers:
            return None
        scheme, _, token = headers["authorization"].strip().partition(" ")
        if scheme.casefold() == "bearer":
            return token.strip()
        return None if self._proxy is not None else ""

    def _not_signed_in(self, request: Request, headers: Headers) -> Response:
        """To the login where a person opens a page, else 401 with a sentence."""
        by_hand = request.method in ("GET", "HEAD") and BY_ITSELF not in headers
        wants_page = "text/html" in headers.get("accept", "")
        sent_token = self._token_in(headers) is not None
        if by_hand and wants_page and not sent_token:
            path = own_path(request.scope)
            requested_address = f"{path}?{request.url.query}" if request.url.query else path
            query = "" if requested_address == "/" else f"?{urlencode({'next': requested_address})}"
            return RedirectResponse(f"{root_of(request.scope)}/login{query}", 303)
        text = BAD_TOKEN if sent_token else NOBODY
        answer = self._answer(request, 401, text)
        answer.headers["www-authenticate"] = 'Bearer realm="stemwatch"'
        return answer

    def _note_not_signed_in(self, scope: Scope, headers: Headers) -> None:
        """Log invalid tokens and changes without authentication, at most once a minute for an
        address, so that unknown clients cannot fill the log."""
        sent_token = self._token_in(headers) is not None
        if not sent_token and scope["method"] in SAFE:
            return
        credentials = "a bad token" if sent_token else ""
        self._once_a_minute(scope, credentials, "answered 401; noted once a minute")

    def _note_stranger(self, scope: Scope, reason: str) -> None:
        """Log a user named by a proxy who has no access, at most once a minute."""
        self._once_a_minute(scope, HOW, f"{reason} Noted once a minute.")

    def _once_a_minute(self, scope: Scope, credentials: str, detail: str) -> None:
        """Log a refusal, at most once a minute for an address."""
        now, address = self._site.clock(), address_of(scope)
        with self._lock:
            if now - self._said.get(address, now - 2 * _ONCE_IN) < _ONCE_IN:
                return
            if len(self._said) >= _MOST_ADDRESSES:
                self._said.clear()
            self._said[address] = now
        self._write(
            AuditEntry(
                at=now,
                who="",
                how=credentials,
                address=address,
                action=state_of(scope)["operation"].value,
                outcome=AuditOutcome.REFUSED,
                detail=detail,
            )
        )

    def _write(self, entry: AuditEntry) -> None:
        try:
            self._site.store.audit.add(entry)
        except StoreError as error:  # the service's log has the error
            log.error("not in the audit log: %s (%s)", entry, error)


def _proxy_of(site: Site) -> ProxySignIn | None:
    """Sign-in by a proxy's header; ``None`` unless the plant file switches it on."""
    if site.plant is None or not site.plant.service.user_header:
        return None
    service = site.plant.service
    return ProxySignIn(service.user_header, service.trusted_proxies, service.user_header_role)


def _lacking(current_user: CurrentUser, operation: Operation) -> str:
    """The missing role or scope, in words."""
    right = PERMISSIONS[operation]
    if right.least is None or current_user.role.rank < right.least.rank:
        return (
            f"To {operation} needs the role {right.least}; {current_user.name} is "
            f"{current_user.role}. An admin can change that."
        )
    if right.in_person:
        return "This is done signed in with a password, not with a token."
    return f"To {operation} a token needs the scope {SCOPE_OF[right.least]}; this one lacks it."


def _subject_of(scope: Scope) -> str:
    """What a request is about: what its route said, and the ``id`` of its address."""
    query = parse_qs(scope.get("query_string", b"").decode("latin-1"))
    numbers = [f"id {number}" for number in query.get("id", ())[:1]]
    subject = state_of(scope).get("about", "")
    return "; ".join(part for part in (subject, *numbers) if part)
