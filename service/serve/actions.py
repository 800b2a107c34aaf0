"""What readers of the pages may set off, with the runner woken at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from stemwatch.service.store.store import Store
from stemwatch.service.web.actions import Actions


class WakingActions(Actions):
    """As ``Actions``; a run that was asked for begins now and not at the runner's next look."""

    def __init__(self, store: Store, wake: Callable[[], None]) -> None:
        super().__init__(store)
        self._wake = wake

    def run_now(self, valves: Sequence[str], who: str) -> int | None:
        """Queue a run and wake the runner."""
        number = super().run_now(valves, who)
        self._wake()
        return number
