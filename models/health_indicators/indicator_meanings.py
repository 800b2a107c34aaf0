"""The table of health indicators: what each one means and which direction is worse.

For new screenings (``indicators.py``) and for numbers read back from the database, which stores
no meanings.
"""

from __future__ import annotations

_MODELS = {
    "stiction": "the stick-slip model",
    "narx": "the NARX network",
    "baseline": "the baseline network",
}

MEANINGS: dict[str, tuple[str, str]] = {
    "op_swing_percent": ("Range of OP, 1st to 99th percentile", "none"),
    "op_reversals": ("Times OP turned round", "up"),
    "usable_percent": ("Share of samples a fit could use", "down"),
    "loop_period_s": ("Period of OP's oscillation", "none"),
    "loop_regularity": ("Regularity of OP's oscillation, above 1 is regular", "up"),
    "slip_count": ("Jumps of the stem from rest", "up"),
    "slips_per_hour": ("Jumps of the stem per hour", "up"),
    "jumped_percent": ("Share of the stem's way made in jumps from rest", "up"),
    "mv_reversals": ("Times the stem turned round", "up"),
    "travel_percent": ("Way of the stem, noise left out", "up"),
    "travel_per_hour_percent": ("Way of the stem per hour", "up"),
    "position_noise_percent": ("Noise of the position", "none"),
    "S_percent": ("Dead band plus stick band, percent of OP span", "up"),
    "J_percent": ("Slip jump, percent of OP span", "up"),
    "S_of_swing_percent": ("S in percent of OP's own swing", "up"),
    "S_of_travel_percent": ("S in percent of travel, where OP strokes by a curve", "up"),
    "J_of_travel_percent": ("J in percent of travel, where OP strokes by a curve", "up"),
    "S_minus_J_percent": ("S - J: what a stroke stays behind after a reversal", "up"),
    # Its name until contract version 3; in the valve standards the dead band is S, not S - J.
    "dead_band_percent": ("Former name of S_minus_J_percent", "none"),
    "breakaway_scatter_percent": ("Scatter of the breakaways about their mean level", "none"),
    "naive_S_percent": ("S of a fit without dead time, lag and speed limit", "none"),
    "naive_J_percent": ("J of a fit without dead time, lag and speed limit", "none"),
    "position_zero_percent": ("Position minus OP, at rest", "none"),
    "dead_time_s": ("Command to stem, or a clock skew", "up"),
    "lag_rising_s": ("Actuator lag, position rising", "up"),
    "lag_falling_s": ("Actuator lag, position falling", "up"),
    "speed_rising_percent_per_s": ("Top speed of the stem, position rising", "down"),
    "speed_falling_percent_per_s": ("Top speed of the stem, position falling", "down"),
    "sticking_score": ("Likeness to a sticking valve by OP and PV alone, 0 to 1", "none"),
    "apparent_S_percent": ("S that OP and PV alone suggest, where sticking is suspected", "none"),
    "control_error_std": ("Standard deviation of SP - PV", "up"),
    "control_error_std_repaired": (
        "Standard deviation of SP - PV predicted for a valve that does not stick",
        "none",
    ),
    "variance_from_sticking_percent": (
        "Share of the variance of SP - PV that the sticking causes",
        "up",
    ),
    "control_error_from_sticking": ("Part of the mean of |SP - PV| that the sticking causes", "up"),
    "off_target_from_sticking_percent": ("Share of time off target that the sticking causes", "up"),
    "travel_from_sticking_per_hour_percent": (
        "Part of the stem's travel that the sticking causes",
        "up",
    ),
    "baseline_ratio": ("Residual of the baseline network against its own window", "up"),
}
for _key, _model in _MODELS.items():
    _held_out = f"of {_model}, free run, held out"
    MEANINGS[f"{_key}_rmse_percent"] = (f"Residual {_held_out}", "up")
    MEANINGS[f"{_key}_fit_percent"] = (f"Fit {_held_out}", "down")
    MEANINGS[f"{_key}_one_step_rmse_percent"] = (f"Residual of {_model}, one step ahead", "up")


def meaning_of(name: str) -> tuple[str, str]:
    """The meaning of an indicator, and the direction that is worse: "up", "down" or "none". A name
    that is not in the table (of an older version) is its own meaning."""
    return MEANINGS.get(name, (name.replace("_", " "), "none"))
