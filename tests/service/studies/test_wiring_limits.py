"""The limits of the wiring checks, beside recordings whose tags and ranges are right."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from stemwatch.models.record_checks import pv_answers, validity_checks, wiring_checks
from stemwatch.models.signals import signal_pairing
from stemwatch.models.stickslip import stored_range
from stemwatch.service.studies.miswiring import AS_IT_IS, draw_miswired
from stemwatch.service.studies.wiring_limits import (
    SWAPPED,
    WiringShown,
    shown_by_valve,
    wiring_limits,
)

CONSTANTS = {
    "a copy: share": signal_pairing.COPIED_SHARE,
    "samples exchanged: neighbours": signal_pairing.EXCHANGED,
    "moves as fast as OP says: explained": signal_pairing.SUMMED,
    "moves as fast as OP says: towards OP, least": signal_pairing.TOWARDS_COMMAND[0],
    "moves as fast as OP says: towards OP, most": signal_pairing.TOWARDS_COMMAND[1],
    "moves alone: share of its way": validity_checks.MOVED_WITHOUT_OP,
    "turns round alone: share of its way": validity_checks.TURNED_AT_THE_END,
    "PV does not answer it: OP alone tells": pv_answers.OP_ALONE,
    "PV does not answer it: evident": pv_answers.EVIDENT,
    "PV does not answer it: S": pv_answers.STICKS_PERCENT,
    "does not go with OP: correlation": validity_checks.UNRELATED,
    "stored in another range: off OP": stored_range.OFF_PERCENT,
    "stored in another range: next range": stored_range.WORSE_PERCENT,
    "OP and position exchanged: left as mapped": wiring_checks.DOUBTED,
    "OP and position exchanged: left exchanged": wiring_checks.SURELY_SWAPPED,
    "OP and position exchanged: S either way": wiring_checks.STICKS_PERCENT,
    "another tag: left as mapped": wiring_checks.DOUBTED,
    "another tag: left by another": wiring_checks.BY_ANOTHER,
    "another time: left as mapped": wiring_checks.DOUBTED,
    "another time: left, of that now": wiring_checks.ANOTHER_TIME,
    "another time: left then": wiring_checks.RELATED,
    "plainly another time: left as mapped": wiring_checks.FOLLOWS_ENOUGH,
    "plainly another time: left then, of that now": wiring_checks.PLAINLY_ANOTHER_TIME,
    "unexplained: left as mapped": wiring_checks.UNRELATED_LEFT,
}
FILE = Path(__file__).parents[3] / "docs" / "figures" / "wiring-limits.json"


@pytest.fixture(scope="module")
def kept() -> dict:
    """What the command wrote on its default draw."""
    return json.loads(FILE.read_text(encoding="utf-8"))


def test_the_limits_of_the_file_are_those_of_the_product(kept) -> None:
    """Each row has the constant that is used."""
    assert {row["name"]: row["limit"] for row in kept["limits"]} == CONSTANTS


def test_no_recording_that_is_right_lies_beyond_all_limits_of_a_check(kept) -> None:
    """Nor would it if a limit lay where it is needed; and each check finds what it is there for."""
    for row in kept["limits"]:
        assert row["nulls_beyond"] == 0, row["name"]
        assert row["beyond"] > 0, row["name"]
        if row["needed"] is not None:
            beyond = row["limit"] - row["needed"] if row["above"] else row["needed"] - row["limit"]
            assert beyond > 0.0, row["name"]


def test_the_rows_of_the_file_follow_from_its_recordings(kept) -> None:
    """Counted again from what each recording shows."""
    nan = float("nan")
    seen = [
        WiringShown(**{name: nan if value is None else value for name, value in row.items()})
        for row in kept["recordings"]
    ]
    counted = [
        (row.name, row.nulls, row.nulls_beyond, row.beyond, row.of) for row in wiring_limits(seen)
    ]
    names = ("name", "nulls", "nulls_beyond", "beyond", "of")
    assert counted == [tuple(row[name] for name in names) for row in kept["limits"]]


def test_the_page_has_the_limits_of_the_file(kept) -> None:
    """Each limit with where it lies and how near the nulls come."""
    page = (FILE.parents[1] / "miswiring.md").read_text(encoding="utf-8")
    for row in kept["limits"]:
        side = "at least" if row["above"] else "at most"
        worst = "-" if row["worst"] is None else f"{row['worst']:.3g}"
        assert f"| {row['name']} | {side} {row['limit']:g} | {worst} |" in page, row["name"]


@pytest.mark.long
def test_the_file_is_what_the_command_writes(kept) -> None:
    """The first valve of the draw, in all ways."""
    (valve, *_) = draw_miswired(kept["valves"], kept["seed"])
    found = shown_by_valve(valve)
    for one, written in zip(found, kept["recordings"], strict=False):
        assert one.way == written["way"]
        assert one.moved_alone == pytest.approx(written["moved_alone"], rel=1e-2, abs=1e-3)
        if written["left"] is not None:
            assert one.left == pytest.approx(written["left"], rel=1e-2, abs=1e-3)


def test_a_null_beyond_all_limits_of_a_check_is_counted() -> None:
    """Of three rightly wired valves that are simpler exchanged, one hardly sticks and one rests as
    a stem does; where OP and position are exchanged one of two is found."""
    plain = dict.fromkeys(WiringShown.__dataclass_fields__, 0.5) | {
        "told": False,
        "of_position": False,
        "op_plainly": False,
        "sticks": 4.0,
        "exchanged": 0.3,
    }
    right = WiringShown(**plain | {"way": AS_IT_IS, "rightly": True})
    nulls = [right, replace(right, sticks=1.0), replace(right, of_position=True)]
    wrong = replace(right, way=SWAPPED, rightly=False)
    seen = [*nulls, wrong, replace(wrong, exchanged=0.7)]
    by_name = {limit.name: limit for limit in wiring_limits(seen)}
    found = by_name["OP and position exchanged: left exchanged"]
    assert (found.nulls, found.nulls_beyond, found.worst, found.holds) == (1, 1, 0.3, False)
    assert (found.beyond, found.of, found.all_nulls) == (1, 2, 3)
    sticks = by_name["OP and position exchanged: S either way"]
    assert (sticks.nulls, sticks.worst) == (2, 4.0)
    assert asdict(sticks)["limit"] == wiring_checks.STICKS_PERCENT
