"""Logs as a service manager wants them: one line each on standard error, without secrets.

What a line is about rides beside it: ``log.info("...", extra={"run": 3, "valve": "FIC-101"})``.
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

ABOUT = ("run", "valve", "device", "notifier")  # keys of ``extra`` that a JSON line has
FORMAT = "STEMWATCH_LOG_FORMAT"  # how a process tells those it starts
JSON, PLAIN = "json", "plain"
_MOST_KINDS = 1000  # of lines that are remembered
_SHORTEST_SECRET = 4  # hiding what is shorter would make logs unreadable
_PACKAGE = "stemwatch.service."
_secrets: set[str] = set()

log = logging.getLogger(__name__)


def set_up_logs(*, as_json: bool = False, process: str = "service") -> None:
    """Send the logs of this process, its warnings and whatever ends a thread to standard error.

    ``process`` is the name that lines of a JSON log bear. Processes started from here can do the
    same by ``logs_as_parent``.
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
        sys.excepthook = _say_end
        threading.excepthook = _say_end_of_thread


def logs_as_parent(process: str) -> None:
    """Log as the process that started this one does, if it has set up its logs."""
    if FORMAT in os.environ:
        set_up_logs(as_json=os.environ[FORMAT] == JSON, process=process)


def hide(secrets: Iterable[str | None]) -> None:
    """Replace these texts by ``***`` in every line of this process from now on."""
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
    """Text; without the time where the journal adds its own."""

    def __init__(self) -> None:
        time = "" if "JOURNAL_STREAM" in os.environ else "%(asctime)s "
        super().__init__(f"{time}%(levelname)s %(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """The line, cleaned."""
        return clean(super().format(record))


class _Json(logging.Formatter):
    """One JSON object a line."""

    def format(self, record: logging.LogRecord) -> str:
        """The object, each of its texts cleaned."""
        said: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "process": record.processName,
            "pid": record.process,
            "part": record.name.removeprefix(_PACKAGE),
            "message": clean(record.getMessage()),
        }
        about = {key: getattr(record, key) for key in ABOUT if hasattr(record, key)}
        said |= {
            key: clean(value) if isinstance(value, str) else value for key, value in about.items()
        }
        if record.exc_info:
            said["trace"] = clean(self.formatException(record.exc_info))
        # Lines end where JSON says so, whatever a tag or a path is made of.
        return json.dumps(said, ensure_ascii=False).encode("utf-8", "replace").decode("utf-8")


def _say_end(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    log.critical("this process ends: %s", error, exc_info=(kind, error, trace))


def _say_end_of_thread(ended: threading.ExceptHookArgs) -> None:
    if ended.exc_value is not None:
        name = ended.thread.name if ended.thread else "a thread"
        trace = (ended.exc_type, ended.exc_value, ended.exc_traceback)
        log.critical("%s ends: %s", name, ended.exc_value, exc_info=trace)
