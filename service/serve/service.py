"""``Service``: starts and stops all parts of ``stemwatch serve`` in order.

The parts are independent: while the database is not available, samples wait on disk and the pages
say so; a screening that hangs delays no page; what is interrupted is continued at the next start.
"""

from __future__ import annotations

import logging
import os
import socket
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from stemwatch.service.access.links import first_link
from stemwatch.service.config import Plant
from stemwatch.service.run.queue_worker import QueueWorker
from stemwatch.service.scheduler import Scheduler
from stemwatch.service.serve.collector_process import CollectorProcess
from stemwatch.service.serve.health_checks import health_checks
from stemwatch.service.serve.page_server import PageServer, address_of, listen
from stemwatch.service.serve.periodic_tasks import LEASE, periodic_tasks, repeat
from stemwatch.service.serve.startup_server import StartupServer
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.store import Store, open_store

log = logging.getLogger(__name__)

_RETRY_S = 5.0


@dataclass(frozen=True, kw_only=True)
class ListenAddress:
    """Host and port of the pages, and further host names under which browsers reach them."""

    host: str = "127.0.0.1"
    port: int = 8300
    hosts: Sequence[str] = ()


class Service:
    """The service for one plant, as ``stemwatch serve`` runs it."""

    def __init__(
        self, plant: Plant, address: ListenAddress | None = None, *, logs_as_json: bool = False
    ):
        self._plant, self._where = plant, address or ListenAddress()
        self._json = logs_as_json
        self._threads: list[threading.Thread] = []

    def run(
        self,
        stop: threading.Event,
        ready: Callable[[str], object] = lambda address: None,
        invite: Callable[[str], object] = lambda link: None,
    ) -> None:
        """Serve until ``stop`` is set; ``ready`` gets the address of the pages, ``invite`` the
        one-time link for the first admin where there is no user yet.

        Raises ``CannotListen`` where the address is taken. If the database is not available at the
        start the service waits for it and collects samples meanwhile.
        """
        listening = listen(self._where.host, self._where.port)
        try:
            if self._plant.devices:
                collecting = CollectorProcess(self._plant.file, logs_as_json=self._json)
                self._start("collecting", lambda: collecting.watch(stop))
            with StartupServer(listening):
                store = self._open(stop)
            if store is not None:
                with store:
                    self._serve(store, listening, stop, ready, invite)
        finally:
            stop.set()
            for thread in self._threads:
                thread.join()
            listening.close()

    def _serve(
        self,
        store: Store,
        listening: socket.socket,
        stop: threading.Event,
        ready: Callable[[str], object],
        invite: Callable[[str], object],
    ) -> None:
        plant, zone = self._plant, self._plant.zone or "UTC"
        store.save_valves(plant.valves.values())
        store.schedules.take_from_file(plant.schedules)
        worker = QueueWorker(store, plant)
        scheduler = Scheduler(store, zone, worker.wake)
        halt, working = threading.Event(), list[threading.Thread]()
        pages = PageServer(
            store,
            plant,
            listening,
            checks=lambda: health_checks(store, plant, scheduler, working),
            wake=worker.wake,
            hosts=self._where.hosts,
        )
        working.append(threading.Thread(target=worker.work, args=(halt,), name="runner"))
        for name, every_s, task in periodic_tasks(store, plant, worker.owner):
            working.append(
                threading.Thread(target=repeat, args=(name, every_s, task, halt), name=name)
            )
        for thread in working:
            thread.start()
        try:
            scheduler.start()
            pages.start()
            ready(address_of(listening))
            here = address_of(listening, for_people=True)
            if link := first_link(store, plant.service.address or here):
                log.warning("nobody can sign in yet: a one-time link for the first admin is made")
                invite(link)
            tell_systemd("READY=1")
            stop.wait()
        finally:
            tell_systemd("STOPPING=1")
            log.info("stopping")
            pages.stop()
            scheduler.stop()
            halt.set()
            worker.wake()
            for thread in working:
                thread.join()
            _release_lease(store, worker.owner)

    def _open(self, stop: threading.Event) -> Store | None:
        """The store, as soon as it is available; ``None`` where ``stop`` was set before."""
        logged = ""
        while not stop.is_set():
            try:
                return open_store(self._plant.storage)
            except StoreError as error:
                if str(error) != logged:
                    log.error("%s; trying again every %g s", error, _RETRY_S)
                logged = str(error)
            stop.wait(_RETRY_S)
        return None

    def _start(self, name: str, work: Callable[[], None]) -> None:
        thread = threading.Thread(target=work, name=name)
        thread.start()
        self._threads.append(thread)


def _release_lease(store: Store, owner: str) -> None:
    try:
        store.leases.release(LEASE, owner)
    except StoreError as error:
        log.warning("%s", error)


def tell_systemd(state: str) -> None:
    """Send ``state`` (``READY=1``, ``STOPPING=1``) to systemd at ``NOTIFY_SOCKET``, if set."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address or not hasattr(socket, "AF_UNIX"):
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link:
            link.sendto(state.encode(), address)
    except OSError:
        pass  # nothing listens on the socket
