"""Wrong plant files: each mistake has its sentence, and all are reported at once."""

from __future__ import annotations

import tomllib
from pathlib import Path
from unittest.mock import Mock

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stemwatch.service.config import PlantFileError, load_plant
from stemwatch.service.config.toml import TomlLines

SOURCE = '[[sources]]\nname = "s"\npath = "a.csv"\n'  # three lines
GOOD = '[[valves]]\nid = "GOOD"\nsource = "s"\n[valves.tags.op]\ntag = "GOOD.OP"\n'  # five lines


def valve(*lines: str, op: str = 'tag = "V.OP"') -> str:
    """A source, a good valve and, from line 9, valve V with ``lines`` before its tags."""
    own = "".join(f"{line}\n" for line in lines)
    return f"{SOURCE}{GOOD}[[valves]]\n{own}[valves.tags.op]\n{op}\n"


def write(folder: Path, text: str, listed: str | None = None) -> Path:
    (folder / "plant.toml").write_text(text, encoding="utf-8")
    if listed is not None:
        (folder / "valves.csv").write_text(listed, encoding="utf-8")
    return folder / "plant.toml"


ID, S = 'id = "V"', 'source = "s"'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (valve(S), "9: valves[2].id: found nothing; expected the valve's own name, as text of"),
        (valve('id = ""', S), "10: valves[2].id: found an empty text; expected the valve's own"),
        (valve("id = 101", S), "10: valves[2].id: found 101; expected the valve's own name"),
        (valve(ID), "9: valves[V].source: found nothing; expected the name of one of the [[sour"),
        (
            valve(ID, 'source = "t"'),
            "11: valves[V].source: found the unknown source 't'; expected one of s",
        ),
        (
            valve(ID, S, "criticality = 4"),
            "12: valves[V].criticality: found 4; expected 1, 2 or 3, where 3 is the valve",
        ),
        (
            valve(ID, S, 'criticality = "3"'),
            "12: valves[V].criticality: found the text '3'; expected 1, 2 or 3",
        ),
        (
            valve(ID, S, 'stroke_curve = "50:0 40:30"'),
            "12: valves[V].stroke_curve: found the text '50:0 40:30'; expected points "
            '"OP:travel" in percent with spaces between them, such as "50:0 75:42 100:100": OP '
            "rising, travel only rising or only falling; here stands OP 40 after OP 50",
        ),
        (
            valve(ID, S, 'stroke_curve = "0:0 60:70 100:50"'),
            "12: valves[V].stroke_curve: found the text '0:0 60:70 100:50'; expected points "
            '"OP:travel" in percent with spaces between them, such as "50:0 75:42 100:100": OP '
            "rising, travel only rising or only falling; here stands travel 50 after 70, so that "
            "it turns round",
        ),
        (
            valve(ID, S, "stroke_curve = [[0, 0], [100, 100]]"),
            '12: valves[V].stroke_curve: found a list of 2; expected points "OP:travel" in percent',
        ),
        (
            valve(ID, S, 'descripton = "x"'),
            "12: valves[V].descripton: found an unknown key; expected one of area, criticality, "
            "description, feeds, id, loop, price_per_hour_off_target, price_per_stroke, "
            "price_per_unit_hour, site, source, stroke, stroke_curve, tags, target_band, unit "
            "(did you mean 'description'?)",
        ),
        (
            valve(ID, S, 'description = "a\\nb"'),
            "12: valves[V].description: found the text 'a\\nb'; expected text without line breaks",
        ),
        (
            f'{SOURCE}{GOOD}[[valves]]\n{ID}\n{S}\n[valves.tags.mv]\ntag = "V.ZT"\n',
            "12: valves[V].tags.op: found nothing; expected the tag of the controller output (OP)",
        ),
        (
            f"{SOURCE}{GOOD}[[valves]]\n{ID}\n{S}\n",
            "9: valves[V].tags: found nothing; expected a table of tags with at least the contr",
        ),
        (
            valve(ID, S, op='tag = "V.OP"\nhigh = 0\nlow = 100'),
            "15: valves[V].tags.op.low: found low = 100 and high = 0; expected low below high: "
            "the engineering values at 0 % and at 100 %",
        ),
        (
            valve(ID, S, op='tag = "V.OP"\nlow = 5.0\nhigh = 5.0'),
            "14: valves[V].tags.op.low: found low = 5 and high = 5; expected low below high",
        ),
        (
            valve(ID, S, op='tag = "V.OP"\nlow = 5.0'),
            "14: valves[V].tags.op.low: found low without high; expected both low and high, or ne",
        ),
        (
            valve(ID, S, op='tag = "V.OP"\nhigh = 5.0'),
            "14: valves[V].tags.op.high: found high without low; expected both low and high",
        ),
        (
            valve(ID, S, op='tag = "V.OP"\nlow = nan\nhigh = 1'),
            "14: valves[V].tags.op.low: found nan; expected the engineering value at 0 %, as a n",
        ),
        (
            valve(ID, S, op='tag = "V.OP"\n[valves.tags.mv]\ntag = "v.op"'),
            "15: valves[V].tags.mv.tag: found 'v.op', which is also the op tag; expected the tag "
            "of the measured valve position; with no position transmitter, no mv",
        ),
        (
            valve(ID, S, op='tag = "V.OP"\n[valves.tags.position]\ntag = "V.ZT"'),
            "14: valves[V].tags.position: found an unknown key; expected one of mode, mv, op, pv",
        ),
        (
            valve('id = "GOOD"', S),
            "10: valves[GOOD].id: found 'GOOD', which plant.toml, line 5 has already; expected a "
            "name of its own (the first entry counts, this one is left out)",
        ),
    ],
)
def test_a_wrong_valve_is_left_out_with_its_sentence(
    tmp_path: Path, text: str, expected: str
) -> None:
    """One sentence with file, line, key, found and expected; the good valve stays."""
    plant = load_plant(write(tmp_path, text), environment={})
    (problem,) = plant.problems
    assert str(problem).startswith(f"plant.toml, line {expected}")
    assert ["GOOD"] == list(plant.valves)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ('zone = "Europe/Berln"', "zone: found the text 'Europe/Berln'; expected an IANA time zone "
         "such as Europe/Berlin (did you mean 'Europe/Berlin'?)"),
        ('zone = "../etc"', "zone: found the text '../etc'; expected an IANA time zone such as"),
        ('encoding = "utf9000"', "encoding: found the text 'utf9000'; expected an encoding that"),
        ('separator = ":"', "separator: found the text ':'; expected one of"),
        ('decimal = 1', 'decimal: found 1; expected "." or ","'),
        ('day_first = "yes"', "day_first: found the text 'yes'; expected true (31.12.2025) or"),
        ("interval_s = 0", "interval_s: found 0; expected seconds between samples, above 0"),
        ("interval_s = true", "interval_s: found true; expected seconds between samples"),
        ('ambiguous_hour = "third"', "ambiguous_hour: found the text 'third'; expected \"infer\""),
        ('good_quality = "192"', "good_quality: found the text '192'; expected a list of the"),
        ('time_colum = "t"', "time_colum: found an unknown key; expected one of"),
        ('time_format = []', "time_format: found a list of 0; expected a format such as"),
    ],
)  # fmt: skip
def test_a_wrong_source_costs_its_own_valves_only(tmp_path: Path, line: str, expected: str) -> None:
    """The source and its valves are left out, with one sentence for all of them."""
    other = SOURCE.replace('"s"', '"other"') + f"{line}\n"
    orphans = "".join(GOOD.replace("GOOD", f"V{n}").replace('"s"', '"other"') for n in range(7))
    plant = load_plant(write(tmp_path, other + SOURCE + GOOD + orphans), environment={})
    mistake, left_out = map(str, plant.problems)
    assert mistake.startswith(f"plant.toml, line 4: sources[other].{expected}")
    assert left_out == (
        "plant.toml, line 1: sources[other]: found a source that is wrong, so its 7 valves are "
        "left out (V0, V1, V2, V3, V4, ...); expected the mistakes in this source to be corrected"
    )
    assert (["s"], ["GOOD"]) == (list(plant.sources), list(plant.valves))


