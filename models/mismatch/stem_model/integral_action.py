"""The integral of a positioner, which adds to the force the error of the position as it sums up.

Outside a dead zone ``b`` of the error ``e = p - MV`` the integral grows by ``dv/dt = e/T_i``, and
within it stands still; the force on the stem is ``p + v - x``. Makers name the zone so (Fisher
DVC6200: integral dead zone), because without one every sticking stem would be hunted: the integral
beside a stem at rest beyond ``b`` grows until the stem lets go, with no change of OP. The pressure
lies between none and that of the supply, and so does ``p + v``.
"""

from __future__ import annotations

from stemwatch.models.mismatch.stem_model.lanes import never_raises

# What no pressure and that of the supply are on a spring's range of 20 to 100 kPa, percent, with
# the reserve of a quarter of the range that actuators are sized with.
_NO_PRESSURE, _SUPPLY = -25.0, 125.0


@never_raises
def integral_after(
    integral: float, command: float, read: float, dt: float, rate: float, zone: float
) -> float:
    """The integral after a sample at the end of which the position was ``read``, percent of MV.

    ``rate`` is ``1/T_i`` and ``zone`` the dead zone, percent.
    """
    error = command - read
    if rate <= 0.0 or abs(error) <= zone:
        return integral
    grown: float = integral + dt * rate * error
    return min(max(grown, _NO_PRESSURE - command), _SUPPLY - command)
