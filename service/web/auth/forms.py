"""Forms that change something: their secret token, which only our own pages contain, and checked
fields.

The token prevents a page of another site from sending a form in the name of the signed-in user
(cross-site request forgery).
"""

from __future__ import annotations

import hmac
from datetime import UTC, datetime, tzinfo
from typing import Annotated
from urllib.parse import parse_qs

from fastapi import Depends, HTTPException, Request, Response
from starlette.types import Scope

from stemwatch.service.access.random_secrets import new_secret
from stemwatch.service.access.sessions import form_token_of
from stemwatch.service.web.auth.current_user import current_user_of, note_about
from stemwatch.service.web.auth.session_cookie import is_secure

COOKIE = "stemwatch_form"  # for the pages that are open before anybody has signed in
FIELD = "mark"
MOST_TEXT = 2000
MOST_FIELDS = 400  # all alerts that a page shows, and what is done with them
NAMED_IN_AUDIT = ("how", "valve", "alert", "run", "area", "user", "role", "token", "name")
TOO_OLD = "This form is too old, or was not opened here. Open the page again and repeat."


class Form:
    """The fields of a form that was sent with its token."""

    def __init__(self, fields: dict[str, list[str]]) -> None:
        self._fields = fields

    def text(self, name: str, *, needed: str = "", longest: int = MOST_TEXT) -> str:
        """A field without blanks around it. ``needed`` is what an error says was expected."""
        text = (self._fields.get(name) or [""])[0].strip()
        if needed and not text:
            raise HTTPException(422, f"{needed} is needed")
        if len(text) > longest:
            raise HTTPException(422, f"{name}: {len(text)} characters, at most {longest} expected")
        return text

    def secret(self, name: str) -> str:
        """A password as it was typed, blanks and all; an error never shows it."""
        text = (self._fields.get(name) or [""])[0]
        if not text:
            raise HTTPException(422, "a password is needed")
        if len(text) > MOST_TEXT:
            raise HTTPException(422, f"a password of at most {MOST_TEXT} characters is expected")
        return text

    def all(self, name: str) -> list[str]:
        """Every value of a field that may be given more than once."""
        return self._fields.get(name, [])

    def typed(self) -> dict[str, list[str]]:
        """Every field as it was sent, for a page that shows a refused form again."""
        return dict(self._fields)

    def number(self, name: str, needed: str) -> int:
        """The whole number in a field; 422 with ``needed`` where there is none."""
        return _number(self.text(name, needed=needed), needed)

    def numbers(self, name: str, needed: str) -> list[int]:
        """One whole number or more, each once."""
        texts = [text.strip() for text in self.all(name)]
        if not any(texts):
            raise HTTPException(422, f"{needed} is needed")
        return list(dict.fromkeys(_number(text, needed) for text in texts))

    def instant(self, name: str, zone: tzinfo, now: datetime) -> datetime:
        """A local time of the plant, such as 2026-03-02T14:30, as UTC; ``now`` where empty."""
        text = self.text(name)
        if not text:
            return now
        try:
            parsed = datetime.fromisoformat(text)
        except ValueError:
            raise HTTPException(
                422, f"a time such as 2026-03-02 14:30 is needed, received {text!r}"
            ) from None
        local = parsed if parsed.tzinfo else parsed.replace(tzinfo=zone)
        try:
            return local.astimezone(UTC)
        except OverflowError:
            raise HTTPException(422, f"{text!r} is no time that a plant has known") from None


def _number(text: str, needed: str) -> int:
    if not text.isascii() or not text.isdigit() or len(text) > 18:
        raise HTTPException(422, f"{needed} is needed, received {text!r}")
    return int(text)


async def form_of(request: Request) -> Form:
    """The form in a request. Raises 403 where its token is not that of the reader's session."""
    current_user = current_user_of(request)
    return await _checked(request, "" if current_user is None else current_user.form_token)


async def open_form_of(request: Request) -> Form:
    """A form of a page that is open to everybody; its token belongs to a cookie of its own."""
    cookie = request.cookies.get(COOKIE, "")
    return await _checked(request, form_token_of(cookie) if cookie else "")


async def _checked(request: Request, token: str) -> Form:
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    if kind != "application/x-www-form-urlencoded":
        raise HTTPException(415, f"a form is expected, received {kind or 'no content type'!r}")
    try:
        text = (await request.body()).decode("utf-8")
        fields = parse_qs(text, keep_blank_values=True, max_num_fields=MOST_FIELDS)
    except ValueError:
        raise HTTPException(422, "the form is not readable as UTF-8 text") from None
    sent_token = (fields.pop(FIELD, None) or [""])[0]
    if not token or not hmac.compare_digest(sent_token.encode(), token.encode()):
        raise HTTPException(403, TOO_OLD)
    problems = [
        f"{name} {', '.join(value.strip()[:80] for value in fields[name])}"
        for name in NAMED_IN_AUDIT
        if any(fields.get(name, ()))
    ]
    note_about(request, "; ".join(problems))
    return Form(fields)


SentForm = Annotated[Form, Depends(form_of)]
SentOpenForm = Annotated[Form, Depends(open_form_of)]


def cookie_of(request: Request) -> str:
    """The reader's cookie for open forms, or a new one."""
    return request.cookies.get(COOKIE) or new_secret()


def set_cookie(response: Response, cookie: str, scope: Scope) -> None:
    """Give the reader the cookie that open forms are checked against; no script can read it."""
    secure = is_secure(scope)
    response.set_cookie(COOKIE, cookie, httponly=True, samesite="strict", secure=secure, path="/")
