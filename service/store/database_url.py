"""``DatabaseUrl``: the database's URL, shown only with its password masked."""

from __future__ import annotations

from stemwatch.connectors.secret import masked


class DatabaseUrl:
    """A database URL. ``str``, ``repr`` and formatting mask the password; ``reveal()`` gives the
    whole URL, for connecting only."""

    __slots__ = ("_url",)

    def __init__(self, url: str) -> None:
        self._url = url

    def reveal(self) -> str:
        """The URL with its password. Never print, log or store it."""
        return self._url

    def __str__(self) -> str:
        return masked(self._url)

    def __repr__(self) -> str:
        return f"DatabaseUrl({masked(self._url)!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DatabaseUrl) and self._url == other._url

    def __hash__(self) -> int:
        return hash(self._url)
