"""Requests without an answer yet, kept because a late answer must not be taken for the answer to
another request.

Modbus TCP numbers its requests. An RTU frame bears the unit, the function and a length, and no
number: an answer that comes after its time-out fits the next request of the same unit, function and
length (Modbus over Serial Line 1.02, section 2.5.1; the frame has no transaction identifier). Words
are therefore good only where no other answer that looks alike can still come.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from stemwatch.connectors.modbus.register_address import FUNCTION, Table

REFUSAL = 0x80  # added to the function of a request that is refused


@dataclass(frozen=True)
class SentRequest:
    """One request: ``count`` words of ``table`` from protocol address ``first`` on."""

    unit_id: int
    table: Table
    first: int
    count: int

    def looks_alike(self, other: SentRequest) -> bool:
        """Whether answers to both cannot be told apart by unit, function and length."""
        return self._shape == other._shape

    @property
    def _shape(self) -> tuple[int, Table, int]:
        return self.unit_id, self.table, self.count


class PendingRequests:
    """The requests of one line that were sent and not answered for certain.

    Each is forgotten once its answer has come, or ``limit_s`` seconds after it was sent: no answer
    comes later than that.
    """

    def __init__(self, limit_s: float, now_s: Callable[[], float] = time.monotonic) -> None:
        self._limit_s, self._now_s = limit_s, now_s
        self._sent: list[tuple[float, SentRequest]] = []

    def __iter__(self) -> Iterator[SentRequest]:
        """The requests whose answers may still come, oldest first."""
        oldest_s = self._now_s() - self._limit_s
        self._sent = [(at_s, request) for at_s, request in self._sent if at_s > oldest_s]
        return iter([request for _, request in self._sent])

    def note_sent(self, request: SentRequest) -> None:
        """``request`` goes out now."""
        self._sent.append((self._now_s(), request))

    def note_answer(self, request: SentRequest) -> None:
        """One answer to ``request``, or to one that looks alike, has come."""
        for index, (_, sent) in enumerate(self._sent):
            if sent.looks_alike(request):
                del self._sent[index]
                return

    def forget(self) -> None:
        """Forget all requests: their connection is closed, so no answer can arrive."""
        self._sent.clear()

    def counts(self, unit_id: int, table: Table) -> frozenset[int]:
        """The lengths, in words, of the answers of this unit and table that may still come."""
        alike_count = (
            request for request in self if (request.unit_id, request.table) == (unit_id, table)
        )
        return frozenset(request.count for request in alike_count)

    def answered_by(self, frame: bytes) -> SentRequest | None:
        """The request that the RTU ``frame`` answers for certain, or ``None``.

        A refusal says which function was refused and not which length was asked for: it is certain
        where one request only can be meant.
        """
        refusal = bool(frame[1] & REFUSAL)
        function = frame[1] & ~REFUSAL
        fits = [
            request
            for request in self
            if (request.unit_id, FUNCTION[request.table]) == (frame[0], function)
            and (refusal or 2 * request.count == frame[2])
        ]
        return fits[0] if fits and (len(fits) == 1 or not refusal) else None
