"""Instants as the table of samples keeps them: microseconds since 1970 in UTC."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICRO = timedelta(microseconds=1)


def microseconds(instant: datetime) -> int:
    """Microseconds since 1970 UTC."""
    return (instant - EPOCH) // _MICRO


def instant_of(at_us: int) -> datetime:
    """The instant of so many microseconds since 1970, in UTC."""
    return EPOCH + at_us * _MICRO
