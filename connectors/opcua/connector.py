"""``OpcUaArchive``: the history of an OPC UA server as a source of recordings."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from stemwatch.connectors.archive.settings import ArchiveSettings
from stemwatch.connectors.connector import (
    WHOLE,
    ArchiveAddress,
    TagInfo,
    UnknownTag,
    ValveTags,
    Window,
    nearest_names,
)
from stemwatch.connectors.opcua.session import OpcUaServer, Security
from stemwatch.connectors.secret import Secret
from stemwatch.connectors.settings import Duration, Name, Text, contradiction
from stemwatch.models.recording import Bools, Recording, Role

if TYPE_CHECKING:
    from stemwatch.connectors.historian.columns import Column
    from stemwatch.connectors.opcua.session import FoundNode, History

LAYOUT = "OPC UA, raw history of a node for each tag"
ZONE = "The server gives instants in UTC."
_FIRST, _LAST = datetime(1970, 1, 2, tzinfo=UTC), datetime(2262, 1, 1, tzinfo=UTC)
# OPC UA part 4 and part 11: severity in the two top bits; in the low bits, where they describe a
# value, that the archive interpolated or calculated it.
_SEVERITY, _DESCRIBES_VALUE, _INTERPOLATED, _CALCULATED = 0xC0000000, 0x400, 0x2, 0x1


@dataclass(frozen=True, kw_only=True)
class OpcUaAddress(OpcUaServer):
    """A server, as it is sent to the worker that reads it; an ``ArchiveAddress``.

    ``before_s`` seconds before each window are read too, because servers keep values when they
    change. ``good`` are names of status codes that are taken as good.
    """

    before_s: float = 3600.0
    good: tuple[str, ...] = ()

    def open(self) -> OpcUaArchive:
        """The archive; no connection is made yet."""
        return OpcUaArchive(self)


Policy = Literal["None", "Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"]


class OpcUaSettings(ArchiveSettings):
    """``kind = "opcua"``: a server's history; tags are node ids."""

    url: Name = Field(description="an address such as opc.tcp://host:4840/path")
    security_policy: Policy = Field(
        default="None",
        description='"None", "Basic256Sha256", "Aes128Sha256RsaOaep" or "Aes256Sha256RsaPss"',
    )
    security_mode: Literal["Sign", "SignAndEncrypt"] = Field(
        default="SignAndEncrypt", description='"Sign" or "SignAndEncrypt"'
    )
    certificate: Name | None = Field(
        default=None, description="this client's certificate, a file relative to the plant file"
    )
    private_key: Name | None = Field(
        default=None, description="its private key, a file relative to the plant file"
    )
    server_certificate: Name | None = Field(
        default=None, description="the server's certificate, a file relative to the plant file"
    )
    user: Text | None = Field(default=None, description="the name to log in with, as text")
    secret_variable: Name | None = Field(
        default=None, description="the name of the environment variable that holds the password"
    )
    secret_file: Name | None = Field(
        default=None, description="the name of a file that holds nothing but the password"
    )
    timeout_s: Duration = Field(default=30.0, description="seconds, above 0")
    page: Annotated[int, Field(ge=2, le=1_000_000)] = Field(
        default=50_000, description="samples asked for at a time, 2 to 1000000"
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if not self.url.startswith("opc.tcp://"):
            raise contradiction(("url",), repr(self.url), "an address with opc.tcp://")
        if self.security_policy != "None":
            for key in ("certificate", "private_key"):
                if getattr(self, key) is None:
                    raise contradiction((key,), "nothing", f"a file, for {self.security_policy}")
        if self.user is not None and (self.secret_variable is None) == (self.secret_file is None):
            found_text = "a user without one place for the password"
            raise contradiction(("user",), found_text, "secret_variable or secret_file as well")
        if self.user is None and (self.secret_variable or self.secret_file):
            raise contradiction(("user",), "nothing beside a password", "the name to log in with")
        return self

    def address(self, folder: Path, zone: str | None) -> ArchiveAddress:
        """Of the server; certificates count from ``folder``."""

        def beside(name: str | None) -> str:
            return "" if name is None else str(folder / name)

        security = Security(
            policy=self.security_policy,
            mode=self.security_mode,
            certificate=beside(self.certificate),
            private_key=beside(self.private_key),
            server_certificate=beside(self.server_certificate),
            user=self.user or "",
            password=Secret(variable=self.secret_variable or "", file=beside(self.secret_file)),
        )
        return OpcUaAddress(
            url=self.url,
            security=security,
            timeout_s=self.timeout_s,
            page=self.page,
            before_s=3600.0 if self.before_s is None else self.before_s,
            good=tuple(self.good_quality or ()),
        )


class OpcUaArchive:
    """A server that keeps history; implements ``stemwatch.connectors.connector.Connector``.

    A tag is a node id such as ``ns=2;s=FIC-101.OP``. Nothing is ever written, called or
    subscribed to.
    """

    settings = OpcUaSettings

    def __init__(self, address: OpcUaAddress) -> None:
        self.address = address

    def tags(self) -> Sequence[TagInfo]:
        """Every node below Objects whose history may be read, with role and valve proposed from its
        name; samples are not counted."""
        from stemwatch.connectors.historian.tags.roles import propose_roles
        from stemwatch.connectors.historian.tags.tag_names import parse_tag
        from stemwatch.connectors.opcua.session import browse, connected

        async def list_nodes() -> list[FoundNode]:
            async with connected(self.address) as client:
                return await browse(client)

        nodes = asyncio.run(list_nodes())
        named = [
            (next((name for name in node.names() if parse_tag(name).loop), node.name), "", "", None)
            for node in nodes
        ]
        candidates = propose_roles(named, stem="", mv_is_output=False)
        return [
            replace(candidate.info(), tag=node.tag, description=node.name)
            for node, candidate in zip(nodes, candidates, strict=True)
        ]

    def present(self, valve: ValveTags) -> ValveTags:
        """``valve`` without the roles beside OP and MV whose node the server does not have."""
        from stemwatch.connectors.archive.valve_columns import with_existing
        from stemwatch.connectors.opcua.session import connected, exists

        async def present_tags(optional: frozenset[str]) -> set[str]:
            async with connected(self.address) as client:
                return {tag for tag in optional if await exists(client, tag, self.address)}

        return with_existing(valve, lambda optional: asyncio.run(present_tags(optional)))

    def read(self, valve: ValveTags, window: Window = WHOLE) -> Recording:
        """The recording of one valve, from raw history.

        Raises ``UnknownTag`` for a node that is not there, and ``ConnectorError`` for one without
        history, a window without samples of OP, and a server that does not answer.
        """
        from stemwatch.connectors.archive.valve_columns import bounds_of, recording_of_columns
        from stemwatch.connectors.historian.recordings import need_op

        server = str(self.address)
        need_op(server, valve)
        histories = asyncio.run(self._read_history(valve, window))
        bounds = bounds_of(window, self.address.before_s)
        columns = {
            mapping.tag: self._column(mapping.tag, role, histories[mapping.tag], bounds)
            for role, mapping in valve.tags.items()
        }
        return recording_of_columns(
            server, LAYOUT, ZONE, columns, valve, window, place="the server's history"
        )

    async def _read_history(self, valve: ValveTags, window: Window) -> dict[str, History]:
        from stemwatch.connectors.opcua.session import browse, connected, read_history

        start = _FIRST
        if window.start is not None:
            start = window.start - timedelta(seconds=self.address.before_s)
        stop = window.stop or _LAST
        histories: dict[str, History] = {}
        async with connected(self.address) as client:
            for tag in {mapping.tag for mapping in valve.tags.values()}:
                try:
                    histories[tag] = await read_history(client, tag, start, stop, self.address)
                except UnknownTag as error:
                    names = [node.tag for node in await browse(client)]
                    near_tags = nearest_names(tag, names) or "none: nothing has a history"
                    raise UnknownTag(f"{error}; the nearest are {near_tags}") from None
        return histories

    def _column(
        self, tag: str, role: Role, history: History, bounds: tuple[int | None, int | None]
    ) -> Column:
        from stemwatch.connectors.archive.number_column import number_column
        from stemwatch.connectors.archive.valve_columns import empty_column, within_bounds
        from stemwatch.connectors.historian.times.epoch import ns_of

        if not history.times:
            return empty_column(tag)
        ns = np.array([ns_of(time) for time in history.times], dtype=np.int64)
        values = np.array([_number(value) for value in history.values], dtype=np.float64)
        codes = np.array(history.statuses, dtype=np.int64)
        bad = is_bad(codes) & ~np.isin(codes, _codes_of(history, self.address.good))
        reasons = Counter(history.names[code] for code in codes[bad].tolist())
        column = number_column(
            tag,
            ns,
            np.ones(ns.size, dtype=bool),
            values,
            source_name=str(self.address),
            bad=bad,
            reasons=reasons,
            as_mode=role is Role.MODE,
        )
        return within_bounds(column, bounds)


def is_bad(codes: NDArray[np.int64]) -> Bools:
    """(n,) True where a status code is bad or uncertain, or says that the archive interpolated or
    calculated the value, which is then no measurement."""
    made_up = (codes & _DESCRIBES_VALUE != 0) & (codes & (_INTERPOLATED | _CALCULATED) != 0)
    return np.asarray((codes & _SEVERITY != 0) | made_up)


def _codes_of(history: History, names: Collection[str]) -> list[int]:
    """The status codes of ``history`` that have one of ``names``."""
    return [code for code, name in history.names.items() if name in names]


def _number(value: object) -> float:
    if isinstance(value, bool | int | float | np.number):
        return float(value)
    try:
        return float(str(value)) if value is not None else float("nan")
    except ValueError:
        return float("nan")
