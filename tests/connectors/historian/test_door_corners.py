"""Exports that hold the corners of a swinging door are read by lines, and no others."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian.columns import Column, finished
from stemwatch.connectors.historian.proposed_plant import ProposedSource, plant_toml
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.source_clock import lay_lines, make_grid
from stemwatch.connectors.historian.times.door_corners import (
    door_deviation,
    find_corners,
    lines_interval_ns,
    scan_ns,
)
from stemwatch.models.recording import Quality, Role
from stemwatch.models.studies.simulator.historian import swinging_door

SECONDS = 12_000
TAGS = {Role.OP: "A.OP", Role.MV: "A.ZT", Role.PV: "A.PV"}
VALVE = ValveTags(valve="A", tags={role: TagMapping(tag=tag) for role, tag in TAGS.items()})
START = datetime(2026, 3, 2, 6, tzinfo=UTC)


def column(places: np.ndarray, values: np.ndarray, tag: str = "A.OP") -> Column:
    """The tag's values at those seconds."""
    good = np.zeros(places.size, dtype=np.uint8)
    ns = places.astype(np.int64) * 1_000_000_000
    every = np.ones(places.size, dtype=bool)
    notes, reasons = ReadingNotes(), Counter[str]()
    return finished(tag, "", "", ns, every, values[places], good, notes=notes, reasons=reasons)


def signals(seed: int, noise: float) -> dict[Role, np.ndarray]:
    """A command that wanders, a stem with 3 % of play, and what it controls."""
    rng = np.random.default_rng(seed)
    slow = np.sin(np.arange(SECONDS) / 90.0) + 0.3 * np.sin(np.arange(SECONDS) / 31.0)
    op = 50.0 + 8.0 * slow + noise * rng.standard_normal(SECONDS)
    stem = op.copy()
    for place in range(1, SECONDS):
        stem[place] = np.clip(stem[place - 1], op[place] - 1.5, op[place] + 1.5)
    stem += (0.05 + 0.5 * noise) * rng.standard_normal(SECONDS)
    pv = 40.0 + np.cumsum(stem - op) / 90.0 + np.cumsum(0.1 * rng.standard_normal(SECONDS))
    return {Role.OP: op, Role.MV: stem, Role.PV: pv}


def of_door(values: np.ndarray, deviation: float) -> np.ndarray:
    return np.flatnonzero(swinging_door(values, deviation))


def in_steps(seed: int) -> np.ndarray:
    """A command that is set by hand to half percents every few minutes."""
    rng = np.random.default_rng(seed)
    steps = rng.choice([-2.0, -1.0, -0.5, 0.5, 1.0, 2.0, 5.0, -5.0], SECONDS)
    when = rng.random(SECONDS) < 1.0 / 90.0
    return 50.0 + np.cumsum(np.where(when, steps, 0.0))


@given(
    kind=st.sampled_from(["walk", "noise", "steps", "waves"]),
    deviation=st.floats(0.05, 2.0),
    seed=st.integers(0, 10_000),
)
@settings(max_examples=25, deadline=None)
def test_any_signal_is_within_the_deviation_of_its_lines(kind, deviation, seed) -> None:
    """At every instant of the grid, between the first corner and the last."""
    rng = np.random.default_rng(seed)
    values = {
        "walk": np.cumsum(0.2 * rng.standard_normal(SECONDS)),
        "noise": rng.standard_normal(SECONDS),
        "steps": in_steps(seed),
        "waves": 5.0 * np.sin(np.arange(SECONDS) / rng.uniform(5.0, 500.0)),
    }[kind]
    stored = column(of_door(values, deviation), values)
    step = 1e9 if scan_ns(stored.times) is None else lines_interval_ns(stored.times)
    grid = make_grid(stored.times, "A.OP", "made", (None, None), step_ns=step)
    laid = lay_lines(stored, grid, np.arange(SECONDS, dtype=np.int64) * 1_000_000_000)
    at = np.round((grid.instants - grid.origin_ns) / 1e9).astype(int)
    known = laid.quality == Quality.GOOD
    assert known.mean() > 0.99
    assert (
        np.abs(laid.values - values[np.minimum(at, SECONDS - 1)])[known].max() <= deviation + 1e-9
    )


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.5])
@pytest.mark.parametrize("deviation", [0.3, 1.0])
def test_corners_are_told(noise, deviation) -> None:
    """With noise by their bends, without by the lattice; the deviation is not told too small."""
    stored = {
        role: column(of_door(values, deviation), values, TAGS[role])
        for role, values in signals(3, noise).items()
    }
    assert {Role.OP, Role.MV} <= find_corners(stored)
    told = max(door_deviation(stored[role]) for role in (Role.OP, Role.MV))
    assert 0.7 * deviation <= told <= 6.0 * deviation


