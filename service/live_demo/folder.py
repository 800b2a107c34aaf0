"""``DemoFolder``: the folder with all files of the live demo."""

from __future__ import annotations

import shutil
from pathlib import Path

from stemwatch.service.collector.lock import FolderLock

ABOUT = "about.txt"
PLANT_FILE, LOG_FILE, DATABASE = "plant.toml", "service.log", "stemwatch.db"
SPOOL, REPORTS, MAILS = "stemwatch-spool", "stemwatch-reports", "mails"
_FILES = (PLANT_FILE, LOG_FILE, DATABASE, f"{DATABASE}-wal", f"{DATABASE}-shm")
_ABOUT_TEXT = (
    "Made by `stemwatch demo --live`. The next live demo in this folder begins anew and removes\n"
    "plant file, database, samples, reports, mails and log of this one.\n"
)


class DemoFolder:
    """The demo's folder at ``path``, created where missing and locked until ``release``.

    The simulated plant starts with a new valve each time, so the files of an earlier demo are
    removed. Raises ``FileExistsError`` for a folder that holds other files, and
    ``BlockingIOError`` where a demo is running in it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path.resolve()
        about_file = self.path / ABOUT
        if self.path.exists() and not about_file.is_file() and any(self.path.iterdir()):
            raise FileExistsError(
                f"{path} holds other files and was not made by a live demo; name a new folder or "
                "an empty one with --out"
            )
        self.path.mkdir(parents=True, exist_ok=True)
        try:
            self._lock = FolderLock(self.path)
        except BlockingIOError:
            raise BlockingIOError(
                f"a live demo is running in {path}; end it, or name another folder with --out"
            ) from None
        about_file.write_text(_ABOUT_TEXT, encoding="utf-8", newline="\n")
        self._clear()

    @property
    def mails(self) -> Path:
        """Where the mail catcher writes each mail."""
        return self.path / MAILS

    @property
    def plant_file(self) -> Path:
        """The plant.toml that the service is started with."""
        return self.path / PLANT_FILE

    @property
    def log(self) -> Path:
        """Where the service writes its log."""
        return self.path / LOG_FILE

    @property
    def database(self) -> str:
        """The URL of the service's database."""
        return f"sqlite:///{self.path / DATABASE}"

    def release(self) -> None:
        """Let another demo use the folder."""
        self._lock.release()

    def _clear(self) -> None:
        for name in _FILES:
            (self.path / name).unlink(missing_ok=True)
        for name in (SPOOL, REPORTS, MAILS):
            if (self.path / name).is_dir():
                shutil.rmtree(self.path / name)
