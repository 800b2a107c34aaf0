"""Windows as an address gives them: checked, and with a sentence where they make no sense."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from fastapi import HTTPException

from stemwatch.service.web.signals import LONGEST, Asked

EARLIEST, LATEST = datetime(1970, 1, 1, tzinfo=UTC), datetime(2200, 1, 1, tzinfo=UTC)
SHORTEST = timedelta(seconds=1)


def asked_of(valve: str, start: datetime, stop: datetime) -> Asked:
    """The window from ``start`` to ``stop``. Raises 422 where it is empty, too long or nowhere."""
    if not (EARLIEST <= start <= LATEST and EARLIEST <= stop <= LATEST):
        raise HTTPException(422, f"a window between {EARLIEST.year} and {LATEST.year} is expected")
    if stop - start < SHORTEST:
        raise HTTPException(422, "a window that ends at least a second after it begins is expected")
    if stop - start > LONGEST:
        raise HTTPException(
            422, f"at most {LONGEST.days} days are drawn at once; received {(stop - start).days}"
        )
    return Asked(valve=valve, start=start.astimezone(UTC), stop=stop.astimezone(UTC))
