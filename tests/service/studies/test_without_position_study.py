"""Training and judging the answers for valves without a position."""

from __future__ import annotations

from io import StringIO

import numpy as np
import pytest
from rich.console import Console
from rich.table import Table

from stemwatch.models.without_position.suspicion import Suspicion, trained_judge
from stemwatch.service.cli.study_without_position import _tables
from stemwatch.service.executors import InProcess
from stemwatch.service.studies.without_position.count import (
    FamilyRow,
    StudiedLoop,
    family_rows,
    run_study,
)
from stemwatch.service.studies.without_position.draw import FAMILIES, look_item
from stemwatch.service.studies.without_position.several_recordings import (
    RecordedLoop,
    in_order_rows,
)
from stemwatch.service.studies.without_position.training import (
    items_of_training,
    limits_of,
    run_training,
)
from tests.service.report.test_without_position import no_sign, suspected


@pytest.fixture(scope="module")
def trained():
    """Networks of few loops: quick, and good for little."""
    answer: list[int] = []
    training = run_training(60, 5151, InProcess(), answer.append)
    assert answer[-1] == sum(map(len, items_of_training(60, 5151)))
    return training


@pytest.mark.long
def test_training_again_gives_the_same(trained) -> None:
    """One seed, one result."""
    repeated = run_training(60, 5151, InProcess(), lambda _: None)
    assert repeated.limits == trained.limits
    for name, array in repeated.network.arrays.items():
        assert np.array_equal(array, trained.network.arrays[name]), name


@pytest.mark.long
def test_the_limits_come_from_their_loops(trained) -> None:
    """The same loops give the same limits, and by too few sticking ones nothing is no sign."""
    assert 0.0 <= trained.limits.suspected_from <= 1.0
    seen = [draw for item in items_of_training(60, 5151)[1] for draw in look_item(item)]
    assert limits_of(seen, trained.network) == trained.limits
    sticking = [draw for draw in seen if draw.S > 0.0]
    named = limits_of(sticking[:3] + [draw for draw in seen if draw.S <= 0.0], trained.network)
    assert named.no_sign.shows_from(0.0, 20.0, 1.0) is None


@pytest.mark.long
def test_every_family_is_asked_and_counted(trained) -> None:
    """Every loop once, in one of three answers."""
    answers = run_study(trained, 4, 5151, InProcess(), lambda _: None)
    rows = [row for row in family_rows(answers) if "swings" not in row.family]
    assert [row.family for row in rows] == list(FAMILIES)
    for row in rows:
        assert (row.sticking, row.sound) == (2, 2)
        counts = np.array([row.suspected, row.no_sign, row.cannot_tell])
        assert counts.sum(axis=0).tolist() == [2, 2]


def test_the_row_of_a_family_counts_what_was_said() -> None:
    """On answers made by hand: areas, alarms, errors and intervals."""

    def answer(
        S: float,
        score: float | None,
        numbers=None,
        swings=5.0,
        alarm: float | None = None,
        shows=None,
    ) -> StudiedLoop:
        verdict = Suspicion.CANNOT_TELL if score is None else Suspicion.NO_SIGN
        verdict = Suspicion.SUSPECTED if numbers else verdict
        return StudiedLoop(
            family="own",
            story="",
            S=S,
            swings=swings,
            verdict=verdict,
            score=score,
            apparent_S=numbers,
            shows_from=shows,
            alarm=(score or 0.0) if alarm is None else alarm,
        )

    answers = [
        answer(3.0, 0.9, (3.5, 2.5, 4.5)),
        answer(5.0, 0.8, (4.0, 3.5, 4.5)),
        answer(2.0, 0.1),
        answer(0.0, 0.7, (1.0, 0.5, 1.5)),
        answer(0.0, None),
    ]
    (row,) = family_rows(answers)
    assert (row.suspected, row.no_sign, row.cannot_tell) == ((2, 1), (1, 0), (0, 1))
    assert row.auc == pytest.approx(5 / 6)
    assert row.error == pytest.approx(0.75)
    assert row.held == (1, 2)
    assert row.missed == 0
    named = [answer(2.0, 0.1, shows=1.9), answer(2.0, 0.1, shows=2.1), answer(0.0, 0.1, shows=1.0)]
    assert next(family_rows(answers + named)).missed == 1
    longer = [answer(4.0, 0.9, (3.5, 2.5, 4.5), swings=8.0), answer(0.0, 0.2, swings=30.0)]
    (_, row) = family_rows(answers + longer)
    assert row.family == "own, 8 swings and more"
    assert (row.sticking, row.sound, row.auc) == (1, 1, 1.0)
    # The sound loop that no limit lets be suspected is no false alarm.
    small = [answer(3.0, 0.8), answer(0.0, 0.9, alarm=0.0), answer(2.0, 0.9, alarm=0.0)]
    (row,) = family_rows(small)
    assert (row.sensitivity, row.found) == ((0.0, 0.0), (0.5, 0.5))


def test_the_tables_of_the_study_fit_into_eighty_columns() -> None:
    """No count is cut off, and each family has its row in both."""
    counts = {"suspected": (193, 107), "no_sign": (159, 233), "cannot_tell": (108, 120)}
    row = FamilyRow(
        family="plant, 8 swings and more",
        sticking=360,
        sound=360,
        **counts,
        missed=125,
        auc=0.86,
        sensitivity=(0.5, 0.6),
        found=(0.56, 0.63),
        error=0.41,
        held=(185, 193),
    )
    said, measured = (printed(table) for table in _tables(5151, [row]))
    for text in ("360 + 360", "193 + 107", "159 + 233", "125", "108 + 120"):
        assert text in said
    assert "0.86    0.50, 0.60        0.56, 0.63 0.41 % 185 of 193" in measured
    assert "plant, 8 swings and more" in measured


def printed(table: Table) -> str:
    """A table as a terminal of eighty columns shows it."""
    shown = StringIO()
    Console(width=80, file=shown).print(table)
    return shown.getvalue()


def test_recordings_in_a_row_are_counted_as_the_service_counts_them() -> None:
    """A sound loop that looked like sticking once is suspected at some time by the newest alone and
    not by the last ones together; a sticking one whose last recording shows nothing is."""
    sticking = RecordedLoop(
        sticky=True, answers=(suspected(0.95), suspected(0.95), suspected(0.95), no_sign())
    )
    limit = trained_judge().limits.suspected_from
    sound = RecordedLoop(sticky=False, answers=(no_sign(), no_sign(), suspected(limit), no_sign()))
    alone, together = in_order_rows([sticking, sound])
    assert (alone.at_the_end, alone.at_some_time) == ((0, 0), (1, 1))
    assert (together.at_the_end, together.at_some_time) == ((1, 0), (1, 0))
