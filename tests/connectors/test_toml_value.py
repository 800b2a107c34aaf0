"""What is written into a plant file is read back as it was."""

from __future__ import annotations

import tomllib

from hypothesis import example, given
from hypothesis import strategies as st

from stemwatch.connectors.settings import toml_value

TEXTS = st.text(st.characters(exclude_categories=["Cs"]))
VALUES = TEXTS | st.booleans() | st.integers(-(2**63), 2**63 - 1)


@given(VALUES | st.lists(VALUES))
@example("FIC\x7f101")
@example('C:\\exports\\"new"\r\n\t')
def test_what_was_written_is_read_back(value: object) -> None:
    """Texts of any signs, numbers, truth values, and lists of them."""
    assert tomllib.loads(f"value = {toml_value(value)}")["value"] == value


def test_tuples_are_lists() -> None:
    """TOML has no other sequence."""
    assert toml_value(("a", "b")) == '["a", "b"]'
