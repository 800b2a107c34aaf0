"""Golden vectors of every data-driven model, and the identities between them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from stemwatch.models.stickslip import kernel
from stemwatch.models.studies.literature import chen, choudhury, he, kano, stenman, xch
from stemwatch.models.studies.literature.canonical import CANONICAL
from stemwatch.models.studies.literature.chen import CHEN_TREE
from stemwatch.models.studies.literature.choudhury import CHOUDHURY_AS_DRAWN, CHOUDHURY_TEXT
from stemwatch.models.studies.literature.he import HE2, HE3
from stemwatch.models.studies.literature.kano import KANO, KANO_ASYMMETRIC
from stemwatch.models.studies.literature.stenman import STENMAN
from stemwatch.models.studies.literature.xch import XCH

NAMES = (
    "triangle",
    "sine",
    "random walk",
    "noisy sine",
    "quantised sine",
    "autoregressive",
)
PAIRS = [(5.0123, 2.0071), (6.0123, 0.0), (4.0123, 4.0123), (2.0123, 5.0071), (0.0, 0.0)]
everywhere = pytest.mark.parametrize("name", NAMES)
for_pairs = pytest.mark.parametrize(("S", "J"), PAIRS)

# S = 5, J = 2 (fs = 3.5, fd = 1.5), y0 = 50: repeated samples, same-direction restarts, exact ties.
GOLDEN_OP = np.array([*range(50, 58), 57, 58, *range(59, 50, -1), *range(52, 58)], dtype=float)
ELEMENT = [50.0] * 4 + [52.5, 53.5, 54.5] + [55.5] * 11 + [52.5] * 6 + [55.5]
GOLDEN = [
    (CANONICAL, (5.0, 2.0), ELEMENT),
    (KANO, (5.0, 2.0), ELEMENT),
    (KANO_ASYMMETRIC, (5.0, 2.0, 5.0, 2.0), ELEMENT),
    (XCH, (3.5, 1.5), ELEMENT),
    (CHEN_TREE, (3.5, 1.5), ELEMENT),
    (HE2, (3.5, 1.5), [50.0] * 4 + [52.5] * 3 + [55.5] * 11 + [52.5] * 6 + [55.5]),
    (HE3, (3.5, 1.5, 1.5), [50.0] * 4 + [53.75] * 5 + [57.875] * 6 + [54.3125] * 10),
    (STENMAN, (3.5,), [50.0] * 4 + [54.0] * 5 + [58.0] * 6 + [54.0] * 10),
    (CHOUDHURY_TEXT, (5.0, 2.0), [50.0] * 6 + [54.5] + [55.5] * 11 + [52.5] * 6 + [55.5]),
    (
        CHOUDHURY_AS_DRAWN,
        (5.0, 2.0),
        [50.0] * 6 + [54.5] + [55.5] * 9 + [54.5, 53.5] + [52.5] * 6 + [55.5],
    ),
]


def run(model, op, *parameters, y0=None):
    """Free run from ``y0``, the first command where it is not given."""
    start = float(op[0]) if y0 is None else y0
    return model.simulate(op, np.array(parameters), 1.0, start)


def element(op, S, J, y0, restick=0.0):
    """The canonical kernel with any re-stick threshold."""
    q = np.zeros(kernel.N_PARAMETERS)
    q[[kernel.S, kernel.J, kernel.GAIN, kernel.RESTICK]] = S, J, 1.0, restick
    q[[kernel.RATE_UP, kernel.RATE_DOWN]] = np.inf
    marks = np.zeros(op.size, dtype=np.uint8)
    marks[0] = kernel.START
    out = np.empty(op.size)
    kernel.simulate(op, np.full(op.size, y0), marks, 1.0, q, out)
    return out


def levels(S, J):
    return 0.5 * (S + J), 0.5 * (S - J)


def play(op, width, y0):
    """The play operator: the stem is dragged by the ends of a slot of ``width``."""
    y = [y0]
    for u in op[1:]:
        y.append(min(max(y[-1], u - 0.5 * width), u + 0.5 * width))
    return np.array(y)


def first_slip(y):
    return int(np.argmax(y != y[0]))


@pytest.mark.parametrize(("model", "q", "expected"), GOLDEN, ids=lambda v: getattr(v, "name", ""))
def test_golden_vector(model, q, expected):
    """A hand-checked record with repeats, restarts and ties comes out to the last digit."""
    assert expected == run(model, GOLDEN_OP, *q).tolist()


@everywhere
@for_pairs
def test_kano_is_the_canonical_element(signals, name, S, J):
    """I1: on deterministic and on stochastic commands alike."""
    op = signals[name]
    np.testing.assert_allclose(run(KANO, op, S, J), run(CANONICAL, op, S, J), atol=1e-9)


@everywhere
@for_pairs
def test_kano_for_each_direction_with_equal_numbers_is_kano(signals, name, S, J):
    """The asymmetric variant contains the symmetric model."""
    op = signals[name]
    np.testing.assert_array_equal(run(KANO_ASYMMETRIC, op, S, J, S, J), run(KANO, op, S, J))


@everywhere
def test_kano_is_the_mirror_of_itself(signals, name):
    """I11 for the asymmetric variant: turned over, with up and down exchanged, it runs in the
    mirror once the stem has slipped."""
    op = signals[name] - 50.0
    up = run(KANO_ASYMMETRIC, op, 5.0123, 2.0071, 4.0123, 1.0071)
    down = -run(KANO_ASYMMETRIC, -op, 4.0123, 1.0071, 5.0123, 2.0071)
    both_moved = max(first_slip(up), first_slip(down)) + 300
    np.testing.assert_allclose(up[both_moved:], down[both_moved:], atol=1e-9)


@everywhere
@for_pairs
def test_xch_is_the_canonical_element(signals, name, S, J):
    """I2: as reconstructed."""
    op = signals[name]
    np.testing.assert_allclose(run(XCH, op, *levels(S, J)), run(CANONICAL, op, S, J), atol=1e-9)


@everywhere
@pytest.mark.parametrize(("S", "J"), [pair for pair in PAIRS if pair[0] >= pair[1]])
def test_chen_is_the_canonical_element_without_overshoot(signals, name, S, J):
    """I3: as reconstructed, for S >= J."""
    op = signals[name]
    expected = run(CANONICAL, op, S, J)
    np.testing.assert_allclose(run(CHEN_TREE, op, *levels(S, J)), expected, atol=1e-9)


def test_chen_is_not_the_canonical_element_with_overshoot(signals):
    """The limit of I3: for J > S the two differ by percents."""
    op = signals["random walk"]
    apart = run(CHEN_TREE, op, *levels(2.0, 5.0)) - run(CANONICAL, op, 2.0, 5.0)
    assert 1.0 < np.max(np.abs(apart)) < 10.0


@everywhere
@for_pairs
def test_he_always_sticks_again(signals, name, S, J):
    """I4: He's model is the canonical element that sticks again at every sample."""
    op = signals[name]
    expected = element(op, S, J, op[0], restick=np.inf)
    np.testing.assert_allclose(run(HE2, op, *levels(S, J)), expected, atol=1e-9)


