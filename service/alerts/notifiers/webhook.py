"""A webhook: the message as JSON by HTTP POST, signed, to public addresses only unless allowed."""

from __future__ import annotations

import hashlib
import hmac
import http.client
import ipaddress
import json
import socket
import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import SplitResult, urlsplit

from stemwatch.service.alerts.notifiers.notifier import NotSent
from stemwatch.service.alerts.notifiers.secret import Secret

TIMEOUT_S = 20.0
SIGNATURE = "X-Stemwatch-Signature"
KEY = "Idempotency-Key"


@dataclass(frozen=True, kw_only=True)
class WebhookNotifier:
    """Posts each message to ``url``.

    The header ``X-Stemwatch-Signature`` is ``sha256=`` and the HMAC of the body with the secret,
    ``Idempotency-Key`` the message's key. Redirections are not followed, and a name that leads to
    an address of this machine or of a private network is refused unless ``allow_private``.
    """

    url: str
    secret: Secret
    allow_private: bool = False

    def send(self, key: str, message: Mapping[str, Any]) -> None:
        """Post the message; any answer from 200 to 299 means that it was taken."""
        body = json.dumps({"key": key, **message}, ensure_ascii=False).encode()
        headers = {"Content-Type": "application/json", KEY: key, "User-Agent": "stemwatch"}
        if (secret := self.secret.read()) is not None:
            digest = hmac.new(secret.encode(), body, hashlib.sha256).hexdigest()
            headers[SIGNATURE] = f"sha256={digest}"
        parts = urlsplit(self.url)
        try:
            status = self._post(parts, body, headers)
        except (OSError, http.client.HTTPException) as error:
            raise NotSent(f"{parts.hostname}: {type(error).__name__}: {error}") from None
        if not 200 <= status < 300:
            raise NotSent(f"{parts.hostname} answered with status {status}")

    def _post(self, parts: SplitResult, body: bytes, headers: dict[str, str]) -> int:
        host, secure = parts.hostname or "", parts.scheme == "https"
        port = parts.port or (443 if secure else 80)
        link = socket.create_connection((self._address(host, port), port), timeout=TIMEOUT_S)
        connection = http.client.HTTPConnection(host, port, timeout=TIMEOUT_S)
        try:
            if secure:
                context = ssl.create_default_context()
                link = context.wrap_socket(link, server_hostname=host)
            connection.sock = link
            path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
            connection.request("POST", path, body, headers)
            answer = connection.getresponse()
            answer.read(1000)
            return answer.status
        finally:
            link.close()

    def _address(self, host: str, port: int) -> str:
        """The address that is connected to: checked, and not looked up a second time."""
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        address = str(found[0][4][0])
        if not self.allow_private and not ipaddress.ip_address(address).is_global:
            raise NotSent(
                f"{host} is {address}, an address of this machine or of a private network; set "
                "allow_private = true where that is meant",
                final=True,
            )
        return address
