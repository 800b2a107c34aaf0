"""``stemwatch twin`` on the recording of a sticking valve, and what the screening keeps of it."""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path

import pytest

from stemwatch.service.studies.twin import FALL, run_twin_study
from tests.service.conftest import BLIND, STICKY, write_small_plant


def test_the_twin_of_a_valve_shows_five_usual_changes(
    stemwatch, small_plant: Path, tmp_path: Path
) -> None:
    """Five usual changes with intervals, on the terminal and as JSON; repair saves most."""
    file = tmp_path / "twin.json"
    outcome = stemwatch("twin", STICKY, "--plant", small_plant, "--json", file)
    assert outcome.status == 0, outcome.err
    assert "repaired: S = J = 0" in outcome.out
    assert "Controller: gain" in outcome.out
    told = json.loads(file.read_text())
    falls = [row["variance_fall_percent"] for row in told["what_if"]]
    assert len(falls) == 5
    assert falls[0]["value"] == max(fall["value"] for fall in falls)
    assert falls[0]["low"] <= falls[0]["value"] <= falls[0]["high"]
    assert falls[0]["value"] > 50.0


def test_a_requested_change_gives_one_row(stemwatch, small_plant: Path) -> None:
    """One row for what was asked; a knocker without sense is refused with what is expected."""
    asked = ("twin", STICKY, "--plant", small_plant)
    outcome = stemwatch(*asked, "--gain-times", "0.7", "--s", "1")
    assert "as asked" in outcome.out
    assert "repaired" not in outcome.out
    refused = stemwatch(*asked, "--knock", "3,2,5")
    assert refused.status == 2
    assert "such as 2,10,2" in " ".join(refused.err.split())


def test_what_has_no_twin_says_why(stemwatch, small_plant: Path) -> None:
    """A valve without a position, and a name that nothing has."""
    blind = stemwatch("twin", BLIND, "--plant", small_plant)
    assert blind.status == 2
    assert "cannot be run again" in " ".join(blind.err.split())
    unknown = stemwatch("twin", "FIC-999", "--plant", small_plant)
    assert unknown.status == 2
    assert "no such valve" in " ".join(unknown.err.split())


@pytest.mark.long
def test_screening_keeps_what_the_sticking_costs(
    stemwatch, small_plant: Path, tmp_path: Path
) -> None:
    """A sticking valve has the indicators, with intervals; a healthy and a blind one have not."""
    out = tmp_path / "report"
    assert stemwatch("screen", "--plant", small_plant, "--out", out, "--workers", "1").status == 0
    found = {one["valve"]: one for one in json.loads((out / "valves.json").read_text())}
    share = found[STICKY]["indicators"]["variance_from_sticking_percent"]
    assert share["low"] <= share["value"] <= share["high"] <= 100.0
    assert share["value"] > 50.0
    for name, one in found.items():
        has = "variance_from_sticking_percent" in one["indicators"]
        assert has == (name == STICKY), name


@pytest.mark.long
def test_the_study_holds_twins_to_the_plant() -> None:
    """Four loops of a development seed: the fall of the variance is foretold within a fifth."""
    loops = list(run_twin_study(4, 6161))
    figures = [one for loop in loops for one in loop.figures]
    falls = [one for one in figures if (one.change, one.figure) == ("repaired", FALL)]
    assert len(falls) >= 3
    errors = sorted(one.error for one in falls)
    assert errors[len(errors) // 2] < 0.2


@pytest.mark.long
def test_a_price_in_the_plant_file_becomes_money(stemwatch, tmp_path: Path) -> None:
    """In the report's head, the valve's section and JSON alike; a wrong price is named. An hour of
    the valve: by a quarter of one, some processes that explain it as well swing by themselves."""
    plant = write_small_plant(tmp_path, (STICKY,), 60)
    text = plant.read_text(encoding="utf-8")
    unpriced = re.sub(r"(?m)^(currency|price_per_unit_hour) = .*\n", "", text)
    priced = unpriced.replace("[plant]", '[plant]\ncurrency = "EUR"').replace(
        f'id = "{STICKY}"', f'id = "{STICKY}"\nprice_per_unit_hour = 12.5\ntarget_band = 1.0'
    )
    plant.write_text(priced, encoding="utf-8")
    out = tmp_path / "report"
    assert stemwatch("screen", "--plant", plant, "--out", out, "--workers", "1").status == 0
    found = {one["valve"]: one for one in json.loads((out / "valves.json").read_text())}
    cost = found[STICKY]["cost_of_sticking"]
    assert cost["money_per_month"]["unit"] == "EUR"
    assert cost["money_per_month"]["value"] > 0.0
    assert "off_target_from_sticking_percent" in found[STICKY]["indicators"]
    page = (out / "report.html").read_text().replace("\N{NO-BREAK SPACE}", " ")
    assert "The sticking of 1 loop costs about" in page
    assert cost["sentence"] in page
    plant.write_text(priced.replace("12.5", "-1"), encoding="utf-8")
    refused = stemwatch("screen", "--plant", plant, "--out", out, "--workers", "1")
    assert "price_per_unit_hour" in refused.said


def test_fmu_and_modelica_are_written_without_simulating(
    stemwatch, small_plant: Path, tmp_path: Path
) -> None:
    """As FMI 3.0 unit and Modelica text in one go, with what the model has; nothing else is run."""
    unit, text = tmp_path / "valve.fmu", tmp_path / "valve.mo"
    made = stemwatch("twin", STICKY, "--plant", small_plant, "--fmu", unit, "--modelica", text)
    assert made.status == 0, made.err
    assert "It has S and J" in made.out
    assert f"Written: {unit}" in made.out
    assert f"Written: {text}" in made.out
    assert "repaired" not in made.out
    with zipfile.ZipFile(unit) as archive:
        names = archive.namelist()
    assert {"modelDescription.xml", "sources/fmi3.c", "documentation/index.html"} <= set(names)
    assert "block " in text.read_text(encoding="utf-8")


def test_a_model_needs_S_and_a_name_that_tools_know(
    stemwatch, small_plant: Path, tmp_path: Path
) -> None:
    """A valve without a position has none, a file of another ending is refused before the fit."""
    blind = stemwatch("twin", BLIND, "--plant", small_plant, "--fmu", tmp_path / "valve.fmu")
    assert blind.status == 2
    assert "there is no model to write: S is not known" in " ".join(blind.err.split())
    assert not (tmp_path / "valve.fmu").exists()
    other = stemwatch("twin", STICKY, "--plant", small_plant, "--fmu", tmp_path / "valve.zip")
    assert other.status == 2
    assert "ends in .fmu is expected" in " ".join(other.err.split())
