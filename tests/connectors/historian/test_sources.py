"""Files, folders and patterns to the recordings in them."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian import find_sources

GOOD = "t_s,OP\n" + "".join(f"{i},{i}\n" for i in range(9))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "b").mkdir()
    (tmp_path / "a.csv").write_text(GOOD)
    (tmp_path / "b" / "c.txt").write_text(GOOD)
    (tmp_path / "b" / "d.csv.gz").write_bytes(gzip.compress(GOOD.encode()))
    (tmp_path / "labels.csv").write_text("file,label\nx.csv,good\ny.csv,bad\nz.csv,bad\n")
    (tmp_path / "README.txt").write_text("These are notes.\nNothing more, and no numbers.\n")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG")
    (tmp_path / ".hidden.csv").write_text(GOOD)
    return tmp_path


def test_folder_is_searched_in_order(folder: Path) -> None:
    """A folder gives its recordings in order of name, and a reason for each other text file."""
    paths, skipped = find_sources([folder])
    assert paths == [folder / "a.csv", folder / "b" / "c.txt", folder / "b" / "d.csv.gz"]
    assert [path for path, _ in skipped] == [folder / "README.txt", folder / "labels.csv"]
    assert all("probably not a recording" in reason for _, reason in skipped)


def test_glob_and_file_name_each_file_once(folder: Path) -> None:
    """Overlapping patterns give a file once; a file that was named itself is always taken."""
    paths, skipped = find_sources([str(folder / "*.csv"), folder / "a.csv", folder / "labels.csv"])
    assert paths == [folder / "a.csv", folder / "labels.csv"]
    assert skipped == []


def test_a_hidden_file_is_taken_where_it_is_named(folder: Path) -> None:
    """What a folder leaves out a person can still ask for by name."""
    assert find_sources([folder / ".hidden.csv"]) == ([folder / ".hidden.csv"], [])


def test_a_pattern_that_names_nothing_is_an_error(tmp_path: Path) -> None:
    """A pattern that names nothing is an error that says what was expected."""
    with pytest.raises(UnreadableSource, match="no such file, folder or pattern"):
        find_sources([tmp_path / "*.csv"])


def test_long_file_is_judged_by_its_start(tmp_path: Path) -> None:
    """A file longer than what is looked at is taken, packed or not."""
    text = "t_s,OP\n" + "".join(f"{i},{i % 89}.25\n" for i in range(90_000))
    (tmp_path / "long.csv").write_text(text)
    (tmp_path / "long.csv.gz").write_bytes(gzip.compress(text.encode(), 1))
    assert len(find_sources([tmp_path]).paths) == 2
