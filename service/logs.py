"""Logging to standard error, one line per message, with secrets masked.

A message may name what it is about: ``log.info("...", extra={"run": 3, "valve": "FIC-101"})``.
"""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from types import TracebackType

from stemwatch.connectors.secret import MASK, masked

ABOUT = ("run", "valve", "device", "notifier")  # keys of ``extra`` that go into a JSON line
FORMAT = "STEMWATCH_LOG_FORMAT"  # environment variable that passes the format to child processes
JSON, PLAIN = "json", "plain"
_MOST_KINDS = 1000  # of lines that are remembered
_SHORTEST_SECRET = 4  # hiding what is shorter would make logs unreadable
_PACKAGE = "stemwatch.service."
_secrets: set[str] = set()

log = logging.getLogger(__name__)


def set_up_logs(*, as_json: bool = False, process: str = "service") -> None:
    """Send log messages, warnings and uncaught errors of threads to standard error.

    ``process`` names this process in JSON lines. Child processes call ``logs_as_parent``.
    """
    multiprocessing.current_process().name = process
    os.environ[FORMAT] = JSON if as_json else PLAIN
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Json() if as_json else _Plain())
    handler.addFilter(OnceAMinute(equal=True))
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)
    logging.captureWarnings(True)
    for name in ("pymodbus", "alembic", "uvicorn"):
        logging.getLogger(name).setLevel(logging.WARNING)
    if as_json:
        sys.excepthook = _log_uncaught
        threading.excepthook = _log_uncaught_in_thread


def logs_as_parent(process: str) -> None:
    """Log in the format of the parent process, if it has called ``set_up_logs``."""
    if FORMAT in os.environ:
        set_up_logs(as_json=os.environ[FORMAT] == JSON, process=process)


def hide(secrets: Iterable[str | None]) -> None:
    """Mask these texts as ``***`` in all later messages of this process."""
    _secrets.update(secret for secret in secrets if secret and len(secret) >= _SHORTEST_SECRET)


def clean(text: str) -> str:
    """``text`` without hidden secrets and without the passwords of URLs."""
    for secret in sorted(_secrets, key=len, reverse=True):
        text = text.replace(secret, MASK)
    return masked(text)


class OnceAMinute(logging.Filter):
    """Lets a line through once in ``every_s``, and says then how often it came meanwhile: what goes
    wrong a thousand times, or what strangers can set off, must not fill the disk of the log.

    One kind of line is one text before its values are filled in, with one kind of error; with
    ``equal`` only lines that are the same with their values, and only warnings and errors.
    """

    def __init__(
        self,
        every_s: float = 60.0,
        *,
        equal: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self._every_s, self._equal, self._clock = every_s, equal, clock
        self._said: dict[tuple[object, ...], tuple[float, int]] = {}
        self._lock = threading.Lock()

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether this record is written; it then bears the count."""
        if self._equal and record.levelno < logging.WARNING:
            return True
        error = record.exc_info[0] if record.exc_info else None
        kind: tuple[object, ...] = (str(record.msg).partition("\n")[0], error)
        if self._equal:
            kind = (record.name, record.getMessage(), error)
        now = self._clock()
        with self._lock:
            if len(self._said) >= _MOST_KINDS:
                self._said.clear()
            last, left_out = self._said.get(kind, (-self._every_s, 0))
            if now - last < self._every_s:
                self._said[kind] = last, left_out + 1
                return False
            self._said[kind] = now, 0
        if left_out:
            record.msg = f"{record.getMessage()} ({left_out} times more since it was last said)"
            record.args = None
        return True


class _Plain(logging.Formatter):
    """Plain text; without the time where systemd's journal adds it."""

    def __init__(self) -> None:
        time = "" if "JOURNAL_STREAM" in os.environ else "%(asctime)s "
        super().__init__(f"{time}%(levelname)s %(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """The line with secrets masked."""
        return clean(super().format(record))


class _Json(logging.Formatter):
    """One JSON object a line."""

    def format(self, record: logging.LogRecord) -> str:
        """The JSON object with secrets masked in each text."""
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "process": record.processName,
            "pid": record.process,
            "part": record.name.removeprefix(_PACKAGE),
            "message": clean(record.getMessage()),
        }
        about = {key: getattr(record, key) for key in ABOUT if hasattr(record, key)}
        line |= {
            key: clean(value) if isinstance(value, str) else value for key, value in about.items()
        }
        if record.exc_info:
            line["trace"] = clean(self.formatException(record.exc_info))
        # Paths and tags may hold lone surrogates, which UTF-8 cannot encode.
        return json.dumps(line, ensure_ascii=False).encode("utf-8", "replace").decode("utf-8")


def _log_uncaught(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    log.critical("this process ends: %s", error, exc_info=(kind, error, trace))


def _log_uncaught_in_thread(ended: threading.ExceptHookArgs) -> None:
    if ended.exc_value is not None:
        name = ended.thread.name if ended.thread else "a thread"
        trace = (ended.exc_type, ended.exc_value, ended.exc_traceback)
        log.critical("%s ends: %s", name, ended.exc_value, exc_info=trace)
