"""Where the work is done: here, in processes beside this one, or in a Dask cluster.

The seam is one method (``Executor.map``). Every executor gives the same results for the same
items, number for number.
"""

from stemwatch.service.executors.address import UnknownExecutor, choose_executor, cluster_at
from stemwatch.service.executors.executor import Executor
from stemwatch.service.executors.in_process import InProcess
from stemwatch.service.executors.local_processes import LocalProcesses, prepare_worker

__all__ = [
    "Executor",
    "InProcess",
    "LocalProcesses",
    "UnknownExecutor",
    "choose_executor",
    "cluster_at",
    "prepare_worker",
]
