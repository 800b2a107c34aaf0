"""``Forwarder``: brings batches from the spool to the sink, in order, retrying until stored; and
``SampleSink``, the interface by which it stores them."""

from __future__ import annotations

import csv
import logging
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import groupby
from typing import Protocol

from stemwatch.connectors.modbus.backoff import Backoff
from stemwatch.connectors.modbus.sample_batch import SampleBatch, joined
from stemwatch.service.collector.spool import Position, Spool, Waiting

log = logging.getLogger(__name__)

MAX_SAMPLES = 20_000  # in one write, unless a single poll has more
LONGEST_WAIT_S = 30.0
REFUSED = "refused"
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class SinkRefused(Exception):
    """These samples can never be stored; the text says why. The collector writes them to a file,
    so that they do not hold up later ones."""


class SampleSink(Protocol):
    """Stores samples permanently.

    ``write`` returns when every sample of ``batch`` is committed. It is called from one thread,
    which is not the event loop's. It must be idempotent by ``(source, tag, at)``: after a crash
    between storing and acknowledging, a batch is written again, and existing samples must stay
    unchanged. Raises ``SinkRefused`` for a batch that can never be stored; after any other
    exception the batch is written again later.
    """

    def write(self, batch: SampleBatch) -> None: ...


@dataclass
class ForwarderState:
    """Samples stored, samples refused by the store, and why storing fails at present."""

    stored: int = 0
    refused: int = 0
    fault: str = ""


class Forwarder:
    """Writes the batches waiting in ``spool`` to ``sink`` and acknowledges them.

    While the sink fails, the time between attempts grows up to half a minute. Samples that it
    refuses for good are written to the spool's folder ``refused`` as CSV, with the reason.
    """

    def __init__(self, spool: Spool, sink: SampleSink) -> None:
        self.state = ForwarderState()
        self._spool, self._sink = spool, sink
        self._backoff = Backoff(0.5, LONGEST_WAIT_S)
        self._place: Position | None = (
            None  # all before it is stored, even if recording that failed
        )

    def run(self, more_arrived: threading.Event, stop: threading.Event, pause_s: float) -> None:
        """Store batches until ``stop``, then once more. ``more_arrived`` is set when something was
        appended; ``pause_s`` is how long samples are gathered before they are stored."""
        while not stop.wait(pause_s):
            if more_arrived.wait(timeout=1.0):
                more_arrived.clear()
                self._until_taken(stop)
        self.once()

    def once(self) -> bool:
        """Store everything that is waiting now; whether that succeeded."""
        try:
            while group := self._next_group():
                self._hand_over(group)
                self._acknowledge(group[-1].next)
        except Exception as error:  # anything but SinkRefused means: try again later
            if not self.state.fault:
                log.warning("the store takes no samples, which wait on disk: %s", error)
            self.state.fault = f"{type(error).__name__}: {error}"
            return False
        if self.state.fault:
            log.info("the store takes samples again")
        self.state.fault = ""
        self._backoff.succeeded()
        return True

    def _acknowledge(self, position: Position) -> None:
        self._place = position
        try:
            self._spool.acknowledge(position)
        except OSError as error:
            log.error("the spool cannot record what is stored (%s); storing continues", error)

    def _until_taken(self, stop: threading.Event) -> None:
        while not self.once():
            if stop.wait(self._backoff.failed()):
                return

    def _next_group(self) -> list[Waiting]:
        group: list[Waiting] = []
        count = 0
        for waiting in self._spool.waiting(self._place):
            if group and count + len(waiting.batch) > MAX_SAMPLES:
                break
            group.append(waiting)
            count += len(waiting.batch)
        return group

    def _hand_over(self, group: list[Waiting]) -> None:
        def by_source(waiting: Waiting) -> str:
            return waiting.batch.source

        for _, of_source in groupby(sorted(group, key=by_source), key=by_source):
            run = list(of_source)
            try:
                self._write(joined([waiting.batch for waiting in run]))
            except SinkRefused:
                self._one_by_one(run)

    def _one_by_one(self, run: Iterable[Waiting]) -> None:
        """Write the batches one by one, to find those that the sink refuses."""
        for waiting in run:
            try:
                self._write(waiting.batch)
            except SinkRefused as error:
                place = waiting.next  # each batch has its own
                self._set_aside(waiting.batch, str(error), f"{place.segment}-{place.offset}")

    def _write(self, batch: SampleBatch) -> None:
        self._sink.write(batch)
        self.state.stored += len(batch)

    def _set_aside(self, batch: SampleBatch, reason: str, name: str) -> None:
        folder = self._spool.folder / REFUSED
        folder.mkdir(exist_ok=True)
        path = folder / f"{name}.csv"
        with path.open("w", encoding="utf-8", errors="replace", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([f"# the store refused these samples: {reason}"])
            writer.writerow(["source", "tag", "at", "value", "quality", "reason"])
            for index, tag in enumerate(batch.tags):
                instant = _EPOCH + timedelta(microseconds=int(batch.at_us[index]))
                numbers = (batch.values[index], batch.quality[index])
                row = (batch.source, tag, instant.isoformat(), *numbers, batch.reasons[index])
                writer.writerow(row)
        self.state.refused += len(batch)
        text = "the store refused %d samples for good (%s): see %s"
        log.error(text, len(batch), reason, path, extra={"device": batch.source})
