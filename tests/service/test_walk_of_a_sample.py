"""docs/architecture.md, "The walk of one sample": a screening passes these places in this order."""

from __future__ import annotations

import re
import sys
import threading
from collections import Counter
from pathlib import Path
from shutil import copy
from types import FrameType

import pytest

REPOSITORY = Path(__file__).parent.parent.parent
PAGE = REPOSITORY / "docs" / "architecture.md"
# Asked of OP and of each other signal, or of the whole recording and again of a part of it, and
# what every output asks for: report, work list, terminal.
MORE_THAN_ONCE = {
    "convert",
    "lay_column",
    "on_own_clock",
    "assess",
    "choose_fit_window",
    "present",
    "rank_valves",
}


def places() -> list[tuple[str, str]]:
    """File and function of each row of the table; of a class only that it is there is checked."""
    text = PAGE.read_text("utf-8").split("## The walk of one sample\n")[1].split("\n## ")[0]
    found = []
    for row in [line for line in text.splitlines() if line.startswith("| ")][1:]:
        file = ""
        for name in re.findall(r"`([^`]+)`", row.split("|")[2]):
            if "/" in name:
                file = name
            elif name[0].islower():
                found.append((file, name))
    return found


@pytest.mark.long
def test_a_sample_passes_each_place_once_and_in_this_order(
    stemwatch, one_valve: Path, tmp_path: Path
) -> None:
    """Every function of the table ends its work in that order; in models and connectors once."""
    wanted = places()
    names = {name for _, name in wanted}
    # A file of its own: what another test opened is kept, and would not be opened here.
    export = copy(one_valve, tmp_path)
    calls: list[tuple[str, str]] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "return" and code.co_name in names:
            calls.extend(
                place
                for place in wanted
                if place[1] == code.co_name and code.co_filename.endswith(place[0])
            )

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        outcome = stemwatch(
            "screen", str(export), "--out", str(tmp_path / "report"), "--executor", "in-process"
        )
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    assert outcome.status == 0, outcome.said
    assert [place for place in wanted if place not in calls] == []
    of_science = [place for place in wanted if not place[0].startswith("service/")]
    assert of_science == sorted(of_science, key=calls.index)
    counts = Counter(calls)
    assert {
        name for file, name in wanted if counts[file, name] > 1 and file in dict(of_science)
    } <= MORE_THAN_ONCE
