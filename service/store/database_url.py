"""Where the store is: a database URL whose password is never printed."""

from __future__ import annotations

import re
from collections.abc import Sequence

MASK = "***"

# Greedy up to the last @: a password may itself hold @ or /, and hiding too much is harmless.
_USER_PASSWORD = re.compile(r"(?P<before>://[^:@/?\s]*:)\S*(?=@)")
_SECRET_IN_QUERY = re.compile(
    r"(?P<before>[?&;](?:[\w-]*(?:password|passwd|passphrase|pwd|secret|token|key))=)[^&;\s]*", re.I
)
_SECRET_OPTION = re.compile(r"^(?P<before>-{1,2}[\w-]*(?:password|passwd|secret|token))(?P<eq>=?)")


def masked(text: str) -> str:
    """``text`` with the password of every database URL in it replaced by ``***``."""
    text = _USER_PASSWORD.sub(rf"\g<before>{MASK}", text)
    return _SECRET_IN_QUERY.sub(rf"\g<before>{MASK}", text)


def masked_command(arguments: Sequence[str]) -> str:
    """A command line as one text, without the passwords of URLs and the values of options such
    as ``--password`` and ``--token``."""
    words: list[str] = []
    hide_next = False
    for word in arguments:
        option = _SECRET_OPTION.match(word)
        if hide_next:
            words.append(MASK)
        elif option and option["eq"]:
            words.append(f"{option['before']}={MASK}")
        else:
            words.append(masked(word))
        hide_next = option is not None and not option["eq"] and not hide_next
    return " ".join(words)


class DatabaseUrl:
    """A database URL that shows itself with its password masked.

    ``str``, ``repr`` and every format give the masked form; ``reveal()`` gives the URL itself, for
    the one call that connects.
    """

    __slots__ = ("_url",)

    def __init__(self, url: str) -> None:
        self._url = url

    def reveal(self) -> str:
        """The URL with its password. Not to be printed, logged or stored."""
        return self._url

    def __str__(self) -> str:
        return masked(self._url)

    def __repr__(self) -> str:
        return f"DatabaseUrl({masked(self._url)!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DatabaseUrl) and self._url == other._url

    def __hash__(self) -> int:
        return hash(self._url)