def test_a_separator_is_not_the_decimal_mark_too(tmp_path: Path) -> None:
    """A number could not be told from two cells."""
    text = SOURCE + 'separator = ","\ndecimal = ","\n'
    (problem,) = load_plant(write(tmp_path, text), environment={}).problems
    assert str(problem) == (
        "plant.toml, line 5: sources[s].decimal: found ',', which is also the separator; "
        "expected two different marks"
    )


def test_a_second_source_of_one_name_is_left_out(tmp_path: Path) -> None:
    """The first entry counts, and the sentence names its line."""
    text = SOURCE + SOURCE.replace("a.csv", "b.csv")
    plant = load_plant(write(tmp_path, text), environment={})
    (problem,) = plant.problems
    assert "line 5: sources[s].name: found 's', which plant.toml, line 2 has already" in str(
        problem
    )
    assert "a.csv" == plant.sources["s"].path


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("valves = 3", "1: valves: found 3; expected tables, each headed [[valves]]"),
        ('sources = ["a.csv"]', "1: sources[1]: found the text 'a.csv'; expected tables, each"),
        ("[valves]\nid = 3", "1: valves: found a table; expected tables, each headed [[valves]]"),
        (
            'plant = "x"',
            "1: plant: found the text 'x'; expected a table with name, site, zone and currency",
        ),
        ("limits = 3", "1: limits: found 3; expected a table of limits, each a number"),
        ("valve_list = 3", "1: valve_list: found 3; expected the name of a CSV file"),
        ("[sorces]", "1: sorces: found an unknown key; expected one of alerts, devices, "
         "limits, notifiers, plant, schedules, service, sources, storage, valve_list, valves (did "
         "you mean 'sources'?)"),
        ('[plant]\nvalve_list = "v.csv"', "2: plant.valve_list: found an unknown key; expected "
         "one of currency, name, site, zone; valve_list belongs at the top of the file, before the "
         "first [table]"),
        ('[plant]\nzone = "CET+1"', "2: plant.zone: found the text 'CET+1'; expected an IANA"),
        ('[limits]\nmin_reversals = "6"', "2: limits.min_reversals: found the text '6'; expected "
         "a number"),
        ("[limits]\nsticky_s_percent = 3", "2: limits.sticky_s_percent: found an unknown key; "),
        ("[limits]\nwatch_S_percent = 9.0", "1: limits: found limits that contradict one another; "
         "expected 0 < watch_S_percent <= sticky_S_percent, received 9.0 and 1.5"),
        ("[storage]\nurl = 5", "2: storage.url: found 5; expected a database URL such as"),
        ('[storage]\npassword = "geheim"', "2: storage.password: found an unknown key; expected "
         "one of url"),
        ('[storage]\nurl = ["sqlite://u:geheim@h"]', "2: storage.url: found a list of 1; expected"),
        ("a = 1\n[plant\nb = 2", "2: file: found text that is not TOML ("),
        ("[plant]\nname = Demo", "2: file: found text that is not TOML (Invalid value); expected "
         "a text in quotation marks"),
        ('[plant]\nname = "a"\nname = "b"', "3: file: found text that is not TOML (Cannot "),
        ('[[sources]]\npath = "C:\\exports\\*.csv"', "2: file: found text that is not TOML ("
         "Unescaped '\\' in a string); expected Windows paths in single quotes"),
        ('[plant]\nname = "a\n', "2: file: found text that is not TOML (Illegal character"),
        ('[plant]\nname = """a\n', "3: file: found text that is not TOML ("),
    ],
)  # fmt: skip
def test_what_is_wrong_for_every_valve_stops_the_reading(
    tmp_path: Path, text: str, expected: str
) -> None:
    """No verdict is given on limits or a mapping that were not understood."""
    with pytest.raises(PlantFileError) as caught:
        load_plant(write(tmp_path, text), environment={})
    (problem,) = caught.value.problems
    assert str(problem).startswith(f"plant.toml, line {expected}")
    assert "geheim" not in str(problem)


