"""Roles from tag, description and unit: only where they leave no doubt, always with why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from stemwatch.connectors.connector import TagInfo
from stemwatch.connectors.historian.tags.tag_names import (
    OUTPUT_WORDS,
    TagName,
    instrument,
    is_position_transmitter,
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

    def info(self, samples: int = 0, facts: Mapping[str, float] | None = None) -> TagInfo:
        """The tag as its source lists it, with so many ``samples`` and the ``facts`` it knows."""
        return TagInfo(
            tag=self.tag,
            unit=self.unit,
            description=self.description,
            samples=samples,
            proposed_role=self.role,
            proposed_valve=self.valve,
            remark=self.remark,
            facts=dict(facts or {}),
        )


def propose_roles(
    tags: Sequence[tuple[str, str, str, float | None]], *, stem: str, mv_is_output: bool
) -> list[Candidate]:
    """A candidate for each (tag, unit, description, own interval in seconds).

    ``stem`` names the valve where tags are nothing but OP, PV, SP. ``mv_is_output``: the layout
    itself uses MV for the manipulated variable, which the description must confirm.
    """
    candidates = [
        Candidate(tag=t, unit=u, description=d, own_interval_s=i, name=parse_tag(t))
        for t, u, d, i in tags
    ]
    candidates = [_propose(candidate, candidates, stem, mv_is_output) for candidate in candidates]
    candidates = _pair_positions(candidates)
    candidates = _pair_transmitters(candidates)
    return _one_per_role(candidates)


def _propose(
    candidate: Candidate, everyone: Sequence[Candidate], stem: str, mv_is_output: bool
) -> Candidate:
    name = candidate.name
    if not name.word:
        return replace(candidate, remark="nothing in tag or description says what it is to a valve")
    valve = name.loop or stem
    described = described_role(candidate.description)
    if name.word == "mv":
        return _propose_mv(replace(candidate, valve=valve), described, everyone, mv_is_output)
    if name.word == "cv":
        return _propose_cv(replace(candidate, valve=valve), everyone)
    role = name.role
    if role is None:
        return replace(
            candidate, remark=f"{name.word!r} of this block has no part in a control loop"
        )
    if described not in (None, role):
        return replace(
            candidate,
            valve=valve,
            remark=(
                f"the tag says {role.value} but the description {candidate.description!r} does not"
            ),
        )
    confirmed = ", as its description says" if described is role else ""
    named = f"its block {name.block!r}" if _says_more(name) else f"its name {name.word.upper()!r}"
    reason = f"by {named}{confirmed}"
    return replace(candidate, role=role, valve=valve, remark=reason)


def _says_more(name: TagName) -> bool:
    """Whether the block, not the word, says the role: ``AI1/OUT`` is no controller output."""
    return name.word == "out" and name.role is not Role.OP


def described_role(description: str) -> Role | None:
    """The role that a description names, ``None`` where it names none or several."""
    text = description.strip().lower()
    hits = {
        role
        for role, words in _DESCRIBED
        if any(text.endswith(w) if w.startswith("_") else w in text for w in words)
    }
    return hits.pop() if len(hits) == 1 else None


def _propose_mv(
    candidate: Candidate,
    described: Role | None,
    everyone: Sequence[Candidate],
    mv_is_output: bool,
) -> Candidate:
    if described is Role.OP:
        evidence = "by the layout and " if mv_is_output else "by "
        reason = (
            f"MV is the controller output here, {evidence}its description {candidate.description!r}"
        )
        return replace(candidate, role=Role.OP, remark=reason)
    loop = candidate.name.loop
    words = {other.name.word for other in everyone if other.name.loop == loop}
    if loop and "sv" in words and described in (None, Role.OP) and not words & OUTPUT_WORDS:
        # Yokogawa's, Azbil's, Omron's and others' faceplates: PV, SV, MV.
        reason = "MV beside the set point SV of its loop: the controller output"
        return replace(candidate, role=Role.OP, remark=reason)
    if (
        not (mv_is_output or candidate.name.loop)
        and described in (None, Role.MV)
        and candidate.unit in ("", PERCENT)
        and {Role.OP, Role.PV} <= _roles_of_its_loop(candidate, everyone)
    ):
        # Columns that somebody named by hand as the literature does. It is neither the manipulated
        # variable nor the measured value, which have columns of their own.
        reason = "MV beside columns OP and PV: the valve position"
        return replace(candidate, role=Role.MV, remark=reason)
    return replace(candidate, remark=_ASK_MV)


def _roles_of_its_loop(candidate: Candidate, everyone: Sequence[Candidate]) -> set[Role | None]:
    """The roles that the tags of the candidate's loop have by their names."""
    return {other.name.role for other in everyone if other.name.loop == candidate.name.loop}


def _propose_cv(candidate: Candidate, everyone: Sequence[Candidate]) -> Candidate:
    roles_of_loop = _roles_of_its_loop(candidate, everyone)
    if (
        candidate.unit == PERCENT
        and roles_of_loop & {Role.MV, Role.PV}
        and Role.OP not in roles_of_loop
    ):
        reason = "CV in percent beside the same loop's position or PV: the controller output"
        return replace(candidate, role=Role.OP, remark=reason)
    return replace(candidate, remark=_ASK_CV)


def _pair_positions(candidates: list[Candidate]) -> list[Candidate]:
    """``ZT-101``, or its measured value ``ZT-101.PV``, belongs to the one loop that has an OP and
    the same number."""
    outputs = {candidate.valve for candidate in candidates if candidate.role is Role.OP}
    out = []
    for candidate in candidates:
        measured = candidate.role is Role.PV and is_position_transmitter(candidate.valve)
        if (candidate.role is Role.MV or measured) and candidate.valve not in outputs:
            same_number = [
                valve for valve in outputs if number(valve) == number(candidate.valve) != ""
            ]
            if len(same_number) == 1:
                reason = f"position transmitter with the number of {same_number[0]}"
                candidate = replace(candidate, role=Role.MV, valve=same_number[0], remark=reason)
        out.append(candidate)
    return out


def _pair_transmitters(candidates: list[Candidate]) -> list[Candidate]:
    """``FIT-400B/AI1/OUT`` is the measurement of ``FIC-400B``; a name without letters and number
    has nothing in common with another."""
    outputs = {candidate.valve for candidate in candidates if candidate.role is Role.OP}
    by_instrument: dict[str, list[str]] = {}
    for valve in outputs:
        if name := instrument(valve):
            by_instrument.setdefault(name, []).append(valve)
    out = []
    for candidate in candidates:
        same_instrument = by_instrument.get(instrument(candidate.valve), [])
        if (
            candidate.role is Role.PV
            and candidate.valve not in outputs
            and len(same_instrument) == 1
        ):
            candidate = replace(
                candidate,
                valve=same_instrument[0],
                remark=f"the measurement of {same_instrument[0]}",
            )
        out.append(candidate)
    return out


def _one_per_role(candidates: list[Candidate]) -> list[Candidate]:
    """Of several tags for one role of one valve the one with the quickest own rate is proposed;
    a controller's own copy (PID block) is the last choice."""
    groups: dict[tuple[str, Role], list[int]] = {}
    for i, candidate in enumerate(candidates):
        if candidate.role is not None:
            groups.setdefault((candidate.valve, candidate.role), []).append(i)
    out = list(candidates)
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
        interval_s = out[i].own_interval_s
        slow = f", new values each {interval_s:g} s" if interval_s else ""
        out[i] = replace(out[i], role=None, remark=f"a copy of {best.tag}{slow}; that one is used")
