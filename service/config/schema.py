"""The tables of ``plant.toml``. A field's description is used as "expected ..." in errors."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Self

from pydantic import AfterValidator, Field, ValidationInfo, model_validator

from stemwatch.connectors.settings import (
    Name,
    Text,
    TomlTable,
    Zone,
    contradiction,
    either_of,
    nearest,
)
from stemwatch.models.recording import Role
from stemwatch.models.stickslip.stroke_curve import POINTS_EXPECTED, KnownCurve, curve_of_points
from stemwatch.service.presenter.cost_of_sticking import Prices

EXPECTED = 'the full stroke with its unit, such as "40 mm", "1.5 in" or "90 deg"'
_FORM = re.compile(r"(\d+(?:[.,]\d+)?)\s*(mm|cm|in|inch|deg|degrees|°)", re.IGNORECASE)
_UNITS = {
    "mm": ("mm", 1.0),
    "cm": ("mm", 10.0),
    "in": ("in", 1.0),
    "inch": ("in", 1.0),
    "deg": ("°", 1.0),
    "degrees": ("°", 1.0),
    "°": ("°", 1.0),
}


@dataclass(frozen=True)
class Stroke:
    """Travel ``full`` from stop to stop, in ``unit``: mm, in, or ° for a rotary valve."""

    full: float
    unit: str

    def __str__(self) -> str:
        return f"{self.full:g}{self._gap}{self.unit}"

    def of_percent(self, percent: float) -> str:
        """``percent`` of the stroke in its own unit: 5 % of 40 mm is "2.0 mm"."""
        value = percent * self.full / 100.0
        digits = 3 if self.unit == "in" else 2 if abs(value) < 1.0 else 1
        return f"{value:.{digits}f}{self._gap}{self.unit}"

    @property
    def _gap(self) -> str:
        return "" if self.unit == "°" else " "


def parse_stroke(text: str) -> Stroke:
    """The stroke in ``text``, such as "40 mm". Raises ``ValueError`` with what was expected."""
    match = _FORM.fullmatch(text.strip())
    if match is None:
        raise ValueError(EXPECTED)
    unit, factor = _UNITS[match[2].lower()]
    full = float(match[1].replace(",", ".")) * factor
    if full <= 0.0:
        raise ValueError(f"{EXPECTED}, above 0")
    return Stroke(full, unit)


def _known_stroke(text: str) -> str:
    parse_stroke(text)
    return text


def _known_points(text: str) -> str:
    try:
        curve_of_points(text)
    except ValueError as error:
        raise ValueError(f"{POINTS_EXPECTED}; here stands {error}") from None
    return text


def _existing_source(name: str, info: ValidationInfo) -> str:
    """Check that the source exists, where the validation's context names the sources."""
    source_names = None if info.context is None else info.context["sources"]
    if source_names is None or name in source_names:
        return name
    expected = either_of(source_names) if source_names else "a [[sources]] table with this name"
    raise contradiction((), f"the unknown source {name!r}", expected + nearest(name, source_names))


class PlantSection(TomlTable):
    """``[plant]``."""

    name: Text = Field(default="", description="the plant's name as text")
    site: Text = Field(default="", description="the site that valves are on which name none")
    currency: Text = Field(default="", description="the currency of prices, such as EUR")
    zone: Zone | None = Field(default=None, description="an IANA time zone such as Europe/Berlin")


class StorageSection(TomlTable):
    """``[storage]``."""

    url: str | None = Field(
        default=None,
        min_length=1,
        description="a database URL such as sqlite:///stemwatch.db or "
        "postgresql://user:password@host/database",
    )


class Tag(TomlTable):
    """``[valves.tags.op]``: one tag, and the engineering values at 0 % and 100 %."""

    tag: Name = Field(description="the tag's name in the source, as text of 1 to 200 letters")
    unit: Text = Field(default="", description='a unit such as "%" or "t/h"')
    low: float | None = Field(default=None, description="the engineering value at 0 %, as a number")
    high: float | None = Field(
        default=None, description="the engineering value at 100 %, as a number"
    )
    deviation: float | None = Field(
        default=None,
        gt=0.0,
        description="the deviation of the archive's compression in the tag's unit, above 0",
    )

    @model_validator(mode="after")
    def _range(self) -> Self:
        if (self.low is None) != (self.high is None):
            given_end, other = ("low", "high") if self.high is None else ("high", "low")
            found_text = f"{given_end} without {other}"
            raise contradiction((given_end,), found_text, "both low and high, or neither")
        if self.low is not None and self.high is not None and self.low >= self.high:
            found_text = f"low = {self.low:g} and high = {self.high:g}"
            expected = "low below high: the engineering values at 0 % and at 100 %"
            raise contradiction(("low",), found_text, expected)
        return self


