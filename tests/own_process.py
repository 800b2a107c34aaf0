"""What a program needs that a test starts, and that imports the tests."""

from __future__ import annotations

import os
from pathlib import Path

import stemwatch

REPOSITORY = Path(__file__).parent.parent


def environment() -> dict[str, str]:
    """Ours, with the package from where this process has it, and the tests, to be found."""
    package = Path(stemwatch.__file__).parent.parent
    more = os.environ.get("PYTHONPATH")
    path = [str(package), str(REPOSITORY), *([more] if more else [])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path)}
