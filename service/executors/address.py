"""Where the work is to be done, as a person writes it: ``local``, ``in-process``, ``dask://...``."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from stemwatch.service.executors.executor import Executor
from stemwatch.service.executors.in_process import InProcess
from stemwatch.service.executors.local_processes import LocalProcesses

if TYPE_CHECKING:
    from stemwatch.service.executors.dask_cluster import DaskCluster

LOCAL, IN_PROCESS, DASK = "local", "in-process", "dask"
EXPECTED = f"expected {LOCAL}, {IN_PROCESS} or {DASK}://HOST:PORT"


class UnknownExecutor(ValueError):
    """The text names no executor; the sentence says what was found and what was expected."""


def choose_executor(workers: int | None, address: str = LOCAL) -> Executor:
    """The executor that ``address`` names.

    ``local``: ``workers`` processes on this machine, by default one per core; one works here.
    ``in-process``: here, whatever ``workers`` says. ``dask://HOST:PORT``: the workers of the Dask
    scheduler there. Raises ``UnknownExecutor``; a cluster is not asked for before it is used.
    """
    if address == IN_PROCESS:
        return InProcess()
    if address in ("", LOCAL):
        workers = workers or os.cpu_count() or 1
        return LocalProcesses(workers) if workers > 1 else InProcess()
    return cluster_at(address)


def cluster_at(address: str) -> DaskCluster:
    """The Dask cluster at ``dask://HOST:PORT``. Raises ``UnknownExecutor`` for anything else."""
    from stemwatch.service.executors.dask_cluster import DaskCluster

    return DaskCluster(_scheduler(address))


def checked(address: str) -> str:
    """``address`` itself. Raises ``UnknownExecutor`` where it names no executor."""
    if address not in (LOCAL, IN_PROCESS):
        _scheduler(address)
    return address


def _scheduler(address: str) -> str:
    """``HOST:PORT`` of a cluster's scheduler."""
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise UnknownExecutor(f"executor {address!r}: {error}; {EXPECTED}") from None
    if parts.scheme != DASK or not host or port is None or parts.path.strip("/") or parts.query:
        raise UnknownExecutor(
            f"executor {address!r} is unknown; {EXPECTED}, such as dask://10.0.0.5:8786"
        )
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
