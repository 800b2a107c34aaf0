"""``[[sources]]`` with a ``kind``: archives that are asked for a valve and a window."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, model_validator

from stemwatch.connectors.archive.secret import Secret
from stemwatch.connectors.connector import ArchiveAddress
from stemwatch.service.config.problems import contradiction
from stemwatch.service.config.schema import Name, Positive, Table, Text, Zone

if TYPE_CHECKING:
    from stemwatch.connectors.historian import ReadOptions

_URL = "a database URL such as postgresql://user@host/database"
NotNegative = Annotated[float, Field(ge=0)]
Query = Annotated[str, Field(min_length=1)]
Policy = Literal["None", "Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"]


class ArchiveSource(Table):
    """What every kind of archive has."""

    name: Name = Field(description="a name of its own for the source, as text of 1 to 200 letters")
    zone: Zone | None = Field(default=None, description="an IANA time zone such as Europe/Berlin")
    good_quality: list[Name] | None = Field(
        default=None, description='a list of the codes that mean good, such as ["192", "Good"]'
    )
    before_s: NotNegative | None = Field(
        default=None,
        description="seconds before a window that are read too, for tags that are archived when "
        "they change; 0 or more",
    )

    @abstractmethod
    def address(self, folder: Path, zone: str | None) -> ArchiveAddress:
        """Where the archive is; paths count from ``folder``, ``zone`` is the plant's."""

    def _options(self, zone: str | None) -> ReadOptions:
        from stemwatch.connectors.historian import ReadOptions

        given = self.model_dump(include=set(ReadOptions.__dataclass_fields__), exclude_none=True)
        if "good_quality" in given:
            given["good_quality"] = tuple(given["good_quality"])
        return ReadOptions(**({"zone": zone} | given))


class ParquetSource(ArchiveSource):
    """``kind = "parquet"``: a file, a folder, or a partitioned folder."""

    kind: Literal["parquet"] = Field(description='"parquet", "opcua" or "sql"')
    path: Annotated[str, Field(min_length=1)] = Field(
        description="a Parquet file, a folder of them or a pattern, relative to the plant file"
    )
    time_column: Name | None = Field(default=None, description="the name of the time column")
    tag_column: Name | None = Field(
        default=None, description="the name of the column, or folder key, of tags or valves"
    )
    value_column: Name | None = Field(default=None, description="the name of the value column")
    quality_column: Name | None = Field(default=None, description="the name of the quality column")
    ambiguous_hour: Literal["infer", "first", "second"] | None = Field(
        default=None, description='"infer", "first" (summer time) or "second" (standard time)'
    )
    missing_hour: Literal["shift", "leave_out"] | None = Field(
        default=None, description='"shift" (forward by an hour) or "leave_out"'
    )

    def address(self, folder: Path, zone: str | None) -> ArchiveAddress:
        """Of the files."""
        from stemwatch.connectors.parquet import ParquetAddress

        path = self.path if "://" in self.path else str(folder / self.path)
        return ParquetAddress(path, self._options(zone), before_s=self.before_s or 0.0)


class SqlSource(ArchiveSource):
    """``kind = "sql"``: a database that is asked with a query of the user's own."""

    kind: Literal["sql"] = Field(description='"parquet", "opcua" or "sql"')
    url: Query | None = Field(default=None, description=_URL)
    url_variable: Name | None = Field(
        default=None, description="the name of the environment variable that holds the URL"
    )
    query: Query = Field(
        description="one SELECT of time, value and perhaps quality, with :tag, :start and :end"
    )
    tags_query: Query | None = Field(
        default=None, description="one SELECT of tag and perhaps unit, which lists all tags"
    )
    bounds_format: Name | None = Field(
        default=None,
        description="how :start and :end are written, where times are kept as text, such as "
        "%Y-%m-%dT%H:%M:%S",
    )
    ambiguous_hour: Literal["infer", "first", "second"] | None = Field(
        default=None, description='"infer", "first" (summer time) or "second" (standard time)'
    )
    missing_hour: Literal["shift", "leave_out"] | None = Field(
        default=None, description='"shift" (forward by an hour) or "leave_out"'
    )

    @model_validator(mode="after")
    def _one_url(self) -> Self:
        if (self.url is None) == (self.url_variable is None):
            found = "nothing" if self.url is None else "both url and url_variable"
            raise contradiction(("url",), found, f"{_URL}; or url_variable instead")
        return self

    @model_validator(mode="after")
    def _only_reads(self) -> Self:
        from stemwatch.connectors.sql.template import fault_of

        for key, given in (("query", self.query), ("tags_query", self.tags_query)):
            if given is not None and (fault := fault_of(given, with_tag=key == "query")):
                raise contradiction((key,), fault.found, fault.expected)
        return self

    def address(self, folder: Path, zone: str | None) -> ArchiveAddress:
        """Of the database; a path in a SQLite URL counts from ``folder``."""
        from stemwatch.connectors.sql import SqlAddress
        from stemwatch.connectors.sql.connector import beside

        url = (
            Secret(text=beside(self.url, folder))
            if self.url
            else Secret(variable=self.url_variable or "")
        )
        return SqlAddress(
            name=self.name,
            url=url,
            query=self.query,
            tags_query=self.tags_query or "",
            bounds_format=self.bounds_format or "",
            options=self._options(zone),
            before_s=0.0 if self.before_s is None else self.before_s,
        )


class OpcUaSource(ArchiveSource):
    """``kind = "opcua"``: a server's history; tags are node ids."""

    kind: Literal["opcua"] = Field(description='"parquet", "opcua" or "sql"')
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
    timeout_s: Positive = Field(default=30.0, description="seconds, above 0")
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
            found = "a user without one place for the password"
            raise contradiction(("user",), found, "secret_variable or secret_file as well")
        return self

    def address(self, folder: Path, zone: str | None) -> ArchiveAddress:
        """Of the server; certificates count from ``folder``."""
        from stemwatch.connectors.opcua import OpcUaAddress, Security

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
        )


KINDS: dict[str, type[ArchiveSource]] = {
    "parquet": ParquetSource,
    "sql": SqlSource,
    "opcua": OpcUaSource,
}
