"""Roles from tag, description and unit: only where they leave no doubt, always with why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from stemwatch.connectors.historian.tags.tag_names import (
    TagName,
    instrument,
    number,
    parse_tag,
)
from stemwatch.models.recording import PERCENT, Role

_ASK_MV = (
    "MV is the controller output in some systems (manipulated variable) and the valve position in "
    "others; say which"
)
_ASK_CV = (
    "CV is the controller output in some systems and the controlled variable in others; say which"
)
_DESCRIBED = (
    (Role.OP, ("_op", "controller output", "output", "stellgröße", "stellgroesse", "leitgröße")),
    (Role.MV, ("valve position", "stem position", "travel", "position feedback", "stellungsrück",
               "ventilstellung", "hub")),
    (Role.SP, ("_sp", "set point", "setpoint", "sollwert", "consigne")),
    (Role.PV, ("_pv", "process value", "measured value", "istwert", "mesure")),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One tag on its way to a role."""

    tag: str
    unit: str
    description: str
    own_interval_s: float | None = None  # slower than the rows
    name: TagName
    role: Role | None = None
    valve: str = ""
    remark: str = ""


def propose_roles(
    tags: Sequence[tuple[str, str, str, float | None]], *, stem: str, mv_is_output: bool
) -> list[Candidate]:
    """A candidate for each (tag, unit, description, own interval in seconds).

    ``stem`` names the valve where tags are nothing but OP, PV, SP. ``mv_is_output``: the layout
    itself uses MV for the manipulated variable, which the description must confirm.
    """
    found = [
        Candidate(tag=t, unit=u, description=d, own_interval_s=i, name=parse_tag(t))
        for t, u, d, i in tags
    ]
    found = [_propose(one, found, stem, mv_is_output) for one in found]
    found = _pair_positions(found)
    found = _pair_transmitters(found)
    return _one_per_role(found)


def _propose(
    one: Candidate, everyone: Sequence[Candidate], stem: str, mv_is_output: bool
) -> Candidate:
    name = one.name
    if not name.word:
        return replace(one, remark="nothing in tag or description says what it is to a valve")
    valve = name.loop or stem
    described = described_role(one.description)
    if name.word == "mv":
        return _propose_mv(replace(one, valve=valve), described, mv_is_output)
    if name.word == "cv":
        return _propose_cv(replace(one, valve=valve), everyone)
    role = name.role
    if role is None:
        return replace(one, remark=f"{name.word!r} of this block has no part in a control loop")
    if described not in (None, role):
        return replace(
            one,
            valve=valve,
            remark=f"the tag says {role.value} but the description {one.description!r} does not",
        )
    confirmed = ", as its description says" if described is role else ""
    remark = f"by its name {name.word.upper()!r}{confirmed}"
    return replace(one, role=role, valve=valve, remark=remark)


def described_role(description: str) -> Role | None:
    """The role that a description names, ``None`` where it names none or several."""
    text = description.strip().lower()
    hits = {
        role
        for role, words in _DESCRIBED
        if any(text.endswith(w) if w.startswith("_") else w in text for w in words)
    }
    return hits.pop() if len(hits) == 1 else None


def _propose_mv(one: Candidate, described: Role | None, mv_is_output: bool) -> Candidate:
    if described is Role.OP:
        where = "by the layout and " if mv_is_output else "by "
        remark = f"MV is the controller output here, {where}its description {one.description!r}"
        return replace(one, role=Role.OP, remark=remark)
    return replace(one, remark=_ASK_MV)


def _propose_cv(one: Candidate, everyone: Sequence[Candidate]) -> Candidate:
    beside = {other.name.role for other in everyone if other.name.loop == one.name.loop}
    if one.unit == PERCENT and beside & {Role.MV, Role.PV} and Role.OP not in beside:
        remark = "CV in percent beside the same loop's position or PV: the controller output"
        return replace(one, role=Role.OP, remark=remark)
    return replace(one, remark=_ASK_CV)


def _pair_positions(found: list[Candidate]) -> list[Candidate]:
    """``ZT-101`` belongs to the one loop that has an OP and the same number."""
    outputs = {one.valve for one in found if one.role is Role.OP}
    out = []
    for one in found:
        if one.role is Role.MV and one.valve not in outputs:
            same = [valve for valve in outputs if number(valve) == number(one.valve) != ""]
            if len(same) == 1:
                remark = f"position transmitter with the number of {same[0]}"
                one = replace(one, valve=same[0], remark=remark)
        out.append(one)
    return out


def _pair_transmitters(found: list[Candidate]) -> list[Candidate]:
    """``FIT-400B/AI1/OUT`` is the measurement of ``FIC-400B``."""
    outputs = {one.valve for one in found if one.role is Role.OP}
    by_instrument: dict[str, list[str]] = {}
    for valve in outputs:
        by_instrument.setdefault(instrument(valve), []).append(valve)
    out = []
    for one in found:
        same = by_instrument.get(instrument(one.valve), [])
        if one.role is Role.PV and one.valve not in outputs and len(same) == 1:
            one = replace(one, valve=same[0], remark=f"the measurement of {same[0]}")
        out.append(one)
    return out


def _one_per_role(found: list[Candidate]) -> list[Candidate]:
    """Of several tags for one role of one valve the one with the quickest own rate is proposed;
    a controller's own copy (PID block) is the last choice."""
    groups: dict[tuple[str, Role], list[int]] = {}
    for i, one in enumerate(found):
        if one.role is not None:
            groups.setdefault((one.valve, one.role), []).append(i)
    out = list(found)
    for members in groups.values():
        if len(members) > 1:
            _choose(out, members)
    return out


def _choose(out: list[Candidate], members: list[int]) -> None:
    def rate(i: int) -> tuple[int, float]:
        # The blocks on either side of the controller show a value when it acts; the controller's
        # own copies are scanned or compressed, seconds to minutes late.
        return int(out[i].name.block.startswith("PID")), out[i].own_interval_s or 0.0

    ranked = sorted(members, key=rate)
    best = out[ranked[0]]
    if rate(ranked[0]) == rate(ranked[1]):
        others = ", ".join(out[i].tag for i in members)
        for i in members:
            out[i] = replace(out[i], role=None, remark=f"several tags may be this one: {others}")
        return
    for i in ranked[1:]:
        own = out[i].own_interval_s
        slow = f", new values each {own:g} s" if own else ""
        out[i] = replace(out[i], role=None, remark=f"a copy of {best.tag}{slow}; that one is used")
