"""``SampleSink``: what the store must do with samples."""

from __future__ import annotations

from typing import Protocol

from stemwatch.connectors.modbus.sample_batch import SampleBatch


class SinkRefused(Exception):
    """These samples can never be stored, however often they are offered: the text says why.

    They are set aside in a file, so that the ones behind them are not held up.
    """


class SampleSink(Protocol):
    """Where samples end up.

    ``write`` returns when every sample of ``batch`` is stored for good. It is called from one
    thread that is not the event loop's. It must be idempotent by ``(source, tag, at)``: after a
    crash between storing and noting it, a batch comes again, and the samples that are there already
    stay as they are. Raises ``SinkRefused`` for a batch that can never be stored; any other
    exception means that the store is away, and the batch is offered again later.
    """

    def write(self, batch: SampleBatch) -> None: ...
