"""Files that are replaced whole or left as they were, so that nobody opens half of one."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Mapping
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
        temporary.unlink(missing_ok=True)
        mend = "make room on its disk" if _is_full(error) else "close the program that has it open"
        return (
            f"{path}: could not be written ({error.strerror or error}); "
            f"{mend}, or choose another folder, and run again."
        )
    return ""


def _is_full(error: OSError) -> bool:
    """Whether a disk, or the share of it that a user may have, is full."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT)
