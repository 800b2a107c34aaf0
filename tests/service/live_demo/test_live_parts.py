"""The parts of the live demo: speed, folder, plant file, mails, and recorded maintenance."""

from __future__ import annotations

import asyncio
import smtplib
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from email.message import EmailMessage
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.models.limits import Limits
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.models.verdict import Verdict
from stemwatch.service.config import load_plant
from stemwatch.service.config.schema import parse_stroke
from stemwatch.service.live_demo import (
    DemoFolder,
    DemoTiming,
    LiveDemo,
    MailCatcher,
    RecordedMaintenance,
)
from stemwatch.service.live_demo.loops import INTERVAL_S, WEARING, live_loops
from stemwatch.service.live_demo.plant_file import demo_toml
from stemwatch.service.store.store import open_store


@given(st.floats(min_value=1.0, max_value=4.0))
def test_the_plant_sees_the_same_at_every_speed(speed: float) -> None:
    """Poll and window are the same seconds of the plant; no device is polled too fast."""
    pace, usual = DemoTiming(speed=speed), DemoTiming()
    assert pace.every_s >= 0.1
    assert pace.every_s * speed == pytest.approx(usual.every_s, rel=0.01)
    assert pace.window_s * speed == pytest.approx(usual.window_s)
    assert pace.schedule_s >= 10.0
    assert pace.shortest_s < pace.window_s
    assert pace.wear == usual.wear


@pytest.mark.parametrize("speed", [0.5, 4.1, float("nan")])
def test_a_speed_that_cannot_be_polled_is_refused(speed: float) -> None:
    """With the bounds and what was received."""
    with pytest.raises(ValueError, match=r"1 to 4 times .* received"):
        DemoTiming(speed=speed)


@pytest.mark.parametrize("speed", [1.0, 2.5, 4.0])
def test_the_plant_file_is_understood_and_says_what_it_is(tmp_path: Path, speed: float) -> None:
    """Nothing is said against it; the plant's name tells that it is simulated, and how fast."""
    file = tmp_path / "plant.toml"
    text = demo_toml(live_loops(), DemoTiming(speed=speed), modbus_port=5020, mail_port=2525)
    file.write_text(text, encoding="utf-8")
    plant = load_plant(file, environment={})
    assert plant.problems == ()
    assert set(plant.valves) == {loop.tag for loop in live_loops()}
    assert WEARING in plant.valves
    assert all(parse_stroke(valve.stroke).unit == "mm" for valve in plant.valves.values())
    assert plant.limits.min_duration_s < DemoTiming(speed=speed).window_s
    assert "simulated" in plant.name
    assert ("times as fast" in plant.name) == (speed > 1.0)
    (notifier,) = plant.notifiers.values()
    assert (notifier.host, notifier.port, notifier.security) == ("127.0.0.1", 2525, "none")


def test_the_shortest_window_carries_verdict_and_baseline() -> None:
    """Of every loop while it is new, as polled at the fastest: healthy, with a network."""
    pace = DemoTiming(speed=4.0)
    cases = []
    for loop in live_loops():
        length_s = pace.shortest_s * pace.speed
        recording = simulate_loop(replace(loop, duration_s=length_s), 7).recording
        step = round(pace.every_s * pace.speed / INTERVAL_S)
        signals = {
            role: replace(signal, values=signal.values[::step], quality=signal.quality[::step])
            for role, signal in recording.signals.items()
        }
        cases.append(Case(recording=replace(recording, signals=signals, interval_s=pace.every_s)))
    options = Options(limits=Limits(min_duration_s=pace.shortest_s - 1.0), mismatch=False)
    for item in screen(cases, options):
        assert item.verdict is Verdict.HEALTHY, item.reason
        assert item.network is not None, item.residuals


def test_a_demo_begins_anew_in_its_own_folder_only(tmp_path: Path) -> None:
    """What an earlier demo made goes; a folder with other files is left alone, with a sentence."""
    first = DemoFolder(tmp_path / "demo")
    first.mails.mkdir()
    (first.mails / "0001.eml").write_text("old")
    first.plant_file.write_text("old")
    mine = first.path / "notes.txt"
    mine.write_text("mine")
    with pytest.raises(BlockingIOError, match="a live demo is running"):
        DemoFolder(tmp_path / "demo")
    assert first.plant_file.exists()
    first.release()
    second = DemoFolder(tmp_path / "demo")
    second.release()
    assert not second.mails.exists()
    assert not second.plant_file.exists()
    assert mine.read_text() == "mine"
    plant = tmp_path / "plant"
    plant.mkdir()
    (plant / "plant.toml").write_text("[plant]")
    with pytest.raises(FileExistsError, match="not made by a live demo"):
        DemoFolder(plant)
    assert [path.name for path in plant.iterdir()] == ["plant.toml"]


