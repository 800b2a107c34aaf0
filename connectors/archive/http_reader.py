"""``HttpReader``: GET requests to a historian's HTTP interface, with retries and limits."""

from __future__ import annotations

import socket
import ssl
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from stemwatch.connectors.connection_deadline import close_after
from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.secret import Secret, masked

if TYPE_CHECKING:
    import httpx

Parameter = tuple[str, str | int | float | bool | None]
Parameters = Mapping[str, str] | Sequence[Parameter]

ATTEMPTS = 4  # attempts for a request that the server cannot answer now
FIRST_WAIT_S, LONGEST_WAIT_S = 0.5, 30.0
# The longest time of a whole answer, as a multiple of the time-out, and its largest size in bytes.
# A faulty or hostile server must not take unlimited time or memory.
LONGEST_ANSWER = 10
ANSWER_BYTES, VALUE_BYTES = 64 * 1024**2, 1000
LOOPBACK = ("localhost", "127.0.0.1", "::1")
_BUSY = (429, 502, 503, 504)


@dataclass(frozen=True)
class HttpAnswer:
    """A whole answer, read to its end: ``body`` unpacked, redirects not followed."""

    status: int
    headers: Mapping[str, str]
    body: bytes
    is_redirect: bool


class HttpReader:
    """Requests through ``client`` to the server that messages call ``name``."""

    def __init__(self, name: str, client: httpx.Client, timeout_s: float) -> None:
        self.name = name
        self._client, self._timeout_s = client, timeout_s
        self._link: socket.socket | None = None

    def get(self, path: str, parameters: Parameters, values: int, too_large: str) -> HttpAnswer:
        """The server's answer; a busy server is asked again after growing waits.

        Raises ``ConnectorError`` where the server cannot be asked, and with the words ``too_large``
        for an answer larger than one of ``values`` can be.
        """
        import httpx

        wait_s = FIRST_WAIT_S
        for attempt in range(1, ATTEMPTS + 1):
            last = attempt == ATTEMPTS
            try:
                answer = self._answer(path, parameters, values, too_large)
            except httpx.HTTPError as error:
                if last:
                    raise self._unreached(error) from None
            else:
                if answer.status not in _BUSY or last:
                    return answer
                wait_s = max(wait_s, _seconds(answer.headers.get("Retry-After")))
            time.sleep(min(wait_s, LONGEST_WAIT_S))
            wait_s *= 2.0
        raise AssertionError("the last attempt returns or raises")

    def _answer(self, path: str, parameters: Parameters, values: int, too_large: str) -> HttpAnswer:
        """One whole answer. Raises ``httpx.ReadTimeout`` for an answer that arrives too slowly."""
        import httpx

        most = ANSWER_BYTES + VALUE_BYTES * values
        parts: list[bytes] = []
        query = parameters if isinstance(parameters, Mapping) else list(parameters)
        told = {"trace": self._see}
        with close_after(LONGEST_ANSWER * self._timeout_s, lambda: self._link) as was_cut:
            try:
                with self._client.stream("GET", path, params=query, extensions=told) as answer:
                    for part in answer.iter_bytes():
                        most -= len(part)
                        parts.append(part)
                        if most < 0:
                            raise ConnectorError(
                                f"{self.name}: an answer is larger than {too_large} can be; it was "
                                "not read to its end. Check url, and what stands between this "
                                "machine and the server"
                            )
            except httpx.HTTPError:
                if not was_cut.is_set():
                    raise
            if was_cut.is_set():  # an answer without a length may end early, as if it were complete
                raise httpx.ReadTimeout("the answer does not come to an end")
            return HttpAnswer(
                answer.status_code, answer.headers, b"".join(parts), answer.is_redirect
            )

    def _see(self, event: str, about: Mapping[str, Any]) -> None:
        """Remember the connection on which the answer comes, its head too."""
        if event in ("connection.connect_tcp.complete", "connection.start_tls.complete"):
            self._link = about["return_value"].get_extra_info("socket")

    def _unreached(self, error: Exception) -> ConnectorError:
        text = one_line(str(error)) or type(error).__name__
        hint = "check the address, and that the network lets it through"
        if "CERTIFICATE" in text.upper():
            hint = "set authority to a file with the certificates of the site's own authority"
        return ConnectorError(
            f"{self.name}: the server could not be asked ({type(error).__name__}: {text}); {hint}"
        )


def http_client(
    name: str,
    url: str,
    authority: str,
    timeout_s: float,
    headers: Mapping[str, str],
    auth: httpx.Auth | None = None,
) -> httpx.Client:
    """A client of the server at ``url``, whose certificate the file ``authority`` may vouch for.

    Redirects are not followed, since they would carry the secret, and proxies and certificates that
    the environment names are not used. Raises ``ConnectorError`` where the file is none.
    """
    import httpx

    return httpx.Client(
        base_url=url.rstrip("/") + "/",
        auth=auth,
        headers=headers,
        timeout=timeout_s,
        verify=_verified(name, url, authority),
        follow_redirects=False,
        trust_env=False,
    )


def _verified(name: str, url: str, authority: str) -> ssl.SSLContext | bool:
    """How the certificate of ``url`` is checked. Raises ``ConnectorError`` for a wrong file."""
    if urlsplit(url).scheme != "https":
        return True
    try:
        return ssl.create_default_context(cafile=authority or None)
    except (OSError, ssl.SSLError) as error:
        raise ConnectorError(
            f"{name}: the file {authority} cannot be used ({type(error).__name__}); "
            "expected certificates in PEM form"
        ) from None


def token_of(name: str, secret: Secret) -> str:
    """The token that ``secret`` holds. Raises ``ConnectorError`` where no header can hold it."""
    token = secret.reveal()
    if not (token.isascii() and token.isprintable()) or " " in token:
        # The library's message about such a header would contain the token.
        raise ConnectorError(
            f"{name}: the token that {secret} holds has blanks, line ends or signs "
            "outside ASCII; expected one token and nothing else"
        )
    return token


def one_line(said: str) -> str:
    """A server's text for messages and logs: one line of limited length without control
    characters."""
    return masked(" ".join("".join(c if c.isprintable() else " " for c in said[:3000]).split()))[
        :300
    ]


def after_colon(said: str) -> str:
    """What a server said, to be put behind the words of a message; empty where it said nothing."""
    return f": {said}" if said else ""


def _seconds(header: str | None) -> float:
    try:
        return max(float(header or 0.0), 0.0)
    except ValueError:
        return 0.0
