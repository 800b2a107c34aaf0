"""The benchmark: published facts do not reveal the truth, and guessing gains nothing."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.service.executors import InProcess
from stemwatch.service.studies.benchmark import draw
from stemwatch.service.studies.benchmark.answers import (
    CaseAnswer,
    MalformedAnswers,
    Number,
    Sticks,
    cause_words,
    read_answers,
    write_answers,
)
from stemwatch.service.studies.benchmark.methods import method_named, public_cases, recording_of
from stemwatch.service.studies.benchmark.score import (
    PARTS,
    BenchmarkScore,
    benchmark_score,
    interval_score,
)
from stemwatch.service.studies.benchmark.seal_and_score import judge, write_benchmark
from stemwatch.service.studies.benchmark.truth import ValveTruth

SECRET_SEED = 5151_000_000_017
WORDS = tuple(cause_words())


def truths(count: int = 64, seed: int = 1) -> list[ValveTruth]:
    """Truths as the drawing makes them, without a simulation."""
    rng = np.random.default_rng(seed)
    cases = []
    for place in range(count):
        sticks, position, proof = place % 2 == 0, place // 2 % 2 == 0, place // 4 % 2 == 0
        turn = place // 8
        cause = draw._CAUSES[sticks][turn % 8] if position and proof else ""
        S = float(rng.uniform(2.0, 9.0) if sticks else rng.uniform(0.1, 0.6))
        cases.append(
            ValveTruth(
                case=f"case-{place + 1:04d}",
                position=position,
                S=S,
                J=S * float(rng.uniform(0.1, 0.9)),
                cause=WORDS[1 + place % 20] if cause == "effect" else cause,
            )
        )
    return cases


def same_for_all(cases: list[ValveTruth], answer: CaseAnswer) -> BenchmarkScore:
    """The merit of one answer, given to every case."""
    return benchmark_score(cases, {truth.case: answer for truth in cases})


def true_answer(truth: ValveTruth) -> CaseAnswer:
    """What is true of a case, with intervals of no width."""
    return CaseAnswer(
        stiction=Sticks.YES if truth.sticks else Sticks.NO,
        S=Number(value=truth.S, low=truth.S, high=truth.S),
        J=Number(value=truth.J, low=truth.J, high=truth.J),
        causes=(truth.cause,) if truth.cause else (),
    )


def test_the_truth_has_merit_1_and_silence_0() -> None:
    """Every part of both, and the interval over the draw of cases."""
    cases = truths()
    best = benchmark_score(cases, {truth.case: true_answer(truth) for truth in cases})
    assert [(part.part, part.score) for part in best.parts] == [(name, 1.0) for name in PARTS]
    assert (best.total, best.low, best.high) == (1.0, 1.0, 1.0)
    silent = benchmark_score(cases, {})
    assert [part.score for part in silent.parts] == [0.0] * len(PARTS)
    assert [part.answered for part in silent.parts] == [0] * len(PARTS)
    assert same_for_all(cases, CaseAnswer()) == silent


@pytest.mark.parametrize("word", [Sticks.YES, Sticks.NO])
def test_always_yes_and_always_no_are_worse_than_silence(word: Sticks) -> None:
    """Half of the answers right gains less than the other half costs."""
    always = same_for_all(truths(), CaseAnswer(stiction=word))
    assert [part.score for part in always.parts[:2]] == [-0.5, -0.5]
    assert always.total < 0.0


def test_answers_by_lot_are_worse_than_silence() -> None:
    """Words and numbers drawn by lot, many times, on the average and nearly every time."""
    rng, cases = np.random.default_rng(2), truths()
    merits = []
    for _ in range(40):
        ends = np.sort(rng.uniform(0.0, 10.0, (len(cases), 2, 2)), axis=2)
        answers = {
            truth.case: CaseAnswer(
                stiction=rng.choice([Sticks.YES, Sticks.NO, Sticks.CANNOT_TELL]),
                S=Number(low=ends[k, 0, 0], high=ends[k, 0, 1]),
                J=Number(low=ends[k, 1, 0], high=ends[k, 1, 1]),
                causes=(str(rng.choice(WORDS)),),
            )
            for k, truth in enumerate(cases)
        }
        merits.append(benchmark_score(cases, answers).total)
    assert np.mean(merits) < -0.5
    assert max(merits) < 0.0


PERCENT = st.floats(0.0, 100.0)
INTERVALS = st.tuples(PERCENT, PERCENT).map(lambda ends: Number(low=min(ends), high=max(ends)))
BLIND = st.builds(
    CaseAnswer,
    stiction=st.sampled_from(Sticks),
    S=INTERVALS,
    J=INTERVALS,
    causes=st.lists(st.sampled_from(WORDS), max_size=3, unique=True).map(tuple),
)


@pytest.mark.long
@given(answer=BLIND, seed=st.integers(0, 50), knows=st.booleans())
@example(answer=CaseAnswer(causes=("none",)), seed=0, knows=False)
@example(answer=CaseAnswer(S=Number(low=2.0, high=9.0)), seed=1, knows=True)
@example(answer=CaseAnswer(S=Number(low=0.0, high=100.0)), seed=2, knows=True)  # as wide as can be
@settings(max_examples=25, deadline=None)
def test_adding_a_blind_answer_never_raises_the_expected_score(
    answer: CaseAnswer, seed: int, knows: bool
) -> None:
    """Whoever knows nothing of a case, or all of the others, expects nothing from a guess on it.

    Expected over which case it is, part by part: an answer that does not depend on the case.
    """
    cases = truths(32, seed)
    rest = {truth.case: true_answer(truth) for truth in cases} if knows else {}
    gains = []
    for truth in cases:
        silent = {case: said for case, said in rest.items() if case != truth.case}
        before = benchmark_score(cases, silent).parts
        after = benchmark_score(cases, silent | {truth.case: answer}).parts
        gains.append([b.score - a.score for a, b in zip(before, after, strict=True)])
    assert np.max(np.mean(gains, axis=0)) <= 1e-12


def test_the_interval_score_wants_the_honest_interval() -> None:
    """Of a normal truth, the central 95 % interval beats narrower and wider ones."""
    drawn = np.random.default_rng(3).normal(5.0, 1.0, 20_000)
    scores = {
        half: np.mean([interval_score(5.0 - half, 5.0 + half, x) for x in drawn])
        for half in (1.0, 1.5, 1.96, 2.5, 4.0)
    }
    assert min(scores, key=scores.__getitem__) == 1.96


def test_what_is_written_is_what_is_read(tmp_path: Path) -> None:
    """To the fourth decimal; a spreadsheet's semicolons and decimal commas give the same."""
    cases = truths()
    answers = {truth.case: true_answer(truth) for truth in cases[:8]}
    answers["case-0009"] = CaseAnswer(causes=("dead_time", "actuator_lag"))
    file = tmp_path / "answers.csv"
    write_answers(file, answers)
    read = read_answers(file, {truth.case for truth in cases})
    assert read["case-0009"] == answers["case-0009"]
    assert read["case-0001"].S.value == pytest.approx(cases[0].S, abs=1e-4)
    assert {case: a.stiction for case, a in read.items()} == {
        case: a.stiction for case, a in answers.items()
    }
    german = tmp_path / "german.csv"
    german.write_text("case;stiction;S\ncase-0001;yes;4,25\n", encoding="utf-8-sig")
    assert read_answers(german, {"case-0001"}) == {
        "case-0001": CaseAnswer(stiction=Sticks.YES, S=Number(value=4.25))
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("case,stiktion\n", "line 1: found the column 'stiktion'; .*did you mean 'stiction'"),
        ("stiction\nyes\n", "found no column 'case'"),
        ("", "found no row"),
        ("case,S\ncase-0001,4\ncase-9001,4\n", "line 3: case: found 'case-9001'; .*'case-0001'"),
        ("case,S\ncase-0001,4\n\ncase-0001,5\n", "line 4: case: .*each case once"),
        ("case,S\ncase-0001,4,5\n", "line 2: found 3 cells; expected 2"),
        ("case,S\ncase-0001,about 4\n", "line 2: S: found 'about 4'; expected a number"),
        ("case,S\ncase-0001,nan\n", "line 2: S: found 'nan'"),
        ("case,S\ncase-0001,1_0\n", "line 2: S: found '1_0'"),
        ("case,S\ncase-0001,٣\n", "line 2: S: found '٣'"),
        ("case,S\ncase-0001,1e308\n", "line 2: S: found '1e308'"),
        ("case,S\ncase-0001,-1\n", "line 2: S: found '-1'"),
        ("case,S_low\ncase-0001,4\n", "line 2: S_low: .*both ends"),
        ("case,J_low,J_high\ncase-0001,4,3\n", r"line 2: J_low: found '4.0'; .*at most J_high, 3"),
        ("case,stiction\ncase-0001,maybe\n", "line 2: stiction: found 'maybe'; .*cannot tell"),
        ("case,cause\ncase-0001,dead_tme\n", "line 2: cause: found 'dead_tme'.*'dead_time'"),
        ("case,cause\ncase-0001,none;other;dead_time;zero_shift\n", "at most 3 causes"),
        ('case,cause\ncase-0001,"none\n', "quotation marks in pairs"),
    ],
)
def test_a_malformed_file_is_told_by_line(tmp_path: Path, text: str, message: str) -> None:
    """What was found where, and what was expected."""
    file = tmp_path / "answers.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(MalformedAnswers, match=rf"(?s)answers\.csv.*{message}"):
        read_answers(file, {"case-0001"})


