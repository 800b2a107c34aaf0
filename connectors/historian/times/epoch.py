"""Instants as nanoseconds since 1970 in UTC, and back."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def ns_of(instant: datetime | None) -> int | None:
    """Nanoseconds since 1970 UTC of an aware instant."""
    return None if instant is None else (instant - EPOCH) // timedelta(microseconds=1) * 1000


def instant_of(ns: int) -> datetime:
    """The instant of ``ns`` nanoseconds since 1970, in UTC, whole microseconds."""
    return EPOCH + timedelta(microseconds=ns // 1000)
