"""Roles are proposed only where they leave no doubt; an inspection says what the data is like."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest

from stemwatch.connectors.historian import HistorianFile, propose_valves
from stemwatch.connectors.historian.proposed_plant import ProposedSource, plant_toml
from stemwatch.connectors.historian.tags.perhaps_position import may_be_position
from stemwatch.connectors.historian.tags.roles import propose_roles
from stemwatch.connectors.historian.tags.tag_names import parse_tag
from stemwatch.models.recording import Role


def roles_of(*tags: tuple[str, str, str]) -> dict[str, Role | None]:
    result = propose_roles(
        [(tag, unit, text, None) for tag, unit, text in tags], stem="file", mv_is_output=False
    )
    return {item.tag: item.role for item in result}


@pytest.mark.parametrize(
    ("tag", "loop", "role"),
    [
        ("FIC-101.OP", "FIC-101", Role.OP),
        ("FIC-101.OUT", "FIC-101", Role.OP),
        ("TIC7_LMN", "TIC7", Role.OP),
        ("FIC101/PV", "FIC101", Role.PV),
        ("2411FIC20102.SV", "2411FIC20102", Role.SP),
        ("FIC-101.MODE", "FIC-101", Role.MODE),
        ("FIC-101.ZT", "FIC-101", Role.MV),
        ("FV-101.POSITION", "FV-101", Role.MV),
        ("LC74_20X_pct", "LC74_20", Role.MV),
        ("LC74_20PV_pct", "LC74_20", Role.PV),
        ("FIC-1/PID1/OUT.CV", "FIC-1", Role.OP),
        ("FIT-1/AI1/OUT.CV", "FIT-1", Role.PV),
        ("FIC-1/PID1/MODE.ACTUAL", "FIC-1", Role.MODE),
        ("FIC-1/AO1/READBACK.CV", "FIC-1", Role.MV),
        ("FIC-1/AI_POS/OUT.CV", "FIC-1", Role.MV),
        ("FIC-1/ZT1/PV.CV", "FIC-1", Role.MV),
        ("FIC-1/AI_DEPOSIT/OUT.CV", "FIC-1", Role.PV),
        ("LIC701_LMNR_IN", "LIC701", Role.MV),
        ("LIC701_PV_IN", "LIC701", Role.PV),
        ("FIC501.Stellgröße", "FIC501", Role.OP),
        ("FIC501.Istwert", "FIC501", Role.PV),
        ("FIC501.Sollwert", "FIC501", Role.SP),
        ("FIC501.Stellungsrückmeldung", "FIC501", Role.MV),
        ("OP", "", Role.OP),
        ("F74_00_tph", "", None),
        ("P74_00_P1_kPa", "", None),
        ("MATRIX", "", None),
        ("FIC-101.MV", "FIC-101", None),
        ("FIC-101.CV", "FIC-101", None),
    ],
)
def test_a_tag_splits_into_loop_and_role_word(tag: str, loop: str, role: Role | None) -> None:
    """Loop and last word of a tag, and the role that the word alone would mean."""
    name = parse_tag(tag)
    assert (name.loop, name.role) == (loop, role)


def test_bare_mv_is_never_guessed(open_text) -> None:
    """A tag .MV without a description asks, with both readings."""
    source = open_text("t_s,FIC1.OP,FIC1.MV\n0,1,2\n1,1,2\n")
    info = {tag.tag: tag for tag in source.tags()}["FIC1.MV"]
    assert info.proposed_role is None
    assert "controller output in some systems" in info.remark
    assert "valve position in others" in info.remark
    assert Role.MV not in propose_valves(source)[0].tags


def test_columns_called_just_op_mv_and_pv_leave_no_doubt() -> None:
    """MV is neither of the other two then; without a PV, in a unit of flow or as a measured value
    by its description it may be one, and tags of a system keep their doubt."""
    assert roles_of(("OP", "", ""), ("MV", "", ""), ("PV", "", ""))["MV"] is Role.MV
    assert roles_of(("OP", "", ""), ("MV", "%", ""), ("PV", "t/h", ""))["MV"] is Role.MV
    assert roles_of(("OP", "", ""), ("MV", "", ""))["MV"] is None
    assert roles_of(("MV", "", ""), ("PV", "", ""))["MV"] is None
    assert roles_of(("OP", "", ""), ("MV", "t/h", ""), ("PV", "t/h", ""))["MV"] is None
    assert roles_of(("OP", "", ""), ("MV", "", "measured value"), ("PV", "", ""))["MV"] is None
    named = roles_of(("F1.OP", "", ""), ("F1.MV", "", ""), ("F1.PV", "", ""))
    assert named["F1.MV"] is None


def test_description_confirms_or_contradicts() -> None:
    """A description makes .MV the output, and a contradiction takes a role away."""
    assert roles_of(("A.MV", "", "Feed_OP"))["A.MV"] is Role.OP
    assert roles_of(("A.OP", "%", "Feed set point"))["A.OP"] is None


def test_the_position_block_of_a_module_is_no_measurement() -> None:
    """Its OUT is neither the PV, of which the controller's would be a copy, nor the output."""
    tags = ("F1/PID1/OUT.CV", "F1/PID1/PV.CV", "F1/AI_POS/OUT.CV")
    found = propose_roles([(tag, "%", "", None) for tag in tags], stem="f", mv_is_output=False)
    assert [item.role for item in found] == [Role.OP, Role.PV, Role.MV]
    assert found[2].remark == "by its block 'AI_POS'"


