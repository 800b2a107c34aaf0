"""The order in which tests are run, and which of them a target of the Makefile runs."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import early_first

REPOSITORY = Path(__file__).parent.parent


@dataclass(frozen=True)
class Item:
    """As much of a test as its order asks for."""

    name: str
    path: Path = field(default=Path("test_others.py"))
    early: bool = False

    def get_closest_marker(self, name: str) -> Any:
        """Whether it is early."""
        return True if self.early and name == "early" else None


@pytest.mark.parametrize("processes", [1, 2, 4, 5])
def test_half_of_the_processes_begin_with_early_tests(processes: int) -> None:
    """None is lost, a module's stay together, and the other processes have other work."""
    others = [Item(f"other {k}") for k in range(40)]
    early = [Item(f"{m} {k}", Path(f"test_{m}.py"), True) for m in "abc" for k in range(3)]
    ordered: list[Any] = early_first([*others, *early], processes)  # type: ignore[list-item]
    assert sorted(item.name for item in ordered) == sorted(item.name for item in others + early)
    begins = [len(ordered) * place // processes for place in range(processes)]
    assert [ordered[at].early for at in begins] == [
        place < max(1, processes // 2) for place in range(processes)
    ]
    names = [item.name for item in ordered if item.early]
    assert all("".join(names).count(f"{m} 0{m} 1{m} 2") == 1 for m in "abc")


def test_few_tests_are_all_run() -> None:
    """Where there are fewer tests than processes, and where all are early."""
    early: list[Any] = [Item("a", Path("test_a.py"), True), Item("b", Path("test_b.py"), True)]
    assert early_first(early, 4) == early
    assert early_first([], 4) == []


def test_every_test_is_run_by_one_target() -> None:
    """``make test``, ``make test-ci`` and ``make test-all`` add what the one before leaves out;
    continuous integration leaves the studies to the last."""
    makefile = (REPOSITORY / "Makefile").read_text("utf-8")
    targets = re.findall(
        r"^(test[a-z-]*): (\S+)(?:(?!^\S).)*?\$\(PYTEST\) -m '?([a-z ]+?)'?\$\(call",
        makefile,
        re.M | re.S,
    )
    assert targets == [
        ("test", "$(VENV)/can-test", "not long"),
        ("test-ci", "test", "long and not study"),
        ("test-all", "test-ci", "study"),
    ]
    run = (REPOSITORY / ".ci" / "run").read_text("utf-8")
    assert re.findall(r"^make (test[a-z-]*) .*STRICT=1", run, re.M) == ["test-ci"]
