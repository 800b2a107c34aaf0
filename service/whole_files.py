"""Files that are replaced whole or left as they were, so that nobody opens half of one."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import BinaryIO


class ReportNotWritten(OSError):
    """One or more files could not be written; the others are complete."""


def put_all(contents: Mapping[Path, bytes]) -> None:
    """Write every file whole or leave it as it was.

    Raises ``ReportNotWritten``, after writing what can be written, with each file and what to do.
    """
    write_all({path: partial(_write, content) for path, content in contents.items()})


def _write(content: bytes, file: BinaryIO) -> None:
    file.write(content)


def write_all(writers: Mapping[Path, Callable[[BinaryIO], None]]) -> None:
    """As ``put_all``, for contents that are written piece by piece."""
    if failures := [failure for path, write in writers.items() if (failure := _put(path, write))]:
        raise ReportNotWritten(" ".join(failures))


def _put(path: Path, write: Callable[[BinaryIO], None]) -> str:
    """Write to a temporary file beside ``path``, then rename it. Returns the error, if any."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            write(file)
        temporary.replace(path)
    except OSError as error:
        with suppress(OSError):  # not even that, where the file system takes no writes
            temporary.unlink(missing_ok=True)
        return (
            f"{path}: could not be written ({error.strerror or error}); "
            f"{_mend(error)}, or choose another folder, and run again."
        )
    return ""


def _mend(error: OSError) -> str:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):  # a disk is full, or the user's share of it
        return "make room on its disk"
    if error.errno == errno.EROFS:
        return "make its file system writable"
    if error.errno in (errno.EACCES, errno.EPERM):  # Windows says so of a file that is open
        return "let this account write there, close the program that has it open"
    return "close the program that has it open"


def make_folder(folder: Path) -> None:
    """Make a folder for files where it is not there. Raises ``ReportNotWritten``."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ReportNotWritten(
            f"{folder}: this folder could not be made ({error.strerror or error}); choose another, "
            "or make it and let this account write there."
        ) from None