class Tags(TomlTable):
    """``[valves.tags]``: the tag of each role; only OP must be there."""

    op: Tag = Field(
        description="the tag of the controller output (OP): "
        '[valves.tags.op] with tag = "...", or column op of a valve list'
    )
    mv: Tag | None = Field(
        default=None, description="a table with the tag of the measured position (MV)"
    )
    pv: Tag | None = Field(
        default=None, description="a table with the tag of the process variable (PV)"
    )
    sp: Tag | None = Field(default=None, description="a table with the tag of the set point (SP)")
    mode: Tag | None = Field(
        default=None, description="a table with the tag of the controller mode"
    )

    @model_validator(mode="after")
    def _position_is_measured(self) -> Self:
        # Historians ignore the case of tags, so two spellings may be the same tag.
        if self.mv is not None and self.mv.tag.casefold() == self.op.tag.casefold():
            found_text = f"{self.mv.tag!r}, which is also the op tag"
            expected = "the tag of the measured valve position; with no position transmitter, no mv"
            raise contradiction(("mv", "tag"), found_text, expected)
        return self

    def by_role(self) -> dict[Role, Tag]:
        """The tags that are given."""
        tags = {role: getattr(self, role.value) for role in Role}
        return {role: tag for role, tag in tags.items() if tag is not None}


Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Price = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class Valve(TomlTable):
    """``[[valves]]``, or one row of a valve list."""

    id: Name = Field(description="the valve's own name, as text of 1 to 200 letters")
    description: Text = Field(default="", description="text on one line")
    site: Text = Field(default="", description="the site's name; default that of [plant]")
    area: Text = Field(default="", description="text on one line")
    unit: Text = Field(default="", description="the unit's name, such as 200")
    loop: Text = Field(default="", description="the control loop's name, such as FIC-201")
    feeds: list[Name] = Field(
        default=[],
        description='ids of the valves whose loops this one acts on, such as ["TIC-102"]',
    )
    criticality: Annotated[int, Field(ge=1, le=3)] = Field(
        default=2, description="1, 2 or 3, where 3 is the valve the plant can least do without"
    )
    stroke: Annotated[str, AfterValidator(_known_stroke)] | None = Field(
        default=None, description=EXPECTED
    )
    stroke_curve: Annotated[str, AfterValidator(_known_points)] | None = Field(
        default=None, description=POINTS_EXPECTED
    )
    target_band: Positive | None = Field(
        default=None, description="how far PV may be from SP and still be on target, in PV's unit"
    )
    price_per_unit_hour: Price | None = Field(
        default=None, description="money for an hour with PV one unit away from SP"
    )
    price_per_hour_off_target: Price | None = Field(
        default=None, description="money for an hour off target; needs target_band"
    )
    price_per_stroke: Price | None = Field(
        default=None, description="money for a stem's travel of one full stroke"
    )
    source: Annotated[Name, AfterValidator(_existing_source)] = Field(
        description="the name of one of the [[sources]]"
    )
    tags: Tags = Field(
        description="a table of tags with at least the controller output: "
        '[valves.tags.op] with tag = "..."'
    )

    @property
    def prices(self) -> Prices | None:
        """What a deviation of this loop costs, where the plant file says so."""
        prices = Prices(
            per_unit_hour=self.price_per_unit_hour,
            per_hour_off_target=self.price_per_hour_off_target,
            per_stroke=self.price_per_stroke,
        )
        return None if prices == Prices() else prices

    @property
    def given_curve(self) -> KnownCurve | None:
        """The curve from OP to stroke, where the plant file gives it."""
        if self.stroke_curve is None:
            return None
        return KnownCurve(curve_of_points(self.stroke_curve), given=True)