def test_mv_beside_sv_is_the_output() -> None:
    """Faceplates with PV, SV and MV call the manipulated variable MV. An output of the loop's own,
    or a description of something else, leaves the doubt."""
    tags = (("21FC1.PV", "", ""), ("21FC1.SV", "", ""), ("21ZI1.PV", "%", ""))
    found = roles_of(*tags, ("21FC1.MV", "%", ""))
    assert (found["21FC1.MV"], found["21ZI1.PV"]) == (Role.OP, Role.MV)
    assert roles_of(*tags, ("21FC1.MV", "%", ""), ("21FC1.OUT", "%", ""))["21FC1.MV"] is None
    assert roles_of(*tags, ("21FC1.MV", "%", "Valve position"))["21FC1.MV"] is None
    assert roles_of(("21FC2.SV", "", ""), ("21FC1.MV", "%", ""))["21FC1.MV"] is None


def test_cv_needs_percent_and_a_neighbour() -> None:
    """CV is the output only in percent beside a position or PV of its own loop."""
    assert roles_of(("L1.CV", "%", ""), ("L1.X", "%", ""))["L1.CV"] is Role.OP
    assert roles_of(("L1.CV", "bar", ""), ("L1.PV", "%", ""))["L1.CV"] is None
    assert roles_of(("L1.CV", "%", ""), ("L2.PV", "%", ""))["L1.CV"] is None


def test_two_outputs_of_one_loop_are_not_chosen_between() -> None:
    """Two equal candidates are both left open."""
    result = roles_of(("A.OP", "%", ""), ("A.OUT", "%", ""))
    assert result == {"A.OP": None, "A.OUT": None}


def test_position_transmitter_is_paired_by_number() -> None:
    """ZT-101 belongs to FIC-101 when no other loop has the number."""
    result = propose_roles(
        [("FIC-101.OP", "%", "", None), ("ZT-101", "%", "", None)], stem="f", mv_is_output=False
    )
    assert [(item.role, item.valve) for item in result] == [
        (Role.OP, "FIC-101"),
        (Role.MV, "FIC-101"),
    ]


@pytest.mark.parametrize(("loop", "other"), [("Boiler", "Kettle"), ("fic-101", "tic-205")])
def test_another_loops_measurement_is_not_taken_for_a_name_without_an_instrument(
    loop: str, other: str
) -> None:
    """Names without letters and number have nothing in common, so that each keeps its own PV."""
    tags = (f"{loop}.OP", f"{loop}.PV", f"{other}.PV")
    found = propose_roles([(tag, "", "", None) for tag in tags], stem="f", mv_is_output=False)
    assert [(item.role, item.valve) for item in found] == [
        (Role.OP, loop),
        (Role.PV, loop),
        (Role.PV, other),
    ]


def export() -> str:
    rng = np.random.default_rng(3)
    rows = []
    for i in range(600):
        op = 50 + 10 * np.sin(i / 20) + rng.normal(0, 0.2)
        frozen = 40.0 if i > 300 else 50 + 10 * np.sin(i / 20)
        pv = "Bad" if i % 10 == 0 else f"{rng.normal(7, 1):.3f}"
        rows.append(f"2026-01-05T06:{i // 60:02d}:{i % 60:02d}Z,{op:.3f},{frozen:.1f},{pv},{i}")
    return "Time,FIC1.OP [%],FIC1.ZT [%],FIC1.PV [t/h],FIC2.MV\n" + "\n".join(rows) + "\n"


@pytest.fixture
def source(open_text) -> HistorianFile:
    return open_text(export(), "plant.csv")


def test_the_measured_value_of_a_position_transmitter_is_the_position():
    """ZT-101.PV belongs to FIC-101, beside the loop's own PV; GT1.PV of a loop GT1 is a PV."""
    tags = ("FIC-101.OP", "FIC-101.PV", "ZT-101.PV", "GT1.OP", "GT1.PV")
    found = propose_roles([(tag, "%", "", None) for tag in tags], stem="f", mv_is_output=False)
    seen = {candidate.tag: (candidate.valve, candidate.role) for candidate in found}
    assert seen["ZT-101.PV"] == ("FIC-101", Role.MV)
    assert seen["FIC-101.PV"] == ("FIC-101", Role.PV)
    assert seen["GT1.PV"] == ("GT1", Role.PV)


