"""The contract of the ``Notifier`` interface: every installed notifier, and one from another
package."""

from __future__ import annotations

import inspect
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from stemwatch.service.alerts.notifiers import NotSent, notifiers_of
from stemwatch.service.config import load_plant
from stemwatch.service.config.service_schema import NOTIFIERS, notifier_kinds

MESSAGE = {"subject": "FV-1: sticks", "text": "FV-1 sticks.\n", "plant": "", "alerts": []}
# What each kind needs to know of a receiver that is not there.
NOBODY_THERE = {
    "mail": 'host = "127.0.0.1"\nport = 1\nsender = "a@b.example"\nto = ["c@d.example"]',
    "webhook": 'url = "http://127.0.0.1:1/"\nallow_private = true',
    "file": 'path = "plant.toml/below-a-file"',
    "pager": 'options = { number = "" }',
}
PAGER = '''
from stemwatch.service.alerts.notifiers import NotSent


class Pager:
    """Writes what it is given into a file with the receiver's number."""

    def __init__(self, number, folder):
        self.number, self.folder = number, folder

    @classmethod
    def from_table(cls, table, secret, folder):
        return cls(table.options["number"], folder)

    def send(self, key, message):
        if not self.number:
            raise NotSent("pager: no number to call")
        with (self.folder / f"{self.number}.txt").open("a") as file:
            file.write(f"{key} {message['subject']}")
'''


@pytest.fixture
def pager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package with a notifier, installed as pip leaves it."""
    site = tmp_path / "site"
    info = site / "plant_pager-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "plant_pager.py").write_text(PAGER)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: plant-pager\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{NOTIFIERS}]\npager = plant_pager:Pager\n")
    monkeypatch.syspath_prepend(str(site))


def plant_with(folder: Path, kind: str, keys: str):
    """A plant file with one notifier."""
    file = folder / "plant.toml"
    file.write_text(f'[[notifiers]]\nname = "n"\nkind = "{kind}"\n{keys}\n', encoding="utf-8")
    return load_plant(file, environment={})


def test_the_product_finds_its_own_notifiers_by_their_entry_points() -> None:
    """Mail, webhook and file are installed as those of a stranger would be."""
    assert {"mail", "webhook", "file"} <= set(notifier_kinds())


@pytest.mark.parametrize("kind", sorted(NOBODY_THERE))
def test_every_notifier_keeps_the_contract(kind: str, pager: None, tmp_path: Path) -> None:
    """It is made from its table, and says that a message did not arrive, so that it is kept."""
    assert set(notifier_kinds()) == set(NOBODY_THERE)
    (point,) = entry_points(group=NOTIFIERS, name=kind)
    made_from = inspect.signature(point.load().from_table).parameters
    assert list(made_from) == ["table", "secret", "folder"]
    plant = plant_with(tmp_path, kind, NOBODY_THERE[kind])
    assert plant.problems == ()
    notifier = notifiers_of(plant)["n"]
    assert list(inspect.signature(notifier.send).parameters) == ["key", "message"]
    with pytest.raises(NotSent, match=r"127\.0\.0\.1|plant\.toml|number"):
        notifier.send("alerts-1-1-1", MESSAGE)


def test_a_notifier_of_another_package_is_told_through_the_plant_file(
    pager: None, tmp_path: Path
) -> None:
    """Its own keys stand in ``options``; nothing in the product knows it."""
    plant = plant_with(tmp_path, "pager", 'options = { number = "4711" }')
    notifiers_of(plant)["n"].send("alerts-1-1-1", MESSAGE)
    assert (tmp_path / "4711.txt").read_text() == "alerts-1-1-1 FV-1: sticks"


def test_a_kind_that_nobody_installed_is_named_with_those_there_are(tmp_path: Path) -> None:
    """Line, what was found, and what would do."""
    (problem,) = plant_with(tmp_path, "pager", "").problems
    assert "'pager'" in str(problem)
    assert "one of 'file', 'mail', 'webhook'" in str(problem)
