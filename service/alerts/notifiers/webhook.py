"""A webhook: the message as JSON by HTTP POST, signed, to public addresses only unless allowed.

Every address that a name resolves to is checked, and the connection goes to one of the checked
addresses: a name that resolves differently the second time gains nothing (DNS rebinding).
"""

from __future__ import annotations

import hashlib
import hmac
import http.client
import json
import socket
import ssl
import time
from collections.abc import Mapping
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address, IPv6Network, ip_address
from pathlib import Path
from typing import Any, Self
from urllib.parse import SplitResult, urlsplit

from stemwatch.connectors.connection_deadline import close_after
from stemwatch.connectors.secret import Secret
from stemwatch.service.alerts.notifiers.notifier import NotSent, revealed, why_not_connected
from stemwatch.service.config.service_schema import NotifierTable

# IPv6 addresses that stand for an IPv4 address: translators (RFC 6052), 6to4 (RFC 3056) and the old
# compatible form. The IPv4 address decides.
_TRANSLATED = IPv6Network("64:ff9b::/96")
_SIX_TO_FOUR = IPv6Network("2002::/16")
_COMPATIBLE = IPv6Network("::/96")
_TEREDO = IPv6Network("2001::/32")
_LOCAL_TRANSLATED = IPv6Network("64:ff9b:1::/48")


def addresses(host: str, port: int, *, allow_private: bool) -> list[str]:
    """The addresses of ``host``, in the order they should be tried.

    Raises ``NotSent`` where one of them is not public and ``allow_private`` is false, and
    ``OSError`` where the name is not known.
    """
    resolved = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    address_list = list(dict.fromkeys(str(entry[4][0]) for entry in resolved))
    if not allow_private:
        for address in address_list:
            if not is_public(address):
                raise NotSent(
                    f"{host} is {address}, an address of this machine or of a private network; set "
                    "allow_private = true where that is meant",
                    final=True,
                )
    return address_list


def is_public(address: str) -> bool:
    """Whether an address belongs to the public internet, as does the IPv4 address that it stands
    for."""
    try:
        parsed = ip_address(address)
    except ValueError:
        return False
    if isinstance(parsed, IPv6Address):
        if parsed in _TEREDO or parsed in _LOCAL_TRANSLATED or parsed.scope_id is not None:
            return False
        if parsed.is_site_local:  # withdrawn, but routers still lead it to networks of a site
            return False
        inner = _inner(parsed)
        if inner is not None:
            return is_public(str(inner))
    return parsed.is_global and not parsed.is_multicast and not parsed.is_reserved


def _inner(address: IPv6Address) -> IPv4Address | None:
    if address.ipv4_mapped is not None:
        return address.ipv4_mapped
    number = int(address)
    if address in _SIX_TO_FOUR:
        return IPv4Address(number >> 80 & 0xFFFFFFFF)
    if address in _TRANSLATED or address in _COMPATIBLE:
        return IPv4Address(number & 0xFFFFFFFF)
    return None


TIMEOUT_S = 20.0
SIGNATURE = "X-Stemwatch-Signature"
KEY = "Idempotency-Key"


@dataclass(frozen=True, kw_only=True)
class WebhookNotifier:
    """Posts each message to ``url``.

    The header ``X-Stemwatch-Signature`` is ``sha256=`` and the HMAC of the body with the secret,
    ``Idempotency-Key`` the message's key. Redirections are not followed: a status of 300 or more
    means that the message was not accepted. A name that leads to an address of this machine or of a
    private network is refused unless ``allow_private``.
    """

    url: str
    secret: Secret
    allow_private: bool = False

    @classmethod
    def from_table(cls, table: NotifierTable, secret: Secret, folder: Path) -> Self:
        """Address of the table, and whether it may be a private one."""
        return cls(url=table.url or "", secret=secret, allow_private=table.allow_private)

    def send(self, key: str, message: Mapping[str, Any]) -> None:
        """Post the message; any status from 200 to 299 means that it was accepted."""
        body = json.dumps({"key": key, **message}, ensure_ascii=False).encode()
        headers = {"Content-Type": "application/json", KEY: key, "User-Agent": "stemwatch"}
        if (secret := revealed(self.secret)) is not None:
            digest = hmac.new(secret.encode(), body, hashlib.sha256).hexdigest()
            headers[SIGNATURE] = f"sha256={digest}"
        parts = urlsplit(self.url)
        try:
            status = self._post(parts, body, headers)
        except (OSError, http.client.HTTPException) as error:
            raise NotSent(f"{parts.hostname}: {why_not_connected(error)}") from None
        if not 200 <= status < 300:
            raise NotSent(f"{parts.hostname} answered with status {status}")

    def _post(self, parts: SplitResult, body: bytes, headers: dict[str, str]) -> int:
        host, secure = parts.hostname or "", parts.scheme == "https"
        port = parts.port or (443 if secure else 80)
        link = self._connect(host, port)
        try:
            with close_after(TIMEOUT_S, lambda: link):
                if secure:
                    context = ssl.create_default_context()
                    link = context.wrap_socket(
                        link, server_hostname=host, do_handshake_on_connect=False
                    )
                    link.do_handshake()
                connection = http.client.HTTPConnection(host, port, timeout=TIMEOUT_S)
                connection.sock = link
                path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
                connection.request("POST", path, body, headers)
                return connection.getresponse().status
        finally:
            link.close()

    def _connect(self, host: str, port: int) -> socket.socket:
        """A connection to the first address that accepts one; all of them were checked before."""
        until = time.monotonic() + TIMEOUT_S
        failed: OSError = OSError("the name leads to no address")
        for address in addresses(host, port, allow_private=self.allow_private):
            left_s = until - time.monotonic()
            if left_s <= 0.0:
                break
            try:
                return socket.create_connection((address, port), timeout=left_s)
            except OSError as error:
                failed = error
        raise failed
