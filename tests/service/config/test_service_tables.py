"""The plant file's tables for the service: read whole, each mistake with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from stemwatch.service.config import Plant, PlantFileError, load_plant
from stemwatch.service.store.runs.schedule import ScreeningSchedule

VALVES = """
[[sources]]
name = "inbox"
folder = "inbox"
[[valves]]
id = "FIC-1"
area = "100"
source = "inbox"
[valves.tags.op]
tag = "OP1"
"""
DEVICE = """
[[devices]]
name = "plc"
host = "192.0.2.1"
byte_order = "ABCD"
[[devices.registers]]
tag = "OP2"
register = "holding"
address = 0
type = "FLOAT32"
[[valves]]
id = "FIC-2"
source = "plc"
[valves.tags.op]
tag = "OP2"
"""


def load(folder: Path, text: str) -> Plant:
    file = folder / "plant.toml"
    file.write_text(text, encoding="utf-8")
    return load_plant(file, environment={})


def test_everything_of_the_service_is_read(tmp_path: Path) -> None:
    """Devices and folders are sources, schedules and notifiers have their names."""
    plant = load(
        tmp_path,
        VALVES
        + DEVICE
        + """
[[schedules]]
name = "nightly"
cron = "30 2 * * 1-5"
areas = ["100"]
[[schedules]]
name = "quick"
every_s = 600.0
jitter_s = 30.0
window_s = 7200.0
valves = ["FIC-2"]
[[notifiers]]
name = "shift"
kind = "mail"
host = "mail"
sender = "a@b.c"
to = ["d@b.c"]
[alerts]
raise_after_runs = 1
[service]
workers = 3
""",
    )
    assert plant.problems == ()
    assert plant.is_live("FIC-1")
    assert plant.is_live("FIC-2")
    assert plant.source_files("inbox") == ()
    assert plant.schedules[0] == ScreeningSchedule(
        name="nightly", cron="30 2 * * 1-5", areas=("100",)
    )
    assert plant.schedules[1].window_s == 7200.0
    assert (plant.alerts.raise_after_runs, plant.alerts.of_runs) == (1, 3)
    assert (plant.service.workers, plant.service.valve_timeout_s) == (3, 120.0)
    assert list(plant.notifiers) == ["shift"]


def test_devices_are_part_of_what_verdicts_depend_on(tmp_path: Path) -> None:
    """Another register map is another setting; a plant without devices keeps its digest."""
    before = load(tmp_path, VALVES + DEVICE).settings_digest
    after = load(tmp_path, VALVES + DEVICE.replace("address = 0", "address = 2")).settings_digest
    assert before != after


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('[[schedules]]\nname = "s"', "schedules[s].cron: found neither cron nor every_s"),
        ('[[schedules]]\nname = "s"\ncron = "0 5 * * *"\nevery_s = 60', "both cron and every_s"),
        ('[[schedules]]\nname = "s"\ncron = "5 o\'clock"', "five cron fields"),
        ('[[schedules]]\nname = "s"\ncron = "0 5 * * 8"', "day of week '8'"),
        ('[[schedules]]\nname = "s"\ncron = "0 5 * * ²"', "day of week '²'"),
        ('[[schedules]]\nname = "s"\ncron = "0 5 31 4 *"', "no month has the days"),
        ('[[schedules]]\nname = "s"\nevery_s = 1', "10 or more"),
        ('[[schedules]]\nname = "s"\nevery_s = 1e13', "at most ten years"),
        ('[[schedules]]\nname = "s"\nevery_s = 60\nwindow_s = 1e13', "at most ten years"),
        ('[[schedules]]\nname = "s"\nevery_s = 60\nareas = ["900"]', "unknown area '900'"),
        ('[[schedules]]\nname = "s"\nevery_s = 60\nunits = ["900"]', "unknown unit '900'"),
        ('[[schedules]]\nname = "s"\nevery_s = 60\nvalves = ["X"]', "unknown valve 'X'"),
        ('[[schedules]]\nname = "s"\nevrey_s = 60', "did you mean 'every_s'?"),
        ('[[notifiers]]\nname = "n"\nkind = "pager"', "one of 'file', 'mail', 'webhook'"),
        ('[[notifiers]]\nname = "n"\nkind = "mail"\nhost = "h"', "host, sender, to for mail"),
        ('[[notifiers]]\nname = "n"\nkind = "webhook"\nurl = "ftp://x"', "http:// or https://"),
        (
            '[[notifiers]]\nname = "n"\nkind = "file"\npath = "p"\nuser = "u"',
            "found a user without a password",
        ),
        (
            '[[notifiers]]\nname = "n"\nkind = "mail"\npassword = "geheim"',
            "password: found an unknown key",
        ),
        (
            '[[valves]]\nid = "FIC-3"\nsource = "plc"\n[valves.tags.op]\ntag = "OP3"',
            "'OP3', which no register of plc has; expected the tag of one of its registers",
        ),
        ('[[devices]]\nname = "inbox"\nhost = "h"\nregisters = []', "which plant.toml, line"),
        ('[[sources]]\nname = "x"\nfolder = "a"\npath = "b"', "both path and folder"),
        ('[[sources]]\nname = "x"', "sources[x].path: found nothing"),
    ],
)
def test_a_mistake_costs_its_own_entry(tmp_path: Path, text: str, expected: str) -> None:
    """What is wrong is left out with a sentence; the valves and the rest stay, and no secret that
    somebody wrote into the file is repeated."""
    plant = load(tmp_path, VALVES + DEVICE + text)
    answer = "\n".join(map(str, plant.problems))
    assert expected in answer
    assert "geheim" not in answer
    assert set(plant.valves) == {"FIC-1", "FIC-2"}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[alerts]\nraise_after_runs = 5", "alerts.raise_after_runs: found raise_after_runs = 5"),
        ("[service]\nkeep_reports = 0", "line 2: service.keep_reports: found 0; expected a whole"),
        (
            '[service]\ntrusted_proxies = ["proxy.plant"]',
            "trusted_proxies[1]: found the text 'proxy.plant'; expected an address or network",
        ),
        ("[service]\nspol = 'x'", "did you mean 'spool'?"),
    ],
)
def test_a_wrong_rule_for_all_stops_the_reading(tmp_path: Path, text: str, expected: str) -> None:
    """No alert is judged by rules that were not understood."""
    with pytest.raises(PlantFileError) as caught:
        load(tmp_path, text)
    assert expected in str(caught.value)


def test_a_faulty_device_leaves_its_valves_out(tmp_path: Path) -> None:
    """One sentence says so; the other valves are watched."""
    plant = load(tmp_path, VALVES + DEVICE.replace('host = "192.0.2.1"', 'hots = "x"'))
    assert set(plant.valves) == {"FIC-1"}
    text = "\n".join(map(str, plant.problems))
    assert "hots: found an unknown key" in text
    assert "its valve is left out (FIC-2)" in text
