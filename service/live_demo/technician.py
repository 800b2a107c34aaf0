"""What the demo does to its valves: one begins to wear, and what is recorded as done is done."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Iterable

from stemwatch.service.modbus_plant import PlantServer, Wear
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.store import Store

log = logging.getLogger(__name__)

_LOOK_S = 0.5


class Technician:
    """Sees in ``store`` which of ``valves`` somebody has newly recorded maintenance of.

    What was recorded before the fitter came is not done again. Raises ``StoreError``.
    """

    def __init__(self, store: Store, valves: Iterable[str]) -> None:
        self._store = store
        self._done = {valve: len(store.maintenance(valve)) for valve in valves}

    def look(self) -> list[str]:
        """The valves with maintenance that is new since the last look. Raises ``StoreError``."""
        worn = []
        for valve, done in self._done.items():
            recorded = len(self._store.maintenance(valve))
            if recorded > done:
                worn.append(valve)
            self._done[valve] = recorded
        return worn

    async def calls(self) -> AsyncIterator[str]:
        """The valves that have to be repaired, for ever; while the database is away it waits."""
        while True:
            await asyncio.sleep(_LOOK_S)
            try:
                worn = await asyncio.to_thread(self.look)
            except StoreError as error:
                log.warning("recorded maintenance cannot be read: %s", error)
                continue
            for valve in worn:
                yield valve


async def repair_what_is_recorded(
    technician: Technician, server: PlantServer, told: Callable[[str], object]
) -> None:
    """Repair each valve of ``server`` that ``technician`` is called to, for ever.

    A repaired valve wears no more. ``told`` is called with its tag.
    """
    async for tag in technician.calls():
        server.repair(tag, lasting=True)
        told(tag)


async def wear_once_known(
    store: Store, server: PlantServer, tag: str, wear: Wear, told: Callable[[str], object]
) -> None:
    """Let the valve ``tag`` wear as soon as ``store`` has a baseline of it, however long the
    service takes for its first verdict: what it wears from has to be known.

    ``told`` is called with its tag when it begins. Raises ``StoreError``.
    """
    while await asyncio.to_thread(store.baseline, tag) is None:
        await asyncio.sleep(_LOOK_S)
    server.begin_wear(tag, wear)
    told(tag)
