"""What a blind trial counts over its cases: groups, targets, errors of S and J, tables."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stemwatch.service.cli.prove_tables import figures_lines, tables
from stemwatch.service.studies.proof.answers import BlindAnswer, NamedEffect, StictionNumbers
from stemwatch.service.studies.proof.figures import heldout, seconds, stiction_errors
from stemwatch.service.studies.proof.marks import CaseMark, mark
from stemwatch.service.studies.proof.rates import (
    as_json,
    by_concealment,
    by_effect,
    confusions,
    headline,
    record_rates,
)
from stemwatch.service.studies.proof.truth import CaseTruth, seal


def marked(hidden=(), named=(), **changes) -> CaseMark:
    """One case: what was hidden, what was named; other fields of truth or answer as given."""
    truth = CaseTruth(
        file="FIC-0001.csv",
        hidden=tuple(hidden),
        effects=tuple(hidden),
        record_effects=(),
        concealment="routine",
        excited=True,
        S=5.0,
        J=2.0,
        scatter=0.05,
        samples=3600,
    )
    names = tuple(NamedEffect(slug=slug, members=(slug,)) for slug in named)
    answer = BlindAnswer(
        file=truth.file, verdict="named" if named else "none", names=names, seconds=0.5
    )
    ours = {name: value for name, value in changes.items() if hasattr(truth, name)}
    theirs = {name: value for name, value in changes.items() if name not in ours}
    return mark(replace(truth, **ours), replace(answer, **theirs))


def rate(marks, group: str, name: str):
    """The rate of that group and name."""
    (result,) = [item for item in headline(marks) if (item.group, item.name) == (group, name)]
    return result


def test_rates_of_single_effects_count_what_was_excited_and_routine() -> None:
    """Hard records, unexcited effects, pairs and nulls do not enter the first rates."""
    marks = [
        marked(["dead_time"], ["dead_time"]),
        marked(["dead_time"], ["lost_motion"], concealment="noisy"),
        marked(["dead_time"], [], concealment="rich"),
        marked(["dead_time"], [], concealment="quiet"),
        marked(["dead_time"], ["zero_shift"], excited=False),
        marked(["dead_time", "lost_motion"], ["zero_shift"]),
        marked([], ["zero_shift"]),
    ]
    group = "one effect, 1 h, moving"
    right, named = rate(marks, group, "right by class"), rate(marks, group, "right when named")
    assert (1, 3) == (right.hits, right.of)
    assert (1, 2) == (named.hits, named.of)
    assert right.reached is False
    assert (0, 1) == (rate(marks, "one effect, quiet", "right by class").hits, 1)


def test_a_further_wrong_name_spoils_every_name_right() -> None:
    """The first name is right, but not all names are; both rates are told."""
    marks = [marked(["dead_time"], ["dead_time", "zero_shift"])]
    group = "one effect, 1 h, moving"
    assert 1 == rate(marks, group, "right when named").hits
    assert 0 == rate(marks, group, "every name right").hits


def test_nulls_are_counted_by_their_scatter() -> None:
    """Nulls of wide breakaway scatter have a limit of their own."""
    marks = [marked([], [])] * 39 + [marked([], ["dead_time"])]
    marks += [marked([], ["dead_time"], scatter=0.12)]
    usual = rate(marks, "nothing hidden, scatter to 8 %", "false alarm")
    wide = rate(marks, "nothing hidden, scatter over 8 %", "false alarm")
    assert (1, 40, True) == (usual.hits, usual.of, usual.reached)
    assert (1, 1, False) == (wide.hits, wide.of, wide.reached)


def test_a_group_without_cases_is_neither_reached_nor_short() -> None:
    """Nothing is claimed of what was not drawn."""
    pairs = rate([marked([], [])], "two effects, 1 h, moving", "both by class")
    assert pairs.share is None
    assert pairs.reached is None
    assert (0.0, 1.0) == pairs.interval


def test_an_unexcited_effect_may_be_left_unnamed() -> None:
    """Silence is right there, a wrong name is wrong, and "not testable" is counted."""
    marks = [
        marked(["travel_stop"], [], excited=False, not_testable=("travel_stop",)),
        marked(["travel_stop"], [], excited=False),
        marked(["travel_stop"], ["flow_force"], excited=False),
    ]
    counts = [rate(marks, "not excited", name).hits for name in (
        "silent or right", "a wrong name", "said to be not testable"
    )]  # fmt: skip
    assert [2, 1, 1] == counts


def test_what_is_outside_the_catalogue_is_caught_or_misnamed() -> None:
    """Said to be unknown is right, any name is wrong, silence is neither."""
    marks = [
        marked(["unknown"], [], verdict="unknown"),
        marked(["unknown"], []),
        marked(["unknown"], ["dead_time"]),
    ]
    assert 1 == rate(marks, "outside the catalogue", "caught as unknown").hits
    assert 1 == rate(marks, "outside the catalogue", "misnamed").hits


def test_a_judge_that_breaks_down_is_not_taken_for_a_cautious_one() -> None:
    """Cases without a verdict are counted, and their reasons are printed."""
    marks = [marked([], [], verdict="not_testable", reason="the search broke down"), marked()]
    assert (1, 2) == (
        rate(marks, "every case", "no verdict at all").hits,
        rate(marks, "every case", "no verdict at all").of,
    )
    assert any("on 1: the search broke down" in line for line in figures_lines(marks))


def test_record_effects_are_found_or_claimed() -> None:
    """Found where they are, and counted apart where they are not."""
    marks = [
        marked([], [], record_effects=("frozen_signal",)),
        marked([], []),
    ]
    marks[0] = replace(marks[0], answer=replace(marks[0].answer, record_effects=("frozen_signal",)))
    marks[1] = replace(marks[1], answer=replace(marks[1].answer, record_effects=("quantisation",)))
    rates = {
        (record_rate.group, record_rate.name): (record_rate.hits, record_rate.of)
        for record_rate in record_rates(marks)
    }
    assert (1, 1) == rates["frozen_signal", "found"]
    assert (1, 2) == rates["quantisation", "claimed in error"]
    assert (0, 0) == rates["sampling_jitter", "found"]


def test_effects_and_concealments_have_a_row_each() -> None:
    """Exact ones count as right by class too; unexcited ones stand apart."""
    marks = [
        marked(["dead_time"], ["dead_time"]),
        marked(["dead_time"], ["lost_motion"], concealment="short"),
        marked(["dead_time"], [], excited=False),
        marked(["lost_motion"], []),
    ]
    rows = {row.group: row for row in by_effect(marks)}
    late = rows["dead_time"]
    assert (2, 1, 1, 1, 0, 1) == (
        late.of, late.exact, late.by_class, late.wrong, late.missed, late.unexcited
    )  # fmt: skip
    assert 1 == rows["lost_motion"].missed
    assert {"routine": 2, "short": 1} == {row.group: row.of for row in by_concealment(marks)}


def test_confusions_do_not_depend_on_the_order_of_a_pair() -> None:
    """Both of a pair named, the stronger first or second, is one and the same answer."""
    marks = [
        marked(["lost_motion", "dead_time"], ["dead_time", "lost_motion"]),
        marked(["dead_time", "lost_motion"], ["lost_motion", "dead_time"]),
        marked(["dead_time"], ["lost_motion"]),
    ]
    pair = "dead_time + lost_motion"
    assert [("dead_time", "lost_motion", 1), (pair, pair, 2)] == confusions(marks)


def biased(naive: float, restated: float | None) -> CaseMark:
    """A hidden dead time whose S of 5 % reads ``naive``, and ``restated`` with it accounted for."""
    return marked(
        ["dead_time"],
        ["dead_time"],
        naive=StictionNumbers(S=naive),
        restated=StictionNumbers(S=restated),
    )


def test_errors_of_s_count_only_where_the_naive_one_is_off() -> None:
    """A naive value within 0.3 % of the truth is not biased; J without numbers has no row."""
    (result,) = stiction_errors([biased(9.0, 5.5), biased(7.0, 5.1), biased(5.2, 8.0)])
    assert ("S", 2) == (result.name, result.of)
    assert (3.0, 0.3) == pytest.approx((result.naive, result.restated))
    assert result.reached


def test_a_restated_number_that_is_withheld_is_no_gain() -> None:
    """Where S is not restated, its error is the naive one."""
    (result,) = stiction_errors([biased(9.0, None)])
    assert pytest.approx(1.0) == result.ratio
    assert not result.reached


def test_heldout_fits_are_medians_over_what_was_hidden() -> None:
    """Nulls and cases without all four numbers take no part."""
    fits = {"fit_naive": 40.0, "fit_extended": 80.0, "rmse_naive": 2.0, "rmse_extended": 0.5}
    marks = [
        marked(["dead_time"], ["dead_time"], **fits),
        marked(["dead_time"], [], **(fits | {"fit_extended": None})),
        marked([], [], **(fits | {"fit_naive": 99.0})),
    ]
    result = heldout(marks)
    assert (1, 40.0, 80.0) == (result.of, result.fit_naive, result.fit_extended)
    assert heldout(marks[2:]) is None


def test_time_is_that_of_records_of_an_hour() -> None:
    """Short records are quick and would flatter."""
    marks = [marked(seconds=1.5), marked(seconds=0.1, samples=900)]
    result = seconds(marks)
    assert (1, 1.5, False) == (result.of, result.median, result.reached)
    assert seconds(marks[1:]) is None


def test_the_tables_say_what_was_reached_and_what_fell_short(capsys) -> None:
    """Each target stands beside its figure with one plain word."""
    from rich.console import Console

    marks = [marked(["dead_time"], ["dead_time"]), marked([], ["zero_shift"]), biased(9.0, 5.5)]
    console = Console(width=140)
    for table in tables(marks):
        console.print(table)
    for line in figures_lines(marks):
        console.print(line)
    out = capsys.readouterr().out
    for words in (">= 90%", "<= 3%", "reached", "short", "zero_shift", "12% of it", "0.50 s a"):
        assert words in out


def test_the_json_can_be_counted_again() -> None:
    """Every case is in the file with truth, answer and outcome."""
    marks = [marked(["dead_time"], ["dead_time"]), marked([], ["zero_shift"])]
    result = as_json(marks, seal([item.truth for item in marks]), 7)
    assert (7, 2) == (result["seed"], result["cases"])
    assert ["exact", "false alarm"] == [item["outcome"] for item in result["marks"]]
    (alarms,) = [
        item for item in result["rates"] if item["group"] == "nothing hidden, scatter to 8 %"
    ]
    assert (1, 1, 1.0) == (alarms["hits"], alarms["of"], alarms["share"])
