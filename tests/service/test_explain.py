"""``stemwatch explain``: several recordings, good and bad; terminal, JSON, page."""

from __future__ import annotations

import json
import re
from importlib.resources import files

import jsonschema
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from stemwatch.service.cli.explain import explain as command
from stemwatch.service.config import load_plant
from stemwatch.service.explain.requested_recordings import recordings_to_explain
from stemwatch.service.run.plan import Request

SCHEMA = json.loads(
    files("stemwatch.service.explain").joinpath("explain.schema.json").read_text("utf-8")
)
TAGS = ("--op", "FV101.OP", "--mv", "FV101.ZT")


@pytest.fixture(scope="module")
def run():
    """Runs the command in this process, on a wide terminal; gives exit status and text."""
    app = typer.Typer()
    app.command()(command)

    def it(*arguments):
        result = CliRunner().invoke(
            app, [*map(str, arguments), "--workers", "1"], env={"COLUMNS": "200"}
        )
        assert result.exception is None or isinstance(result.exception, SystemExit), result.output
        return result.exit_code, " ".join(re.sub("[─-╿]", " ", result.output).split())

    return it


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recording of a valve whose stem arrives two seconds late, and a file that is no table."""
    home = tmp_path_factory.mktemp("exports")
    rng = np.random.default_rng(3)
    op = 50.0 + np.cumsum(rng.normal(0.0, 0.4, 1500))
    mv = np.concatenate([op[:1], op[:1], op[:-2]]) + rng.normal(0.0, 0.05, op.size)
    lines = [f"{k},{a:.4f},{b:.4f}" for k, (a, b) in enumerate(zip(op, mv, strict=True))]
    text = "\n".join(["time_s,FV101.OP,FV101.ZT", *lines]) + "\n"
    (home / "fv101.csv").write_text(text, encoding="utf-8")
    (home / "broken.csv").write_bytes(bytes(range(256)) * 8)
    return home


def test_one_bad_recording_costs_no_other(run, folder, tmp_path, monkeypatch):
    """Good, broken and absent: three objects in order, named as they were given; status 0."""
    monkeypatch.chdir(folder)
    given = ["./broken.csv", "./fv101.csv", "absent.csv"]
    out = tmp_path / "found.json"
    status, text = run(*given, *TAGS, "--json", out, "--no-narx")
    assert status == 0
    objects = json.loads(out.read_text("utf-8"))
    jsonschema.validate(objects, SCHEMA)
    assert [object["recording"] for object in objects] == given
    assert [object["verdict"] for object in objects][::2] == ["not_testable"] * 2
    assert "broken.csv" in objects[0]["sentence"]
    assert "no such file" in objects[2]["sentence"]
    assert objects[1]["seconds"] > 0.0
    assert "3 recordings:" in text
    assert "no such file, folder or pattern" in text


def test_where_nothing_can_be_read_it_is_status_2(run, folder, tmp_path):
    """The reasons stand on the terminal, once, and in the JSON; an earlier page stays."""
    out, pages = tmp_path / "found.json", tmp_path / "pages"
    pages.mkdir()
    (pages / "explain.html").write_text("the last good page", encoding="utf-8")
    both = (folder / "broken.csv", tmp_path / "absent.csv")
    status, text = run(*both, *TAGS, "--json", out, "--out", pages)
    assert status == 2
    assert text.count("nothing could be explained") == 1
    assert text.count("no such file, folder or pattern") == 1
    assert (pages / "explain.html").read_text("utf-8") == "the last good page"
    assert [load["verdict"] for load in json.loads(out.read_text("utf-8"))] == ["not_testable"] * 2


def test_the_page_the_json_and_the_maps_lie_in_the_folder(run, folder, tmp_path):
    """--out leaves one page, the same objects, and the maps that the page shows."""
    status, text = run(folder / "fv101.csv", *TAGS, "--out", tmp_path, "--no-narx")
    assert status == 0
    assert "explain.html" in text
    (item,) = json.loads((tmp_path / "explain.json").read_text("utf-8"))
    page = (tmp_path / "explain.html").read_text("utf-8")
    assert item["heldout"]["rmse_ceiling"] is None
    maps = sorted(path.name for path in (tmp_path / "maps").glob("*.svg"))
    assert len(maps) == page.count('<svg class="map"')


def test_a_stem_that_arrives_late_is_no_sticking_stem(run, folder, tmp_path):
    """Two seconds of dead time: S restated is next to nothing, and the fit is better for it."""
    out = tmp_path / "found.json"
    run(folder / "fv101.csv", *TAGS, "--json", out)
    (item,) = json.loads(out.read_text("utf-8"))
    assert item["verdict"] in ("named", "candidates")
    slugs = {slug for effect in item["effects"] for slug in effect["class"]}
    assert "dead_time" in slugs
    assert item["stiction"]["restated"]["S"]["value"] < 0.5
    assert item["heldout"]["rmse_extended"] < 0.5 * item["heldout"]["rmse_naive"]
    assert item["heldout"]["rmse_ceiling"] > 0.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "give a file, a folder or --plant plant.toml"),
        (("x.csv", "--mv", "ZT"), "the controller output is needed"),
        (("x.csv", "--from", "yesterday"), "is not a time"),
        (("--plant", "none.toml"), "there is no file none.toml"),
    ],
)
def test_wrong_usage_is_a_sentence(run, arguments, words):
    """Status 2 and what to do."""
    status, text = run(*arguments)
    assert status == 2
    assert words in text


def test_a_plant_file_names_its_valves(plant):
    """With --plant alone, each valve of its sources is asked for once."""
    valves = recordings_to_explain(Request(plant=load_plant(plant))).valves
    assert [item.valve for item in valves] == ["FIC-107", "FIC-104", "FIC-113"]
    assert {item.reason for item in valves} == {""}


def test_a_file_that_is_named_twice_is_explained_once(folder):
    """By itself and through its folder; its own spelling comes first."""
    item = folder / "fv101.csv"
    valves = recordings_to_explain(Request(sources=(str(item), str(folder), str(item)))).valves
    assert [each.source for each in valves if each.valve == "FV101"] == [str(item)]


def test_what_a_folder_holds_beside_recordings_is_left_out(run, folder, tmp_path):
    """A note beside the recordings is said to be left out, and is no object of the list."""
    home = tmp_path / "exports"
    home.mkdir()
    (home / "fv101.csv").write_bytes((folder / "fv101.csv").read_bytes())
    (home / "notes.txt").write_text("Packing renewed.\n", encoding="utf-8")
    out = tmp_path / "found.json"
    status, text = run(home, *TAGS, "--json", out, "--no-narx")
    assert status == 0
    assert "left out:" in text
    assert [load["recording"] for load in json.loads(out.read_text("utf-8"))] == [
        str(home / "fv101.csv")
    ]
