"""A connector of another package: found by its entry point, and used through ``plant.toml``."""

from __future__ import annotations

import csv
import importlib
import json
import sys
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from stemwatch.connectors.registry import installed_connectors
from stemwatch.service.config import load_plant

VALVE = "FIC-104"
PACKAGE = '''
"""Samples in JSON files, one for each tag: [[seconds since 1970, value], ...]."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from stemwatch.connectors.archive.number_column import number_column
from stemwatch.connectors.archive.settings import ArchiveSettings
from stemwatch.connectors.archive.valve_columns import ValveColumns
from stemwatch.connectors.connector import TagInfo, UnknownTag, WHOLE, ArchiveAddress
from stemwatch.connectors.historian.recordings import assemble
from stemwatch.connectors.settings import NotEmpty


class JsonSettings(ArchiveSettings):
    path: NotEmpty = Field(description="a folder of JSON files, relative to the plant file")

    def address(self, folder: Path, zone: str | None) -> ArchiveAddress:
        return JsonAddress(str(folder / self.path))


@dataclass(frozen=True)
class JsonAddress:
    folder: str

    def open(self):
        return JsonArchive(Path(self.folder))

    def __str__(self):
        return self.folder


class JsonArchive:
    settings = JsonSettings

    def __init__(self, folder):
        self.folder = folder

    def tags(self):
        return [TagInfo(tag=path.stem) for path in sorted(self.folder.glob("*.json"))]

    def present(self, valve):
        return valve

    def read(self, valve, window=WHOLE):
        columns = {one.tag: self._column(one.tag) for one in valve.tags.values()}
        read = ValveColumns(source_name=str(self.folder), layout="JSON", columns=columns)
        return assemble(read, valve, window)

    def _column(self, tag):
        try:
            rows = json.loads((self.folder / f"{tag}.json").read_text())
        except FileNotFoundError:
            raise UnknownTag(f"{self.folder}: there is no {tag}.json") from None
        ns = np.array([round(second * 1e9) for second, _ in rows], dtype=np.int64)
        values = np.array([np.nan if value is None else value for _, value in rows])
        ok = np.ones(ns.size, dtype=bool)
        return number_column(tag, ns, ok, values, source_name=str(self.folder))
'''
PLANT = """\
[[sources]]
name = "archive"
kind = "json"
path = "samples"

[[valves]]
id = "FIC-104"
source = "archive"
tags.op = { tag = "FIC-104.OP", unit = "%" }
tags.mv = { tag = "FIC-104.ZT", unit = "%" }
"""


def installed(folder: Path, name: str, module: str, points: dict[str, str]) -> None:
    """What installing a package of one module leaves behind in ``folder``."""
    (folder / f"{name}.py").write_text(module, encoding="utf-8")
    about = folder / f"{name}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [f"{kind} = {target}" for kind, target in points.items()]
    (about / "entry_points.txt").write_text("\n".join(["[stemwatch.connectors]", *lines, ""]))


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder whose packages are installed while the test runs."""
    folder = tmp_path / "site-packages"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    yield folder
    importlib.invalidate_caches()
    for name in ("plant_json", "plant_other"):
        sys.modules.pop(name, None)


@pytest.fixture
def plant(tmp_path: Path, one_valve: Path) -> Path:
    """A plant whose source is a folder of JSON files with the samples of the sticking valve."""
    with one_valve.open(encoding="utf-8", newline="") as file:
        header, _, *rows = csv.reader(file)
    (tmp_path / "samples").mkdir()
    for tag in (f"{VALVE}.OP", f"{VALVE}.ZT"):
        place = header.index(tag)
        samples = [(datetime.fromisoformat(row[0]).timestamp(), number(row[place])) for row in rows]
        (tmp_path / "samples" / f"{tag}.json").write_text(json.dumps(samples))
    path = tmp_path / "plant.toml"
    path.write_text(PLANT, encoding="utf-8")
    return path


def number(cell: str) -> float | None:
    """A cell's number, if it is one."""
    try:
        return float(cell)
    except ValueError:
        return None


