"""docs/tutorial.md: each of its commands, in its order, in an empty folder."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial.md"
COMMANDS = re.findall(r"^```\nstemwatch (.+)$", TUTORIAL.read_text("utf-8"), re.MULTILINE)


@pytest.mark.long
@pytest.mark.early
def test_the_tutorial_does_what_it_says(
    stemwatch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each command ends well, the files it names are there, and the valves it names stick."""
    monkeypatch.chdir(tmp_path)
    assert len(COMMANDS) >= 5
    for command in COMMANDS:
        process = stemwatch(*shlex.split(command))
        assert process.status == 0, f"{command}: {process.said}"
    named = re.findall(r"^\| (`[^|]+`) \|", TUTORIAL.read_text("utf-8"), re.MULTILINE)
    files = [name for row in named for name in re.findall(r"`([\w.-]+)`", row)]
    assert len(files) >= 8
    assert [file for file in files if not (tmp_path / "tutorial/report" / file).is_file()] == []
    valves = json.loads((tmp_path / "tutorial/report/valves.json").read_text("utf-8"))
    sticky = {valve["valve"] for valve in valves if valve["verdict"] == "sticky"}
    assert {"FIC-104"} <= sticky
    (explained,) = json.loads((tmp_path / "tutorial/explained/explain.json").read_text("utf-8"))
    assert explained["valve"] == "FIC-115"
    assert "when closing" in explained["sentence"]
