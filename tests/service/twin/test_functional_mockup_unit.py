"""The valve as an FMU, run by a foreign importer (FMPy), against the kernels that fitted it."""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from stemwatch.models.field_test.rival_runs import RivalRuns
from stemwatch.models.mismatch.open_question import OpenQuestion, RivalModel
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.stickslip import kernel
from stemwatch.models.stickslip.evaluator import ALWAYS, ONLY_WHEN_TURNING
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.models.valve_chain import CHAIN_PARAMETERS, ValveChain, valve_chain
from stemwatch.service.twin.simulation_model.write_model import functional_mockup_unit
from tests.models.health_indicators.test_response_figures import effect, judged, percent
from tests.models.mismatch.test_terms import MATTERS

HOUR = 3600
NEAR = 1e-9  # percent
COMPILER = next((path for path in map(shutil.which, ("cc", "gcc", "clang")) if path), None)
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler here")
NEUTRAL = {parameter.name: parameter.neutral for parameter in CHAIN_PARAMETERS}
LARGE = {slug: large for slug, _, large in MATTERS}
LARGE["sensor_drift"] = [-0.7, 0.4, -0.3, 0.2]
LARGE["motor_drive"] = [20.0, 3.0, 3.0]  # meets the limit of its voltage at an error of 6.7 %


