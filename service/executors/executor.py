"""``Executor``: the interface of executors, and the handling of failures for all of them.

An executor only hands out batches and answers with results or a failure. Failures are handled here:
by ``outcomes`` for a run, in which a bad valve must not affect others, and by ``map_items`` for a
study, in which every item needs a result.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from threading import Event
from typing import Generic, Protocol, TypeVar

log = logging.getLogger(__name__)

Item = TypeVar("Item")
Result = TypeVar("Result")
Work = Callable[[Sequence[Item]], Sequence[Result]]  # done on a batch
Batches = Iterable[Sequence[Item]]

THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
LONGEST_REASON = 500


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Why a batch has no results.

    ``error`` is the exception of the work, where it could be returned; ``lost`` means that the
    worker ended before the batch was done, which may have other causes than the work.
    """

    reason: str
    error: Exception | None = None
    lost: bool = False


@dataclass(frozen=True, kw_only=True)
class Answer(Generic[Result]):
    """The answer for the batch at ``index``: a result for each of its items, or a failure."""

    index: int
    results: Sequence[Result] = ()
    failure: Failure | None = None


@dataclass(frozen=True, kw_only=True)
class Outcome(Generic[Item, Result]):
    """The outcome of the item at ``index`` among all items: its result, or the reason for none."""

    index: int
    item: Item
    result: Result | None
    reason: str = ""


class Executor(Protocol):
    """Runs ``work`` on batches of items: in this process, in other processes, or on other machines.

    An implementation must answer each batch once, in any order, as soon as it is done; answer with
    a ``Failure`` where the work raised or its worker ended, and go on with the others; take batches
    from the iterable as needed; end soon after ``stop`` is set; and leave nothing running when the
    caller closes the generator. ``work`` is pickled by name. Raises ``ExecutorUnavailable`` where
    the executor itself cannot work (no cluster answers, no process can be started).
    """

    @property
    def workers(self) -> int:
        """How many batches are worked on at the same time; at least 1."""
        ...

    def hand_out(
        self, work: Work[Item, Result], batches: Batches[Item], stop: Event, *, alone: bool = False
    ) -> Generator[Answer[Result]]:
        """An answer for each batch. ``alone``: the batches are repeated after a failure, so that a
        worker may hold only one of them at a time, and none is done in the calling process, where
        the executor has others."""
        ...


class ExecutorUnavailable(OSError):
    """The executor cannot work at all; the text says why and what to do."""


def outcomes(
    executor: Executor,
    work: Callable[[Sequence[Item]], Sequence[Result]],
    batches: Sequence[Sequence[Item]],
    stop: Event,
) -> Iterator[list[Outcome[Item, Result]]]:
    """The outcome of each item, those of a batch together, as soon as the batch is done.

    A failed batch is repeated item by item after the others; so is a single item whose worker was
    lost, which may have had other causes. What fails again is given up with its reason. Ends early
    when ``stop`` is set.
    """
    firsts = list(accumulate((len(batch) for batch in batches), initial=0))
    to_repeat: list[tuple[int, Item]] = []
    with closing(executor.hand_out(work, batches, stop)) as answers:
        for answer in answers:
            numbered = list(enumerate(batches[answer.index], start=firsts[answer.index]))
            failure = answer.failure
            if failure is not None and (len(numbered) > 1 or failure.lost):
                text = "a batch of %d: %s; done again one by one"
                log.warning(text, len(numbered), failure.reason)
                to_repeat += numbered
            else:
                yield _outcomes_of(numbered, answer)
    if to_repeat and not stop.is_set():
        singles = [[item] for _, item in to_repeat]
        with closing(executor.hand_out(work, singles, stop, alone=True)) as answers:
            for answer in answers:
                yield _outcomes_of([to_repeat[answer.index]], answer)


def map_items(
    executor: Executor, work: Callable[[Item], Result], items: Iterable[Item]
) -> Iterator[tuple[int, Result]]:
    """``(place, work(item))`` for each item, in the order in which they are done.

    Raises what ``work`` raises. An item on which two workers were lost is done in this process, so
    that every item has a result. When the caller closes the generator, pending items are dropped.
    """
    out: dict[int, Item] = {}

    def singly() -> Iterator[Sequence[Item]]:
        for index, item in enumerate(items):
            out[index] = item
            yield [item]

    work_on_each = partial(_work_on_each, work)
    never = Event()
    lost: list[tuple[int, Item]] = []
    with closing(executor.hand_out(work_on_each, singly(), never)) as answers:
        for answer in answers:
            item = out.pop(answer.index)
            if answer.failure is None:
                yield answer.index, answer.results[0]
            elif answer.failure.lost:
                lost.append((answer.index, item))
            else:
                raise answer.failure.error or RuntimeError(answer.failure.reason)
    if not lost:
        return
    log.warning("%d pieces of work lost their worker and are done again", len(lost))
    second_answers = executor.hand_out(
        work_on_each, [[item] for _, item in lost], never, alone=True
    )
    with closing(second_answers) as answers:
        for answer in answers:
            index, item = lost[answer.index]
            if answer.failure is None:
                yield index, answer.results[0]
            elif answer.failure.lost:
                log.warning("two workers were lost on one piece of work; it is done here")
                yield index, work(item)
            else:
                raise answer.failure.error or RuntimeError(answer.failure.reason)


def results_in_order(
    executor: Executor,
    work: Callable[[Item], Result],
    items: Iterable[Item],
    on_progress: Callable[[int], None],
) -> list[Result]:
    """The result of each item, in the order of the items; ``on_progress`` is given how many items
    are done. Raises what ``work`` raises."""
    result_at: dict[int, Result] = {}
    for index, result in map_items(executor, work, items):
        result_at[index] = result
        on_progress(len(result_at))
    return [result_at[index] for index in sorted(result_at)]


def map_in_order(
    executor: Executor,
    work: Callable[[Item], Sequence[Result]],
    items: Iterable[Item],
    on_progress: Callable[[int], None],
) -> list[Result]:
    """All results of ``work``, several for each item, in the order of the items; ``on_progress`` is
    given how many there are so far. Raises what ``work`` raises."""
    results_at: dict[int, Sequence[Result]] = {}
    for index, results in map_items(executor, work, items):
        results_at[index] = results
        on_progress(sum(map(len, results_at.values())))
    return [result for index in sorted(results_at) for result in results_at[index]]


def _outcomes_of(
    numbered: Sequence[tuple[int, Item]], answer: Answer[Result]
) -> list[Outcome[Item, Result]]:
    if answer.failure is not None:
        reason = answer.failure.reason
        return [Outcome(index=n, item=item, result=None, reason=reason) for n, item in numbered]
    pairs = zip(numbered, answer.results, strict=True)
    return [Outcome(index=n, item=item, result=result) for (n, item), result in pairs]


def failure_of(error: Exception) -> Failure:
    """The exception of the work as the failure of its batch."""
    return Failure(reason=f"{type(error).__name__}: {error}"[:LONGEST_REASON], error=error)


def one_thread() -> None:
    """Limit numerical libraries in this process to one thread.

    Workers then do not compete for cores, and sums are added in one order everywhere, which makes
    results bitwise equal. Libraries that are not loaded yet read the environment; torch, if loaded,
    is set directly.
    """
    for name in THREADS:
        os.environ[name] = "1"
    torch = sys.modules.get("torch")
    if torch is not None and torch.get_num_threads() != 1:
        torch.set_num_threads(1)


def _work_on_each(work: Callable[[Item], Result], batch: Sequence[Item]) -> list[Result]:
    return [work(item) for item in batch]
