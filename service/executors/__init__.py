"""Executors: work in this process, in local worker processes, or in a Dask cluster.

``Executor.hand_out`` is the one method of the interface. Every executor gives bitwise the same
results for the same items.
"""

from stemwatch.service.executors.address import UnknownExecutor, choose_executor
from stemwatch.service.executors.executor import (
    Executor,
    ExecutorUnavailable,
    Outcome,
    map_in_order,
    map_items,
    outcomes,
    results_in_order,
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
    "map_in_order",
    "map_items",
    "outcomes",
    "results_in_order",
]
