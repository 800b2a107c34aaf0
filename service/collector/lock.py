"""``FolderLock``: reserves a folder for one process until the process ends."""

from __future__ import annotations

import os
import sys
from pathlib import Path

NAME = "lock"


class FolderLock:
    """Holds ``folder`` until ``release`` or the end of the process, also by a kill.

    Raises ``BlockingIOError`` where another process holds it.
    """

    def __init__(self, folder: Path) -> None:
        self._handle = os.open(folder / NAME, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            _take(self._handle)
        except OSError as error:
            os.close(self._handle)
            message = "another process is using it"
            raise BlockingIOError(error.errno, message, str(folder / NAME)) from error

    def release(self) -> None:
        """Give the folder free for another process."""
        os.close(self._handle)


if sys.platform == "win32":
    import msvcrt

    def _take(handle: int) -> None:
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _take(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
