"""The only file that uses the OPC UA library: it connects, browses and reads, nothing else."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from stemwatch.connectors.connector import ConnectorError, UnknownTag
from stemwatch.connectors.secret import Secret, masked

PAGE = 50_000

MOST_TAGS = 20_000
_DEPTH = 12  # levels that are browsed, since a server's references may form a cycle
_HISTORY_READ = 0b100  # the bit of an access level
_MISSING = (
    "reading OPC UA needs the package asyncua, which is not installed; expected the extra: "
    "pip install 'stemwatch[opcua]'"
)


@dataclass(frozen=True, kw_only=True)
class Security:
    """How a connection is secured: policy and mode by their OPC UA names, certificates as paths.

    Without ``server_certificate`` the certificate that the server presents is accepted.
    """

    policy: str = "None"
    mode: str = "SignAndEncrypt"
    certificate: str = ""
    private_key: str = ""
    server_certificate: str = ""
    user: str = ""
    password: Secret = field(default_factory=Secret)


@dataclass(frozen=True, kw_only=True)
class OpcUaServer:
    """A server; it is asked for ``page`` samples at a time and answers within ``timeout_s``."""

    url: str
    security: Security = field(default_factory=Security)
    timeout_s: float = 30.0
    page: int = PAGE

    def __str__(self) -> str:
        return masked(self.url)


@dataclass
class History:
    """Raw values of one node in the server's order."""

    times: list[datetime] = field(default_factory=list)  # UTC
    values: list[Any] = field(default_factory=list)
    statuses: list[int] = field(default_factory=list)
    names: dict[int, str] = field(default_factory=dict)  # of the status codes that occurred


@dataclass(frozen=True)
class FoundNode:
    """A variable that has a history. ``name`` and ``folder`` are what the server shows for it and
    for the node above it."""

    tag: str
    name: str
    folder: str = ""

    def names(self) -> tuple[str, ...]:
        """What may tell loop and role: the text of the node id, the name, the name with the one
        above it, as a block ``FIC-101`` holds a variable ``OP``."""
        text = self.tag.partition(";s=")[2] or self.tag.removeprefix("s=")
        return (text, self.name, f"{self.folder}.{self.name}")


@asynccontextmanager
async def connected(server: OpcUaServer) -> AsyncIterator[Any]:
    """A session with the server. Raises ``ConnectorError`` where there is none, or it breaks."""
    try:
        from asyncua.client.client import Client
        from asyncua.ua import uaerrors
    except ImportError:
        raise ConnectorError(f"{server}: {_MISSING}") from None
    # At DEBUG the library logs what it sends, the password among it.
    logging.getLogger("asyncua.client").setLevel(logging.INFO)
    try:
        client = Client(server.url, timeout=server.timeout_s)
        await _secure(client, server)
        async with client:
            yield client
    except ConnectorError:
        raise
    except (TimeoutError, uaerrors.UaError, OSError, ValueError) as error:
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ConnectorError(
            f"{server}: the server could not be asked ({type(error).__name__}: {text}); check "
            "that it is reached, its security policy, and that it trusts this client's certificate"
        ) from None


async def _secure(client: Any, server: OpcUaServer) -> None:
    from asyncua import ua
    from asyncua.crypto import security_policies

    security = server.security
    if security.policy != "None":
        await client.set_security(
            getattr(security_policies, f"SecurityPolicy{security.policy}"),
            security.certificate,
            security.private_key,
            server_certificate=security.server_certificate or None,
            mode=ua.MessageSecurityMode[security.mode],
        )
    if security.user:
        client.set_user(security.user)
        client.set_password(security.password.reveal())


