"""Correct plant files: what is read from them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from stemwatch.connectors.connector import TagMapping
from stemwatch.connectors.historian.connector import TextExportSettings
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.models.limits import Limits
from stemwatch.models.recording import Role
from stemwatch.service.config import Plant, load_plant
from stemwatch.service.config.plant import verdict_settings
from stemwatch.service.plant_path import path_of

WHOLE = """\
valve_list = "valves.csv"

[plant]
name = "Demo refinery"
site = "Inland"
zone = "Europe/Berlin"

[limits]
sticky_S_percent = 2
min_reversals = 8

[storage]
url = "sqlite:///results/store.db"

[[sources]]
name = "historian"
path = "export/*.csv"
decimal = ","
separator = ";"
interval_s = 1
good_quality = ["192"]

[[sources]]
name = "boiler"
path = "boiler.csv"
zone = "UTC"

[[valves]]
id = "FIC-101"
description = "Naphtha feed to the reactor"
area = "Reforming"
unit = "100"
loop = "FC-101"
criticality = 3
source = "historian"
[valves.tags.op]
tag = "FIC-101.OP"
unit = "%"
[valves.tags.mv]
tag = "FIC-101.ZT"
[valves.tags.pv]
tag = "FIC-101.PV"
unit = "t/h"
low = 0
high = 40.0

[[valves]]
id = "LIC-7"
source = "boiler"
tags = { op = { tag = "LIC-7.OUT" }, mode = { tag = "LIC-7.MODE" } }
"""

LIST = """\
id,description,site,area,unit,criticality,source,op,op_unit,op_low,op_high,mv
TIC-1,"Column, top",Harbour,East,200,1,historian,TIC-1.OP,mA,4,20,TIC-1.ZT
TIC-2,,,,,,boiler,TIC-2.OP,,,,
"""


@pytest.fixture
def plant(tmp_path: Path) -> Plant:
    (tmp_path / "plant.toml").write_text(WHOLE, encoding="utf-8")
    (tmp_path / "valves.csv").write_text(LIST, encoding="utf-8")
    return load_plant(tmp_path / "plant.toml", environment={})


def load(folder: Path, text: str, **environment: str) -> Plant:
    (folder / "plant.toml").write_text(text, encoding="utf-8")
    return load_plant(folder / "plant.toml", environment=environment)


def test_a_right_file_has_no_problems(plant: Plant) -> None:
    """Everything the file says is there and nothing is complained about."""
    assert () == plant.problems
    assert ("Demo refinery", "Europe/Berlin") == (plant.name, plant.zone)
    assert ["historian", "boiler"] == list(plant.sources)
    assert ["FIC-101", "LIC-7", "TIC-1", "TIC-2"] == list(plant.valves)
    valve = plant.valves["FIC-101"]
    assert ("Naphtha feed to the reactor", "Reforming", 3) == (
        valve.description,
        valve.area,
        valve.criticality,
    )
    assert "boiler" == plant.source_of("LIC-7").name


def test_the_tags_of_a_valve_are_what_a_connector_is_asked_for(plant: Plant) -> None:
    """Each role that is given, with unit and range; no role that is not."""
    tags = plant.valve_tags("FIC-101")
    assert "FIC-101" == tags.valve
    assert {
        Role.OP: TagMapping(tag="FIC-101.OP", unit="%"),
        Role.MV: TagMapping(tag="FIC-101.ZT"),
        Role.PV: TagMapping(tag="FIC-101.PV", unit="t/h", low=0.0, high=40.0),
    } == tags.tags
    assert {Role.OP, Role.MODE} == set(plant.valve_tags(plant.valves["LIC-7"]).tags)


def test_a_listed_valve_is_like_one_of_the_file(plant: Plant) -> None:
    """A row gives the same facts and tags; an empty cell is a key that is not given."""
    assert ("Column, top", "East", 1) == (
        plant.valves["TIC-1"].description,
        plant.valves["TIC-1"].area,
        plant.valves["TIC-1"].criticality,
    )
    assert {
        Role.OP: TagMapping(tag="TIC-1.OP", unit="mA", low=4.0, high=20.0),
        Role.MV: TagMapping(tag="TIC-1.ZT"),
    } == plant.valve_tags("TIC-1").tags
    assert 2 == plant.valves["TIC-2"].criticality
    assert {Role.OP: TagMapping(tag="TIC-2.OP")} == plant.valve_tags("TIC-2").tags


def test_each_valve_has_its_path_through_the_plant(plant: Plant) -> None:
    """Site, area, unit and loop, from the file and the list; the plant's site where one names
    none."""
    paths = {name: path_of(valve) for name, valve in plant.valves.items()}
    assert {
        "FIC-101": "Inland/Reforming/100/FC-101",
        "LIC-7": "Inland",
        "TIC-1": "Harbour/East/200",
        "TIC-2": "Inland",
    } == paths


def test_limits_are_the_files_and_otherwise_the_defaults(plant: Plant) -> None:
    """Only what is set differs from the science's own limits."""
    assert Limits(sticky_S_percent=2.0, min_reversals=8.0) == plant.limits


