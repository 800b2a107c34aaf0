"""The catalogue of effects that the stiction model leaves out: one file each.

A module ``SLUG.py`` in this folder with a ``TERM`` is a term; adding one touches nothing else.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from stemwatch.models.mismatch.term import Term


@cache
def catalogue() -> dict[str, Term]:
    """All terms by slug, in alphabetical order."""
    names = sorted(module.name for module in pkgutil.iter_modules(__path__))
    terms = {}
    for name in names:
        term = getattr(importlib.import_module(f"{__name__}.{name}"), "TERM", None)
        if term is not None:
            terms[name] = term
    return terms
