"""``stemwatch serve`` as a process: it collects, screens and serves, stops in order, and loses
nothing when it is killed."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import typer

from stemwatch.connectors.modbus import read_devices
from stemwatch.models.studies.simulator import demo_plant
from stemwatch.models.verdict import Verdict
from stemwatch.service.cli.serve import _follow, _show, run_sentence
from stemwatch.service.modbus_plant.live import LivePlant
from stemwatch.service.modbus_plant.plant_file import plant_toml
from stemwatch.service.modbus_plant.plant_server import PlantServer
from stemwatch.service.serve.page_server import CannotListen, listen
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.screenings.records import RunState, StoredRun
from stemwatch.service.store.store import Store
from tests.service.example_user import make_user
from tests.service.serve.running_service import SERVICE, Site, get, site_in, until

pytestmark = pytest.mark.early


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    """A folder for the service."""
    with site_in(tmp_path) as created:
        yield created


@pytest.fixture
def csv_site(site: Site, plant: Path) -> Site:
    """The small plant of exports, with a service's settings."""
    text = plant.read_text(encoding="utf-8")
    plant.write_text(SERVICE + text, encoding="utf-8")
    return site


@pytest.fixture
def live_site(site: Site) -> Iterator[Site]:
    """A simulated Modbus plant of two valves, polled ten times a second."""
    import asyncio

    loops = demo_plant(1)[:2]
    up, stop = threading.Event(), threading.Event()

    async def run() -> None:
        live = LivePlant(loops, wear=None, seed=1)
        async with PlantServer(live, "127.0.0.1", 0, speed=10.0) as server:
            text = plant_toml(loops, host="127.0.0.1", port=server.port, every_s=0.1)
            (site.folder / "plant.toml").write_text(SERVICE + text, encoding="utf-8")
            up.set()
            await asyncio.to_thread(stop.wait)

    thread = threading.Thread(target=lambda: asyncio.run(run()))
    thread.start()
    assert up.wait(timeout=60)
    try:
        yield site
    finally:
        stop.set()
        thread.join()


def test_it_serves_works_and_stops_in_order(csv_site: Site) -> None:
    """Pages answer, a run that is asked for is done, SIGTERM ends everything with status 0, and
    no secret is in the log.

    The first start prints a one-time link on standard output alone: the log, which is kept, has no
    link in it. At the link the first admin signs in; after that no start prints one.
    """
    process, address = csv_site.serve()
    assert "Nobody can sign in yet" in process.stdout.readline()
    link = process.stdout.readline().strip()
    assert re.fullmatch(re.escape(address) + r"welcome\?link=[\w-]{43}", link)
    assert link.partition("link=")[2] not in csv_site.log()
    assert get(link)[0] == 200
    with pytest.raises(urllib.error.HTTPError, match="401"):
        urllib.request.urlopen(address, timeout=20)
    with csv_site.store() as store:
        make_user(store, "Karl", "wet gasket, dry bonnet", "admin")
    with pytest.raises(urllib.error.HTTPError, match="410"):
        get(link)
    assert get(address)[0] == 200
    assert json.loads(get(address + "healthz")[1])["ok"]
    result = csv_site.start("run-now", "FIC-104", "--who", "Ann")
    text, _ = result.communicate(timeout=120)
    assert "the service works on it" in text
    assert "done, 1 of 1 valves (1 sticky)" in text
    assert "FIC-104" in get(address)[1]
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=40) == 0, csv_site.log()
    process, _ = csv_site.serve()
    process.send_signal(signal.SIGTERM)
    assert process.stdout.read() == ""
    assert "Traceback" not in csv_site.log()


