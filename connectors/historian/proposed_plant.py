"""A plant file proposed from what was seen of exports, or of the tags of an archive: sources, and
every valve whose controller output is certain. What is not certain is a commented line.
"""

from __future__ import annotations

import glob
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from stemwatch.connectors.connector import RANGE_HIGH, RANGE_LOW, TagInfo
from stemwatch.connectors.historian.tags.perhaps_position import may_be_position
from stemwatch.connectors.historian.values.units import SHARE_OF_SPAN
from stemwatch.connectors.settings import toml_value
from stemwatch.models.recording import PERCENT, Role

if TYPE_CHECKING:
    from stemwatch.connectors.historian.inspection import Inspection, TagInspection

NO_CURVES: Mapping[str, str] = MappingProxyType({})
# Transmitted values stay within 20 mA, 15 psi, 10 V or 1.
BEYOND_TRANSMITTED = 21.0
# A current signal and the faults that it tells lie within these mA (NAMUR NE 43).
LIVE_ZERO_MA = (3.5, 22.0)
_ORDER = (Role.OP, Role.MV, Role.PV, Role.SP, Role.MODE)


@dataclass(frozen=True, kw_only=True)
class ProposedTag:
    """One tag, the role and valve that its name proposes (empty where there is doubt), and the
    range that was seen, or that an archive knows as the engineering values at 0 % and 100 %."""

    tag: str
    unit: str
    description: str
    role: str
    valve: str
    remark: str
    low: float | None = None
    high: float | None = None
    range_known: bool = False
    compressed: bool = False  # stored as points between which lines or rests are left out

    @classmethod
    def inspected(cls, seen: TagInspection) -> ProposedTag:
        """A tag of an export."""
        return cls(
            tag=seen.tag,
            unit=seen.unit,
            description=seen.description,
            role=seen.role,
            valve=seen.valve,
            remark=seen.remark,
            low=seen.low,
            high=seen.high,
            compressed=seen.compressed,
        )

    @classmethod
    def listed(cls, info: TagInfo) -> ProposedTag:
        """A tag that an archive lists; its range where ``facts`` have one."""
        low, high = info.facts.get(RANGE_LOW), info.facts.get(RANGE_HIGH)
        return cls(
            tag=info.tag,
            unit=info.unit,
            description=info.description,
            role="" if info.proposed_role is None else info.proposed_role.value,
            valve=info.proposed_valve,
            remark=info.remark,
            low=low,
            high=high,
            range_known=low is not None and high is not None and low < high,
        )


@dataclass(frozen=True)
class ProposedSource:
    """One source: its name, its path or pattern, the inspections of its files, and the reading
    ``options`` that the user gave."""

    name: str
    path: str
    inspections: tuple[Inspection, ...]
    options: Mapping[str, Any] = field(default_factory=dict)


def sources_of(
    seen: Sequence[tuple[Path, Inspection]], folder: Path, options: Mapping[str, Any]
) -> list[ProposedSource]:
    """The sources for the files ``seen`` in ``folder``: one pattern for all files with one ending,
    so that later files are read too; or a source for each file where the same tag belongs to
    different valves."""
    paths: dict[str, list[Inspection]] = {}
    one_valve = _tags_have_one_valve([inspection for _, inspection in seen])
    subfolders = "" if all(path.parent == folder for path, _ in seen) else "**/"
    for path, inspection in seen:
        ending = "".join(path.suffixes[-2:]) if path.suffix == ".gz" else path.suffix
        pattern = f"{glob.escape(folder.as_posix())}/{subfolders}*{ending}"
        pattern_of_one = pattern if one_valve else glob.escape(path.as_posix())
        paths.setdefault(pattern_of_one, []).append(inspection)
    return [
        ProposedSource(
            "historian" if len(paths) == 1 else f"historian {number}",
            path,
            tuple(tags_of_file),
            options,
        )
        for number, (path, tags_of_file) in enumerate(paths.items(), start=1)
    ]


def _tags_have_one_valve(inspections: Sequence[Inspection]) -> bool:
    valves: dict[str, set[str]] = {}
    for tag in (tag for inspection in inspections for tag in inspection.tags):
        if tag.role == Role.OP:
            valves.setdefault(tag.tag, set()).add(tag.valve)
    return all(len(sources) == 1 for sources in valves.values())


def plant_toml(sources: Sequence[ProposedSource], curves: Mapping[str, str] = NO_CURVES) -> str:
    """The text of the plant file. ``curves`` are lines for valves whose position is not
    proportional to OP. A valve in several sources is listed under the first."""
    lines: list[str] = []
    for source in sources:
        lines += [
            "",
            "[[sources]]",
            f"name = {toml_value(source.name)}",
            f"path = {toml_value(source.path)}",
        ]
        lines += [_zone_line(source.inspections), *_option_lines(source.options)]
    proposed: set[str] = set()
    questions: list[str] = []
    for source in sources:
        tags = _tags(source.inspections)
        lines += valves_toml(tags, source.name, proposed, curves)
        proposed |= set(valves_of(tags))
        questions += questions_toml(tags)
    return "\n".join([*lines[1:], *questions]) + "\n"


def valves_toml(
    tags: Sequence[ProposedTag],
    source: str,
    known: Collection[str],
    curves: Mapping[str, str] = NO_CURVES,
) -> list[str]:
    """The lines of each valve of ``tags`` that is not ``known`` already."""
    lines: list[str] = []
    for valve in valves_of(tags):
        if valve not in known:
            lines += ["", *_valve_lines(tags, valve, source, curves.get(valve, ""))]
    return lines


