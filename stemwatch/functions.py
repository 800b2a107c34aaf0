"""``read``, ``screen``, ``explain``, ``twin``, ``plan_test`` and ``simulate``: what ``import
stemwatch`` promises."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Unpack, overload

from stemwatch.connectors.settings import nearest
from stemwatch.input_options import FileOptions, FilePath, OneValve, SignalInput, checked_options
from stemwatch.inputs import is_several, one_recording, several
from stemwatch.models.limits import Limits
from stemwatch.models.recording import Recording
from stemwatch.models.screening_result import Screening
from stemwatch.next_steps import LoopTwin, PlannedTest
from stemwatch.results import (
    ExplainedValve,
    ExplainedValves,
    ScreenedValve,
    ScreenedValves,
    explained,
    screened,
)

if TYPE_CHECKING:
    from stemwatch.service.explain.explain_recording import Explained

Ranges = Mapping[str, tuple[float, float]]
ManyValves = FilePath | Sequence[OneValve | FilePath] | Mapping[str, OneValve | FilePath]


class ReadAs(FileOptions, total=False):
    """The arguments of ``read`` beside the data, which ``screen`` and ``explain`` take as well."""

    op: SignalInput | None
    mv: SignalInput | None
    pv: SignalInput | None
    sp: SignalInput | None
    mode: SignalInput | None
    valve: str
    interval_s: float | None
    zone: str | None
    ranges: Ranges | None
    start: datetime | str | None
    stop: datetime | str | None


class ExplainAs(ReadAs, total=False):
    """The arguments of ``explain`` beside the data."""

    narx: bool


class ScreenAs(ExplainAs, total=False):
    """The arguments of ``screen`` beside the data."""

    mismatch: bool
    limits: Mapping[str, float] | None


# The start of simulated recordings: an arbitrary Monday morning.
_START = datetime(2026, 3, 2, 6, tzinfo=UTC)


def read(
    data: OneValve | FilePath | None = None,
    *,
    op: SignalInput | None = None,
    mv: SignalInput | None = None,
    pv: SignalInput | None = None,
    sp: SignalInput | None = None,
    mode: SignalInput | None = None,
    valve: str = "",
    interval_s: float | None = None,
    zone: str | None = None,
    ranges: Ranges | None = None,
    start: datetime | str | None = None,
    stop: datetime | str | None = None,
    **file_options: Unpack[FileOptions],
) -> Recording:
    """One valve's recording out of a DataFrame, arrays or a file, on one even clock.

    Args:
        data: A pandas DataFrame, a row for each instant and a column for each signal, its index
            the times; the path of a historian export or Parquet file; or nothing, with the samples
            in ``op``, ``mv``, ...
        op: Controller output: the name of a column or tag, or its samples, shape (n,).
        mv: Measured valve position, likewise. Without it no verdict is possible.
        pv: Process variable, likewise; in its own unit.
        sp: Set point, likewise; in the unit of ``pv``.
        mode: Controller mode, likewise: 1 or "AUTO" automatic, 0 or "MAN" manual.
        valve: The valve's name; of a source with several valves, which one.
        interval_s: Seconds between rows, where the data has no times.
        zone: IANA zone of times without one, such as ``"Europe/Berlin"``. Without it the date of
            such times stays unknown, and durations are right.
        ranges: Values at 0 % and at 100 % of span of a signal, where it is not in percent:
            ``{"op": (4, 20), "mv": (0, 1)}`` for milliampere and a fraction.
        start: First instant to read, a datetime or ISO text such as ``"2026-03-02 06:00"``. One
            without an offset is a local time of ``zone``.
        stop: Instant to end before, likewise.
        **file_options: How a file is written, where the reader should not decide it: ``encoding``,
            ``separator``, ``decimal``, ``day_first``, ``time_column``, ``time_format``,
            ``tag_column``, ``value_column``, ``quality_column``, ``good_quality``,
            ``ambiguous_hour``, ``missing_hour`` (docs/historian-formats.md).

    Without ``op`` the columns called ``op``, ``mv``, ``pv``, ``sp`` and ``mode`` are taken, else
    what the names leave no doubt about, such as ``FIC101.OP``. OP and MV are expected in percent
    of span. Uneven times are laid on an even clock: each sample goes to the nearest instant, an
    instant without one is MISSING, and nothing is interpolated. NaN is MISSING. What was decided
    stands in ``recording.provenance.decisions``.

    Returns:
        The ``Recording``: signals of shape (n,) with the quality of each sample.

    Raises:
        ConnectorError: The source cannot be read, has no such column (the nearest are named),
            holds several valves and none was chosen, or OP and MV are one column.
        ValueError: Arrays without ``interval_s``, of unequal length or of another shape than (n,);
            a range that is none; a time without a zone.
        TypeError: ``data`` is nothing of the above.

    Example:
        >>> import numpy as np, pandas as pd, stemwatch as sw
        >>> times = pd.date_range("2026-03-02 06:00", periods=600, freq="s", tz="UTC")
        >>> op = 50 + 10 * np.sin(np.arange(600) / 40)
        >>> frame = pd.DataFrame({"FIC101.OP": op, "ZT101": np.roll(op, 3)}, index=times)
        >>> sw.read(frame, op="FIC101.OP", mv="ZT101")
        FIC101: op, mv; 600 samples of 1 s (10 min) from 2026-03-02 06:00 UTC, 100 % usable
        >>> sw.read(op=op, mv=np.roll(op, 3), interval_s=0.5, valve="FIC101")
        FIC101: op, mv; 600 samples of 0.5 s (5 min), date not known, 100 % usable
    """
    signals = {"op": op, "mv": mv, "pv": pv, "sp": sp, "mode": mode}
    inputs = checked_options(signals, valve, interval_s, zone, ranges, start, stop, file_options)
    return one_recording(data, inputs)


@overload
def screen(data: OneValve | None = None, **how: Unpack[ScreenAs]) -> ScreenedValve: ...


@overload
def screen(data: ManyValves, **how: Unpack[ScreenAs]) -> ScreenedValves: ...


def screen(
    data: OneValve | ManyValves | None = None,
    *,
    op: SignalInput | None = None,
    mv: SignalInput | None = None,
    pv: SignalInput | None = None,
    sp: SignalInput | None = None,
    mode: SignalInput | None = None,
    valve: str = "",
    interval_s: float | None = None,
    zone: str | None = None,
    ranges: Ranges | None = None,
    start: datetime | str | None = None,
    stop: datetime | str | None = None,
    narx: bool = True,
    mismatch: bool = True,
    limits: Mapping[str, float] | None = None,
    **file_options: Unpack[FileOptions],
) -> ScreenedValve | ScreenedValves:
    """How far a valve sticks (S) and jumps (J), with intervals, a verdict and the reason for it.

    Args:
        data: One valve as ``read`` takes it (a DataFrame, a ``Recording``, arrays as ``op`` and
            ``mv``), or several: the path of a file, folder or pattern, a list, or a dict by the
            valve's name.
        op, mv, pv, sp, mode, valve, interval_s, zone, ranges, start, stop, **file_options: As
            ``read`` takes them; they hold for every entry of a list or dict.
        narx: Train a NARX network beside the stick-slip model, for comparison. False saves a
            second or two a valve; verdict, S and J rest on the stick-slip model.
        mismatch: Look for what S and J leave out. False is quicker, and S and J are then those of
            the stick-slip model alone.
        limits: Limits of the verdict other than the defaults, such as ``{"sticky_S_percent": 2}``
            (the section ``[limits]`` of docs/plant-file.md).

    The stick-slip element is that of Choudhury, Thornhill and Shah: S is dead band plus stick
    band, how far OP must move after a reversal before the stem lets go, J the slip jump that
    follows, both in percent of OP span. Of several valves, what S and J leave out is held to a
    false discovery rate of 5 % over all of them (Benjamini and Hochberg). A valve that cannot be
    judged is ``undetermined`` with the reason; in a list or a path the others are not affected.

    Returns:
        A ``ScreenedValve`` for one valve: ``verdict``, ``reason``, ``advice``, ``S``, ``J``,
        ``to_dict()``, ``plot()``. ``ScreenedValves`` for several, the most urgent first in
        ``to_frame()``.

    Raises:
        ConnectorError, ValueError, TypeError: As ``read``, for one valve and for what no entry can
            be; of several valves one that cannot be read is a result with the reason.

    References:
        Choudhury, Thornhill, Shah: Modelling valve stiction. Control Engineering Practice 13
        (2005) 641-658. https://doi.org/10.1016/j.conengprac.2004.05.005

        Benjamini, Hochberg: Controlling the false discovery rate. J. Royal Statistical Society B
        57 (1995) 289-300. https://doi.org/10.1111/j.2517-6161.1995.tb02031.x

    Example:
        >>> import stemwatch as sw
        >>> found = sw.screen(sw.simulate(S=5, J=1.5, minutes=30), narx=False, mismatch=False)
        >>> found.verdict
        <Verdict.STICKY: 'sticky'>
        >>> found.S.low < 5 < found.S.high
        True
    """
    from stemwatch.models.screening.screen import Case, Options
    from stemwatch.models.screening.screen import screen as screen_cases

    signals = {"op": op, "mv": mv, "pv": pv, "sp": sp, "mode": mode}
    inputs = checked_options(signals, valve, interval_s, zone, ranges, start, stop, file_options)
    options = Options(narx=narx, mismatch=mismatch, limits=_limits(limits))
    many = is_several(data)
    recordings = several(data, inputs) if many else [one_recording(data, inputs)]
    cases = [Case(recording=item) for item in recordings if isinstance(item, Recording)]
    fitted = iter(screen_cases(cases, options))
    screenings = [next(fitted) if isinstance(item, Recording) else item for item in recordings]
    valves, discoveries = screened(screenings)
    return ScreenedValves(valves, discoveries, zone) if many else valves[0]


@overload
def explain(data: OneValve | None = None, **how: Unpack[ExplainAs]) -> ExplainedValve: ...


@overload
def explain(data: ManyValves, **how: Unpack[ExplainAs]) -> ExplainedValves: ...


def explain(
    data: OneValve | ManyValves | None = None,
    *,
    op: SignalInput | None = None,
    mv: SignalInput | None = None,
    pv: SignalInput | None = None,
    sp: SignalInput | None = None,
    mode: SignalInput | None = None,
    valve: str = "",
    interval_s: float | None = None,
    zone: str | None = None,
    ranges: Ranges | None = None,
    start: datetime | str | None = None,
    stop: datetime | str | None = None,
    narx: bool = True,
    **file_options: Unpack[FileOptions],
) -> ExplainedValve | ExplainedValves:
    """Where S and J fail a recording, which physics they leave out, and S and J restated with it.

    A long record (from four times ``fitted_samples`` on) is explained as the windows that tell
    most, and what they agree on counts; ``screen`` fits the one stretch that tells most.

    Args:
        data: As ``screen`` takes it.
        op, mv, pv, sp, mode, valve, interval_s, zone, ranges, start, stop, **file_options: As
            ``read`` takes them.
        narx: Train a NARX network to say how much of the residual is systematic at all.

    Returns:
        An ``ExplainedValve`` for one valve: ``sentence``, ``effects``, ``S``, ``J``,
        ``to_dict()``, ``plot()``. ``ExplainedValves`` for several.

    Raises:
        ConnectorError, ValueError, TypeError: As ``screen``.

    Example:
        >>> import stemwatch as sw
        >>> found = sw.explain(sw.simulate(S=3, J=1, minutes=20), narx=False)
        >>> found.finding
        <Finding.NONE: 'none'>
    """
    signals = {"op": op, "mv": mv, "pv": pv, "sp": sp, "mode": mode}
    inputs = checked_options(signals, valve, interval_s, zone, ranges, start, stop, file_options)
    many = is_several(data)
    recordings = several(data, inputs) if many else [one_recording(data, inputs)]
    valves, discoveries = explained([_explained(item, narx) for item in recordings])
    return ExplainedValves(valves, discoveries) if many else valves[0]


def twin(
    data: OneValve | FilePath | ScreenedValve | None = None, **how: Unpack[ReadAs]
) -> LoopTwin:
    """The loop around a valve, fitted, to be run again: repaired, tuned otherwise, with a knocker.

    Args:
        data: What ``screen`` gave for the valve, or one valve as ``read`` takes it, which is then
            screened. It needs OP, position and PV, and the set point where there is one.
        **how: As ``read`` takes them.

    The controller's law and the process are fitted to OP, position, PV and set point; the valve has
    its fitted S and J. What else moved the loop is kept and played again, so that each change shows
    what it would have done on the same day, with a 90 % interval (docs/twin.md).

    Returns:
        A ``LoopTwin``: ``to_frame()`` compares the usual changes, ``what_if(S=0, J=0)`` predicts
        one of your own.

    Raises:
        ConnectorError, TypeError: As ``read``.
        ValueError: As ``read``; or the loop cannot be run again, with the reason.

    Example:
        >>> import stemwatch as sw
        >>> loop = sw.twin(sw.simulate(S=5, J=1.5, minutes=30))
        >>> saved = loop.what_if(S=0, J=0).fall("error_std", squared=True)  # % of the variance
        >>> saved.low < saved.value < saved.high
        True
    """
    from stemwatch.models.screening.repair import loop_of

    found = data if isinstance(data, ScreenedValve) else _screened_for_its_twin(read(data, **how))
    if isinstance(data, ScreenedValve) and how:
        raise ValueError(f"{', '.join(how)}: a valve that was screened has its signals already")
    if found.recording is None:
        raise ValueError(f"{found.valve}: the loop cannot be run again: {found.reason}")
    loop = loop_of(found.recording, found.screening)
    if isinstance(loop, str):
        raise ValueError(f"{found.valve}: the loop cannot be run again: {loop}")
    return LoopTwin(found.valve, loop)


def plan_test(
    data: OneValve | FilePath | ScreenedValve | ExplainedValve | None = None,
    *,
    amplitude: float = 5.0,
    minutes: float = 10.0,
    pv_upset: float | None = None,
    op_low: float = 5.0,
    op_high: float = 95.0,
    op_now: float | None = None,
    **how: Unpack[ReadAs],
) -> PlannedTest:
    """The field test that would tell what a recording left open, within limits.

    Args:
        data: What ``screen`` or ``explain`` gave for the valve, or one valve as ``read`` takes it,
            which is then explained.
        amplitude: How far OP may go either way, percent.
        minutes: How long the test may take.
        pv_upset: How far PV may change, in its unit; else as far as it moved in the recording.
        op_low, op_high: Limits of OP, percent.
        op_now: Where OP is, percent; else where the recording ended.
        **how: As ``read`` takes them.

    The moves are chosen so that the two explanations that are hardest to tell apart differ most,
    as in T-optimal designs (Atkinson and Fedorov 1975, https://doi.org/10.1093/biomet/62.1.57);
    a valve without a verdict gets the bump test that would give one (docs/plan-test.md). A person
    sets OP: stemwatch never writes to a plant.

    Returns:
        A ``PlannedTest``: ``sentence``, ``probability``, ``to_frame()`` with the values of OP,
        ``write(folder)`` for the sheet as HTML and PDF.

    Raises:
        ConnectorError, TypeError: As ``read``.
        ValueError: As ``read``; a limit that makes no sense.

    Example:
        >>> import stemwatch as sw
        >>> test = sw.plan_test(sw.simulate(S=3, J=1, minutes=20), minutes=3)
        >>> test.kind
        <PlanKind.NOTHING_LEFT: 'nothing_left'>
    """
    from stemwatch.models.field_test.programme import TestLimits
    from stemwatch.service.field_test.plan_from_screening import plan_of, plan_of_screening
    from stemwatch.service.field_test.sheet import sheet_of

    limits = TestLimits(
        amplitude=amplitude,
        duration_s=60.0 * minutes,
        pv_upset=pv_upset,
        op_low=op_low,
        op_high=op_high,
    )
    known = isinstance(data, ScreenedValve | ExplainedValve)
    if known and how:
        raise ValueError(f"{', '.join(how)}: this valve has its signals already")
    if isinstance(data, ScreenedValve):
        plan = plan_of_screening(data.screening, limits, op_now)
        return PlannedTest(sheet_of(plan, data.valve))
    found = data if isinstance(data, ExplainedValve) else explain(read(data, **how), narx=False)
    plan = plan_of(found.mismatch, limits, judged=False, op=op_now)
    return PlannedTest(sheet_of(plan, found.valve))


def _screened_for_its_twin(recording: Recording) -> ScreenedValve:
    return screen(recording, narx=False)


def simulate(
    *,
    S: float = 4.0,
    J: float = 1.0,
    minutes: float = 60.0,
    interval_s: float = 1.0,
    seed: int = 1,
    valve: str = "FIC-101",
    noise: float = 0.05,
    start: datetime = _START,
) -> Recording:
    """A recording with known S and J: a flow loop whose valve sticks, simulated by force balance.

    Args:
        S: Dead band plus stick band that the OP-MV loop shows, percent of OP span; 0 or more.
        J: Slip jump, percent of OP span; 0 or more. A valve with S and J below 1 is healthy.
        minutes: Length of the recording.
        interval_s: Seconds between samples.
        seed: Draws noise, disturbances and nameplate; the same seed gives the same recording.
        valve: Its name.
        noise: Standard deviation of the noise of the measured position, percent of span.
        start: Time of the first sample, aware.

    The simulator integrates the force balance of spring, packing and stem at one millisecond in a
    closed PI loop with a wandering load; it shares no code with what is fitted (docs/method.md).

    Returns:
        The ``Recording`` with OP, MV, PV, SP and mode.

    Raises:
        ValueError: S, J or noise is negative, or there are fewer than two samples.

    Example:
        >>> import stemwatch as sw
        >>> sw.simulate(S=5, J=2, minutes=10)  # doctest: +ELLIPSIS
        FIC-101: op, mv, pv, sp, mode; 600 samples of 1 s (10 min) from ... 06:00 UTC, 100 % usable
    """
    from stemwatch.simulation import sticking_flow_loop

    recording = sticking_flow_loop(
        S=S,
        J=J,
        duration_s=60.0 * minutes,
        interval_s=interval_s,
        seed=seed,
        tag=valve,
        noise=noise,
    )
    return replace(recording, start=start)


def _explained(recording: Recording | Screening, narx: bool) -> Explained:
    """The explanation of a recording; of one that could not be read, that nothing is known."""
    from stemwatch.models.mismatch.findings import Mismatch
    from stemwatch.service.explain.explain_recording import Explained, explain_recording
    from stemwatch.service.presenter.wording import as_sentences

    source = recording.provenance.source
    if isinstance(recording, Recording):
        return explain_recording(recording, source, narx=narx)
    mismatch = Mismatch.unknown(as_sentences((*recording.quality.reasons, *recording.still_seen)))
    return Explained(source=source, valve=recording.valve, mismatch=mismatch)


def _limits(limits: Mapping[str, float] | None) -> Limits:
    """The default limits with those given. Raises ``ValueError`` for a name that is none."""
    limit_names = [field.name for field in fields(Limits)]
    for name in limits or {}:
        if name not in limit_names:
            suggestion = nearest(name, limit_names)
            raise ValueError(
                f"limits: {name!r} is no limit{suggestion}; expected some of {limit_names}"
            )
    return Limits(**{name: float(value) for name, value in (limits or {}).items()})
