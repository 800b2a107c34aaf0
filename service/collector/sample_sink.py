"""``SampleSink``: the interface by which the collector stores samples."""

from __future__ import annotations

from typing import Protocol

from stemwatch.connectors.modbus.sample_batch import SampleBatch


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