@everywhere
@for_pairs
def test_he_with_a_factor_of_one_is_he(signals, name, S, J):
    """I5: K = 1 takes the third parameter away."""
    op = signals[name]
    expected = run(HE2, op, *levels(S, J))
    np.testing.assert_allclose(run(HE3, op, *levels(S, J), 1.0), expected, atol=1e-9)


@everywhere
@pytest.mark.parametrize("d", [0.0123, 3.5123, 6.0123])
def test_stenman_is_he_without_sliding_friction(signals, name, d):
    """I6: and the canonical element with S = J = d that always sticks again."""
    op = signals[name]
    process = run(STENMAN, op, d)
    np.testing.assert_allclose(process, run(HE2, op, d, 0.0), atol=1e-9)
    np.testing.assert_allclose(process, element(op, d, d, op[0], restick=np.inf), atol=1e-9)


@everywhere
def test_choudhury_without_offset_is_the_canonical_element(signals, name):
    """I7: as the text says, for S = J."""
    op = signals[name]
    expected = run(CANONICAL, op, 4.0123, 4.0123)
    np.testing.assert_allclose(run(CHOUDHURY_TEXT, op, 4.0123, 4.0123), expected, atol=1e-9)


@pytest.mark.parametrize("model", [CHOUDHURY_TEXT, CHOUDHURY_AS_DRAWN], ids=lambda m: m.name)
@pytest.mark.parametrize("name", ["triangle", "sine"])
@for_pairs
def test_both_readings_agree_on_sweeps(signals, model, name, S, J):
    """I8: after the first slips, on sweeps without repeated samples."""
    op = signals[name]
    result, expected = run(model, op, S, J), run(CANONICAL, op, S, J)
    np.testing.assert_allclose(result[300:], expected[300:], atol=1e-9)