@pytest.mark.parametrize("workers", [1, 2])
def test_a_valve_of_an_installed_connector_is_screened(
    packages: Path, plant: Path, stemwatch: Callable[..., Any], workers: int
) -> None:
    """Its package names it, the plant file configures it, a worker opens it."""
    installed(packages, "plant_json", PACKAGE, {"json": "plant_json:JsonArchive"})
    out = plant.parent / "out"
    text = plant.read_text(encoding="utf-8")
    more = text[text.index("[[valves]]") :].replace('id = "FIC-104"', 'id = "again"')
    plant.write_text(text + more, encoding="utf-8")
    db = f"sqlite:///{plant.parent / 'own.db'}"
    outcome = stemwatch("screen", "--plant", plant, "--out", out, "--workers", workers, "--db", db)
    assert outcome.status == 0, outcome.said
    loaded = json.loads((out / "valves.json").read_text(encoding="utf-8"))
    assert [valve["verdict"] for valve in loaded] == ["sticky", "sticky"]


def test_its_settings_are_checked_as_ours_are(packages: Path, plant: Path) -> None:
    """With the line, what was found, what was expected, and the nearest key."""
    installed(packages, "plant_json", PACKAGE, {"json": "plant_json:JsonArchive"})
    text = plant.read_text(encoding="utf-8").replace('path = "samples"', 'pat = "samples"')
    plant.write_text(text, encoding="utf-8")
    missing, unknown, left_out = map(str, load_plant(plant, environment={}).problems)
    assert missing == (
        "plant.toml, line 1: sources[archive].path: found nothing; expected a folder of JSON "
        "files, relative to the plant file"
    )
    assert unknown.startswith("plant.toml, line 4: sources[archive].pat: found an unknown key")
    assert unknown.endswith("zone (did you mean 'path'?)")
    assert "its valve is left out (FIC-104)" in left_out


def test_a_kind_that_nobody_brings_is_said_with_the_nearest(plant: Path) -> None:
    """The kinds that are installed are listed."""
    text = plant.read_text(encoding="utf-8").replace('"json"', '"parket"')
    plant.write_text(text, encoding="utf-8")
    problem = str(load_plant(plant, environment={}).problems[0])
    assert "plant.toml, line 3: sources[archive].kind: found the text 'parket'" in problem
    assert (
        "one of csv, influx, opcua, parquet, pi, sql; without kind a source is a text export"
        in problem
    )
    assert problem.endswith("(did you mean 'parquet'?)")


@pytest.mark.parametrize(
    ("module", "answer"),
    [
        ("import no_such_library", "cannot be loaded (ModuleNotFoundError"),
        ("class JsonArchive:\n    pass", "does not say what its table looks like"),
    ],
)
def test_a_connector_that_cannot_be_used_costs_its_own_sources(
    packages: Path, plant: Path, module: str, answer: str
) -> None:
    """Its package is named, and a source beside it is read all the same."""
    installed(packages, "plant_json", module, {"json": "plant_json:JsonArchive"})
    text = plant.read_text(encoding="utf-8")
    plant.write_text(text + '\n[[sources]]\nname = "files"\npath = "*.csv"\n', encoding="utf-8")
    loaded = load_plant(plant, environment={})
    assert list(loaded.sources) == ["files"]
    assert answer in str(loaded.problems[0])
    assert "plant_json:JsonArchive of plant_json" in str(loaded.problems[0])


def test_two_packages_that_claim_one_kind_are_both_named(packages: Path, plant: Path) -> None:
    """Which of them is meant nobody can know."""
    installed(packages, "plant_json", PACKAGE, {"json": "plant_json:JsonArchive"})
    installed(packages, "plant_other", PACKAGE, {"json": "plant_other:JsonArchive"})
    problem = str(load_plant(plant, environment={}).problems[0])
    assert "several connectors claim the kind 'json'" in problem
    assert "plant_json" in problem
    assert "plant_other" in problem


def test_kind_csv_is_a_text_export(plant: Path) -> None:
    """As is a source without a kind."""
    text = plant.read_text(encoding="utf-8").replace('"json"', '"csv"')
    plant.write_text(text.replace('"samples"', '"*.csv"'), encoding="utf-8")
    loaded = load_plant(plant, environment={})
    assert loaded.problems == ()
    assert loaded.source_files("archive") == ()
    assert {"csv", "opcua", "parquet", "sql"} <= set(installed_connectors())
