"""An OPC UA server with a history, on loopback, in a thread of its own."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.crypto.permission_rules import SimpleRoleRuleset, User, UserRole
from asyncua.server.history import HistoryDict
from asyncua.server.server import Server
from asyncua.ua.attribute_ids import AttributeIds

Sample = tuple[datetime, float | None, int]  # time, value, status code


@dataclass
class Recorder:
    """Which services clients asked for."""

    asked: set[str]


class Conforming(HistoryDict):
    """The library's history in memory, which hands out ``most`` values at a time."""

    def __init__(self, data: Mapping[str, Sequence[ua.DataValue]], most: int) -> None:
        super().__init__(most)
        self.data = data
        self.pages = 0

    async def read_node_history(
        self, node_id: Any, start: Any, end: Any, nb_values: int
    ) -> tuple[list[ua.DataValue], datetime | None]:
        """Values of a node; a continuation point where there are more than ``most``."""
        self._datachanges[node_id] = list(self.data.get(node_id.to_string(), ()))
        self.pages += 1
        return await super().read_node_history(node_id, start, end, nb_values)


def data_value(sample: Sample) -> ua.DataValue:
    """A value with its source time and status."""
    time, value, status = sample
    return ua.DataValue(
        Value=ua.Variant() if value is None else ua.Variant(value, ua.VariantType.Double),
        StatusCode=ua.StatusCode(status),
        SourceTimestamp=time,
    )


class Users:
    """One user, called reader."""

    def get_user(
        self, iserver: Any, username: Any = None, password: Any = None, certificate: Any = None
    ) -> User | None:
        """The user, where name and password are right."""
        if username is None or (username, password) == ("reader", "geheim"):
            return User(role=UserRole.User)
        return None


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as item:
        item.bind(("127.0.0.1", 0))
        return int(item.getsockname()[1])


@dataclass(frozen=True)
class Secured:
    """Certificate and private key of the server, as files."""

    certificate: Path
    private_key: Path


@contextmanager
def serving(
    history: Mapping[str, Sequence[Sample]], *, most: int = 10_000, secured: Secured | None = None
) -> Iterator[tuple[str, Conforming]]:
    """Address and history of a server whose nodes are ``ns=2;s=NAME`` for each name."""
    ready, ended = threading.Event(), threading.Event()
    url = f"opc.tcp://127.0.0.1:{free_port()}/history"
    store = Conforming(
        {
            f"ns=2;s={name}": [data_value(sample) for sample in samples]
            for name, samples in history.items()
        },
        most,
    )
    failed: list[BaseException] = []

    def work() -> None:
        try:
            asyncio.run(_serve(url, list(history), store, secured, ready, ended))
        except BaseException as error:
            failed.append(error)
            ready.set()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    ready.wait(30.0)
    try:
        if failed:
            raise failed[0]
        yield url, store
    finally:
        ended.set()
        thread.join(30.0)


async def _serve(
    url: str,
    names: Sequence[str],
    store: Conforming,
    secured: Secured | None,
    ready: threading.Event,
    ended: threading.Event,
) -> None:
    server = Server(user_manager=Users() if secured else None)
    await server.init()
    server.set_endpoint(url)
    if secured is not None:
        server.set_security_policy(
            [ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt],
            permission_ruleset=SimpleRoleRuleset(),
        )
        await server.load_certificate(str(secured.certificate))
        await server.load_private_key(str(secured.private_key))
    server.iserver.history_manager.set_storage(store)
    space = await server.register_namespace("urn:stemwatch:test")
    folder = await server.nodes.objects.add_folder(space, "Loops")
    for name in [*names, "NOT.ARCHIVED"]:
        node = await folder.add_variable(ua.NodeId(name, space), name, 0.0)
        if name in names:
            await node.set_attr_bit(AttributeIds.UserAccessLevel, ua.AccessLevel.HistoryRead)
            await node.set_attr_bit(AttributeIds.AccessLevel, ua.AccessLevel.HistoryRead)
    async with server:
        ready.set()
        while not ended.is_set():
            await asyncio.sleep(0.05)


def even(values: Sequence[float | None], start: datetime, bad: Mapping[int, int]) -> list[Sample]:
    """One value a second, with a status where ``bad`` says."""
    return [(start + timedelta(seconds=i), value, bad.get(i, 0)) for i, value in enumerate(values)]
