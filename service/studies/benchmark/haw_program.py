"""Runs HAW's Stiction-Analyser on recordings; a program for the Python that has it installed.

    MPLBACKEND=Agg python haw_program.py FOLDER CASE...    prints the cycles of each case, JSON

It imports the package ``stictionanalyser`` as it was installed (Apache-2.0; PyPI) and hands over OP
and the error SP - PV. What is put in place of its user interface and of the Seeq server draws and
calculates nothing. Nothing of stemwatch is imported here: the package needs older libraries.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import io
import json
import sys
import types
import warnings
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

PACKAGE = "seeq.addons.stictionanalyser"
INTERFACE = ("ipyvuetify", "ipyvuetify.generated", "ipyvuetify.generated.Row", "ipywidgets",
             "seeq.spy", "IPython", "IPython.display")  # fmt: skip


def analyser() -> Any:
    """The function of the package that analyses a frame with OP and Error."""
    places = [
        str(path) for path in (Path(p, *PACKAGE.split(".")) for p in sys.path) if path.is_dir()
    ]
    if not places:
        raise SystemExit("the package stictionanalyser is not installed here")
    for name in INTERFACE:
        sys.modules[name] = MagicMock()
    parent = ""
    for part in PACKAGE.split("."):
        parent = f"{parent}.{part}".lstrip(".")
        module = types.ModuleType(parent)
        module.__path__ = places if parent == PACKAGE else []
        sys.modules[parent] = module
    sys.modules["seeq"].spy = sys.modules["seeq.spy"]  # type: ignore[attr-defined]
    execute = importlib.import_module(f"{PACKAGE}._ExecutePullSignal").ExecutePullSignal
    for name in INTERFACE:  # matplotlib asks whether IPython is loaded
        del sys.modules[name]
    return execute


def cycles(execute: Any, file: Path) -> list[str]:
    """ "sticking / all" for each oscillation that the package finds."""
    import pandas as pd

    recording = pd.read_csv(file, skiprows=[1], index_col=0, parse_dates=True, na_values="Bad")
    frame = pd.DataFrame(
        {"OP": recording["OP"], "Error": recording["SP"] - recording["PV"]}
    ).interpolate(limit_direction="both")
    stiction, _ = execute(frame)
    return [str(word) for word in stiction[4::5]]


def main(folder: str, *cases: str) -> None:
    """Every case by itself: what the package raises on one costs the others nothing."""
    warnings.simplefilter("ignore")
    execute = analyser()
    answers: dict[str, dict[str, Any]] = {}
    for case in cases:
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                answers[case] = {"cycles": cycles(execute, Path(folder, f"{case}.csv"))}
        except Exception as error:
            answers[case] = {"error": f"{type(error).__name__}: {error}"}
    print(json.dumps(answers))


if __name__ == "__main__":
    main(*sys.argv[1:])