def _tags(inspections: Sequence[Inspection]) -> list[ProposedTag]:
    """Each tag of each valve once, over the range that all files show."""
    tags: dict[tuple[str, str], ProposedTag] = {}
    for seen in (tag for inspection in inspections for tag in inspection.tags):
        tag = ProposedTag.inspected(seen)
        before = tags.get((tag.valve, tag.tag))
        tags[tag.valve, tag.tag] = tag if before is None else _wider(before, tag)
    return list(tags.values())


def _wider(first: ProposedTag, other: ProposedTag) -> ProposedTag:
    lows = [low for low in (first.low, other.low) if low is not None]
    highs = [high for high in (first.high, other.high) if high is not None]
    role = first.role or other.role
    compressed = first.compressed or other.compressed
    low, high = min(lows, default=None), max(highs, default=None)
    return replace(first, low=low, high=high, role=role, compressed=compressed)


def _zone_line(inspections: Sequence[Inspection]) -> str:
    zones = [inspection.zone_name for inspection in inspections if inspection.zone_name]
    if zones:
        return f"zone = {toml_value(zones[0])}"
    if all(inspection.start is not None for inspection in inspections):
        return "# the times carry their offset or are in UTC; no zone is needed"
    return '# zone = "Europe/Berlin"   # the file does not say; without it dates stay unknown'


def _option_lines(options: Mapping[str, Any]) -> list[str]:
    """The reading options that the user gave; the zone has a line of its own."""
    return [f"{name} = {toml_value(value)}" for name, value in options.items() if name != "zone"]


def valves_of(tags: Sequence[ProposedTag]) -> list[str]:
    """The valves whose controller output is certain."""
    return sorted({tag.valve for tag in tags if tag.role == Role.OP and tag.valve})


def _valve_lines(tags: Sequence[ProposedTag], valve: str, source: str, curve: str) -> list[str]:
    mine = {tag.role: tag for tag in tags if tag.valve == valve and tag.role}
    description = next((t.description for t in mine.values() if t.description), "")
    lines = [
        "[[valves]]",
        f"id = {toml_value(valve)}",
        f"description = {toml_value(description)}",
        f"source = {toml_value(source)}",
    ]
    if curve:
        lines.append(f"{curve}   # OP:travel in percent, as the recording shows it")
    for role in _ORDER:
        if role in mine:
            lines += _tag_lines(role, mine[role])
        elif role is Role.MV:
            lines += _ask_position(tags, valve)
    return lines


def _tag_lines(role: Role, tag: ProposedTag) -> list[str]:
    lines = _named_lines(role, tag)
    if role in (Role.OP, Role.MV) and tag.compressed:
        lines.append("# deviation = 0.1   # of the archive's compression, in the tag's unit?")
    return lines


def _named_lines(role: Role, tag: ProposedTag) -> list[str]:
    lines = [f"[valves.tags.{role.value}]", f"tag = {toml_value(tag.tag)}"]
    if role is Role.MODE:
        return lines
    lines.append(
        f"unit = {toml_value(tag.unit)}" if tag.unit else '# unit = "%"   # not in the file'
    )
    if tag.range_known:
        return [*lines, f"low = {tag.low!r}", f"high = {tag.high!r}   # as the archive has them"]
    percent = tag.unit == PERCENT or (not tag.unit and role is Role.OP and _within_percent(tag))
    if percent:
        return [*lines, "low = 0.0", "high = 100.0"]
    if role in (Role.OP, Role.MV) and tag.unit == SHARE_OF_SPAN:
        return [*lines, "low = 0.0", "high = 1.0"]
    if role in (Role.OP, Role.MV) and _has_live_zero(tag):
        return [*lines, "low = 4.0", "high = 20.0   # mA as usual; low = 0.0 without live zero"]
    seen = "" if tag.low is None else f"   # seen: {tag.low:g} to {tag.high:g}"
    return [*lines, f"# low = 0.0{seen}", "# high = 100.0   # engineering values at 0 % and 100 %"]


def _has_live_zero(tag: ProposedTag) -> bool:
    """Whether the values are of a current signal whose 0 % is 4 mA (IEC 60381-1), by their unit and
    since none lies below."""
    if tag.unit.casefold() != "ma" or tag.low is None or tag.high is None:
        return False
    return LIVE_ZERO_MA[0] <= tag.low and tag.high <= LIVE_ZERO_MA[1]


def _within_percent(tag: ProposedTag) -> bool:
    """Whether the values of an OP without unit are percent and nothing else: what stays within 4
    to 20 may be mA, within 0 to 1 a fraction. A range that is written counts as known, and the
    recording is no longer asked for one that fits better.
    """
    if tag.low is None or tag.high is None:
        return False
    return tag.low >= -15 and BEYOND_TRANSMITTED < tag.high <= 115


def _ask_position(tags: Sequence[ProposedTag], valve: str) -> list[str]:
    maybe = [
        t.tag
        for t in tags
        if t.valve == valve and not t.role and may_be_position(t.tag, t.description)
    ]
    hint = f" (perhaps {', '.join(maybe[:3])})" if maybe else ""
    return [
        f"# which tag is the measured position (MV) of {valve}?{hint}".replace("\n", " "),
        "# [valves.tags.mv]",
        '# tag = ""',
    ]


def questions_toml(tags: Sequence[ProposedTag]) -> list[str]:
    """Loops without a certain OP, listed so that a person sees what is missing; what only measures
    lacks none."""
    certain = set(valves_of(tags))
    loops = {t.valve for t in tags if t.role != Role.PV} - certain
    open_tags = [t for t in tags if t.valve and t.valve in loops]
    if not open_tags:
        return []
    lines = ["", "# Not proposed, because the controller output (OP) is not certain:"]
    return lines + [
        f"#   {t.tag} ({t.valve}): {t.remark}".replace("\n", " ") for t in open_tags[:200]
    ]