def test_everything_is_said_at_once(tmp_path: Path) -> None:
    """One reading names all mistakes of the file and its list, in whatever table they are."""
    text = 'valve_list = "valves.csv"\n' + valve(ID, 'source = "t"', "criticality = 9")
    text += '[plant]\nzone = "x"\n[limits]\nmin_samples = true\nother = 1\n'
    with pytest.raises(PlantFileError) as caught:
        load_plant(write(tmp_path, text, "id,source,op\nW,t,\n"), environment={})
    assert [
        "plant.zone", "limits.min_samples", "limits.other", "valves[V].criticality",
        "valves[V].source", "column source", "column op",
    ] == [problem.key for problem in caught.value.problems]  # fmt: skip
    assert 7 == len(str(caught.value).splitlines())


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    """No file, a folder, and a file in another encoding."""
    with pytest.raises(PlantFileError, match=r"plant\.toml: file: found no such file in /"):
        load_plant(tmp_path / "plant.toml")
    with pytest.raises(PlantFileError, match="a file that cannot be read"):
        load_plant(tmp_path)
    (tmp_path / "plant.toml").write_bytes('[plant]\nname = "Süd"'.encode("cp1252"))
    with pytest.raises(
        PlantFileError, match=r"line 2: file: found the byte 0xfc, which is not UTF"
    ):
        load_plant(tmp_path / "plant.toml")