@pytest.fixture
def quick_draw(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, int], draw.DrawnCase]:
    """Valves drawn as usual, their recordings of noise, because simulating takes seconds."""
    drawn_truths = truths(8)

    def drawn(seed: int, place: int) -> draw.DrawnCase:
        rng = np.random.default_rng([seed, place])
        truth = drawn_truths[place]
        roles = [role for role in draw.TAGS if role is not Role.MV or truth.position]
        signals = {role: Signal.good(rng.normal(50.0, 5.0, 300), role.value) for role in roles}
        return draw.DrawnCase(
            recording=Recording(valve="x", signals=signals, interval_s=1.0),
            integrating=False,
            truth=replace(truth, case=""),
        )

    monkeypatch.setattr(draw, "draw_case", drawn)
    return drawn


@pytest.fixture
def benchmark_folder(quick_draw, tmp_path: Path) -> Path:
    """A small benchmark, its truth beside it."""
    folder = tmp_path / "valves"
    write_benchmark(
        folder,
        tmp_path / "valves-truth.json",
        seed=SECRET_SEED,
        cases=8,
        executor=InProcess(),
        on_progress=lambda _: None,
    )
    return folder


def test_what_is_given_away_does_not_tell_the_truth(benchmark_folder: Path) -> None:
    """No seed, no name, no header, no length and no number of digits depends on the truth."""
    given_away = sorted(path.name for path in benchmark_folder.iterdir())
    numbers = [f"case-{number:04d}.csv" for number in range(1, 9)]
    assert given_away == ["README.md", *numbers, "cases.csv"]
    page = (benchmark_folder / "README.md").read_text("utf-8")
    assert str(SECRET_SEED) not in page
    headings, others = set(), set()
    for name in numbers:
        lines = (benchmark_folder / name).read_text("utf-8").splitlines()
        digits = {len(cell.split(".")[1]) for line in lines[2:] for cell in line.split(",")[1:]}
        headings.add(lines[0])
        others.add((lines[2].split(",")[0], len(lines), *digits))
    assert headings == {"Time,OP,MV,PV,SP", "Time,OP,PV,SP"}
    assert len(others) == 1
    stored = json.loads(benchmark_folder.with_name("valves-truth.json").read_text("utf-8"))
    assert stored["seed"] == SECRET_SEED
    order = [truth["S"] for truth in stored["cases"]]
    assert order != [truth.S for truth in truths(8)]  # not the order of the drawing