def test_the_first_link_leads_to_where_people_reach_the_pages(csv_site: Site) -> None:
    """Behind a proxy or in a container nobody could open the address that is listened on; below a
    path of their host the pages' own links lead there too."""
    file = csv_site.folder / "plant.toml"
    named = '[service]\naddress = "https://plant.example/valves/"\n'
    file.write_text(file.read_text("utf-8").replace("[service]\n", named), encoding="utf-8")
    process, base = csv_site.serve()
    process.stdout.readline()
    link = process.stdout.readline().strip()
    assert re.fullmatch(r"https://plant\.example/valves/welcome\?link=[\w-]{43}", link)
    with urllib.request.urlopen(f"{base.rstrip('/')}/valves/login") as page:
        assert 'action="/valves/login"' in page.read().decode()


@pytest.mark.long
def test_run_now_works_without_a_service(csv_site: Site) -> None:
    """Where no service runs the command does the run itself, with report, alerts and messages."""
    file = csv_site.folder / "plant.toml"
    at_once = "[alerts]\nraise_after_runs = 1\nof_runs = 1\n"
    file.write_text(at_once + file.read_text("utf-8"), encoding="utf-8")
    result = csv_site.start("run-now")
    text, _ = result.communicate(timeout=180)
    assert result.returncode == 0, csv_site.log()
    assert "this command does it" in text
    assert "3 of 3 valves" in text
    with csv_site.store() as store:
        (run,) = store.queue.recent()
        assert run.state is RunState.DONE
        assert (Path(run.report) / "report.html").is_file()
    (message,) = (csv_site.folder / "alerts.jsonl").read_text("utf-8").splitlines()
    assert "FIC-104" in json.loads(message)["subject"]


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=["SIGTERM", "SIGINT"])
def test_run_now_that_is_asked_to_stop_leaves_its_run_to_the_next(
    csv_site: Site, number: signal.Signals
) -> None:
    """It ends by itself, says what becomes of the run, and the next one finishes it and its own."""
    cut = csv_site.start("run-now")
    with csv_site.store() as store:
        until(
            lambda: [item.state for item in store.queue.recent()] == [RunState.RUNNING],
            site=csv_site,
        )
        cut.send_signal(number)
        cut.send_signal(number)
        text, _ = cut.communicate(timeout=120)
        assert cut.returncode == 1, csv_site.log()
        assert "Run 1 is left" in text
        assert "Traceback" not in csv_site.log()
        result = csv_site.start("run-now")
        assert "3 of 3 valves" in result.communicate(timeout=600)[0]
        assert [item.state for item in store.queue.recent()] == [RunState.DONE, RunState.DONE]


@pytest.mark.long
def test_a_live_plant_is_collected_across_a_kill(live_site: Site) -> None:
    """Samples reach the store; after SIGKILL the next start goes on, finishes the run that was
    begun, and no sample is there twice or out of its place."""
    process, _ = live_site.serve()

    with live_site.store() as store:

        def samples() -> int:
            return store.samples.read("plc-1", "FIC-101.OP").at_us.size

        until(lambda: samples() > 60, site=live_site)
        number = store.queue.put(RunToQueue(who="Ann"), software_version="1")
        until(lambda: store.run(number).state is RunState.RUNNING, site=live_site)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        store.queue.leave(number, _owner(store, number))  # as after half a minute of silence
        before = samples()
        process, _ = live_site.serve()
        until(lambda: store.run(number).state is RunState.DONE, site=live_site)
        until(lambda: samples() > before + 20, site=live_site)
        run = store.run(number)
        assert (run.done, run.total) == (2, 2)
        for valve in ("FIC-101", "TIC-102"):
            assert len({screening.window for screening in store.screenings(valve)}) == 1
        recording = store.samples.read("plc-1", "FIC-101.OP")
        steps = recording.at_us[1:] - recording.at_us[:-1]
        assert (steps > 0).all()
        assert (steps % 100_000 == 0).all()
        (state,) = [state for state in store.sources.states() if state.source == "plc-1"]
        assert state.connected
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=40) == 0, live_site.log()


