"""docs/models.md against the catalogue: every model is there, in its own words, with its figure."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from stemwatch.models.studies.literature.catalogue import EVERY
from stemwatch.models.studies.literature.physical.published import PUBLISHED

DOCS = Path(__file__).parents[4] / "docs"
PAGE = (DOCS / "models.md").read_text("utf-8")
FLAT = re.sub(r"\s+", " ", PAGE)
every = pytest.mark.parametrize("model", EVERY, ids=lambda m: m.name)


@every
def test_a_model_has_its_section(model):
    """Statement, source and limits stand in the page as the model says them itself."""
    assert f"\n### {model.name}\n" in PAGE
    for words in (model.equation(), model.source, *model.limits):
        assert re.sub(r"\s+", " ", words) in FLAT
    assert [p.name for p in model.parameters if f"`{p.name}`" not in PAGE] == []


@every
def test_a_model_has_its_figure(model):
    """The drawing that the page shows is there, and small."""
    assert f"(figures/model_{model.name}.svg)" in PAGE
    assert 1_000 < (DOCS / "figures" / f"model_{model.name}.svg").stat().st_size < 60_000


@pytest.mark.parametrize("published", PUBLISHED, ids=lambda s: s.name)
def test_the_published_numbers_are_the_documented_ones(published):
    """The levels of each set, as the table has them."""
    packing = published.packing
    for value in (packing.static_n, packing.kinetic_n, packing.viscous_ns_per_m):
        assert f"| {value:,.1f} |".replace(".0 |", " |") in PAGE