def test_a_command_set_by_hand_is_no_ramp_from_change_to_change() -> None:
    """Stored on change its values hold, beside a position that is stored by corners or reports."""
    op = in_steps(5)
    changed = np.flatnonzero(np.append(True, np.diff(op) != 0.0))
    others: dict[Role, Column] = {
        role: column(of_door(values, 0.3), values, TAGS[role])
        for role, values in signals(3, 0.3).items()
        if role is not Role.OP
    }
    assert not find_corners({Role.OP: column(changed, op), **others})
    assert not find_corners({Role.OP: column(changed, op)})


def test_a_command_in_steps_has_corners_on_either_side_of_each() -> None:
    """A scan apart: such a command is drawn, and stays in steps."""
    op = in_steps(5)
    stored = column(of_door(op, 0.2), op)
    assert find_corners({Role.OP: stored}) == {Role.OP}
    grid = make_grid(stored.times, "A.OP", "made", (None, None), step_ns=1e9)
    laid = lay_lines(stored, grid, np.arange(SECONDS, dtype=np.int64) * 1_000_000_000)
    assert np.array_equal(laid.values, op)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.5])
def test_what_is_no_corners_is_laid_as_before(noise) -> None:
    """Reports by a deviation, samples at some scans, even samples, and rows of a table."""
    rng = np.random.default_rng(9)
    drawn = signals(3, noise)
    rows = np.flatnonzero(rng.random(SECONDS) < 0.1)
    table = {role: column(rows, values, TAGS[role]) for role, values in drawn.items()}
    shared = table[Role.OP].times
    assert not find_corners({role: replace(one, times=shared) for role, one in table.items()})
    even = np.arange(0, SECONDS, 5)
    assert not find_corners({role: column(even, values) for role, values in drawn.items()})
    assert not find_corners(
        {role: column(reported(values, 0.3), values) for role, values in drawn.items()}
    )
    if noise:
        scans = {
            role: column(np.flatnonzero(rng.random(SECONDS) < 0.2), values)
            for role, values in drawn.items()
        }
        assert not find_corners(scans)


def reported(values: np.ndarray, deviation: float) -> np.ndarray:
    """Places of the reports of a value that has moved by a deviation."""
    places = [0]
    for place, value in enumerate(values):
        if abs(value - values[places[-1]]) > deviation:
            places.append(place)
    return np.unique(places)


def test_an_export_of_corners_is_read_by_lines(open_text) -> None:
    """The values are within the deviation, which the signals keep; where the archive was down,
    nothing is known. A deviation that the plant states is the one."""
    deviation, true = 0.3, signals(3, 0.3)
    rows: list[tuple[int, str]] = []
    for role, values in true.items():
        for place in of_door(values, deviation).tolist():
            stamp = (START + timedelta(seconds=place)).isoformat()
            if not 4000 <= place < 7000:
                rows.append((place, f"{TAGS[role]},{stamp},{values[place]:.4f}\n"))
    text = "Tag,Time,Value\n" + "".join(row for _, row in sorted(rows, key=lambda row: row[0]))
    opened = open_text(text)
    recording = opened.read(VALVE)
    stated = TagMapping(tag="A.ZT", low=0.0, high=50.0, deviation=0.3)
    told = opened.read(replace(VALVE, tags={**VALVE.tags, Role.MV: stated}))
    assert told.signals[Role.MV].deviation == pytest.approx(0.6)
    at = np.round(np.arange(len(recording)) * recording.interval_s).astype(int)
    down = (at > 4200) & (at < 6800)
    for role in (Role.OP, Role.MV):
        signal = recording.signals[role]
        assert signal.deviation == pytest.approx(1.2 * deviation, rel=0.5)
        assert set(signal.quality[down].tolist()) == {Quality.MISSING}
        good = signal.usable & ((at < 3900) | (at > 7100))
        assert np.abs(signal.values - true[role][at])[good].max() <= deviation + 1e-4
    assert recording.usable[~down].mean() > 0.9
    assert any("corners of a swinging door" in said for said in recording.provenance.decisions)
    proposal = plant_toml([ProposedSource("h", "loop.csv", (opened.inspect(),))])
    assert "# deviation = 0.1" in proposal  # asked where the tag comes by exception


def test_a_deviation_that_is_not_used_is_told(open_text) -> None:
    """Of samples at even times no lines are drawn, whatever the plant file states."""
    rows = []
    for place in range(0, 600, 5):
        stamp = (START + timedelta(seconds=place)).isoformat()
        rows += [f"{tag},{stamp},{50.0 + place % 7:.4f}\n" for tag in TAGS.values()]
    stated = {**VALVE.tags, Role.MV: TagMapping(tag="A.ZT", deviation=0.3)}
    opened = open_text("Tag,Time,Value\n" + "".join(rows))
    recording = opened.read(replace(VALVE, tags=stated))
    assert recording.signals[Role.MV].deviation is None
    said = [each for each in recording.provenance.decisions if "it is not used" in each]
    assert said == [
        "A.ZT: the plant file states a deviation of 0.3, but these samples are not the corners of "
        "a swinging door; it is not used."
    ]
