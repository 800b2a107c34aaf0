"""What OP and PV alone say of a valve, in the report: page, order, chart, JSON, tables."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Role
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import NoVerdict, Verdict
from stemwatch.models.without_position.picture import ElementTraces
from stemwatch.models.without_position.suspicion import Suspicion, WithoutPosition
from stemwatch.service.cli import screening_views as views
from stemwatch.service.maintenance.work_list import work_list_of
from stemwatch.service.presenter.suspicion_words import (
    HOW_SURE,
    MOST_NAMED,
    MOVED,
    NO_SIGN_NOTE,
    answers_sentence,
    loops_to_test,
    loops_without_sign,
    next_steps,
    suspected_sentence,
)
from stemwatch.service.report.charts.valve_charts import chart_of
from stemwatch.service.report.charts.window_pictures import (
    WindowPictures,
    pack_pictures,
    unpack_pictures,
    window_pictures,
)
from stemwatch.service.report.html_page import html_bytes
from stemwatch.service.report.json_contract import to_contract
from stemwatch.service.report.ranking import rank_valves
from stemwatch.service.report.spreadsheet_columns import header_and_rows
from tests.service.report.test_oscillation_groups import GROUP


def suspected(score: float = 0.9) -> WithoutPosition:
    """A suspicion."""
    return WithoutPosition(
        verdict=Suspicion.SUSPECTED,
        reason="Sticking is suspected: with a valve that sticks by about 2.5 % of OP.",
        advice="Do a bump test.",
        score=score,
        apparent_S=Estimate(value=2.5, low=1.9, high=3.3, unit="%"),
        rivals=("a PV sensor that sticks",),
    )


def no_sign() -> WithoutPosition:
    """Nothing suspected."""
    return WithoutPosition(
        verdict=Suspicion.NO_SIGN,
        reason="OP and PV show no sign of sticking.",
        advice="Nothing to do at the valve on these grounds.",
        score=0.1,
        apparent_S=Estimate.unknown("there is no sign of sticking", unit="%"),
        shows_from=1.5,
    )


def without_mv(make_screening, valve: str, answer: WithoutPosition) -> Screening:
    """A valve without a verdict of which OP and PV say ``told``."""
    return replace(
        make_screening(valve, Verdict.UNDETERMINED),
        reason="Cannot tell: there is no valve position in this recording.",
        no_verdict=NoVerdict.NO_POSITION,
        without_position=answer,
    )


def page_of(valves, make_context) -> str:
    """The text of the page, spaces as one."""
    context = make_context(valves)
    text = html_bytes(rank_valves(valves, context), context).decode()
    text = re.sub(r"<script.*?</script>|<style.*?</style>|<[^>]+>", " ", text, flags=re.S)
    return re.sub(r"\s+", " ", text.replace("\N{NO-BREAK SPACE}", " "))


def test_a_suspicion_stands_in_the_page_with_its_rivals(make_screening, make_context):
    """Title, reason, rivals and advice; the valve is named over the ranking; no verdict of it."""
    valves = [
        without_mv(make_screening, "FV-1", suspected()),
        without_mv(make_screening, "FV-2", no_sign()),
    ]
    text = page_of(valves, make_context)
    for answer in (
        "By OP and PV alone: sticking suspected",
        suspected().reason,
        "a PV sensor that sticks",
        "Do a bump test.",
        "By OP and PV alone: no sign of sticking",
        suspected_sentence(["FV-1"]),
    ):
        assert answer in text, answer
    assert "None of 2 valves can be judged" in text
    # Before a ranking in which all lines are the same; behind one that says more.
    title = "Valves without a verdict: what OP and PV alone say"
    assert text.index(title) < text.index("Ranking, the most urgent first")
    beside = page_of([*valves, make_screening("FV-3")], make_context)
    assert beside.index(title) > beside.index("Ranking, the most urgent first")
    looks_so = "it looks as if the valve sticks by 2.5 % of OP."
    assert f"1 sticking suspected {looks_so} Do a bump test. FV-1" in text
    shows = "a valve that sticks by 1.5 % of OP or more would have shown in four cases of five."
    nothing = "Nothing to do at the valve on these grounds."
    assert f"1 no sign of sticking {shows} {nothing} FV-2" in text


def test_a_valve_has_one_line_in_the_terminal_where_none_has_a_verdict(
    make_screening, make_context
) -> None:
    """Its other recordings would say the same; beside a verdict each recording has its line."""

    def lines_of(valves: list[Screening]) -> list[str]:
        table = views.summary(rank_valves(valves, make_context(valves)))
        return sorted(str(cell).partition("\n")[0] for cell in table.columns[1].cells)

    valves = [without_mv(make_screening, valve, no_sign()) for valve in ("A", "A", "B")]
    assert lines_of(valves) == ["A", "B"]
    assert lines_of([*valves, make_screening("C")]) == ["A", "A", "B", "C"]


def test_beside_a_position_it_is_a_cross_check(make_screening, make_context):
    """The verdict rests on the position, and the valve is not among those to test first."""
    valve = replace(make_screening("FV-1"), without_position=suspected())
    text = page_of([valve], make_context)
    assert "This is a cross-check: the verdict above rests on the measured position." in text
    assert "deserves a position transmitter" not in text


def test_the_suspected_come_first_of_those_without_a_verdict(make_screening, make_context):
    """By their score, and after every valve that has a verdict for work."""
    valves = [
        without_mv(make_screening, "A", no_sign()),
        without_mv(make_screening, "B", suspected(0.8)),
        without_mv(make_screening, "C", suspected(0.95)),
        make_screening("D"),
    ]
    ranking = rank_valves(valves, make_context(valves))
    assert [valve.screening.valve for valve in ranking] == ["D", "C", "B", "A"]
    assert loops_to_test(ranking.next_steps) == ("C", "B")


def with_suspected_stem(valve: Screening, answer: WithoutPosition) -> Screening:
    """``valve`` without a position, and with a stem that keeps to steps of 2 % of OP."""
    assert valve.recording is not None
    signals = {role: s for role, s in valve.recording.signals.items() if role is not Role.MV}
    recording = replace(valve.recording, signals=signals)
    stem = 2.0 * np.round(recording.op.values / 2.0)
    traces = ElementTraces(stem=stem, linear=stem + 1.0, sticking=stem + 2.0)
    return replace(valve, recording=recording, without_position=replace(answer, traces=traces))


def test_the_chart_shows_the_suspected_stem_between_op_and_pv(make_screening):
    """OP and the stem, PV and what both models make of it, the stem against OP."""
    valve = with_suspected_stem(make_screening("FV-1", Verdict.UNDETERMINED), suspected())
    chart = chart_of(valve)
    labels = [trace["label"] for panel in chart["panels"] for trace in panel["series"]]
    assert "suspected stem" in labels
    assert {"PV by a linear loop", "PV by a sticking valve"} <= set(labels)
    assert chart["loop"]["title"] == "The suspected stem against OP"
    assert "Nobody has measured" in chart["loop"]["says"]
    short = valve.excerpt(5, 25)
    assert short.without_position.traces.stem.size == 20
    assert short.without_samples().without_position.traces is None


def test_the_pictures_of_a_suspicion_outlive_the_samples(make_screening):
    """The stem over time, PV by both models, the stem against OP: kept in some KB, and drawn again
    as they were; where nothing is suspected nothing is kept."""
    valve = with_suspected_stem(make_screening("FV-1", Verdict.UNDETERMINED), suspected())
    pictures = window_pictures(valve)
    kept = pack_pictures(pictures)
    assert 500 < len(kept) < 20_000
    back = unpack_pictures(kept)
    titles = [
        "OP and the suspected stem",
        "PV as both models predict it",
        "The suspected stem against OP",
    ]
    assert [picture.title for picture in back.suspicion] == titles
    stem, pv, _ = back.suspicion
    assert [line.label for line in stem.plot.lines] == ["OP", "suspected stem"]
    assert pv.plot.lines[0].label == "PV, recorded"
    assert re.search(
        r"the linear loop misses PV by [\d.]+ m³/h rms, the sticking valve by", pv.caption
    )
    for drawn, again in zip(pictures.suspicion, back.suspicion, strict=True):
        assert drawn.caption == again.caption
        for line, repeated in zip(drawn.plot.lines, again.plot.lines, strict=True):
            np.testing.assert_allclose(repeated.y, line.y, atol=0.02)
    sound = replace(valve, without_position=no_sign())
    assert window_pictures(sound) == WindowPictures()
    assert pack_pictures(window_pictures(sound)) == b""


def test_the_pictures_are_of_the_piece_that_was_looked_at(make_screening):
    """Of a recording with a hole one piece raises the suspicion: a stretch of the other one would
    show OP and PV without a stem."""
    valve = with_suspected_stem(make_screening("FV-1", Verdict.UNDETERMINED), suspected())
    traces, size = valve.without_position.traces, len(valve.recording)
    unknown = np.arange(size) < size * 3 // 4
    piece = ElementTraces(
        **{name: np.where(unknown, np.nan, line) for name, line in vars(traces).items()}
    )
    shown = replace(valve, without_position=replace(valve.without_position, traces=piece))
    for picture in window_pictures(shown).suspicion:
        for line in picture.plot.lines:
            assert np.isfinite(line.y).mean() > 0.9, (picture.title, line.label)


def test_json_and_tables_say_it_too(make_screening, make_context):
    """As its own object, and as columns beside the finding."""
    valves = [without_mv(make_screening, "FV-1", suspected())]
    without_position = to_contract(valves[0])["without_position"]
    assert without_position["verdict"] == "suspected"
    assert without_position["score"] == 0.9
    assert without_position["apparent_S"]["value"] == 2.5
    assert without_position["rivals"] == ["a PV sensor that sticks"]
    context = make_context(valves)
    columns, rows = header_and_rows(rank_valves(valves, context), context)
    row = dict(zip((column.header for column in columns), next(rows), strict=True))
    assert row["OP and PV alone"] == "suspected"
    assert row["apparent S"] == 2.5
    assert to_contract(make_screening("FV-2"))["without_position"] is None


def test_whom_to_test_first_is_one_sentence():
    """One loop, several, and none."""
    assert suspected_sentence([]) == ""
    assert suspected_sentence(["A"]).startswith("1 loop deserves a position transmitter")
    assert f"a sticking valve: A, B. {HOW_SURE}" in suspected_sentence(["A", "B"])


def test_what_op_and_pv_say_is_counted_before_anything_is_ranked(make_screening, make_context):
    """So that a plant without positions reads what is known of it, in report and terminal."""
    answers = {"A": suspected(), "B": no_sign(), "C": no_sign(), "D": cannot_tell("it is short")}
    valves = [without_mv(make_screening, valve, answer) for valve, answer in answers.items()]
    steps = rank_valves(valves, make_context(valves)).next_steps
    sentence = answers_sentence(steps)
    assert sentence.startswith(
        "What OP and PV alone tell of 4 valves without a verdict, faulty position readings aside: "
        "1 suspected of sticking, 2 without any sign of it, 1 left open. 1 loop deserves a "
        "position transmitter"
    )
    assert answers_sentence([step for step in steps if step.loops == ("D",)]) == (
        "What OP and PV alone tell of one valve without a verdict, faulty position readings aside: "
        "0 suspected of sticking, 0 without any sign of it, 1 left open."
    )
    assert answers_sentence([]) == ""
    assert loops_without_sign(steps) == ("B", "C")
    page = html_bytes(rank_valves(valves, make_context(valves)), make_context(valves)).decode()
    table = page[page.index('id="ranking-table"') :]
    rows = table[: table.index("</table>")].split("<tr ")
    assert sum(NO_SIGN_NOTE in row and "undetermined" in row for row in rows) == 2
    assert "2 without any sign of it" in page


def test_a_loop_that_another_moves_is_first_looked_for_there(make_screening, make_context):
    """It needs no bump test of its own; one without a sign, and the source itself, stay as are."""
    valves = [
        without_mv(make_screening, valve, answer)
        for valve, answer in {
            "FIC-104": suspected(),
            "TIC-2": cannot_tell("the signs are too weak"),
            "<b>LIC": no_sign(),
            "PIC-9": cannot_tell("the signs are too weak"),
        }.items()
    ]
    context = replace(make_context(valves), groups=(GROUP,))
    steps = rank_valves(valves, context).next_steps
    assert [(step.why, step.loops) for step in steps] == [
        ("it looks as if the valve sticks by 2.5 % of OP.", ("FIC-104",)),
        (MOVED, ("TIC-2",)),
        ("the signs are too weak.", ("PIC-9",)),
        (
            "a valve that sticks by 1.5 % of OP or more would have shown in four cases of five.",
            ("<b>LIC",),
        ),
    ]
    assert steps[1].step.startswith("Look at FIC-104 first")


def cannot_tell(reason: str, score: float | None = None) -> WithoutPosition:
    """No answer, for a reason."""
    return WithoutPosition(
        verdict=Suspicion.CANNOT_TELL,
        reason=f"OP and PV cannot tell whether the valve sticks: {reason}.",
        advice="Export longer.",
        score=score,
        apparent_S=Estimate.unknown(reason, unit="%"),
    )


def test_one_suspicion_in_many_recordings_of_a_valve_names_it_not(make_screening, make_context):
    """One of three is chance; two of three are not. Each valve has one next step, and the one that
    has a work order is not said to need nothing."""
    answer = {"A": (suspected(), no_sign(), no_sign()), "B": (suspected(), suspected(), no_sign())}
    valves = [
        without_mv(make_screening, valve, item)
        for valve, several in answer.items()
        for item in several
    ]
    steps = rank_valves(valves, make_context(valves)).next_steps
    assert loops_to_test(steps) == ("B",)
    assert [(step.verdict.value, step.loops) for step in steps] == [
        ("suspected", ("B",)),
        ("cannot_tell", ("A",)),
    ]
    assert "1 of its 3 recordings looks like sticking, and the others do not" in steps[1].why


def test_nothing_is_to_do_only_where_no_recording_leaves_it_open(
    make_screening, make_context
) -> None:
    """The recording that leaves it open makes a work order; the list must not say the contrary."""
    reason = "Cannot tell: there is no valve position in this recording."
    several = [
        replace(without_mv(make_screening, "A", item), reason=reason)
        for item in (no_sign(), no_sign(), cannot_tell("only 126 samples"))
    ]
    (step,) = next_steps(several)
    assert (step.verdict.value, step.why) == ("cannot_tell", "only 126 samples.")
    assert work_list_of(several, make_context(several)).sheets


def test_loops_with_one_reason_have_one_step_whatever_their_numbers(make_screening) -> None:
    """Most loops first, those that look most like sticking at the front of them; long lists are
    cut; a valve with a verdict in one of its recordings needs none."""
    few = [
        without_mv(make_screening, f"F-{k:02}", cannot_tell(f"only {90 + k} samples", k / 100))
        for k in range(MOST_NAMED + 2)
    ]
    others = [
        without_mv(make_screening, "P-1", cannot_tell("PV is not in this recording")),
        without_mv(make_screening, "P-2", cannot_tell("PV is not in this recording")),
        make_screening("P-2"),
    ]
    first, second = next_steps([*others, *few])
    assert first.why == f"only 90 to {90 + MOST_NAMED + 1} samples."
    assert first.loops[:2] == (f"F-{MOST_NAMED + 1:02}", f"F-{MOST_NAMED:02}")
    assert (len(first.named), first.unnamed) == (len(first.loops) - 2, " and 2 more")
    assert (second.why, second.loops) == ("PV is not in this recording.", ("P-1",))
    (alone,) = next_steps(few[5:6])
    assert alone.why == "only 95 samples."
