"""Lazy imports: torch is loaded only by what trains networks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.early

REPOSITORY = Path(__file__).parents[2]
# The process that workers are forked from loads what they train with.
PRELOAD = "stemwatch.service.run.worker_preload"
ROOMS = ("stemwatch", "connectors", "service")

# In a fresh interpreter, one after the other: where torch is not there at the end, none loaded it.
EVERY = """
import sys
from importlib import import_module

for name in sys.argv[1:]:
    import_module(name)
    if "torch" in sys.modules:
        sys.exit(name + " loads torch when it is imported")
print("none")
"""


def modules_of(room: str) -> list[str]:
    """The names of all modules of a folder at the top of the repository."""
    matching = []
    for path in sorted((REPOSITORY / room).rglob("*.py")):
        if "migrations" in path.parts or path.stem == "__main__":
            continue  # run by their own commands
        parts = path.relative_to(REPOSITORY).with_suffix("").parts
        parts = parts[:-1] if parts[-1] == "__init__" else parts
        matching.append(".".join(parts if room == "stemwatch" else ("stemwatch", *parts)))
    return matching


def run(code: str, *arguments: object, cwd: Path | None = None) -> str:
    """What a fresh interpreter prints for ``code``."""
    process = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    assert process.returncode == 0, process.stderr
    return process.stdout


def test_no_module_loads_torch_when_it_is_imported() -> None:
    """Commands, pages, the store, the report, connectors and the front door: none of them."""
    modules = [name for room in ROOMS for name in modules_of(room) if name != PRELOAD]
    assert len(modules) > 100
    assert run(EVERY, *modules) == "none\n"


@pytest.mark.parametrize(
    "arguments",
    [["--help"], pytest.param(["inspect", "export"], marks=pytest.mark.long)],
    ids=lambda words: words[0],
)
def test_commands_that_train_nothing_load_no_torch(
    one_valve: Path, arguments: list[str], tmp_path: Path
) -> None:
    """From the command line to the last line that it prints."""
    words = ["stemwatch", *(str(one_valve) if word == "export" else word for word in arguments)]
    code = (
        f"import sys; sys.argv = {words!r}\n"
        "from stemwatch.service.cli import main\n"
        "try:\n    main()\nfinally:\n    assert 'torch' not in sys.modules\n"
    )
    assert run(code, cwd=tmp_path)


def test_the_front_door_loads_no_networks_and_no_service(one_valve: Path) -> None:
    """``import stemwatch`` loads not even numpy; reading, screening without networks, showing and
    simulating load no torch, web or database library."""
    code = (
        "import sys, stemwatch as sw\n"
        "assert 'numpy' not in sys.modules\n"
        f"read = sw.read({str(one_valve)!r}, op='FIC-104.OP', mv='FIC-104.ZT')\n"
        "sw.simulate(minutes=1)\n"
        "found = sw.screen(read, narx=False, mismatch=False)\n"
        "found._repr_html_(), found.to_dict()\n"
        "print([n for n in ('torch', 'fastapi', 'sqlalchemy', 'matplotlib') if n in sys.modules])"
    )
    assert run(code) == "[]\n"