async def read_history(
    client: Any, tag: str, start: datetime, stop: datetime, server: OpcUaServer
) -> History:
    """All raw values of a node from ``start`` to ``stop``, page by page.

    A server that has more gives a continuation point; one that stops at the requested number
    without one is asked again from the last time it gave. Raises ``UnknownTag`` for a node it does
    not have and ``ConnectorError`` for one without a history.
    """
    from asyncua import ua

    history, point, values_at_cut = History(), None, 0
    node = _node(client, tag, server)
    begin = start
    while True:
        details = ua.ReadRawModifiedDetails(
            IsReadModified=False,
            StartTime=_moment(begin),
            EndTime=_moment(stop),
            NumValuesPerNode=server.page,
            ReturnBounds=False,
        )
        result = await node.history_read(details, point)
        _check(result, tag, server)
        page = list(getattr(result.HistoryData, "DataValues", None) or ())
        before = len(history.times)
        _take(history, page[values_at_cut:])
        values_at_cut, previous, point = 0, point, result.ContinuationPoint
        if point:
            if point == previous:
                raise _stuck(tag, server)
            continue
        if len(page) < server.page:
            if not history.times and not await exists(client, tag, server):
                raise UnknownTag(f"{server}: there is no node {tag!r}")
            return history
        if len(history.times) == before:
            raise _stuck(tag, server)
        begin = history.times[-1]
        values_at_cut = sum(1 for time in history.times[-server.page :] if time == begin)


def _stuck(tag: str, server: OpcUaServer) -> ConnectorError:
    return ConnectorError(
        f"{server}: {tag}: the server gives the same page of its history again and again; "
        "expected it to go on. Ask for another page size (page), or a shorter window"
    )


def _take(history: History, page: Sequence[Any]) -> None:
    for value in page:
        time = value.SourceTimestamp or value.ServerTimestamp
        if time is None:
            continue
        history.times.append(time if time.tzinfo is not None else time.replace(tzinfo=UTC))
        history.values.append(None if value.Value is None else value.Value.Value)
        status = value.StatusCode
        code = 0 if status is None else int(status.value)
        history.statuses.append(code)
        if code not in history.names:
            history.names[code] = "Good" if status is None else str(status.name)


def _moment(instant: datetime) -> datetime:
    """The instant as this version of the library expects it: older ones take naive UTC."""
    from asyncua import ua

    utc = instant.astimezone(UTC)
    return utc if ua.get_win_epoch().tzinfo is not None else utc.replace(tzinfo=None)


def _node(client: Any, tag: str, server: OpcUaServer) -> Any:
    from asyncua.ua import uaerrors

    try:
        return client.get_node(tag)
    except (uaerrors.UaError, ValueError) as error:
        raise UnknownTag(
            f"{server}: {tag!r} is no node id ({error}); expected one such as "
            "ns=2;s=FIC-101.OP or ns=2;i=1042"
        ) from None


def _check(result: Any, tag: str, server: OpcUaServer) -> None:
    status = result.StatusCode
    if status.is_good():
        return
    if status.name in ("BadNodeIdUnknown", "BadNodeIdInvalid"):
        raise UnknownTag(f"{server}: there is no node {tag!r}")
    raise ConnectorError(
        f"{server}: {tag}: the server gives no history ({status.name}); expected a node that is "
        "historized and that this user may read the history of"
    )


async def exists(client: Any, tag: str, server: OpcUaServer) -> bool:
    """Whether the server has the node."""
    from asyncua import ua

    try:
        await _node(client, tag, server).read_node_class()
    except (UnknownTag, ua.uaerrors.BadNodeIdUnknown, ua.uaerrors.BadNodeIdInvalid):
        return False
    return True


async def browse(client: Any) -> list[FoundNode]:
    """Variables below Objects whose history may be read, at most ``MOST_TAGS``."""
    from asyncua import ua

    nodes: list[FoundNode] = []
    seen: set[str] = set()
    level = [("", client.get_objects_node())]
    for _ in range(_DEPTH):
        children: list[tuple[str, Any]] = []
        for folder, node in level:
            for child in await node.get_children_descriptions():
                tag = child.NodeId.to_string()
                if tag in seen or child.NodeId.NamespaceIndex == 0:
                    continue
                seen.add(tag)
                name = child.DisplayName.Text or ""
                found = client.get_node(child.NodeId)
                children.append((name, found))
                if child.NodeClass == ua.NodeClass.Variable and await _historized(found):
                    nodes.append(FoundNode(tag, name, folder))
                    if len(nodes) == MOST_TAGS:
                        return nodes
        level = children
    return nodes


async def _historized(node: Any) -> bool:
    from asyncua.ua.attribute_ids import AttributeIds

    value = await node.read_attribute(AttributeIds.UserAccessLevel)
    return bool(int(value.Value.Value or 0) & _HISTORY_READ)
