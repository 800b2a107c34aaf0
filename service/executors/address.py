"""``choose_executor``: the executor for ``local``, ``in-process``, ``dask://...``, as in
``--executor`` and ``[service] executor``."""

from __future__ import annotations

import math
import os
from importlib.metadata import entry_points
from urllib.parse import urlsplit

from stemwatch.service.executors.executor import Executor
from stemwatch.service.executors.in_process import InProcess
from stemwatch.service.executors.local_processes import LocalProcesses

LOCAL, IN_PROCESS, DASK = "local", "in-process", "dask"
GROUP = "stemwatch.executors"
EXPECTED = f"expected {LOCAL}, {IN_PROCESS} or {DASK}://HOST:PORT"


class UnknownExecutor(ValueError):
    """There is no such executor; the text says what was found and what was expected."""


def choose_executor(
    workers: int | None,
    address: str = LOCAL,
    *,
    item_timeout_s: float = math.inf,
    isolated: bool = False,
) -> Executor:
    """The executor that ``address`` names; nothing is started or connected before it is used.

    ``local``: ``workers`` processes on this machine, by default one per core; a single worker is
    this process itself, unless ``isolated``; items that take longer than ``item_timeout_s`` are
    given up. ``in-process``: this process, whatever ``workers`` says. ``NAME://...``: made by the
    entry point NAME of the group ``stemwatch.executors``, such as ``dask://HOST:PORT``. Raises
    ``UnknownExecutor``.
    """
    if address == IN_PROCESS:
        return InProcess()
    if address in ("", LOCAL):
        workers = workers or os.cpu_count() or 1
        if workers == 1 and not isolated:
            return InProcess()
        return LocalProcesses(workers, item_timeout_s, isolated)
    name, separator, _ = address.partition("://")
    points = entry_points(group=GROUP, name=name) if separator else ()
    for entry in points:
        executor: Executor = entry.load()(address)
        return executor
    raise UnknownExecutor(f"executor {address!r} is unknown; {EXPECTED}{_others()}")


def host_and_port(address: str, name: str) -> str:
    """``HOST:PORT`` of ``name://HOST:PORT``. Raises ``UnknownExecutor`` for anything else."""
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise UnknownExecutor(f"executor {address!r}: {error}; {EXPECTED}") from None
    if parts.scheme != name or not host or port is None or parts.path.strip("/") or parts.query:
        raise UnknownExecutor(
            f"executor {address!r} is unknown; {EXPECTED}, such as {name}://10.0.0.5:8786"
        )
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _others() -> str:
    """The executors of other packages, for error messages."""
    names = sorted({entry.name for entry in entry_points(group=GROUP)} - {DASK})
    return "".join(f", or {name}://..." for name in names)