@everywhere
@pytest.mark.parametrize("model", [CANONICAL, KANO, CHOUDHURY_TEXT], ids=lambda m: m.name)
def test_without_friction_the_stem_is_the_command(signals, name, model):
    """I10: S = J = 0 hands the command on."""
    op = signals[name]
    np.testing.assert_allclose(run(model, op, 0.0, 0.0), op, atol=1e-9)


@everywhere
@pytest.mark.parametrize(
    ("model", "q"), [(CANONICAL, (5.0123, 0.0)), (KANO, (5.0123, 0.0)), (XCH, (2.50615, 2.50615))]
)
def test_without_jump_it_is_play(signals, name, model, q):
    """I9: with J = 0 the stem is dragged as by a slot of width S."""
    op = signals[name]
    np.testing.assert_allclose(run(model, op, *q), play(op, 5.0123, op[0]), atol=1e-9)


SHIFTABLE = [
    (model, q) for model, q, _ in GOLDEN if model not in (CHOUDHURY_TEXT, CHOUDHURY_AS_DRAWN)
]


@everywhere
@pytest.mark.parametrize(("model", "q"), SHIFTABLE, ids=lambda v: getattr(v, "name", ""))
def test_scale_and_translation(signals, name, model, q):
    """I12 and I13: twice the command and the levels is twice the way; a shift is a shift."""
    op, q = signals[name], np.array(q) + 0.0123 * np.arange(1, len(q) + 1)  # no ties
    doubled = np.where([p.unit == "%" for p in model.parameters], 2.0, 1.0) * q
    once = run(model, op, *q)
    np.testing.assert_allclose(run(model, 2.0 * op, *doubled), 2.0 * once, atol=1e-9)
    np.testing.assert_allclose(run(model, op + 32.0, *q), once + 32.0, atol=1e-9)


@everywhere
@pytest.mark.parametrize("model", [HE2, XCH, CHEN_TREE], ids=lambda m: m.name)
def test_force_balances_are_odd(signals, name, model):
    """I11: the mirrored command moves the stem in the mirror."""
    op = signals[name]
    once = run(model, op, 3.5123, 1.5071)
    np.testing.assert_allclose(run(model, -op, 3.5123, 1.5071), -once, atol=1e-9)


@everywhere
@pytest.mark.parametrize("model", [HE2, XCH, CHEN_TREE], ids=lambda m: m.name)
def test_the_stem_is_never_further_than_breakaway(signals, name, model):
    """I14: |u - y| stays within fs."""
    op = signals[name]
    assert np.max(np.abs(op - run(model, op, 3.5123, 1.5071))) <= 3.5123 + 1e-9


