"""Finds sticking control valves in plant-historian data.

    import stemwatch as sw

    found = sw.screen(frame, op="FIC101.OP", mv="ZT101")    a DataFrame with a time index
    work = sw.screen("exports/")                            every valve of every file
    work.to_frame()                                         the most urgent first

``read`` gives one valve's ``Recording``, ``screen`` the verdict with S and J, ``explain`` what S
and J leave out, ``twin`` the loop to be run again as it might be, ``plan_test`` the field test that
tells what was left open, ``simulate`` a recording with known S and J. These names are promised;
what stands in the packages below may change with any version. ``stemwatch.service``,
``stemwatch.connectors`` and ``stemwatch.models`` are described in docs/architecture.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stemwatch.functions import explain as explain
    from stemwatch.functions import plan_test as plan_test
    from stemwatch.functions import read as read
    from stemwatch.functions import screen as screen
    from stemwatch.functions import simulate as simulate
    from stemwatch.functions import twin as twin
    from stemwatch.models.recording import Recording as Recording

    __version__: str

# The module of each name, imported on first use.
_PLACES = {
    "Recording": "stemwatch.models.recording",
    "explain": "stemwatch.functions",
    "plan_test": "stemwatch.functions",
    "read": "stemwatch.functions",
    "screen": "stemwatch.functions",
    "simulate": "stemwatch.functions",
    "twin": "stemwatch.functions",
}
__all__ = [
    "Recording",
    "__version__",
    "explain",
    "plan_test",
    "read",
    "screen",
    "simulate",
    "twin",
]


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name == "__version__":
        from importlib.metadata import version

        return version("stemwatch")
    if name not in _PLACES:
        raise AttributeError(f"module 'stemwatch' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
