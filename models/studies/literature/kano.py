"""Kano and co-workers (2004): the input at which the stem last stopped is the state."""

from __future__ import annotations

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.model import KernelModel
from stemwatch.models.studies.literature.shared_parameters import UNREAD, band, jump


@compiled()
def run_kano(
    op: Floats, S_up: float, J_up: float, S_down: float, J_down: float, y0: float, out: Floats
) -> None:
    """Free run over ``op`` (n,) from ``y0`` into ``out`` (n,), percent.

    ``S_up`` is what a reversal from falling to rising needs, ``J_up`` what a rising stem that
    stopped needs to rise on; the same, mirrored, for ``S_down`` and ``J_down``.
    """
    offset_up, offset_down = 0.5 * (S_up - J_up), 0.5 * (S_down - J_down)
    rising, stopped, y = True, True, y0
    us = y0 + offset_up
    out[0] = y
    for k in range(1, op.size):
        u = op[k]
        step = u - op[k - 1]
        if not stopped and (step <= 0.0 if rising else step >= 0.0):
            us, stopped = op[k - 1], True
        if stopped:
            travelled = u - us
            if rising:
                up, down = travelled > J_up, -travelled > S_down
            else:
                up, down = travelled > S_up, -travelled > J_down
            if up or down:
                rising, stopped = up, False
        if not stopped:
            y = u - offset_up if rising else u + offset_down
        out[k] = y


def _symmetric(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
    run_kano(op, q[0], q[1], q[0], q[1], y0, out)


def _asymmetric(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
    run_kano(op, q[0], q[1], q[2], q[3], y0, out)


_PAPER = (
    "Kano, Maruta, Kugemoto and Shimizu, Practical model and detection algorithm for valve "
    "stiction, IFAC DYCOPS (2004)"
)

KANO = KernelModel(
    name="kano",
    source=f"{_PAPER}; {UNREAD}, and the flow agrees with published code.",
    parameters=(band(), jump()),
    text=(
        "us is the input at which the stem stopped, d its last direction. It slips when "
        "-d (u - us) > S, which turns d, or when d (u - us) > J; while it moves y = u - d "
        "(S - J)/2; it stops when d (u[k] - u[k-1]) <= 0. The direction is the stem's, not the "
        "input's, so that stochastic inputs are handled like deterministic ones."
    ),
    limits=(
        "Those of canonical: a repeated input sample stops the stem (A3, A10), J above S has no "
        "friction behind it (A5).",
        "Some published code stops the stem on a change of the input's own direction instead; "
        "this does not.",
    ),
    run=_symmetric,
)
KANO_ASYMMETRIC = KernelModel(
    name="kano_asymmetric",
    source=f"{_PAPER}, its variant with separate numbers for each direction; {UNREAD}.",
    parameters=(
        band("S_up", " before the stem rises"),
        jump("J_up", " of a rising stem"),
        band("S_down", " before the stem falls"),
        jump("J_down", " of a falling stem"),
    ),
    text=(
        "As kano, with S_up and J_up for a slip upward and S_down and J_down for one downward; "
        "the offset while the stem moves is (S_up - J_up)/2 or (S_down - J_down)/2."
    ),
    limits=(
        "Friction that is larger upward by as much as it is smaller downward is a shift of the "
        "command, which the free zero of a fit takes up.",
        "A force balance needs S_up - J_up = S_down - J_down; other choices have no friction "
        "behind them.",
        "Those of kano.",
    ),
    run=_asymmetric,
)