def test_a_run_is_waited_for_while_its_database_is_away(monkeypatch, capsys) -> None:
    """The service goes on with it after a restart of PostgreSQL, and so does who waits; but not
    for ever, and not where no service would go on."""
    at = datetime(2026, 3, 2, 6, tzinfo=UTC)
    run = StoredRun(
        id=7,
        started=at,
        finished=at,
        command="",
        software_version="",
        settings_digest="",
        counts={},
    )

    class Restarted:
        answers: list[StoredRun | StoreError]

        def run(self, number: int) -> StoredRun:
            answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
            if isinstance(answer, StoreError):
                raise answer
            return answer

    monkeypatch.setitem(_follow.__globals__, "_LOOK_S", 0.001)
    store: Any = Restarted()
    away = StoreError("postgresql://db/site: reading failed.")
    store.answers = [replace(run, finished=None), away, away, run]
    _follow(store, 7, None, threading.Event())
    said = " ".join(capsys.readouterr().err.split())
    assert said.count("goes on with run 7 when it is back") == 1
    monkeypatch.setitem(_follow.__globals__, "_AWAY_S", 0.02)
    for working in (None, threading.current_thread()):
        store.answers = [away]
        with pytest.raises(StoreError):
            _follow(store, 7, working, threading.Event())


def _owner(store: Store, number: int) -> str:
    from sqlalchemy import text

    with store.transactions.reading() as session:
        statement = text("SELECT owner FROM runs WHERE id = :n")
        return str(session.execute(statement, {"n": number}).scalar_one())


def test_listening_to_other_machines_is_said(caplog) -> None:
    """What travels unencrypted is warned of; a port that is taken is refused with a way out."""
    with listen("127.0.0.1", 0), caplog.at_level("WARNING"):
        assert caplog.text == ""
    with listen("0.0.0.0", 0):
        assert "put a proxy with TLS before it" in caplog.text
    with socket.socket() as accepted:
        accepted.bind(("127.0.0.1", 0))
        accepted.listen()
        with pytest.raises(CannotListen, match=r"cannot listen on .*--port"):
            listen("127.0.0.1", accepted.getsockname()[1])


def test_the_simulated_plants_file_is_read(tmp_path: Path) -> None:
    """What the simulator writes is a plant file that the service understands whole."""
    from stemwatch.service.config import load_plant

    file = tmp_path / "plant.toml"
    text = plant_toml(demo_plant(1)[:2], host="127.0.0.1", port=5020)
    file.write_text(SERVICE + text, encoding="utf-8")
    plant = load_plant(file, environment={})
    assert plant.problems == ()
    assert list(plant.devices) == ["plc-1"]
    assert read_devices([]).devices == ()
    assert all(plant.is_live(valve) for valve in plant.valves)


def test_the_verdicts_of_a_run_are_those_of_recordings_where_a_valve_has_several() -> None:
    """One valve of 22 files is not "1 of 1 valves (11 sticky, 11 healthy)"."""
    at = datetime(2026, 3, 2, tzinfo=UTC)
    run = StoredRun(
        id=7,
        started=at,
        finished=at,
        command="",
        software_version="",
        settings_digest="",
        counts={Verdict.STICKY: 1},
        total=1,
        done=1,
    )
    assert run_sentence(run) == "Run 7: done, 1 of 1 valves (1 sticky)"
    many = replace(run, counts={Verdict.STICKY: 11, Verdict.HEALTHY: 11}, set_aside=1)
    assert run_sentence(many) == (
        "Run 7: done, 1 of 1 valves (22 recordings: 11 sticky, 11 healthy), 1 set aside"
    )


def test_a_run_that_is_not_over_is_said_to_be_left(capsys) -> None:
    """A full database ends the work of this command; the next one goes on with the run."""
    run = StoredRun(
        id=7,
        started=datetime(2026, 3, 2, tzinfo=UTC),
        finished=None,
        command="",
        software_version="",
        settings_digest="",
        counts={},
        state=RunState.RUNNING,
        total=6,
        done=1,
    )
    with pytest.raises(typer.Exit) as ended:
        _show(run)
    assert ended.value.exit_code == 1
    assert "Run 7 is left after 1 of 6 valves" in capsys.readouterr().out
