"""A server that demands encryption, a certificate and a password."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("asyncua", reason="asyncua is missing: OPC UA IS NOT TESTED")

from asyncua.crypto.cert_gen import setup_self_signed_certificate
from cryptography.x509.oid import ExtendedKeyUsageOID

from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.opcua import OpcUaAddress, Security
from stemwatch.connectors.secret import Secret
from tests.connectors import example_archives as made
from tests.connectors.opcua.loopback_server import Secured, serving
from tests.connectors.opcua.test_opcua_archive import PREFIX, history

VARIABLE = "STEMWATCH_TEST_OPCUA"


def certificate(folder: Path, name: str, uri: str, use: object) -> Secured:
    """A certificate of an application, signed by itself, and its key."""
    made_here = Secured(folder / f"{name}.der", folder / f"{name}.pem")
    asyncio.run(
        setup_self_signed_certificate(
            made_here.private_key,
            made_here.certificate,
            uri,
            "localhost",
            [use],  # type: ignore[list-item]
            {"countryName": "DE", "organizationName": "Stemwatch"},
        )
    )
    return made_here


@pytest.fixture(scope="module")
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpcUaAddress]:
    """The address of such a server, with everything that is needed to log in."""
    folder = tmp_path_factory.mktemp("certificates")
    server = certificate(
        folder, "server", "urn:freeopcua:python:server", ExtendedKeyUsageOID.SERVER_AUTH
    )
    client = certificate(folder, "client", "urn:freeopcua:client", ExtendedKeyUsageOID.CLIENT_AUTH)
    with serving(history(), secured=server) as (url, _):
        security = Security(
            policy="Basic256Sha256",
            mode="SignAndEncrypt",
            certificate=str(client.certificate),
            private_key=str(client.private_key),
            server_certificate=str(server.certificate),
            user="reader",
            password=Secret(variable=VARIABLE),
        )
        yield OpcUaAddress(url=url, security=security, timeout_s=10.0)


def test_it_reads_encrypted_and_logged_in(
    secured: OpcUaAddress, monkeypatch, caplog: pytest.LogCaptureFixture
) -> None:
    """With certificate, user and password from the environment; no log line holds the password."""
    monkeypatch.setenv(VARIABLE, "geheim")
    with caplog.at_level(logging.DEBUG):
        assert len(secured.open().read(made.valve(PREFIX))) == made.COUNT
    answer = [record.name for record in caplog.records if "geheim" in record.getMessage()]
    assert answer == []


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"password": Secret(text="wrong")}, "could not be asked"),
        ({"policy": "None"}, "could not be asked"),
        ({"private_key": "/nowhere/key.pem"}, "could not be asked"),
        ({"password": Secret(variable="STEMWATCH_NOT_SET")}, "STEMWATCH_NOT_SET is not set"),
    ],
)
def test_what_is_wrong_is_an_error_and_no_data(
    secured: OpcUaAddress, monkeypatch, changes: dict, text: str
) -> None:
    """A wrong password, no encryption, no key, no secret: each ends in a sentence."""
    monkeypatch.setenv(VARIABLE, "geheim")
    address = replace(secured, security=replace(secured.security, **changes))
    with pytest.raises(ConnectorError, match=text) as result:
        address.open().read(made.valve(PREFIX))
    assert "wrong" not in str(result.value).replace("was wrong", "")