def test_lines_are_found_in_every_form_of_toml() -> None:
    """Headers, lists of tables, dotted and quoted keys, inline tables, texts over many lines."""
    text = '''# comment
a.b = 1
"quoted key" = """
[not.a.header]
c = 3
"""
list = [
  1, # ]
  [2],
]
[t.inner] # comment
x = { y = 1 }
[[v]]
k = 1
[v.tags."o.p"]
tag = 1
[[v]]
[[v.deep]]
[[v.deep]]
k = 2
'''
    lines = TomlLines(text)
    for path, line in {
        ("a", "b"): 2, ("quoted key",): 3, ("list", 1): 7, ("t", "inner"): 11,
        ("t", "inner", "x", "y"): 12, ("v",): 13, ("v", 0): 13, ("v", 0, "k"): 14,
        ("v", 0, "tags", "o.p", "tag"): 16, ("v", 1): 17, ("v", 1, "deep", 1, "k"): 20,
        ("v", 1, "deep", 1, "missing"): 19, ("nowhere",): None,
    }.items():  # fmt: skip
        assert line == lines.of(path), path


def test_a_long_list_of_tables_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not once more for each of its lines: a register map has thousands."""
    rows = "".join(f'  {{ tag = "T{n}", address = {n} }},\n' for n in range(300))
    reading = Mock(wraps=tomllib.loads)
    monkeypatch.setattr("tomllib.loads", reading)
    lines = TomlLines(f"registers = [\n{rows}]\nlast = 1\n")
    assert lines.of(("registers", 299, "tag")) is not None
    assert lines.of(("last",)) == 303
    assert reading.call_count < 10


WORDS = st.sampled_from(["plant", "valves", "sources", "limits", "tags", "op", "tag", "id", "é"])
VALUES = st.recursive(
    st.integers() | st.text(max_size=5) | st.booleans() | st.floats(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=5,
)
LINES = st.one_of(
    st.builds("[{}]".format, WORDS),
    st.builds("[[{}]]".format, WORDS),
    st.builds("{} = {!r}".format, WORDS, VALUES),
    st.text(max_size=10),
)


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(text=st.lists(LINES, max_size=8).map("\n".join) | st.binary(max_size=60))
def test_any_file_is_read_or_refused_in_words(tmp_path: Path, text: str | bytes) -> None:
    """Whatever stands in the file, the answer is a plant or a PlantFileError with lines."""
    raw = text if isinstance(text, bytes) else text.encode("utf-8", errors="replace")
    (tmp_path / "plant.toml").write_bytes(raw)
    try:
        problems = load_plant(tmp_path / "plant.toml", environment={}).problems
    except PlantFileError as error:
        problems = error.problems
        assert problems
    for problem in problems:
        assert problem.line is None or 1 <= problem.line <= raw.count(b"\n") + 1
        assert problem.found
        assert problem.expected


def test_the_example_lines_are_toml() -> None:
    """What the tests call good is TOML, so that what they refuse is refused for its own reason."""
    assert "GOOD" == tomllib.loads(SOURCE + GOOD)["valves"][0]["id"]


def test_a_connection_to_a_valve_that_is_not_there_is_said_and_costs_nothing(tmp_path) -> None:
    """The valve stays with its other connections; a misspelt id has a proposal."""
    plant = load_plant(write(tmp_path, valve(ID, S, 'feeds = ["GOOD", "GOD"]')), environment={})
    (problem,) = plant.problems
    assert str(problem) == (
        "plant.toml, line 12: valves[V].feeds: found the unknown valve 'GOD'; expected the id of "
        "a valve of this plant (did you mean 'GOOD'?)"
    )
    assert plant.valves["V"].feeds == ["GOOD", "GOD"]
