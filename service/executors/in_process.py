"""``InProcess``: the executor that works in this process."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from threading import Event

from stemwatch.service.executors.executor import Answer, Batches, Item, Result, Work, failure_of


@dataclass(frozen=True)
class InProcess:
    """Runs one batch after the other in this process, without protection against hangs and
    crashes."""

    workers: int = 1

    def hand_out(
        self, work: Work[Item, Result], batches: Batches[Item], stop: Event, *, alone: bool = False
    ) -> Generator[Answer[Result]]:
        """An answer for each batch, in order; an exception is a failure of its batch."""
        for index, batch in enumerate(batches):
            if stop.is_set():
                return
            try:
                answer = Answer(index=index, results=work(batch))
            except Exception as error:
                answer = Answer(index=index, failure=failure_of(error))
            yield answer
