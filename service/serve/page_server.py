"""``PageServer``: serves the pages and the API in a thread."""

from __future__ import annotations

import ipaddress
import logging
import os
import socket
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from stemwatch.connectors.connector import ConnectorError, NothingInWindow, Window
from stemwatch.connectors.historian import ReadOptions
from stemwatch.models.recording import Recording
from stemwatch.service.config import Plant
from stemwatch.service.run.task import open_archive, open_file
from stemwatch.service.store.samples.connector import StoredSamples
from stemwatch.service.store.store import Store
from stemwatch.service.web.actions import Actions

if TYPE_CHECKING:
    from stemwatch.service.web.site import Check

log = logging.getLogger(__name__)

_END_S = 10  # for pending answers and the end of the thread


class CannotListen(OSError):
    """The service cannot listen on this address; the text says why and what to do."""


def listen(host: str, port: int) -> socket.socket:
    """A listening socket. Raises ``CannotListen``; warns where other machines can reach it, since
    HTTP is not encrypted."""
    if not _is_loopback(host):
        log.warning(
            "other machines can reach %s, and passwords are sent to it unencrypted: put a proxy "
            "with TLS before it, or listen on 127.0.0.1",
            host,
        )
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(128)
    except OSError as error:
        listening.close()
        raise CannotListen(
            f"cannot listen on {host} port {port}: {error.strerror or error}; choose another with "
            "--host and --port"
        ) from None
    return listening


class PageServer:
    """Serves the pages on ``listening`` until ``stop``."""

    def __init__(
        self,
        store: Store,
        plant: Plant,
        listening: socket.socket,
        *,
        checks: Callable[[], Sequence[Check]],
        wake: Callable[[], None],
        hosts: Sequence[str] = (),
    ) -> None:
        from stemwatch.service.access.tokens import ENVIRONMENT
        from stemwatch.service.serve.http_server import http_server
        from stemwatch.service.web.app import create_app
        from stemwatch.service.web.path_prefix import below_path, path_of_address
        from stemwatch.service.web.site import LOOPBACK, Site

        own_names = (listening.getsockname()[0], socket.gethostname().lower(), *LOOPBACK)
        site = Site(
            store=store,
            plant=plant,
            read=recording_reader(plant, store),
            actions=Actions(store, wake),
            checks=checks,
            hosts=tuple(dict.fromkeys((*hosts, *own_names))),
            token=os.environ.get(ENVIRONMENT, ""),
        )
        app = below_path(create_app(site), path_of_address(plant.service.address))
        self._server = http_server(app, proxies=plant.service.trusted_proxies)
        self._listening = listening
        self._thread = threading.Thread(target=self._run, name="pages")

    def start(self) -> None:
        """Begin to serve pages and API, in a thread of their own."""
        self._thread.start()

    def stop(self) -> None:
        """Finish pending answers, then stop serving."""
        self._server.should_exit = True
        self._thread.join(timeout=_END_S)

    def _run(self) -> None:
        self._server.run(sockets=[self._listening])


def address_of(listening: socket.socket, *, for_people: bool = False) -> str:
    """The URL of the pages; with ``for_people`` it has this machine's name where the socket listens
    on all addresses."""
    host, port = listening.getsockname()[:2]
    if for_people and ipaddress.ip_address(host).is_unspecified:
        host = socket.gethostname().lower()
    return f"http://{f'[{host}]' if ':' in host else host}:{port}/"


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def recording_reader(plant: Plant, store: Store) -> Callable[[str, Window], Recording | None]:
    """A function that reads the recording of a valve in a window, or returns ``None`` where there
    is none. It raises ``ConnectorError`` for a valve that the plant file does not describe, and for
    a source that cannot be read: nobody knows then whether there is anything."""

    def read(valve: str, window: Window) -> Recording | None:
        if valve not in plant.valves:
            raise ConnectorError(f"the plant file does not describe the valve {valve!r}")
        if plant.is_live(valve):
            source = StoredSamples(store.samples, plant.valves[valve].source)
            try:
                return source.read(plant.valve_tags(valve), window)
            except ConnectorError:
                return None  # nothing was collected in this window
        address = plant.archive_of(valve)
        if address is None:
            return _in_files(plant, valve, window)
        archive = open_archive(address)
        return archive.read(archive.present(plant.valve_tags(valve)), window)

    return read


def _in_files(plant: Plant, valve: str, window: Window) -> Recording | None:
    """The recording from the newest of the source's files that has samples in the window. Raises
    ``ConnectorError`` where none of them could be read."""
    source = plant.source_of(valve)
    options = ReadOptions(**plant.read_options(source))
    unread: ConnectorError | None = None
    nothing_there = False
    for path in reversed(plant.source_files(source)):
        try:
            return open_file(str(path), options).read(plant.valve_tags(valve), window)
        except NothingInWindow:
            nothing_there = True
        except ConnectorError as error:
            unread = unread or error
    if unread is not None and not nothing_there:
        raise unread
    return None
