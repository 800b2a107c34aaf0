"""Logs: every line of a JSON log is an object that says what it is about, and no line a secret."""

from __future__ import annotations

import io
import json
import logging
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stemwatch.service.logs import OnceAMinute

TOKEN, HOOK, FILED = "the-readers-token-1", "the-hooks-secret-2", "the-filed-secret-3"
# The service looks for queued runs ten times as often as at a plant.
SERVE = """
import typer
from stemwatch.service.cli.serve import serve
from stemwatch.service.run import queue_worker
queue_worker._LOOK_S = 0.5
typer.run(serve)
"""
SERVICE = """
[limits]
min_duration_s = 5
[service]
workers = 1
[alerts]
raise_after_runs = 1
of_runs = 1
[[schedules]]
name = "often"
every_s = 10
valves = ["FIC-104"]
[[devices]]
name = "plc-1"
host = "127.0.0.1"
port = 1
[[devices.registers]]
tag = "A"
address = "40001"
type = "INT16"
[[notifiers]]
name = "hook"
kind = "webhook"
url = "http://user:the-urls-password-4@127.0.0.1:1/the-path?token=the-querys-token-5"
allow_private = true
secret_variable = "HOOK"
[[notifiers]]
name = "mail"
kind = "mail"
host = "127.0.0.1"
port = 1
user = "u"
secret_file = "filed"
sender = "s@plant.example"
to = ["a@plant.example"]
"""
KEYS = {"time", "level", "process", "pid", "part", "message"}


@pytest.mark.long
def test_every_line_of_a_json_log_is_an_object_without_secrets(plant: Path) -> None:
    """Service, collector and workers, through a run, an alert, messages that fail, and the end."""
    folder = plant.parent
    plant.write_text(SERVICE + plant.read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "filed").write_text(FILED + "\n", encoding="utf-8")
    environment = {
        **os.environ, "OMP_NUM_THREADS": "1", "STEMWATCH_WEB_TOKEN": TOKEN, "HOOK": HOOK,
    }  # fmt: skip
    log = folder / "log.txt"
    with log.open("w") as sink:
        process = subprocess.Popen(
            [sys.executable, "-c", SERVE, "--port", "0", "--json-logs"],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=sink,
            text=True,
            start_new_session=True,
        )
        try:
            assert "http" in process.stdout.readline(), log.read_text(encoding="utf-8")
            until(lambda: "message alerts" in log.read_text(encoding="utf-8"), log)
            process.send_signal(signal.SIGTERM)
            assert process.wait(timeout=60) == 0
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            process.stdout.close()
    text = log.read_text(encoding="utf-8")
    lines = [json.loads(line) for line in text.splitlines()]
    assert all(line.keys() >= KEYS for line in lines)
    assert {line["level"] for line in lines} <= {"info", "warning", "error"}
    assert {line["process"] for line in lines} >= {"service"}
    about = [line.get("run") for line in lines if " is over" in line["message"]]
    assert about
    assert all(isinstance(run, int) for run in about)
    assert any(line.get("notifier") == "hook" for line in lines)
    for secret in (TOKEN, HOOK, FILED, "urls-password-4", "querys-token-5"):
        assert secret not in text


def until(there, log: Path, seconds: float = 120.0) -> None:
    """Wait for ``there``."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if there():
            return
        time.sleep(0.2)
    pytest.fail(f"it did not happen:\n{log.read_text(encoding='utf-8')}")


SAY = """
import logging, sys, threading, warnings
from stemwatch.service.logs import hide, logs_as_parent, set_up_logs
set_up_logs(as_json=sys.argv[1] == "json", process="collector")
hide(["geheim-1", "", None, "ab"])
log = logging.getLogger("stemwatch.service.collector.forwarder")
log.info("first\\nsecond geheim-1 ab postgresql://u:geheim-2@h/d", extra={"device": "plc geheim-1"})
log.error("\\ud800 half a letter")
warnings.warn("geheim-1 is old")
try:
    raise OSError("geheim-1")
except OSError:
    log.exception("it failed", extra={"run": 3, "valve": "FIC-101"})
thread = threading.Thread(target=lambda: 1 / 0, name="poller")
thread.start()
thread.join()
raise SystemExit(int("geheim-1"))
"""


def say(kind: str) -> str:
    """What a process says that logs, warns, and ends badly."""
    process = subprocess.run(
        [sys.executable, "-c", SAY, kind], capture_output=True, text=True, check=False
    )
    return process.stderr


def test_what_a_line_is_about_stands_beside_it() -> None:
    """Device, run and valve are keys; a line break in a message makes no second line; a warning, a
    thread and a process that end are lines too."""
    lines = [json.loads(line) for line in say("json").splitlines()]
    first, _, warned, failed, thread, end = lines
    assert first["device"] == "plc ***"
    assert first["message"] == "first\nsecond *** ab postgresql://u:***@h/d"
    assert first["part"] == "collector.forwarder"
    assert {line["process"] for line in lines} == {"collector"}
    assert "***" in warned["message"]
    assert (failed["run"], failed["valve"]) == (3, "FIC-101")
    assert "OSError: ***" in failed["trace"]
    assert "poller ends" in thread["message"]
    assert "ZeroDivisionError" in thread["trace"]
    assert end["level"] == "critical"
    assert "geheim" not in json.dumps(lines)


def test_plain_logs_hide_secrets_too() -> None:
    """The same, for people."""
    text = say("plain")
    assert "second *** ab postgresql://u:***@h/d" in text
    assert "geheim-2" not in text


def test_a_token_in_an_address_is_masked() -> None:
    """Whatever logs an address: what looks like a secret in it is not shown, the rest is."""
    from stemwatch.service.logs import clean

    assert clean("GET /?token=geheim&x=1 failed") == "GET /?token=***&x=1 failed"


def test_equal_warnings_are_counted_and_not_repeated() -> None:
    """A full disk says the same line hundreds of times: it is written once a minute, with how often
    it came; other lines, and what is no warning, are untouched."""
    now, lines = [0.0], io.StringIO()
    handler = logging.StreamHandler(lines)
    handler.addFilter(OnceAMinute(equal=True, clock=lambda: now[0]))
    log = logging.Logger("a part")
    log.addHandler(handler)
    for second in range(150):
        now[0] = float(second)
        for _ in range(4):
            log.error("the disk is full: %s", "store.db")
        if second % 50 == 0:
            log.info("a run begins")
            log.warning("another at %d s", second)
    now[0] = 300.0
    log.error("the disk is full: %s", "store.db")
    full = "the disk is full: store.db"
    assert lines.getvalue().splitlines() == [
        full,
        *("a run begins", "another at 0 s"),
        *("a run begins", "another at 50 s"),
        f"{full} (239 times more since it was last said)",
        *("a run begins", "another at 100 s"),
        f"{full} (239 times more since it was last said)",
        f"{full} (119 times more since it was last said)",
    ]