def test_without_the_extra_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One sentence, before anything is begun in the folder."""
    monkeypatch.setitem(sys.modules, "aiosmtpd", None)
    with pytest.raises(OSError, match=r"pip install 'stemwatch\[live-demo\]'"):
        caught(tmp_path / "mails", lambda port: None)
    assert not (tmp_path / "mails").exists()


def caught(folder: Path, send: Callable[[int], None]) -> MailCatcher:
    """The catcher after ``send`` was done with its port."""

    async def run() -> MailCatcher:
        async with MailCatcher(folder) as catcher:
            assert "No mail yet" in catcher.list_file.read_text("utf-8")
            await asyncio.to_thread(send, catcher.port)
        return catcher

    return asyncio.run(run())


def mail(subject: str, text: str) -> EmailMessage:
    """A mail as the service sends it."""
    email_message = EmailMessage()
    email_message["Subject"], email_message["From"], email_message["To"] = (
        subject,
        "a@demo.invalid",
        "b@demo.invalid",
    )
    email_message.set_content(text)
    return email_message


def test_mails_are_kept_as_files_and_listed_as_text(tmp_path: Path) -> None:
    """Letter by letter, whatever a tag looks like, the newest first."""

    def send(port: int) -> None:
        with smtplib.SMTP("127.0.0.1", port) as server:
            server.send_message(mail("FIC-101 sticks", "S is 4 % – look at the packing"))
            server.send_message(mail("<script>alert(1)</script>", "second"))

    catcher = caught(tmp_path / "mails", send)
    files = sorted(path.name for path in catcher.folder.glob("*.eml"))
    assert files == ["0001.eml", "0002.eml"]
    assert [item.subject for item in catcher.caught] == [
        "FIC-101 sticks",
        "<script>alert(1)</script>",
    ]
    assert catcher.caught[0].text.strip() == "S is 4 % – look at the packing"
    listing = catcher.list_file.read_text("utf-8")
    assert "<script>" not in listing
    assert listing.index("&lt;script&gt;") < listing.index("FIC-101 sticks")
    assert "2 arrived" in listing


def test_a_mail_that_is_too_large_is_refused(tmp_path: Path) -> None:
    """The sender is told; nothing is kept."""

    def send(port: int) -> None:
        with (
            smtplib.SMTP("127.0.0.1", port) as server,
            pytest.raises(smtplib.SMTPResponseException, match="size"),
        ):
            server.send_message(mail("large", "x" * 70 + "\n" + "y" * (1 << 21)))

    assert caught(tmp_path, send).caught == []


def test_each_recorded_maintenance_is_reported_once(tmp_path: Path) -> None:
    """Earlier records and records of unknown valves are not reported."""
    with open_store(f"sqlite:///{tmp_path / 'plant.db'}") as store:
        now = datetime.now(UTC)
        store.record_maintenance("FIC-102", now, "long ago", "Ann")
        fitter = RecordedMaintenance(store, ["FIC-101", "FIC-102"])
        assert fitter.look() == []
        store.record_maintenance("FIC-101", now, "packing renewed", "Ann")
        store.record_maintenance("FIC-999", now, "elsewhere", "Ann")
        assert fitter.look() == ["FIC-101"]
        assert fitter.look() == []
        store.record_maintenance("FIC-101", now, "again", "Ann")
        store.record_maintenance("FIC-102", now, "too", "Ann")
        assert fitter.look() == ["FIC-101", "FIC-102"]


@pytest.mark.long
def test_a_service_that_cannot_start_ends_the_demo_with_a_sentence(tmp_path: Path) -> None:
    """Where the port is taken, its log is named; the folder is free again."""
    import socket

    async def run(port: int) -> None:
        live_demo = LiveDemo(
            tmp_path / "demo", DemoTiming(speed=4.0), port, announce=lambda line: None
        )
        await live_demo.run(asyncio.Event())

    with socket.socket() as accepted:
        accepted.bind(("127.0.0.1", 0))
        accepted.listen()
        port = accepted.getsockname()[1]
        with pytest.raises(OSError, match=r"the service ended with status 2.*service\.log"):
            asyncio.run(run(port))
    assert "cannot listen on" in (tmp_path / "demo" / "service.log").read_text("utf-8")
    DemoFolder(tmp_path / "demo").release()