def test_inspection_says_what_was_understood(source: HistorianFile) -> None:
    """Encoding, separator, rows, interval, and the times in UTC."""
    seen = source.inspect()
    assert (seen.encoding, seen.separator, seen.decimal) == ("utf-8", ",", ".")
    assert (seen.rows, seen.interval_s, seen.clock.gaps) == (600, 1.0, 0)
    assert seen.start is not None
    assert seen.start.isoformat() == "2026-01-05T06:00:00+00:00"


def test_inspection_finds_bad_frozen_and_quantised(source: HistorianFile) -> None:
    """Bad share with its words, a frozen position, the recorder's resolution."""
    tags = {tag.tag: tag for tag in source.inspect().tags}
    assert tags["FIC1.PV"].bad_share == pytest.approx(0.1)
    assert dict(tags["FIC1.PV"].reasons) == {"Bad": 60}
    assert (tags["FIC1.ZT"].frozen, tags["FIC1.OP"].frozen) == (True, False)
    assert tags["FIC1.ZT"].quantum == pytest.approx(0.1)


def test_inspection_sees_lines_instead_of_samples(open_text) -> None:
    """A column of straight lines between knots is called compressed."""
    knots = np.random.default_rng(4).normal(50, 5, 31)
    values = np.interp(np.arange(600), np.arange(31) * 20, knots)
    text = "t_s,OP\n" + "".join(f"{i},{v:.9f}\n" for i, v in enumerate(values))
    (tag,) = open_text(text).inspect().tags
    assert tag.compressed
    assert tag.line_share > 0.5


def test_inspection_is_plain_data(source: HistorianFile) -> None:
    """The inspection serialises to JSON."""
    loaded = json.loads(json.dumps(source.inspect().to_dict()))
    assert loaded["tags"][0]["role"] == "op"
    assert loaded["start"] == "2026-01-05T06:00:00+00:00"


def test_plant_toml_is_valid_and_asks_for_what_is_open(open_text) -> None:
    """The proposal parses, maps what is certain and asks for the position in a comment."""
    text = export().replace("FIC1.ZT", "FIC1.MV")
    seen = open_text(text, "plant.csv").inspect()
    proposal = plant_toml([ProposedSource("boiler", seen.source, (seen,))])
    plant = tomllib.loads(proposal)
    assert plant["sources"][0]["name"] == "boiler"
    (valve,) = plant["valves"]
    assert valve["id"] == "FIC1"
    assert valve["tags"]["op"] == {"tag": "FIC1.OP", "unit": "%", "low": 0.0, "high": 100.0}
    assert valve["tags"]["pv"]["unit"] == "t/h"
    assert "# which tag is the measured position (MV) of FIC1? (perhaps FIC1.MV)" in proposal
    assert "#   FIC2.MV (FIC2): MV is the controller output in some systems" in proposal


@pytest.mark.parametrize(
    ("scale", "known"), [((0.0, 1.0), True), ((4.0, 0.16), False), ((0.0, 0.01), False)]
)
def test_the_range_of_an_output_without_unit_is_stated_only_where_it_is_plain(
    open_text, scale, known
) -> None:
    """What stays within 4 to 20 or 0 to 1 may be mA or a fraction: its range is left open, so that
    the recording itself is asked."""
    start, slope = scale
    percent = np.random.default_rng(4).uniform(30.0, 60.0, 400)
    values = start + slope * percent
    text = "t_s,FIC1.OP,FIC1.ZT\n" + "".join(
        f"{k},{op:.4f},{at:.1f}\n" for k, (op, at) in enumerate(zip(values, percent, strict=True))
    )
    seen = open_text(text, "plant.csv").inspect()
    proposal = plant_toml([ProposedSource("boiler", seen.source, (seen,))])
    (valve,) = tomllib.loads(proposal)["valves"]
    assert ("low" in valve["tags"]["op"]) is known
    asked = [line for line in proposal.splitlines() if line.startswith("# low = 0.0   # seen: ")]
    assert len(asked) == (1 if known else 2)  # that of the position, and of OP


def test_a_share_of_span_is_proposed_with_its_range(open_text) -> None:
    """The unit says what 0 % and 100 % are."""
    text = "Time,F1.OP [0-1]\n" + "".join(f"2026-01-05T06:00:{i:02d}Z,0.{i}\n" for i in range(60))
    source = ProposedSource("historian", "a.csv", (open_text(text).inspect(),))
    op = tomllib.loads(plant_toml([source]))["valves"][0]["tags"]["op"]
    assert op == {"tag": "F1.OP", "unit": "0-1", "low": 0.0, "high": 1.0}