def test_every_limit_can_be_set(tmp_path: Path) -> None:
    """A limit the science adds is a key of the plant file without further work."""
    doubled = {f.name: 2.0 * float(getattr(Limits(), f.name)) for f in dataclasses.fields(Limits)}
    text = "[limits]\n" + "\n".join(f"{name} = {value}" for name, value in doubled.items())
    assert Limits(**doubled) == load(tmp_path, text).limits


def test_read_options_are_the_readers_own(plant: Plant) -> None:
    """A source has a key for each option of the reader; what is not given is left to it."""
    assert {f.name for f in dataclasses.fields(ReadOptions)} == set(
        TextExportSettings.model_fields
    ) - {
        "name",
        "kind",
        "path",
        "folder",
    }
    assert ReadOptions(
        zone="Europe/Berlin", decimal=",", separator=";", interval_s=1.0, good_quality=("192",)
    ) == ReadOptions(**plant.read_options("historian"))
    assert ReadOptions(zone="UTC") == ReadOptions(**plant.read_options("boiler"))


def test_source_files_are_beside_the_plant_file(plant: Plant) -> None:
    """A pattern is relative to the plant file, from whatever folder the program runs in."""
    folder = plant.file.parent / "export"
    folder.mkdir()
    for name in ("b.csv", "a.csv", "readme.txt"):
        (folder / name).touch()
    (folder / "folder.csv").mkdir()
    assert (folder / "a.csv", folder / "b.csv") == plant.source_files("historian")
    assert () == plant.source_files("boiler")


def test_the_store_is_beside_the_plant_file(tmp_path: Path) -> None:
    """Without an address it is stemwatch.db there; a relative path is relative to there."""
    url = '[storage]\nurl = "sqlite:///results/store.db"'
    assert f"sqlite:///{tmp_path}/stemwatch.db" == load(tmp_path, "").storage.reveal()
    assert f"sqlite:///{tmp_path}/results/store.db" == load(tmp_path, url).storage.reveal()
    server = '[storage]\nurl = "postgresql://u:geheim@h/d"'
    assert "postgresql://u:geheim@h/d" == load(tmp_path, server).storage.reveal()


def test_the_environment_decides_the_store(tmp_path: Path) -> None:
    """A container's setting wins over the file, and a password is not in the plant's text."""
    url = "postgresql://watch:geheim@db/stemwatch"
    plant = load(tmp_path, '[storage]\nurl = "sqlite:///a.db"', STEMWATCH_STORAGE_URL=url)
    assert url == plant.storage.reveal()
    assert "geheim" not in repr(plant)
    assert "postgresql://watch:***@db/stemwatch" in repr(plant)


