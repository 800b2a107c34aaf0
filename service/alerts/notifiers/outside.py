"""Which addresses a webhook may reach: public ones, unless the plant file allows others.

Every address that a name leads to is looked at, and the connection goes to one of those that were:
a name that answers differently the second time gains nothing.
"""

from __future__ import annotations

import socket
from ipaddress import IPv4Address, IPv6Address, IPv6Network, ip_address

from stemwatch.service.alerts.notifiers.notifier import NotSent

# IPv6 addresses that lead to an IPv4 one: translators (RFC 6052), 6to4 (RFC 3056) and the old
# compatible form. What counts is where they lead.
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
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    listed = list(dict.fromkeys(str(one[4][0]) for one in found))
    if not allow_private:
        for one in listed:
            if not is_public(one):
                raise NotSent(
                    f"{host} is {one}, an address of this machine or of a private network; set "
                    "allow_private = true where that is meant",
                    final=True,
                )
    return listed


def is_public(address: str) -> bool:
    """Whether an address is one of the public internet, and leads to no other."""
    try:
        plain = ip_address(address)
    except ValueError:
        return False
    if isinstance(plain, IPv6Address):
        if plain in _TEREDO or plain in _LOCAL_TRANSLATED or plain.scope_id is not None:
            return False
        inner = _inner(plain)
        if inner is not None:
            return is_public(str(inner))
    return plain.is_global and not plain.is_multicast and not plain.is_reserved


def _inner(address: IPv6Address) -> IPv4Address | None:
    if address.ipv4_mapped is not None:
        return address.ipv4_mapped
    number = int(address)
    if address in _SIX_TO_FOUR:
        return IPv4Address(number >> 80 & 0xFFFFFFFF)
    if address in _TRANSLATED or address in _COMPATIBLE:
        return IPv4Address(number & 0xFFFFFFFF)
    return None
