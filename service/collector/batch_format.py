"""The format of a record in a spool file: mark, length, checksum, compressed batch."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.modbus.sample_batch import SampleBatch

MARK = b"\xf1sWb"  # begins each record; its first byte occurs neither in ASCII nor in UTF-8
_HEAD = struct.Struct("<4sII")  # mark, bytes of the body, checksum of the body
_META = struct.Struct("<I")
HEAD_BYTES = _HEAD.size
LARGEST_BODY = 64 * 1024 * 1024  # bytes; a larger length means that the record is damaged


@dataclass(frozen=True)
class SpooledRecord:
    """A record of a file: the batch, and the byte at which the next record begins.

    ``skipped`` bytes before it were not a record.
    """

    batch: SampleBatch
    samples: int
    stop: int
    skipped: int = 0


def pack(batch: SampleBatch) -> bytes:
    """The record of ``batch``."""
    reasons = sorted(set(batch.reasons))
    places = {reason: index for index, reason in enumerate(reasons)}
    meta = {"source": batch.source, "tags": batch.tags, "reasons": reasons}
    text = json.dumps(meta, ensure_ascii=False, separators=(",", ":")).encode("utf-8", "replace")
    parts = (
        _META.pack(len(text)),
        text,
        np.ascontiguousarray(batch.at_us, dtype="<i8").tobytes(),
        np.ascontiguousarray(batch.values, dtype="<f8").tobytes(),
        np.ascontiguousarray(batch.quality, dtype="u1").tobytes(),
        np.array([places[reason] for reason in batch.reasons], dtype="<u4").tobytes(),
    )
    body = zlib.compress(b"".join(parts), 1)
    return _HEAD.pack(MARK, len(body), zlib.crc32(body)) + body


def unpack(body: bytes) -> SampleBatch:
    """The batch in the ``body`` of a record whose checksum is right."""
    body_bytes = zlib.decompress(body)
    (length,) = _META.unpack_from(body_bytes)
    start = _META.size + length
    meta = json.loads(body_bytes[_META.size : start])
    count = len(meta["tags"])

    def column(kind: str) -> NDArray[Any]:
        nonlocal start
        values = np.frombuffer(body_bytes, dtype=kind, count=count, offset=start)
        start += values.nbytes
        return values

    at_us, values, quality = column("<i8"), column("<f8"), column("u1")
    reasons = meta["reasons"]
    return SampleBatch(
        source=meta["source"],
        tags=tuple(meta["tags"]),
        at_us=at_us.astype(np.int64),
        values=values.astype(np.float64),
        quality=quality.astype(np.uint8),
        reasons=tuple(reasons[index] for index in column("<u4").tolist()),
    )


def records(data: bytes, start: int = 0) -> Iterator[SpooledRecord]:
    """Each intact record in ``data`` from ``start`` on; after damage the search continues at the
    next mark.

    Bytes behind the last record, such as one that was being written at a power failure, are not
    reported; they begin at ``stop`` of the last record.
    """
    offset, skipped_from = start, start
    while (offset := data.find(MARK, offset)) >= 0:
        record = _record_at(data, offset, offset - skipped_from)
        if record is None:
            offset += 1
            continue
        yield record
        offset = skipped_from = record.stop


def _record_at(data: bytes, offset: int, skipped: int) -> SpooledRecord | None:
    if offset + HEAD_BYTES > len(data):
        return None
    _, length, checksum = _HEAD.unpack_from(data, offset)
    stop = offset + HEAD_BYTES + length
    if length > LARGEST_BODY or stop > len(data):
        return None
    body = data[offset + HEAD_BYTES : stop]
    if zlib.crc32(body) != checksum:
        return None
    try:
        batch = unpack(body)
    except (ValueError, KeyError, IndexError, struct.error, zlib.error):
        return None  # written by another version
    return SpooledRecord(batch, len(batch), stop, skipped)