def wandering_op(samples: int = HOUR, seed: int = 3) -> np.ndarray:
    """OP of a loop that hunts and is disturbed, held now and then, percent."""
    rng = np.random.default_rng(seed)
    k = np.arange(samples)
    op = 50.0 + 8.0 * np.sin(k / 37.0) + np.cumsum(rng.normal(0.0, 0.15, samples))
    op += np.where(k % 600 > 400, 6.0, 0.0)
    held = np.maximum.accumulate(np.where((k // 90) % 4 == 3, 0, k))
    return np.clip(op[held], 5.0, 95.0)


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    """A function that makes the FMU of a chain and gives its unpacked folder; a chain of the same
    kind is compiled once, since its numbers are only start values; with ``its_values`` they are its
    own."""
    made: dict[object, Path] = {}

    def folder(chain: ValveChain, its_values: bool = False) -> Path:
        values = tuple(chain.values.items()) if its_values else ()
        key = (chain.one_actuator, chain.unit_s, chain.curve, values)
        if key not in made:
            file = tmp_path_factory.mktemp("fmu") / "valve.fmu"
            answer = functional_mockup_unit(chain)
            assert answer.no_binary == ""
            file.write_bytes(answer.content)
            assert validate_fmu(str(file)) == []
            made[key] = Path(fmpy.extract(str(file), unzipdir=str(file.with_suffix(""))))
        return made[key]

    return folder


def simulated(folder: Path, chain: ValveChain, op: np.ndarray, step_s: float, **start: float):
    """Times and positions at the communication points of a run over ``op``."""
    dt = chain.values["sample_time"]
    series = np.array(
        [(k * dt, value) for k, value in enumerate(op)], dtype=[("time", float), ("OP", float)]
    )
    result = fmpy.simulate_fmu(
        str(folder),
        start_time=0.0,
        stop_time=(op.size - 1) * dt,
        step_size=step_s,
        output_interval=step_s,
        start_values={**chain.values, **start},
        input=series,
        output=["position"],
    )
    return result["time"], result["position"]


def as_held(op: np.ndarray, dt: float, step_s: float) -> np.ndarray:
    """(n,) the OP that each sample of the valve sees when it is given every ``step_s``: that of the
    last communication point, by FMPy's straight line between the given values."""
    sample = np.arange(op.size) * dt
    given = np.floor(sample / step_s + 1e-9) * step_s
    return np.interp(given, sample, op)


def before(times: np.ndarray, dt: float) -> np.ndarray:
    """The sample that the position at each of ``times`` > 0 is that of: the last one before it."""
    return np.ceil(times / dt - 1e-6).astype(int) - 1


def by_quick_fit(chain: ValveChain, op: np.ndarray) -> np.ndarray:
    """(n,) the kernel of S, J and actuator over ``op``."""
    own = chain.values
    command = op if chain.curve is None else chain.curve.command(op)
    per_op = abs(own["travel_per_op"])
    q = np.zeros(kernel.N_PARAMETERS)
    q[kernel.S], q[kernel.J] = own["S"] * per_op, own["J"] * per_op
    q[kernel.DEAD_TIME_S] = own["dead_time"]
    q[kernel.LAG_UP_S], q[kernel.LAG_DOWN_S] = own["lag_rising"], own["lag_falling"]
    q[kernel.RATE_UP], q[kernel.RATE_DOWN] = own["speed_rising"], own["speed_falling"]
    q[kernel.ZERO], q[kernel.GAIN] = own["reading_zero"], 1.0
    q[kernel.RESTICK] = own["restick_speed"]
    marks = np.zeros(op.size, dtype=np.uint8)
    marks[0] = kernel.START
    out, mv = np.empty(op.size), np.full(op.size, own["position_start"])
    kernel.simulate(command, mv, marks, own["sample_time"], q, out)
    return out


def quick_fit(curve: StrokeCurve | None = None, **own: float) -> ValveChain:
    """A chain as the quick fit gives it."""
    values = NEUTRAL | {"S": 5.0, "J": 1.5, "travel_per_op": 1.0 if curve is None else curve.slope}
    return ValveChain(valve="FIC-104", values=values | own, curve=curve)


BENT = StrokeCurve(op=(0.0, 30.0, 60.0, 100.0), travel=(100.0, 80.0, 30.0, 0.0))


PLAIN = quick_fit()
ACTUATOR = quick_fit(dead_time=2.3, lag_rising=3.0, lag_falling=1.0, speed_rising=0.8)
CURVED = quick_fit(BENT, dead_time=1.0, lag_rising=2.0, lag_falling=2.0, reading_zero=1.3)


@needs_compiler
@pytest.mark.parametrize(
    ("chain", "step_s"),
    [
        *((PLAIN, step_s) for step_s in (0.5, 1.0, 5.0)),
        *((ACTUATOR, step_s) for step_s in (0.1, 0.5, 1.0, 2.0, 5.0)),
        *((CURVED, step_s) for step_s in (0.5, 1.0, 4.0)),
    ],
)
def test_an_hour_of_the_fmu_equals_the_quick_fits_kernel(unit, chain, step_s: float) -> None:
    """To 1e-9 percent, whatever the communication step; OP is held between two of them."""
    op = wandering_op()
    times, positions = simulated(unit(chain), chain, op, step_s)
    expected = by_quick_fit(chain, as_held(op, 1.0, step_s))[before(times[1:], 1.0)]
    assert times.size == round((HOUR - 1) / step_s) + 1
    assert np.ptp(positions) > 5.0
    assert np.max(np.abs(positions[1:] - expected)) < NEAR


def with_term(slug: str, unit_s: float = 1.0, curve: StrokeCurve | None = None) -> Any:
    """A screening that named ``slug``, with the fitted model, and that model's question."""
    slope = 1.0 if curve is None else abs(curve.slope)
    base = (4.0 * slope, 0.3, 0.7, 0.02, 0.0 if slug == "dead_time" else 0.4, 0.0)
    if slug in ("load_by_position", "motor_drive"):
        base = (*base[:3], 0.0, *base[4:])
    terms = {} if slug in ("zero_shift", "span_error") else {slug: (tuple(LARGE[slug]),) * 2}
    if slug == "motor_drive":  # a voltage has a limit, a load has none
        terms["load_by_position"] = ((6.0, 0.0, -2.0),) * 2
    question = OpenQuestion(
        published=RivalModel(slug="", base=(base, base), terms=terms),
        unit_s=unit_s,
        interval=1.0,
        duration=3600.0,
        op=50.0,
    )
    screening = judged(percent(4.0), percent(1.2), effects=(effect(slug),), question=question)
    return replace(screening, stroke_curve=curve), question


def by_fitted_model(question: OpenQuestion, command: np.ndarray) -> np.ndarray:
    """(n,) the kernel of the fitted model over ``command``, from rest."""
    model = question.published
    return RivalRuns(question, (model,), command, question.interval).predicted(model)


@needs_compiler
@pytest.mark.parametrize("slug", sorted(catalogue()))
def test_every_effect_is_the_kernel_that_named_it(unit, slug: str) -> None:
    """The whole catalogue, from the stored fit through names and units into C, over an hour."""
    screening, question = with_term(slug)
    chain = valve_chain(screening)
    assert isinstance(chain, ValveChain)
    assert chain.named == (slug,)
    op = wandering_op()
    op[0] = chain.op_start
    times, positions = simulated(unit(chain), chain, op, 1.0, position_start=op[0])
    expected = by_fitted_model(question, op)
    assert np.max(np.abs(positions[1:] - expected[before(times[1:], 1.0)])) < NEAR
    other = by_fitted_model(replace(question, published=replace(question.published, terms={})), op)
    assert slug in ("zero_shift", "span_error") or np.max(np.abs(expected - other)) > 0.01


@needs_compiler
@pytest.mark.parametrize("restick", [ALWAYS, ONLY_WHEN_TURNING])
@pytest.mark.parametrize("slug", [None, "lost_motion"])
def test_the_stem_sticks_again_as_the_fit_has_it(unit, slug: str | None, restick: float) -> None:
    """At every sample, or only where the command turns; with S and J alone and with an effect."""
    screening, question = with_term(slug or "lost_motion")
    question = replace(question, restick=restick)
    effects = () if slug is None else screening.mismatch.effects
    mismatch = replace(screening.mismatch, open_question=question, effects=effects)
    chain = valve_chain(replace(screening, mismatch=mismatch))
    assert isinstance(chain, ValveChain)
    op = wandering_op()
    op[0] = chain.op_start
    times, positions = simulated(unit(chain), chain, op, 1.0, position_start=op[0])
    fitted = {**chain.values, "position_start": op[0], "restick_speed": restick}
    own = replace(chain, values=fitted)
    expected = by_quick_fit(own, op) if slug is None else by_fitted_model(question, op)
    assert np.max(np.abs(positions[1:] - expected[before(times[1:], 1.0)])) < NEAR
    assert sources_have_no_infinity(chain)


@needs_compiler
@pytest.mark.parametrize("slug", ["asymmetric_lag", "dwell_dependent_breakaway", "viscous_drag"])
def test_the_fmu_keeps_the_records_interval(unit, slug: str) -> None:
    """A sample a minute through a bent curve: times are in seconds, S and J in percent of OP."""
    screening, question = with_term(slug, unit_s=60.0, curve=BENT)
    chain = valve_chain(screening)
    assert isinstance(chain, ValveChain)
    assert chain.values["sample_time"] == 60.0
    op = wandering_op(600)
    op[0] = 50.0
    command = BENT.command(op)
    times, positions = simulated(unit(chain), chain, op, 60.0, position_start=command[0])
    expected = by_fitted_model(question, command)[before(times[1:], 60.0)]
    assert np.max(np.abs(positions[1:] - expected)) < NEAR


@pytest.mark.long
@needs_compiler
@pytest.mark.parametrize(
    "step_s",
    [0.1, *(pytest.param(step_s, marks=pytest.mark.long) for step_s in (0.5, 2.0)), 5.0],
)
@pytest.mark.parametrize("slug", ["growing_stiction", "sensor_drift"])
def test_what_changes_with_time_does_so_at_every_step_size(unit, slug: str, step_s: float) -> None:
    """Friction grows and the reading drifts by the time of each sample, whatever the step."""
    screening, question = with_term(slug)
    chain = valve_chain(screening)
    assert isinstance(chain, ValveChain)
    op = wandering_op()
    op[0] = chain.op_start
    times, positions = simulated(unit(chain), chain, op, step_s, position_start=op[0])
    expected = by_fitted_model(question, as_held(op, 1.0, step_s))[before(times[1:], 1.0)]
    assert np.max(np.abs(positions[1:] - expected)) < NEAR


@needs_compiler
def test_what_changed_with_time_stays_after_the_recording(unit) -> None:
    """A simulation longer than the recording: S and J stay as they are at its end, and the reading
    where it then was."""
    short = {"record_time": 600.0}
    op = wandering_op(1800)
    late = slice(601, None)
    grows = quick_fit(friction_growth=1.0, **short)
    drifts = quick_fit(reading_drift=2.0, reading_wave_2=0.7, **short)
    plain = by_quick_fit(PLAIN, op)
    _, grown = simulated(unit(PLAIN), grows, op, 1.0)
    _, drifted = simulated(unit(PLAIN), drifts, op, 1.0)
    twice = by_quick_fit(quick_fit(S=10.0, J=3.0), op)
    # From the first slip after the end of the recording on, as if it had always been so.
    assert np.max(np.abs(grown[1:][late][300:] - twice[:-1][late][300:])) < NEAR
    assert np.max(np.abs(drifted[1:][late] - (plain[:-1][late] + 1.0))) < NEAR


@needs_compiler
def test_a_finer_sample_is_the_finer_kernel(unit) -> None:
    """``sample_time`` may be shortened: the valve then moves, and hears OP, more often."""
    chain = quick_fit(dead_time=1.5, lag_rising=2.0, lag_falling=2.0, sample_time=0.25)
    op = np.repeat(wandering_op(900), 4)
    times, positions = simulated(unit(chain), chain, op, 0.25)
    expected = by_quick_fit(chain, op)[before(times[1:], 0.25)]
    assert np.max(np.abs(positions[1:] - expected)) < NEAR


class _Running:
    """An instance that is stepped by hand, with what it logged."""

    def __init__(self, folder: Path) -> None:
        description = fmpy.read_model_description(str(folder))
        self.places = {one.name: one.valueReference for one in description.modelVariables}
        self.said: list[str] = []
        self.slave = FMU3Slave(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="valve",
        )
        self.slave.instantiate(logMessage=self._log)

    def _log(self, environment: Any, status: Any, category: Any, message: bytes) -> None:
        self.said.append(message.decode())

    def begin(self, **start: float) -> None:
        for name, value in start.items():
            self.set(name, value)
        self.slave.enterInitializationMode(startTime=0.0)
        self.slave.exitInitializationMode()

    def set(self, name: str, value: float) -> None:
        self.slave.setFloat64([self.places[name]], [value])

    def get(self, name: str) -> float:
        return float(self.slave.getFloat64([self.places[name]])[0])

    def run(self, op: np.ndarray, begin: int = 0, step_s: float = 1.0) -> list[float]:
        positions = []
        for k, value in enumerate(op.tolist(), start=begin):
            self.set("OP", value)
            self.slave.doStep(k * step_s, step_s)
            positions.append(self.get("position"))
        return positions


@pytest.fixture
def running(unit):
    instance = _Running(unit(quick_fit(), its_values=True))
    yield instance
    instance.slave.freeInstance()


@needs_compiler
@pytest.mark.parametrize("step_s", [0.3, 0.7, 1.3, 3.7])
def test_each_sample_takes_the_op_of_its_step(running, step_s: float) -> None:
    """Each sample takes the OP of the step that it falls in; the position is the last sample's."""
    running.begin()
    given = wandering_op(round(HOUR / step_s))
    positions = np.array(running.run(given, step_s=step_s))
    ends = step_s * np.arange(1, given.size + 1)
    samples = before(ends, 1.0)
    seen = given[np.floor(np.arange(samples[-1] + 1) / step_s + 1e-9).astype(int)]
    assert np.max(np.abs(positions - by_quick_fit(quick_fit(), seen)[samples])) < NEAR


@needs_compiler
def test_reset_and_a_kept_state_begin_anew(running) -> None:
    """After reset the same run gives the same; from a kept state it goes on as it did."""
    op = wandering_op(400)
    running.begin(dead_time=3.0)
    first = running.run(op[:200])
    state = running.slave.getFMUState()
    rest = running.run(op[200:], 200)
    running.slave.setFMUState(state)
    assert running.run(op[200:], 200) == rest
    running.slave.freeFMUState(state)
    running.slave.terminate()
    running.slave.reset()
    assert running.get("dead_time") == 0.0
    running.begin(dead_time=3.0)
    assert running.run(op) == first + rest


@needs_compiler
def test_s_and_j_can_be_tuned_to_zero_during_a_run(running) -> None:
    """With S and J tuned to 0 the position follows OP; what is fixed cannot be tuned."""
    op = wandering_op(300)
    running.begin()
    stuck = np.array(running.run(op[:150]))
    running.set("S", 0.0)
    running.set("J", 0.0)
    repaired = np.array(running.run(op[150:], 150))
    assert np.max(np.abs(stuck - op[:150])) > 1.5
    assert np.max(np.abs(repaired - op[150:])) < NEAR
    with pytest.raises(fmpy.fmi1.FMICallException):
        running.set("dead_time", 5.0)
    assert running.said == ["A fixed parameter can be set before the run only."]


@needs_compiler
@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("sample_time", 0.0, "sample_time, tight_width"),
        ("dead_time", 1e12, "dead_time must be 0 or more"),
        ("S", float("nan"), "no number"),
        ("position", 3.0, "cannot be set"),
    ],
)
def test_a_wrong_value_is_refused_in_words(running, name: str, value: float, said: str) -> None:
    """With an error of FMI and a sentence in its log."""
    with pytest.raises(fmpy.fmi1.FMICallException):
        running.begin(**{name: value})
    assert said in running.said[-1]


@needs_compiler
def test_a_step_out_of_turn_is_refused(running) -> None:
    """A step before the start, and one that does not begin where the last ended."""
    with pytest.raises(fmpy.fmi1.FMICallException):
        running.slave.doStep(0.0, 1.0)
    assert running.said[-1] == "The valve is not running."
    running.begin()
    with pytest.raises(fmpy.fmi1.FMICallException):
        running.slave.doStep(7.0, 1.0)
    assert "begins where the one before ended" in running.said[-1]


def test_a_name_cannot_break_the_descriptions(tmp_path: Path) -> None:
    """Whatever a plant may call a valve, the importer finds no fault and reads the name back."""
    file = tmp_path / "valve.fmu"
    name = 'FIC"1 <b>&/*\\'
    file.write_bytes(functional_mockup_unit(replace(quick_fit(), valve=name)).content)
    assert validate_fmu(str(file)) == []
    assert fmpy.read_model_description(str(file)).modelName == name


@pytest.mark.parametrize("name", ["FIC\x001", "FIC\ud8001", "../../x", "F" * 5000])
def test_characters_that_xml_lacks_become_blanks(tmp_path: Path, name: str) -> None:
    """Signs that XML does not have are blanks there; no file of the archive is elsewhere."""
    file = tmp_path / "valve.fmu"
    unit = functional_mockup_unit(replace(quick_fit(), valve=name), "no compiler")
    file.write_bytes(unit.content)
    assert validate_fmu(str(file)) == []
    with zipfile.ZipFile(file) as archive:
        assert not any(".." in entry or len(entry) > 200 for entry in archive.namelist())


def sources_have_no_infinity(chain: ValveChain) -> bool:
    """Neither C nor XML has a number without an end."""
    with zipfile.ZipFile(io.BytesIO(functional_mockup_unit(chain, "no compiler").content)) as made:
        texts = [made.read(name) for name in made.namelist()]
    return not any(re.search(rb"[^a-z]inf[^a-z]", text) for text in texts)


def sources(tmp_path: Path, chain: ValveChain) -> Path:
    """The unpacked sources of an FMU."""
    file = tmp_path / "valve.fmu"
    file.write_bytes(functional_mockup_unit(chain).content)
    with zipfile.ZipFile(file) as archive:
        archive.extractall(tmp_path / "valve")
    return tmp_path / "valve" / "sources"


@needs_compiler
@pytest.mark.parametrize(
    ("chain", "more"),
    [
        pytest.param(chain, more, marks=[] if k == 1 and kind == 1 else [pytest.mark.long])
        for k, chain in enumerate((quick_fit(), replace(quick_fit(BENT), one_actuator=False)))
        for kind, more in enumerate(
            ([], ["-DFMI3_STANDARD_HEADERS"], ["-DFMI3_FUNCTION_PREFIX=V_"])
        )
    ],
)
def test_the_sources_compile_without_a_warning(tmp_path: Path, chain, more: list[str]) -> None:
    """As C99, with every warning an error; also by the standard's own headers, whose declarations
    the functions must then fit."""
    headers = Path(fmpy.__file__).parent / "c-code"
    assert COMPILER is not None
    options = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", f"-I{headers}", *more]
    done = subprocess.run(
        [COMPILER, *options, "-c", "fmi3.c", "-o", str(tmp_path / "valve.o")],
        cwd=sources(tmp_path, chain),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


MAIN = """
#include "fmi3.c"
#include <stdio.h>
int main(void)
{
    bool a, b, c;
    double last, position, op, lag = 4.0;
    fmi3ValueReference one = 1, two = 2, of_lag = FIRST_PARAMETER + LAG_RISING, none_such = 999;
    fmi3FMUState state = NULL;
    fmi3Instance i = fmi3InstantiateCoSimulation("v", INSTANTIATION_TOKEN, "", false, false, false,
        false, NULL, 0, NULL, NULL, NULL);
    if (fmi3InstantiateCoSimulation("v", "another", "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL))
        return 1;
    for (int round = 0; round < 2; round++) {
        fmi3EnterInitializationMode(i, false, 0.0, 0.0, false, 0.0);
        fmi3ExitInitializationMode(i);
        for (int k = 0; k < 3600; k++) {
            op = 150.0 * sin(k / 40.0);
            if (fmi3SetFloat64(i, &one, 1, &op, 1)) return 2;
            if (fmi3DoStep(i, k, 1.0, true, &a, &b, &c, &last)) return 2;
            if (k == 1000 && fmi3GetFMUState(i, &state)) return 3;
            if (k == 1200 && fmi3GetFMUState(i, &state)) return 4;
            if (k == 2000 && fmi3SetFloat64(i, &of_lag, 1, &lag, 1)) return 5;
        }
        if (fmi3GetFloat64(i, &two, 1, &position, 1)) return 6;
        if (fmi3GetFloat64(i, &none_such, 1, &position, 1) != fmi3Error) return 7;
        printf("%.9f\\n", position);
        if (fmi3SetFMUState(i, state) || fmi3Terminate(i) != fmi3OK || fmi3Reset(i)) return 8;
    }
    fmi3FreeFMUState(i, &state);
    fmi3FreeInstance(i);
    return 0;
}
"""


@needs_compiler
@pytest.mark.parametrize(
    "slug",
    [
        None,
        *(
            pytest.param(slug, marks=pytest.mark.long)
            for slug in ("motor_drive", "underdamped_positioner")
        ),
    ],
)
def test_no_address_or_arithmetic_goes_wrong(tmp_path: Path, slug: str | None) -> None:
    """Under the sanitizers of addresses, leaks and undefined behaviour, with OP far beyond its
    range, states kept, a reset, and wrong references."""
    chain = quick_fit(BENT, dead_time=7.4) if slug is None else valve_chain(with_term(slug)[0])
    assert isinstance(chain, ValveChain)
    folder = sources(tmp_path, chain)
    (folder / "main.c").write_text(MAIN, encoding="utf-8")
    checks = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-std=c99"]
    assert COMPILER is not None
    command = [COMPILER, *checks, "main.c", "-o", "main", "-lm"]
    made = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if made.returncode and "sanitize" in made.stderr + made.stdout:
        pytest.skip(f"this compiler has no sanitizers: {made.stderr.strip()[:100]}")
    assert made.returncode == 0, made.stderr
    # Where processes are traced, the look for leaks cannot run; the others can.
    environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=0"}
    done = subprocess.run(
        [str(folder / "main")], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.split()
    assert first == second