@everywhere
@pytest.mark.parametrize("shift", [-1.1, 0.7])
def test_levels_that_differ_by_direction_are_a_shifted_command(signals, name, shift):
    """I15: fs and fd larger by a shift upward and smaller downward give Kano's S and J unchanged,
    so that no asymmetric S can show them."""
    op = signals[name]
    expected = _by_direction(op, *levels(5.0123, 2.0071), shift, op[0] - shift)
    process = run(KANO, op - shift, 5.0123, 2.0071)
    np.testing.assert_allclose(process, expected, atol=1e-9)


def _by_direction(op, fs, fd, shift, y0):
    y, moving, d = [y0], False, 1
    for before, u in pairwise(op):
        moving = moving and d * (u - before) > 0
        force = u - y[-1]
        side = 1 if force > 0 else -1
        if not moving and abs(force) > fs + side * shift:
            moving, d = True, side
        y.append(u - d * (fd + d * shift) if moving else y[-1])
    return np.array(y)


@pytest.mark.parametrize("width", [0.8, 2.5, 3.0, 4.0])
def test_play_behind_the_element_takes_from_the_jump(signals, width):
    """I16: on full reversals, play of width b after C(S, J) is C(S, J - b), or C(S + b - J, 0)."""
    op = signals["triangle"]
    S, J = 5.0, 2.0
    q = (S, J - width) if width < J else (S + width - J, 0.0)
    result = play(run(CANONICAL, op, S, J), width, float(op[0]))
    np.testing.assert_allclose(result[400:], run(CANONICAL, op, *q)[400:], atol=1e-9)


@everywhere
def test_a_flow_force_is_an_error_of_span(signals, name):
    """I17: with a force of a x + c from the flow the stem is C(u - c)/(1 + a)."""
    op, a, c, S, J = signals[name], 0.13, 0.7, 5.0123, 2.0071
    fs, fd = levels(S, J)
    y, moving, d = [(op[0] - c) / (1.0 + a)], False, 1
    for before, u in pairwise(op):
        moving = moving and d * (u - before) > 0
        force = u - y[-1] - (a * y[-1] + c)
        if not moving and abs(force) > fs:
            moving, d = True, 1 if force > 0 else -1
        y.append((u - c - d * fd) / (1.0 + a) if moving else y[-1])
    np.testing.assert_allclose(y, run(CANONICAL, op - c, S, J) / (1.0 + a), atol=1e-9)


KERNELS = [
    (kano.run_kano, (5.0123, 2.0071, 4.0123, 1.0071)),
    (choudhury.run_choudhury, (5.0123, 2.0071)),
    (he.run_he2, (3.5123, 1.5071)),
    (he.run_he3, (3.5123, 1.5071, 1.3)),
    (stenman.run_stenman, (3.5123,)),
    (xch.run_xch, (3.5123, 1.5071)),
    (chen.run_chen, (3.5123, 1.5071)),
]


@everywhere
@pytest.mark.parametrize(("compiled", "q"), KERNELS, ids=lambda v: getattr(v, "__name__", ""))
def test_compiled_is_interpreted(signals, name, compiled, q):
    """A compiled kernel gives what the same Python gives uncompiled."""
    op = signals[name][:400]
    flags = [(True,), (False,)] if compiled is choudhury.run_choudhury else [()]
    for flag in flags:
        out, plain = np.empty(op.size), np.empty(op.size)
        compiled(op, *q, op[0], *flag, out)
        compiled.py_func(op, *q, op[0], *flag, plain)
        np.testing.assert_allclose(out, plain, rtol=1e-13)


@everywhere
@for_pairs
def test_the_canonical_model_is_the_products_own_kernel(signals, name, S, J):
    """What is compared is what the product reports S and J by."""
    op = signals[name]
    np.testing.assert_array_equal(run(CANONICAL, op, S, J), element(op, S, J, op[0]))
