"""Logs as a service manager wants them: one line each on standard error, without secrets."""

from __future__ import annotations

import json
import logging
import os
import sys

from stemwatch.service.store.address import masked


class _Plain(logging.Formatter):
    """Text; without the time where the journal adds its own."""

    def __init__(self) -> None:
        time = "" if "JOURNAL_STREAM" in os.environ else "%(asctime)s "
        super().__init__(f"{time}%(levelname)s %(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """The line, with the password of every URL in it masked."""
        return masked(super().format(record))


class _Json(logging.Formatter):
    """One JSON object a line."""

    def format(self, record: logging.LogRecord) -> str:
        """The object, with the password of every URL in it masked."""
        said = {
            "at": self.formatTime(record, "%Y-%m-%dT%H:%M:%S%z"),
            "level": record.levelname.lower(),
            "part": record.name.removeprefix("stemwatch.service."),
            "message": masked(record.getMessage()),
        }
        if record.exc_info:
            said["trace"] = masked(self.formatException(record.exc_info))
        return json.dumps(said, ensure_ascii=False)


def set_up_logs(*, as_json: bool = False) -> None:
    """Send the logs of this process to standard error."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Json() if as_json else _Plain())
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)
    for name in ("pymodbus", "alembic", "uvicorn"):
        logging.getLogger(name).setLevel(logging.WARNING)
    logging.getLogger("apscheduler").setLevel(logging.CRITICAL)  # ``Alarm`` says what went wrong
