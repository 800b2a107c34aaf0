"""The parameters that most models share, and the two ways to write them.

``S`` (dead band plus stick band) and ``J`` (slip jump) against the friction levels ``fs``
(breakaway) and ``fd`` (sliding), all in percent of OP::

    fs = (S + J)/2    fd = (S - J)/2    S = fs + fd    J = fs - fd

This is the newer meaning of ``S`` (Choudhury, Kano); in older work it is the stick band alone.
"""

from __future__ import annotations

from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.model import Parameter

MOST = 200.0  # percent of OP
UNREAD = "quoted from memory"


def band(name: str = "S", suffix: str = "") -> Parameter:
    """S, percent of OP."""
    meaning = f"dead band plus stick band{suffix}: travel of OP from a reversal to the slip"
    return _level(name, 5.0, meaning)


def jump(name: str = "J", suffix: str = "") -> Parameter:
    """J, percent of OP."""
    return _level(name, 2.0, f"slip jump{suffix}: height of the slip")


def breakaway() -> Parameter:
    """fs, percent of OP."""
    return _level("fs", 3.5, "static friction level: imbalance at which a resting stem lets go")


def sliding() -> Parameter:
    """fd, percent of OP; below 0 the stem runs ahead of its command, which friction cannot
    cause.
    """
    meaning = "kinetic friction level: imbalance while the stem slides; below 0 an overshoot"
    return _level("fd", 1.5, meaning, lower=-MOST)


def _level(name: str, default: float, meaning: str, lower: float = 0.0) -> Parameter:
    return Parameter(
        name=name,
        unit="%",
        lower=lower,
        upper=MOST,
        default=default,
        meaning=meaning,
        per_percent=1.0,
    )


def not_above_breakaway(parameters: Floats) -> str | None:
    """The objection of a model whose first two parameters are fs and fd: J = fs - fd and
    S = fs + fd must not be negative."""
    fs, fd = parameters[:2].tolist()
    if abs(fd) <= fs:
        return None
    return f"expected |fd| <= fs, received fs = {fs:g} % and fd = {fd:g} %"
