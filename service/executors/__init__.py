"""Where the work is done: here, in processes beside this one, or in a Dask cluster.

The seam is one method (``Executor.hand_out``). Every executor gives the same results for the same
items, number for number.
"""

from stemwatch.service.executors.address import UnknownExecutor, choose_executor
from stemwatch.service.executors.executor import (
    Executor,
    ExecutorUnavailable,
    Outcome,
    map_items,
    outcomes,
)
from stemwatch.service.executors.in_process import InProcess
from stemwatch.service.executors.local_processes import LocalProcesses

__all__ = [
    "Executor",
    "ExecutorUnavailable",
    "InProcess",
    "LocalProcesses",
    "Outcome",
    "UnknownExecutor",
    "choose_executor",
    "map_items",
    "outcomes",
]
