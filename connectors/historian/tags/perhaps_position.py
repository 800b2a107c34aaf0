"""Tags that may be a valve's measured position although their names leave doubt: none of them is
read as the position, and a person is asked."""

from __future__ import annotations

from collections.abc import Iterable

from stemwatch.connectors.connector import TagInfo
from stemwatch.connectors.historian.tags.roles import described_role
from stemwatch.connectors.historian.tags.tag_names import parse_tag
from stemwatch.models.recording import Role

_MOST_NAMED = 3


def may_be_position(tag: str, description: str) -> bool:
    """Whether name or description of a tag without a role can mean the position.

    A copy of the controller output, a parameter of the controller or a measurement cannot.
    """
    name = parse_tag(tag)
    return name.word == "mv" or Role.MV in (name.role, described_role(description))


def position_question(valve: str, infos: Iterable[TagInfo]) -> str:
    """A sentence that asks whether one of the tags is the position of ``valve``; empty where the
    valve has a position, or no tag may be one."""
    of_valve = [info for info in infos if info.proposed_valve == valve]
    if any(info.proposed_role is Role.MV for info in of_valve):
        return ""
    tags = [
        info.tag
        for info in of_valve
        if info.proposed_role is None and may_be_position(info.tag, info.description)
    ]
    if not tags:
        return ""
    names = ", ".join(tags[:_MOST_NAMED])
    return (
        f"{names} may be the measured position of {valve}, but the name leaves doubt, so it was "
        f"not read. If it is, say so: --mv '{tags[0]}' beside --op, mv='{tags[0]}' in Python, or "
        "[valves.tags.mv] in the plant file."
    )