def test_the_seal_holds_truth_and_recordings(benchmark_folder: Path, tmp_path: Path) -> None:
    """Neither can be changed after the digest was printed."""
    answers, truth = tmp_path / "answers.csv", tmp_path / "valves-truth.json"
    answers.write_text("case\n", encoding="utf-8")
    assert judge(benchmark_folder, answers, truth).total == 0.0
    changed = tmp_path / "changed.json"
    changed.write_text(truth.read_text("utf-8").replace("S", "T", 1), encoding="utf-8")
    with pytest.raises(ValueError, match=r"(?s)SHA-256 is .* nothing was scored"):
        judge(benchmark_folder, answers, changed)
    recording = benchmark_folder / "case-0003.csv"
    recording.write_text(recording.read_text("utf-8").replace("5", "6", 1), encoding="utf-8")
    with pytest.raises(ValueError, match=r"recordings .* nothing was scored"):
        judge(benchmark_folder, answers, truth)


def test_the_same_seed_gives_the_same_set(quick_draw, tmp_path: Path) -> None:
    """Digest and files; another seed gives another digest."""
    digests = [
        write_benchmark(
            tmp_path / name,
            tmp_path / f"{name}.json",
            seed=seed,
            cases=8,
            executor=InProcess(),
            on_progress=lambda _: None,
        )
        for name, seed in (("one", 5151), ("two", 5151), ("three", 6161))
    ]
    assert digests[0] == digests[1] != digests[2]
    for folder, truth, cases, message in (
        ("odd", "odd.json", 12, "multiple of 8"),
        ("new", "new/truth.json", 8, "would lie in the folder"),
        ("new", "one.json", 8, "exists and is not overwritten"),
    ):
        with pytest.raises(ValueError, match=message):
            write_benchmark(
                tmp_path / folder,
                tmp_path / truth,
                seed=5151,
                cases=cases,
                executor=InProcess(),
                on_progress=lambda _: None,
            )
    assert (tmp_path / "one/README.md").read_bytes() == (tmp_path / "two/README.md").read_bytes()


