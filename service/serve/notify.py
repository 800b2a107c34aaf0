"""Telling systemd how the service is doing, where it asked to be told."""

from __future__ import annotations

import os
import socket


def tell_systemd(state: str) -> None:
    """Send ``state`` (``READY=1``, ``STOPPING=1``) to the socket in ``NOTIFY_SOCKET``, if any."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address or not hasattr(socket, "AF_UNIX"):
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link:
            link.sendto(state.encode(), address)
    except OSError:
        pass  # nobody listens: then nobody waits for it