@pytest.mark.parametrize(("start", "live"), [(4.0, True), (0.0, False)])
def test_milliamperes_are_proposed_with_their_live_zero(open_text, start, live) -> None:
    """Where the file gives mA and no value lies below 4, 0 and 100 % are written as 4 and 20."""
    percent = np.random.default_rng(4).uniform(10.0, 60.0, 400)
    current = start + 0.16 * percent
    text = "t_s,FIC1.OP [mA],FIC1.ZT [mA]\n" + "".join(
        f"{k},{value:.4f},{value:.4f}\n" for k, value in enumerate(current)
    )
    seen = open_text(text, "plant.csv").inspect()
    (valve,) = tomllib.loads(plant_toml([ProposedSource("boiler", seen.source, (seen,))]))["valves"]
    op = valve["tags"]["op"]
    assert op["unit"] == "mA"
    assert (op.get("low"), op.get("high")) == ((4.0, 20.0) if live else (None, None))


def test_plant_toml_maps_a_certain_position(source: HistorianFile) -> None:
    """A position that leaves no doubt is mapped."""
    seen = source.inspect()
    proposal = plant_toml([ProposedSource("historian", seen.source, (seen,))])
    (valve,) = tomllib.loads(proposal)["valves"]
    assert valve["tags"]["mv"]["tag"] == "FIC1.ZT"


def test_slow_scan_is_measured(open_text) -> None:
    """A column scanned every 10 s on a 1 s clock says so in its signal and its tag."""
    rng = np.random.default_rng(5)
    slow = np.repeat(rng.normal(50, 5, 61), 10)[4:604]
    rows = "".join(f"{i},{rng.normal(50, 5):.3f},{slow[i]:.3f}\n" for i in range(600))
    source = open_text("t_s,OP,PV\n" + rows)
    assert {t.tag: dict(t.facts) for t in source.tags()} == {
        "OP": {},
        "PV": {"own_interval_s": 10.0},
    }
    (valve,) = propose_valves(source)
    recording = source.read(valve)
    assert recording.signals[Role.PV].interval_s == 10.0
    assert recording.op.interval_s is None


def test_a_copy_of_the_output_is_not_offered_as_the_position(open_text) -> None:
    """What is known to be a copy, or a parameter, is never named where the position is asked for:
    whoever took it at its word would compare OP with itself."""
    rows = "".join(
        f"2026-01-05T06:{k // 60:02d}:{k % 60:02d}-04:00,{40 + k % 9},{40 + (k // 9) % 9},"
        f"{20 + k % 5},{20 + (k // 9) % 5},0.5\n"
        for k in range(300)
    )
    head = (
        "Timestamp,FIC-400B/BLOCK1/OUT.CV %,FIC-400B/PID1/OUT.CV %,FIT-400B/AI1/OUT.CV gal/min,"
        "FIC-400B/PID1/PV.CV gal/min,FIC-400B/PID1/GAIN.CV\n"
    )
    seen = open_text(head + rows, "rig.csv").inspect()
    assert "a copy of FIC-400B/BLOCK1/OUT.CV" in " ".join(tag.remark for tag in seen.tags)
    proposal = plant_toml([ProposedSource("rig", seen.source, (seen,))])
    assert "# which tag is the measured position (MV) of FIC-400B?\n" in proposal


def test_a_mere_measurement_is_no_loop_without_an_output(open_text) -> None:
    """A transmitter that belongs to no controller lacks no OP, and is not listed among the loops
    whose OP is not certain; a loop with a set point and no output is."""
    rows = "".join(f"2026-01-05T06:00:{k:02d}Z,{40 + k % 9},{20 + k % 5},7\n" for k in range(60))
    head = "Timestamp,FIC1.OP,TE-9/AI1/OUT.CV °C,PIC3.SP\n"
    seen = open_text(head + rows, "rig.csv").inspect()
    proposal = plant_toml([ProposedSource("rig", seen.source, (seen,))])
    assert "TE-9" not in proposal
    assert "#   PIC3.SP (PIC3): by its name 'SP'" in proposal


@pytest.mark.parametrize(
    ("tag", "description", "may_be"),
    [
        ("FIC1.MV", "", True),
        ("MV", "", True),
        ("ZT-101", "", True),
        ("FIC1/AO1/READBACK.CV", "", True),
        ("FIC1.OUT", "valve position of FIC1", True),
        ("FIC1/PID1/OUT.CV", "", False),
        ("FIC1/PID1/GAIN.CV", "", False),
        ("FIC1.CV", "", False),
        ("TI7", "", False),
    ],
)
def test_which_tags_may_be_a_position(tag: str, description: str, may_be: bool) -> None:
    """A word that means the position somewhere, or a description that says so."""
    assert may_be_position(tag, description) is may_be
