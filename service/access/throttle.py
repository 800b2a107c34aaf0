"""How long to wait after failed attempts to sign in.

Counted under the name, whether or not there is such a user, and under the address. The first few
are free, then the wait doubles up to a bound: who forgot a password is not kept out for long, and
who tries one after the other gets nowhere (60 s a guess against one name).
"""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping
from datetime import timedelta

from stemwatch.service.access.secret import digest_of
from stemwatch.service.store.accounts.login_attempts import Wait
from stemwatch.service.store.accounts.users import name_key

FORGET = timedelta(hours=1)  # without an attempt, and counting begins anew
FREE_OF_NAME, FREE_OF_ADDRESS = 5, 20
LONGEST_OF_NAME, LONGEST_OF_ADDRESS = timedelta(seconds=60), timedelta(seconds=300)
_IPV6_SITE = 64  # bits: one machine has all addresses below them


def wait_after(count: int, free: int, longest: timedelta) -> timedelta:
    """1 s after the first attempt that is not free, twice as long after each, up to ``longest``."""
    if count < free:
        return timedelta(0)
    return min(longest, timedelta(seconds=2.0 ** min(count - free, 30)))


def of_name(count: int) -> timedelta:
    """The wait of a name."""
    return wait_after(count, FREE_OF_NAME, LONGEST_OF_NAME)


def of_address(count: int) -> timedelta:
    """The wait of an address."""
    return wait_after(count, FREE_OF_ADDRESS, LONGEST_OF_ADDRESS)


def key_of_name(name: str) -> str:
    """Under which a name is counted: its digest, since people type passwords into wrong fields."""
    return f"name {digest_of(name_key(name))}"


def key_of_address(address: str) -> str:
    """Under which an address is counted; of IPv6 the network that one machine has for itself."""
    try:
        known = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return f"address {address}"
    if known.version == 6 and known.ipv4_mapped is None:
        return f"address {ipaddress.ip_network((known, _IPV6_SITE), strict=False)}"
    return f"address {known.ipv4_mapped or known if known.version == 6 else known}"


def waits_of(name: str, address: str) -> Mapping[str, Wait]:
    """Both counts of an attempt."""
    return {key_of_name(name): of_name, key_of_address(address): of_address}