def test_from_write_to_judge_on_the_command_line(
    stemwatch, quick_draw, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is written can be answered and judged; a refusal says what to do."""
    monkeypatch.setattr("stemwatch.service.executors.choose_executor", lambda *_: InProcess())
    folder, out = tmp_path / "set", tmp_path / "he.csv"
    written = stemwatch("benchmark", "write", folder, "--cases", 8)
    assert written.status == 0, written.said
    assert "SHA-256" in written.said
    assert stemwatch("benchmark", "answer", folder, "--method", "he", "--out", out).status == 0
    silent = tmp_path / "silent.csv"
    silent.write_text("case,stiction\n", encoding="utf-8")
    found = tmp_path / "judged.json"
    judged = stemwatch("benchmark", "judge", folder, out, silent, "--json", found)
    assert judged.status == 0, judged.said
    assert "silent" in judged.out
    assert json.loads(found.read_text("utf-8"))[str(silent)]["total"] == 0.0

    again = stemwatch("benchmark", "write", folder, "--cases", 8)
    assert again.status == 2
    assert "is not empty" in again.said
    other = stemwatch("benchmark", "judge", folder, out, "--truth", silent)
    assert other.status == 2
    assert "nothing was scored" in other.said
    unknown = stemwatch("benchmark", "answer", folder, "--method", "hes", "--out", out)
    assert "expected one of stemwatch, horch, he, haw" in unknown.said
    nowhere = stemwatch("benchmark", "answer", tmp_path, "--out", out)
    assert "cases.csv" in nowhere.said


FAKE_PACKAGE = """
from ipyvuetify.generated.Row import Row
from seeq import spy

def ExecutePullSignal(df):
    assert list(df.columns) == ["OP", "Error"] and not df.isna().any().any()
    print("noise that is no answer")
    return ["Oscillation 1", "a", "b", 0.1, "9 / 10", "Oscillation 2", "a", "b", 0.1, "0 / 10"], []
"""


def test_an_installed_program_of_others_answers_through_its_own_code(
    benchmark_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """HAW's package is imported as installed, without its user interface; here one that stands
    for it. Where it is not installed, the message says what to do."""
    cases = public_cases(benchmark_folder)[:1]
    haw = method_named("haw", sys.executable)
    with pytest.raises(ValueError, match=r"not installed here\. docs/benchmark\.md"):
        haw(cases, InProcess(), lambda _: None)
    package = tmp_path / "packages/seeq/addons/stictionanalyser"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("raise AssertionError('the user interface')")
    (package / "_ExecutePullSignal.py").write_text(FAKE_PACKAGE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "packages"))
    answers = haw(cases, InProcess(), lambda _: None)
    assert answers == {cases[0].case: CaseAnswer(stiction=Sticks.YES)}
    with pytest.raises(ValueError, match="--python"):
        method_named("haw")


@pytest.mark.parametrize("method", ["stemwatch", "horch", "he"])
def test_every_method_answers_whatever_it_is_given(benchmark_folder: Path, method: str) -> None:
    """The contract: an answer for each case, in words and numbers that a judge can read, also for
    recordings of noise."""
    cases = public_cases(benchmark_folder)[:2]
    assert {case.position for case in cases} <= {True, False}
    answers = method_named(method)(cases, InProcess(), lambda _: None)
    assert set(answers) == {case.case for case in cases}
    out = benchmark_folder.with_name(f"{method}.csv")
    write_answers(out, answers)
    assert set(read_answers(out, set(answers))) == set(answers)


def test_columns_are_read_in_their_roles(benchmark_folder: Path) -> None:
    """MV is the measured position here, and is there where the list says so."""
    for case in public_cases(benchmark_folder):
        assert (recording_of(case).mv is not None) is case.position


@pytest.mark.long
def test_drawn_valves_stick_by_half_and_say_nothing_by_their_process() -> None:
    """Of each pair one sticks; both have the same kind of process, length and clock."""
    for place in range(0, 8, 2):
        sticking, sound = (draw.draw_case(5151, place + k) for k in (0, 1))
        assert sticking.truth.sticks
        assert not sound.truth.sticks
        assert sticking.integrating == sound.integrating
        assert len(sticking.recording) == len(sound.recording) == draw.SAMPLES
        assert (
            sticking.truth.position == sound.truth.position == (sticking.recording.mv is not None)
        )
        assert bool(sticking.truth.cause) == bool(sound.truth.cause) == (place == 0)
        assert sticking.truth.S > 1.4
        assert sound.truth.S < 0.7
