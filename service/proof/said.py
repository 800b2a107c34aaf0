"""What the judge said of a recording, read from the JSON of ``stemwatch explain``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

NOTHING = "nothing named"


@dataclass(frozen=True, kw_only=True)
class Name:
    """An effect that was named: its slug, and all that the recording cannot tell from it."""

    slug: str
    members: tuple[str, ...]

    def holds(self, slug: str) -> bool:
        """Whether ``slug`` is it, or one of its class."""
        return slug == self.slug or slug in self.members


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """S and J in percent of span; ``None`` where the judge would not say."""

    S: float | None = None
    J: float | None = None


@dataclass(frozen=True, kw_only=True)
class Said:
    """One judged recording: the names, strongest first, and the figures beside them.

    ``fit_naive`` and ``fit_extended`` in percent, on data that the fit did not see; ``reason`` why
    there is no S, where there is none.
    """

    file: str
    verdict: str
    names: tuple[Name, ...] = ()
    record_effects: tuple[str, ...] = ()
    not_testable: tuple[str, ...] = ()
    naive: Numbers = field(default_factory=Numbers)
    restated: Numbers = field(default_factory=Numbers)
    fit_naive: float | None = None
    fit_extended: float | None = None
    rmse_naive: float | None = None
    rmse_extended: float | None = None
    seconds: float = 0.0
    reason: str = ""

    @property
    def label(self) -> str:
        """What was said, in a table of confusions."""
        if self.names:
            return " + ".join(name.slug for name in self.names)
        return NOTHING if self.verdict in ("none", "") else self.verdict


def read_said(found: Mapping[str, Any]) -> Said:
    """One object of the JSON of ``stemwatch explain``.

    Raises ``ValueError`` with what is missing where it does not follow the contract.
    """
    try:
        heldout, stiction = found["heldout"] or {}, found["stiction"] or {}
        return Said(
            file=Path(found["recording"]).name,
            verdict=str(found["verdict"]),
            names=tuple(
                Name(slug=one["slug"], members=tuple(one["class"])) for one in found["effects"]
            ),
            record_effects=_slugs(found["record_effects"]),
            not_testable=_slugs(found["not_testable"]),
            naive=_numbers(stiction.get("naive")),
            restated=_numbers(stiction.get("restated")),
            fit_naive=heldout.get("fit_naive"),
            fit_extended=heldout.get("fit_extended"),
            rmse_naive=heldout.get("rmse_naive"),
            rmse_extended=heldout.get("rmse_extended"),
            seconds=float(found["seconds"]),
            reason=_no_s(stiction.get("naive")),
        )
    except KeyError as missing:
        raise ValueError(
            f"the JSON of explain lacks {missing} for {found.get('recording', 'a recording')}; "
            f"received the fields {sorted(found)}"
        ) from missing


def _slugs(found: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    return tuple(str(one["slug"]) for one in found if one.get("slug"))


def _no_s(found: Mapping[str, Any] | None) -> str:
    return str(((found or {}).get("S") or {}).get("reason") or "")


def _numbers(found: Mapping[str, Any] | None) -> Numbers:
    """S and J; a missing object or a null value is no number."""
    values = {name: ((found or {}).get(name) or {}).get("value") for name in ("S", "J")}
    return Numbers(S=values["S"], J=values["J"])
