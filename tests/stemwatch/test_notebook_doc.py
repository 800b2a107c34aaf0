"""docs/notebook.md says what is so: its code runs as it stands there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

PAGE = Path(__file__).parent.parent.parent / "docs" / "notebook.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
PLOTTING = [block for block in BLOCKS if ".plot()" in block]


# The functions of the page run with their own examples in the short run.
runs_the_page = pytest.mark.long


@pytest.fixture(scope="module")
def cells(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The names that the page has made once all its blocks ran in turn, but for the plots."""
    names: dict[str, Any] = {"folder": tmp_path_factory.mktemp("notebook")}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(names["folder"])
        for block in BLOCKS:
            if block not in PLOTTING:
                exec(compile(block, "docs/notebook.md", "exec"), names)
    return names


@runs_the_page
def test_the_work_list_holds_the_valves_that_stick(cells: dict[str, Any]) -> None:
    """Of the three simulated valves the two that stick are to be seen to, the worse one first."""
    to_do: pd.DataFrame = cells["to_do"]
    assert ["FIC-101", "LIC-103"] == list(to_do["valve"])
    assert ["sticky", "sticky"] == list(to_do["verdict"])


@runs_the_page
def test_a_file_gives_what_the_frame_gave(cells: dict[str, Any]) -> None:
    """The same samples from a CSV file are the same valves."""
    assert sorted(cells["loops"]) == sorted(cell.valve for cell in cells["work"])
    assert len(cells["frame"]) == len(cells["recording"])


def test_the_page_goes_from_a_frame_to_a_work_list_in_twenty_lines() -> None:
    """The first two blocks, which do it, are no longer than promised."""
    lines = [line for block in BLOCKS[:2] for line in block.splitlines() if line.strip()]
    assert len(lines) <= 20


@runs_the_page
def test_the_plots_of_the_page_are_drawn(cells: dict[str, Any]) -> None:
    """The figure is a file with something in it."""
    pytest.importorskip("matplotlib", reason="PLOTS ARE NOT TESTED: matplotlib is not installed")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(cells["folder"])
        for block in PLOTTING:
            exec(compile(block, "docs/notebook.md", "exec"), cells)
    assert (cells["folder"] / "FIC-101.png").stat().st_size > 10_000
