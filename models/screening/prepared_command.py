"""OP as it commands the stem: with the right clock, finer than its coarse steps, percent of travel.

Each step needs the one before. An OP that was stored late hides its steps, and coarse steps hide
how the stroke depends on OP.
"""

from __future__ import annotations

from dataclasses import dataclass

from stemwatch.models.mismatch.refined_curve import refined
from stemwatch.models.record_checks.data_quality import Obstacle
from stemwatch.models.record_checks.validity_checks import reversed_obstacles
from stemwatch.models.record_checks.wiring_checks import perhaps_exchanged, wiring_obstacles
from stemwatch.models.recording import Recording
from stemwatch.models.stickslip.clock_shift import LateEvidence, brought_forward, late_evidence
from stemwatch.models.stickslip.find_stroke_curve import stroke_curve_of
from stemwatch.models.stickslip.first_look import FirstLook
from stemwatch.models.stickslip.op_within_steps import op_within_steps
from stemwatch.models.stickslip.stroke_curve import KnownCurve, StrokeCurve, in_travel


@dataclass(frozen=True, kw_only=True)
class PreparedCommand:
    """A recording with the command that is fitted, and why it should not be, if so.

    ``on_time`` has OP as it was stored, shifted ``late_s`` earlier (units of the own clock), for
    the network and for plots. ``commanded`` is what S and J are fitted to: OP also reconstructed
    from PV and set point where its steps are coarse (``within_steps``), and in percent of travel
    where there is a ``curve`` from OP to stroke. ``first_look`` is one at ``commanded``.
    ``perhaps_exchanged``: OP seems late, and may as well be the position.
    """

    on_time: Recording
    commanded: Recording
    late_s: float
    within_steps: bool
    curve: StrokeCurve | None
    curve_changed: str  # how it differs from the known curve, or empty
    first_look: FirstLook | None
    obstacles: tuple[Obstacle, ...]
    perhaps_exchanged: bool = False

    @property
    def unsure_degree(self) -> int:
        """The degree of the curve's uncertain part; 0 where OP is percent of travel."""
        return self.curve.unsure_degree if self.curve else 0


def prepare_command(as_stored: Recording, known_curve: KnownCurve | None) -> PreparedCommand:
    """The command in a recording on its own clock, without the samples that record effects spoilt.

    ``known_curve`` is what is known of its curve from OP to stroke.
    """
    look_as_stored = FirstLook.of(as_stored)
    late = late_evidence(as_stored, look_as_stored)
    prepared = _prepared(as_stored, known_curve, late, look_as_stored)
    if prepared.curve is None or prepared.late_s == 0.0:
        return prepared
    # An OP that is not percent of travel, read as if it were, may look late.
    through_curve = late_evidence(in_travel(as_stored, prepared.curve))
    if through_curve.late_s(as_stored.interval_s) == prepared.late_s:
        return prepared
    return _prepared(as_stored, known_curve, through_curve, look_as_stored)


def _prepared(
    as_stored: Recording,
    known_curve: KnownCurve | None,
    late: LateEvidence,
    look_as_stored: FirstLook | None,
) -> PreparedCommand:
    """The command where OP is as ``late`` as that."""
    late_s = late.late_s(as_stored.interval_s)
    on_time = brought_forward(as_stored, late_s)
    resolved = op_within_steps(on_time)
    finer = on_time if resolved is None else resolved.recording
    found_curve, curve_changed = stroke_curve_of(finer, known_curve)
    curve = refined(finer, found_curve)
    commanded = in_travel(finer, curve)
    first_look = look_as_stored if commanded is as_stored else FirstLook.of(commanded)
    obstacles = [] if curve else reversed_obstacles(finer)
    # An OP that answers PV as a controller does cannot be a position, however late it is.
    stored_late = as_stored if late_s > 0.0 and not late.by_controller else None
    obstacles = obstacles or wiring_obstacles(commanded, stored_late, first_look)
    return PreparedCommand(
        on_time=on_time,
        commanded=commanded,
        late_s=late_s,
        within_steps=resolved is not None,
        curve=curve,
        curve_changed=curve_changed,
        first_look=first_look,
        obstacles=tuple(obstacles),
        perhaps_exchanged=stored_late is not None
        and not obstacles
        and perhaps_exchanged(commanded, stored_late, late_s, first_look),
    )