def test_the_settings_digest_follows_what_can_change_a_verdict(tmp_path: Path) -> None:
    """A limit, a source or a tag changes it; a description, the store and comments do not."""
    digest = load(tmp_path, WHOLE.replace("valve_list", "# valve_list")).settings_digest
    same = WHOLE.replace("Naphtha", "Crude").replace("results/", "").replace("criticality = 3", "")
    assert digest == load(tmp_path, same.replace("valve_list", "# ")).settings_digest
    for before, after in (
        ("min_reversals = 8", "min_reversals = 9"),
        ("FIC-101.ZT", "FIC-101.ZI"),
        ("high = 40.0", "high = 50.0"),
        ('zone = "UTC"', ""),
    ):
        changed = WHOLE.replace(before, after).replace("valve_list", "# ")
        assert digest != load(tmp_path, changed).settings_digest, before


def test_the_deviation_of_a_tag_changes_the_digest_where_it_is_stated(tmp_path: Path) -> None:
    """It widens or narrows S; a file without it has the digest that it always had."""
    text = WHOLE.replace("valve_list", "# valve_list")
    stated = text.replace('tag = "FIC-101.ZT"', 'tag = "FIC-101.ZT"\ndeviation = 0.1')
    digests = []
    for content, deviation in ((text, None), (stated, 0.1)):
        plant = load(tmp_path, content)
        assert plant.valve_tags("FIC-101").tags[Role.MV].deviation == deviation
        settings = verdict_settings(plant.valves["FIC-101"])
        assert settings["tags"]["mv"].get("deviation") == deviation
        assert "deviation" not in settings["tags"]["op"]
        digests.append(plant.settings_digest)
    assert digests[0] != digests[1]


def test_a_file_as_windows_saves_it_is_read(tmp_path: Path) -> None:
    """A byte order mark and two-character line ends are no mistake, and lines still count."""
    text = '[plant]\r\nname = "Raffinerie Süd"\r\nzone = "Europe/Bärlin"\r\n'
    (tmp_path / "plant.toml").write_bytes(b"\xef\xbb\xbf" + text.replace("ä", "e").encode())
    assert "Raffinerie Süd" == load_plant(tmp_path / "plant.toml", environment={}).name


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_list_as_spreadsheets_save_it_is_read(
    tmp_path: Path, encoding: str, separator: str
) -> None:
    """Encodings, separators, decimal commas, empty columns and blank rows of spreadsheets."""
    mark = "." if separator == "," else ","
    rows = [
        ["ID", "Source", "OP", "op_low", "op_high", "description", ""],
        ["V-1", "s", "V-1.OP", f"3{mark}9", f"20{mark}5", '"Füllstand"', ""],
        [],
        ["V-2", "s", "V-2.OP", "", "", "", ""],
    ]
    text = "\r\n".join(separator.join(row) for row in rows)
    (tmp_path / "v.csv").write_bytes(text.encode(encoding))
    plant = load(tmp_path, 'valve_list = "v.csv"\n[[sources]]\nname = "s"\npath = "a.csv"')
    assert () == plant.problems
    assert "Füllstand" == plant.valves["V-1"].description
    op = plant.valves["V-1"].tags.op
    assert (3.9, 20.5) == (op.low, op.high)
    assert ["V-1", "V-2"] == list(plant.valves)


def test_thousands_of_valves_load(tmp_path: Path) -> None:
    """A plant's whole list is read, every valve of it."""
    rows = "".join(f"V-{n},s,V-{n}.OP,V-{n}.ZT\n" for n in range(3000))
    (tmp_path / "v.csv").write_text("id,source,op,mv\n" + rows)
    plant = load(tmp_path, 'valve_list = "v.csv"\n[[sources]]\nname = "s"\npath = "a.csv"')
    assert (3000, ()) == (len(plant.valves), plant.problems)


def test_the_example_in_deploy_loads() -> None:
    """What a plant copies to begin with is right as it stands."""
    plant = load_plant(Path(__file__).parents[3] / "deploy" / "plant.example.toml")
    assert (("FIC-101",), ()) == (tuple(plant.valves), plant.problems)
