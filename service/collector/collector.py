"""``Collector``: polls all devices, writes samples to the spool at once, and stores them."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Iterable
from queue import SimpleQueue

from stemwatch.connectors.modbus import Device, DevicePoller, SampleBatch
from stemwatch.connectors.modbus.device_state import DeviceState
from stemwatch.service.collector.forwarder import Forwarder, ForwarderState, SampleSink
from stemwatch.service.collector.spool import Spool

log = logging.getLogger(__name__)

GATHER_S = 0.5  # how long samples are gathered before they are stored together
_IN_MEMORY = 2000  # batches kept in memory, at most, while the disk cannot be written


class Collector:
    """Polls ``devices`` and brings their samples through ``spool`` to ``sink``.

    Polling (an event loop), appending to the spool (a thread) and storing (a thread) do not wait
    for one another. A device that hangs, an unavailable store or a slow disk therefore does not
    delay the polls of other devices.
    """

    def __init__(
        self,
        devices: Iterable[Device],
        sink: SampleSink,
        spool: Spool,
        *,
        gather_s: float = GATHER_S,
    ) -> None:
        self.dropped = 0  # samples lost because disk and memory were full
        self._spool = spool
        self._queue: SimpleQueue[SampleBatch | None] = SimpleQueue()
        self._pollers = [DevicePoller(device, self._queue.put) for device in devices]
        self._forwarder = Forwarder(spool, sink)
        self._gather_s = gather_s
        self._more, self._stop = threading.Event(), threading.Event()

    @property
    def states(self) -> list[DeviceState]:
        """The state of each device, in the given order."""
        return [poller.state for poller in self._pollers]

    @property
    def store(self) -> ForwarderState:
        """How many samples were stored or refused, and why storing fails if it does."""
        return self._forwarder.state

    async def run(self) -> None:
        """Collect until cancelled; everything polled is on disk when this returns."""
        self._more.set()  # an earlier process may have left samples in the spool
        writing = threading.Thread(target=self._keep, name="spool")
        draining = threading.Thread(
            target=self._forwarder.run,
            args=(self._more, self._stop, self._gather_s),
            name="forwarder",
        )
        for thread in (writing, draining):
            thread.start()
        polling = [asyncio.create_task(poller.run()) for poller in self._pollers]
        for_ever = asyncio.Event()  # without devices the spool still has to be emptied
        try:
            await asyncio.gather(*polling, for_ever.wait())
        finally:
            for task in polling:
                task.cancel()
            try:
                await asyncio.gather(*polling, return_exceptions=True)
                self._queue.put(None)
                await asyncio.to_thread(writing.join)
            finally:  # also when cancelled a second time: no thread may outlive this
                self._queue.put(None)
                self._stop.set()
                await asyncio.to_thread(draining.join)

    def _keep(self) -> None:
        """Append polled batches to the spool; keep them in memory while the disk is full."""
        waiting: deque[SampleBatch] = deque()
        while True:
            batch = self._queue.get()
            if batch is not None:
                waiting.append(batch)
            while waiting and self._appended(waiting[0]):
                waiting.popleft()
            while len(waiting) > _IN_MEMORY:
                self._drop(waiting.popleft())
            if batch is None:
                for lost in waiting:
                    self._drop(lost)
                return

    def _appended(self, batch: SampleBatch) -> bool:
        try:
            self._spool.append(batch)
        except OSError as error:
            log.error("the spool cannot be written: %s; samples wait in memory", error)
            return False
        except Exception:  # a bug may cost this batch, but not the following ones
            log_fields = {"device": batch.source}
            log.exception("a batch of %s cannot be kept", batch.source, extra=log_fields)
            self._drop(batch)
            return True
        self._more.set()
        return True

    def _drop(self, batch: SampleBatch) -> None:
        self.dropped += len(batch)
        log.error(
            "NO ROOM: %d samples of %s were dropped, %d in all; free space where the spool is",
            len(batch),
            batch.source,
            self.dropped,
            extra={"device": batch.source},
        )


def collect(collector: Collector, stop: threading.Event) -> None:
    """Run ``collector`` on a new event loop until ``stop`` is set, in a thread or process that does
    nothing else."""

    async def until_stopped() -> None:
        running = asyncio.create_task(collector.run())
        waiting = asyncio.create_task(asyncio.to_thread(stop.wait))
        await asyncio.wait([running, waiting], return_when=asyncio.FIRST_COMPLETED)
        stop.set()
        running.cancel()
        await asyncio.wait([running, waiting])
        if not running.cancelled():
            running.result()

    asyncio.run(until_stopped())
