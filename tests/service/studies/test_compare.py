"""``stemwatch compare``: every model on one recording, as table, JSON and page."""

from __future__ import annotations

import html
import json
import re

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from stemwatch.models.recording import Provenance, Recording, Role, Signal
from stemwatch.models.studies.literature.canonical import CANONICAL
from stemwatch.models.studies.literature.catalogue import DATA_DRIVEN, EVERY
from stemwatch.models.studies.literature.model import values_of
from stemwatch.service.cli.compare import compare as command
from stemwatch.service.studies.comparison.compare_models import NETWORKS, compare
from stemwatch.service.studies.comparison.comparison_html import html_bytes

pytestmark = pytest.mark.long  # a study: it simulates, fits and trains from the beginning


@pytest.fixture(scope="module")
def app():
    app = typer.Typer()
    app.command()(command)
    return app


def made(samples=900, valve="FV-101", source="memory"):
    k = np.arange(samples)
    rng = np.random.default_rng(8)
    op = (
        50.0
        + 12.0 * np.sin(2 * np.pi * (k + 0.3) / 130.0)
        + np.cumsum(0.05 * rng.standard_normal(samples))
    )
    mv = CANONICAL.simulate(op, values_of(CANONICAL, S=4.0, J=1.5), 1.0, float(op[0]))
    mv += 0.1 * rng.standard_normal(samples)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "ZT")}
    return Recording(
        valve=valve, signals=signals, interval_s=1.0, provenance=Provenance(source=source)
    )


@pytest.fixture(scope="module")
def compared():
    return compare(made(), 600, DATA_DRIVEN, network=False)


@pytest.fixture
def export(tmp_path):
    recording = made()
    lines = ["time_s,FV101.OP,FV101.ZT"]
    pairs = zip(recording.op.values, recording.mv.values, strict=True)
    lines += [f"{k},{op:.4f},{mv:.4f}" for k, (op, mv) in enumerate(pairs)]
    path = tmp_path / "fv101.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_the_model_that_made_the_record_is_among_the_best(compared):
    """Canonical, and its equals Kano, XCH and Chen, lead the ranking on what is held out."""
    first = {row.model for row in compared.ranked()[:5]}
    assert {"canonical", "kano", "xch", "chen_tree"} <= first
    assert compared.ranked()[0].heldout.rmse < 0.2


def test_every_model_and_every_network_has_a_row():
    """Fifteen models and three networks, each with marks or a sentence."""
    answer = []
    comparison = compare(
        made(700), 450, on_progress=lambda model, done, of: answer.append((model, of))
    )
    names = [row.model for row in comparison.rows]
    assert names == [*(model.name for model in EVERY), *(network.name for network in NETWORKS)]
    assert answer == [(name, 18) for name in names]
    assert all(row.training is not None or row.outcome for row in comparison.rows)


def test_a_record_without_a_position_is_a_table_of_reasons():
    """No model breaks: each row says that there is nothing to fit to."""
    recording = made()
    bare = Recording(valve="V", signals={Role.OP: recording.op}, interval_s=1.0)
    rows = compare(bare, 600, DATA_DRIVEN[:2]).rows
    assert ["no valve position" in row.outcome for row in rows] == [True] * 5


def test_the_page_holds_the_table_and_the_traces(compared):
    """Each model's name and its points are in the page, rounded to a thousandth."""
    page = html_bytes(compared).decode()
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])
    labels = [trace["label"] for trace in data["traces"]]
    assert labels == ["OP", "MV", *(row.model for row in compared.ranked())]
    assert [trace["shown"] for trace in data["traces"]] == [True] * 5 + [False] * 7
    assert {len(trace["values"]) for trace in data["traces"]} == {900}
    assert data["heldout"] == 600.0


def test_the_page_loads_nothing(compared):
    """A policy without any source, and no address in an attribute."""
    page = html.unescape(html_bytes(compared).decode())
    assert "default-src 'none'" in page
    assert re.findall(r'(?:src|href)="', page) == []


def test_a_hostile_name_is_text():
    """What a file calls its valve, or itself, cannot become markup."""
    recording = made(valve="<img src=x onerror=alert(1)>", source="</script><b>")
    page = html_bytes(compare(recording, 600, DATA_DRIVEN[:1], network=False)).decode()
    assert "<img" not in page
    assert "</script><b>" not in page


def test_the_command_prints_writes_and_draws(app, export, tmp_path):
    """Table on the terminal, rows in JSON, a page in the folder."""
    args = [str(export), "--op", "FV101.OP", "--mv", "FV101.ZT", "--no-narx"]
    json_file, out = tmp_path / "rows.json", tmp_path / "page"
    result = CliRunner().invoke(app, [*args, "--json", str(json_file), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "canonical" in result.output
    rows = {row["model"]: row for row in json.loads(json_file.read_text("utf-8"))}
    assert set(rows) == {model.name for model in EVERY}
    assert rows["canonical"]["parameters"]["S"]["value"] == pytest.approx(4.0, abs=0.2)
    assert (out / "compare.html").stat().st_size > 50_000


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--mv", "FV101.ZT"], "the controller output is needed"),
        (["--train-share", "0.01"], "Invalid value for '--train-share'"),
    ],
)
def test_wrong_usage_is_a_sentence(app, export, args, words):
    """Status 2 and what to do."""
    result = CliRunner().invoke(app, [str(export), *args], env={"COLUMNS": "200"})
    assert result.exit_code == 2
    assert words in re.sub(r"[│\s]+", " ", result.output)
