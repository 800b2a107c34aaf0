"""What a page shows of one mismatch, worked out before the template writes it."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup

from stemwatch.models.mismatch.findings import Finding, HeldOutFit, Mismatch
from stemwatch.models.recording import Recording
from stemwatch.service.report.heatmap import heat_map, largest
from stemwatch.service.report.overlay import overlay_of
from stemwatch.service.report.panels import Chart
from stemwatch.service.report.places import Facet, facets
from stemwatch.service.report.words import finite


@dataclass(frozen=True, kw_only=True)
class MismatchView:
    """``found`` with its pictures; ``anchor`` and ``tag`` name the valve in the page.

    ``held_back`` is why its effects do not stand among all valves of the run; empty where they do.
    """

    found: Mismatch
    anchor: str
    tag: str
    before: Markup | None
    after: Markup | None
    top: float  # rms in percent of span at the full colour of both maps
    facets: tuple[Facet, ...]
    overlay: Chart | None
    held_back: str = ""

    @property
    def brief(self) -> bool:
        """Nothing was left out or nothing could be said: one sentence is enough."""
        return self.found.finding in (Finding.NONE, Finding.NOT_TESTABLE)


@dataclass(frozen=True, kw_only=True)
class LeftOver:
    """One bar of the fit: ``rmse`` in percent of span, ``length`` in percent of the longest."""

    kind: str
    name: str
    rmse: float
    fit_percent: float | None
    length: float


def mismatch_view(
    found: Mismatch,
    recording: Recording | None,
    anchor: str,
    tag: str,
    held_back: str = "",
    overlay: Chart | None = None,
) -> MismatchView:
    """The view of ``found``; without ``recording`` it has the ``overlay`` that is given, if any."""
    top = largest(found.before, found.after)
    return MismatchView(
        found=found,
        anchor=anchor,
        tag=tag,
        before=heat_map(found.before, top, f"Residual of S and J alone, {tag}"),
        after=heat_map(found.after, top, f"Residual of the extended model, {tag}"),
        top=top,
        facets=tuple(facets(found)),
        overlay=overlay_of(recording, found.runs) or overlay,
        held_back=held_back,
    )


def left_over_bars(heldout: HeldOutFit) -> list[LeftOver]:
    """Rmse before and after beside what is systematic at all and the noise; known ones only."""
    rows = (
        ("naive", "S and J alone", heldout.rmse_naive, heldout.fit_naive),
        ("extended", "with what was left out", heldout.rmse_extended, heldout.fit_extended),
        ("narx", "NARX network, the ceiling", heldout.rmse_ceiling, None),
        ("floor", "noise floor", heldout.noise_floor, None),
    )
    known = [(*row[:2], rmse, row[3]) for row in rows if (rmse := finite(row[2])) is not None]
    longest = max((rmse for _, _, rmse, _ in known), default=0.0)
    return [
        LeftOver(
            kind=kind,
            name=name,
            rmse=rmse,
            fit_percent=finite(fit),
            length=round(100.0 * rmse / longest, 1) if longest > 0.0 else 0.0,
        )
        for kind, name, rmse, fit in known
    ]
