"""Wear and repair of the demo's valves: one wears, and recorded maintenance repairs its valve."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Iterable

from stemwatch.service.modbus_plant import PlantServer, Wear
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.store import Store

log = logging.getLogger(__name__)

_LOOK_S = 0.5


class RecordedMaintenance:
    """Watches ``store`` for newly recorded maintenance of ``valves``.

    Maintenance recorded before this object was created does not count. Raises ``StoreError``.
    """

    def __init__(self, store: Store, valves: Iterable[str]) -> None:
        self._store = store
        self._done = {valve: len(store.maintenance(valve)) for valve in valves}

    def look(self) -> list[str]:
        """The valves with maintenance that is new since the last call. Raises ``StoreError``."""
        to_repair = []
        for valve, repaired_at in self._done.items():
            recorded = len(self._store.maintenance(valve))
            if recorded > repaired_at:
                to_repair.append(valve)
            self._done[valve] = recorded
        return to_repair

    async def calls(self) -> AsyncIterator[str]:
        """Valves with new maintenance, without end; database errors are logged and retried."""
        while True:
            await asyncio.sleep(_LOOK_S)
            try:
                to_repair = await asyncio.to_thread(self.look)
            except StoreError as error:
                log.warning("recorded maintenance cannot be read: %s", error)
                continue
            for valve in to_repair:
                yield valve


async def repair_recorded_valves(
    maintenance: RecordedMaintenance, server: PlantServer, on_news: Callable[[str], object]
) -> None:
    """Repair each valve of ``server`` with newly recorded maintenance, without end.

    A repaired valve no longer wears. ``on_news`` is called with its tag.
    """
    async for tag in maintenance.calls():
        server.repair(tag, lasting=True)
        on_news(tag)


async def wear_after_baseline(
    store: Store, server: PlantServer, tag: str, wear: Wear, on_news: Callable[[str], object]
) -> None:
    """Start the wear of valve ``tag`` once ``store`` has a baseline of it, which the drift is
    measured against.

    ``on_news`` is called with the tag when the wear starts. Raises ``StoreError``.
    """
    while await asyncio.to_thread(store.baseline, tag) is None:
        await asyncio.sleep(_LOOK_S)
    server.begin_wear(tag, wear)
    on_news(tag)
