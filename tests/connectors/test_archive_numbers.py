"""What connectors to archives share: quality of numbers, and secrets that are shown nowhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.connectors.archive.number_column import Codes, number_column
from stemwatch.connectors.connector import ConnectorError, UnreadableSource
from stemwatch.connectors.secret import Secret, masked
from stemwatch.models.recording import Quality


def column(values, codes: Codes | None = None, **more):
    """A column of one value a second."""
    array = np.array(values, dtype=np.float64)
    ns = np.arange(array.size, dtype=np.int64) * 1_000_000_000
    ok = np.ones(array.size, dtype=bool)
    return number_column("A.OP", ns, ok, array, source_name="archive", codes=codes, **more)


def coded(*codes: str, good: tuple[str, ...] = ()) -> Codes:
    """One code for each sample."""
    words = list(dict.fromkeys(codes))
    return Codes(words=words, index=np.array([words.index(code) for code in codes]), good=good)


def test_a_missing_value_is_missing_or_bad_by_its_code() -> None:
    """It leaves no sample, or a bad one where its code says so; infinity is bad."""
    result = column([1.0, np.nan, np.nan, np.inf], coded("Good", "Good", "Bad", "Good"))
    assert result.quality.tolist() == [Quality.GOOD, Quality.BAD, Quality.BAD]
    assert (result.ns // 1_000_000_000).tolist() == [0, 2, 3]
    assert result.reasons == {"infinite": 1, "quality Bad": 1}


def test_opc_codes_from_192_up_are_good_unless_the_user_says_otherwise() -> None:
    """192 and above are good; what a person says is good goes before it."""
    codes = ("192", "216", "0", "64")
    assert column([1.0] * 4, coded(*codes)).quality.tolist() == [0, 0, 2, 2]
    assert column([1.0] * 4, coded(*codes, good=("0",))).quality.tolist() == [2, 2, 0, 2]


def test_codes_that_nothing_settles_are_refused() -> None:
    """0 is good in one system and bad in another: it is asked, not guessed."""
    with pytest.raises(UnreadableSource, match="holds the codes 0, 1; 0 means good in one"):
        column([1.0, 2.0], coded("0", "1"))


def test_a_mode_other_than_0_and_1_is_a_code() -> None:
    """1 is automatic and 0 manual; another number is a code."""
    assert column([1.0, 0.0, 4.0], as_mode=True).quality.tolist() == [0, 0, Quality.CODE]


PASSWORDS = st.text(
    min_size=1, alphabet=st.characters(exclude_characters="@", exclude_categories=("Z", "C"))
)


@given(PASSWORDS)
def test_no_password_of_a_url_is_left(password: str) -> None:
    """Whatever the password is made of."""
    result = masked(f"postgresql://reader:{password}@host/db")
    assert result == "postgresql://reader:***@host/db"


def test_a_secret_is_read_from_text_variable_or_file(tmp_path: Path, monkeypatch) -> None:
    """Given, in the environment, or in a file; where it is not there the place is named."""
    monkeypatch.setenv("STEMWATCH_TEST_SECRET", "geheim")
    (tmp_path / "secret").write_text("geheim\n", encoding="utf-8")
    places = (
        Secret(text="geheim"),
        Secret(variable="STEMWATCH_TEST_SECRET"),
        Secret(file=str(tmp_path / "secret")),
    )
    for secret in places:
        assert secret.reveal() == "geheim"
        assert "geheim" not in f"{secret} {secret!r}"
    assert not Secret()
    with pytest.raises(ConnectorError, match=r"secret file .*gone cannot be read"):
        Secret(file=str(tmp_path / "gone")).reveal()
