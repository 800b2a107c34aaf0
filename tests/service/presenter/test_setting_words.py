"""What limits and alert rules mean is said on the page Settings as in the docs."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

from stemwatch.models.limits import Limits
from stemwatch.service.config.service_schema import AlertRules
from stemwatch.service.presenter.setting_words import LIMIT_WORDS, RULE_WORDS

PLANT_FILE = Path(__file__).parents[3] / "docs" / "plant-file.md"


def test_every_limit_and_rule_is_explained_in_the_words_of_the_docs() -> None:
    """Each key has its words, and the row of docs/plant-file.md says the same."""
    assert list(LIMIT_WORDS) == [limit.name for limit in fields(Limits)]
    assert list(RULE_WORDS) == list(AlertRules.model_fields)
    text = re.sub(r"\*(\w+)\*", r"\1", PLANT_FILE.read_text("utf-8"))
    rows = dict(re.findall(r"^\| `(\w+)` \|(?: [\d.]+ \|)? (.+) \|$", text, re.MULTILINE))
    for key, words in (LIMIT_WORDS | RULE_WORDS).items():
        assert rows[key].replace("`", "").startswith(words), key
