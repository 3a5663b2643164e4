import pickle
import time

import numba
import numpy as np
import pytest
from conformance import check_field
from hypothesis import given
from hypothesis import strategies as st

from ilattice.errors import InputError
from ilattice.tiles import TrigField
from ilattice.tiles._kernels import sincos_turns, trig_jet, trig_tab

GYROID = TrigField.parse("sum[cosX sinY]")
SKEW = [[1.0, 0.5, 0.0], [0.2, 1.1, -0.3], [0.0, 0.4, 0.9]]
codes = st.integers(0, 8)
terms = st.lists(
    st.tuples(st.tuples(codes, codes, codes), st.floats(-3, 3, allow_subnormal=False)),
    min_size=1,
    max_size=6,
)


def naive(field, p):
    """Term by term, with the library's sines; complex points pass."""
    q = np.asarray(p) if field.linear is None else np.asarray(p) @ field.linear.T
    total = np.zeros(len(q), dtype=q.dtype)
    for c, codes in zip(field.coef, field.factor, strict=True):
        term = c
        for axis, code in enumerate(codes):
            angle = ((code + 1) // 2) * 2 * np.pi * q[:, axis] / field.period[axis]
            term = term * (np.sin(angle) if code and code % 2 == 0 else np.cos(angle))
        total = total + term
    return total


def field_of(pairs, **options):
    factor = np.array([k for k, _ in pairs], dtype=np.int64).reshape(-1, 3)
    return TrigField([v for _, v in pairs], factor, **options)


def random_field(rng, m=6, top=8, **options):
    return TrigField(rng.normal(size=m), rng.integers(0, top + 1, (m, 3)), **options)


# ------------------------------------------------------------------------------ evaluation


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "options", [{}, {"period": (0.5, 2.0, 0.7)}, {"linear": SKEW}], ids=["unit", "period", "linear"]
)
def test_random_polynomials_conform(seed, options):
    rng = np.random.default_rng(seed)
    check_field(random_field(rng, **options), rng)


@pytest.mark.parametrize("options", [{}, {"period": (0.5, 2.0, 0.7)}, {"linear": SKEW}])
def test_values_and_gradients_agree_with_terms_typed_out(options):
    rng = np.random.default_rng(5)
    field = random_field(rng, m=9, top=12, **options)
    p = rng.uniform(-2, 2, (300, 3))
    scale = np.abs(field.coef).sum()
    np.testing.assert_allclose(field(p), naive(field, p), atol=2e-13 * scale)
    steps = [naive(field, p + 1e-30j * e).imag / 1e-30 for e in np.eye(3)]
    g = field.jet(p, 1)[1]
    np.testing.assert_allclose(g, np.stack(steps, axis=1), atol=1e-13 * np.abs(g).max() * 10)


@pytest.mark.parametrize("top", [0, 1, 6, 64])
def test_gradients_of_many_points_are_those_of_single_points(top):
    rng = np.random.default_rng(7)
    field = random_field(rng, top=top, period=(1.0, 0.5, 2.0))
    p = rng.uniform(-3, 3, (2500, 3))
    p[::10] = np.rint(8 * p[::10]) / 16  # ends of quadrants, and places next to them
    f, g = field.jet(p, 1)
    scale = np.abs(field.coef).sum()
    full = field.jet(p)
    np.testing.assert_allclose(f, full[0], atol=1e-14 * scale)
    np.testing.assert_allclose(g, full[1], atol=1e-14 * scale * 64 * 4 * np.pi)
    for part in (slice(3, 4), slice(100, 301), slice(1030, 2400)):
        again = field.jet(p[part], 1)
        np.testing.assert_array_equal(again[0], f[part])
        np.testing.assert_array_equal(again[1], g[part])


def test_gradient_of_the_linear_map_is_transformed():
    rng = np.random.default_rng(6)
    placed = GYROID.placed(SKEW)
    p = rng.random((50, 3))
    np.testing.assert_allclose(placed(p), GYROID(p @ np.transpose(SKEW)), atol=1e-14)
    assert placed.placed(None).linear is None
    np.testing.assert_array_equal(placed.placed(None)(p), GYROID(p))


def test_sincos_is_accurate_in_every_quadrant():
    t = np.concatenate([np.linspace(-2, 2, 4001), np.arange(-8, 9) / 8])
    got = np.array([sincos_turns(x) for x in t])
    angle = (np.longdouble(t) - np.rint(np.longdouble(t))) * (2 * np.arccos(np.longdouble(-1)))
    np.testing.assert_allclose(got[:, 0], np.sin(angle).astype(float), rtol=0, atol=3e-16)
    np.testing.assert_allclose(got[:, 1], np.cos(angle).astype(float), rtol=0, atol=3e-16)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="Python refuses to round NaN, machines do not")
def test_nan_stays_nan():
    assert np.isnan(sincos_turns(np.nan)).all()


def test_a_field_of_period_one_repeats_exactly():
    p = np.random.default_rng(0).integers(0, 1 << 20, (500, 3)) / (1 << 20)
    np.testing.assert_array_equal(GYROID(p + np.array([1, -3, 1024])), GYROID(p))


def test_the_kernel_of_one_point_fills_value_gradient_hessian():
    field = random_field(np.random.default_rng(2), period=(1.0, 0.5, 2.0))
    omega = 2 * np.pi / field.period
    tab, out = trig_tab(field.factor), np.full(10, np.nan)
    p = np.array([0.3, -0.7, 1.9])
    trig_jet(field.coef, field.factor, omega, *p, tab, out)
    f, g, hess = (a[0] for a in field.jet(p[None]))
    np.testing.assert_array_equal(out[0], f)
    np.testing.assert_array_equal(out[1:4], g)
    np.testing.assert_array_equal(out[4:], hess[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]])


def test_float32_grids_and_given_output():
    axes = [np.linspace(0, 1, n) for n in (5, 6, 40)]
    exact = GYROID.grid(axes)
    out = np.empty((5, 6, 40), np.float32)
    assert GYROID.grid(axes, np.float32, out=out) is out
    np.testing.assert_allclose(out, exact, atol=1e-6)
    np.testing.assert_allclose(
        GYROID.placed(SKEW).grid(axes, out=np.empty((5, 6, 40))).max(), 1.5, atol=0.1
    )
    for bad in (np.empty((5, 6, 40)), np.empty((6, 5, 40), np.float32), out[..., ::2]):
        with pytest.raises(InputError, match="out must be"):
            GYROID.grid(axes, np.float32, out=bad)
    for bad in (np.int32, np.float16, ">f8", "foo", {"a": 1}):
        with pytest.raises(InputError, match="dtype must be float64 or float32"):
            GYROID.grid(axes, bad)
    assert GYROID.grid([[], [0.0], [1.0]]).shape == (0, 1, 1)


# ---------------------------------------------------------------------------------- bounds


@given(terms, st.integers(0, 2**32 - 1))
def test_ranges_contain_every_value(pairs, seed):
    rng = np.random.default_rng(seed)
    field = field_of(pairs, linear=SKEW if seed % 2 else None)
    size = 10.0 ** rng.uniform(-8, 0.5, (12, 1))
    lo = rng.uniform(-3, 3, (12, 3))
    hi = lo + size * rng.random((12, 3))
    bounds = field.range(lo, hi)
    p = np.clip(lo + rng.random((40, 12, 3)) * (hi - lo), lo, hi)
    p[0], p[1] = lo, hi
    f = field(p.reshape(-1, 3)).reshape(40, 12)
    assert (bounds[:, 0] <= f.min(axis=0)).all()
    assert (bounds[:, 1] >= f.max(axis=0)).all()


def test_ranges_are_exact_where_one_factor_decides():
    field = TrigField.parse("2 cos2X")
    lo = np.array([[0.1, 0, 0], [0.2, 0, 0], [-0.1, 0, 0], [0.05, 0, 0], [0.0, 0, 0]])
    hi = np.array([[0.2, 1, 1], [0.3, 1, 1], [0.1, 1, 1], [0.60, 1, 1], [0.0, 1, 1]])
    a, b, c = 2 * np.cos(4 * np.pi * np.array([0.1, 0.2, 0.3]))
    want = [[b, a], [-2, max(b, c)], [a, 2], [-2, 2], [2, 2]]
    np.testing.assert_allclose(field.range(lo, hi), want, atol=1e-12)


def test_ranges_of_small_boxes_shrink_quadratically():
    """Width minus the true spread falls like the square of the box."""
    rng = np.random.default_rng(0)
    lo = rng.random((200, 3))
    slack = []
    for size in (0.04, 0.02, 0.01):
        bounds = GYROID.range(lo, lo + size)
        p = lo[:, None] + size * np.random.default_rng(1).random((400, 3))
        corners = lo[:, None] + size * np.array(np.meshgrid(*[[0, 1]] * 3)).reshape(3, -1).T
        f = GYROID(np.concatenate([p, corners], axis=1).reshape(-1, 3)).reshape(200, -1)
        slack.append(np.mean(bounds[:, 1] - bounds[:, 0] - np.ptp(f, axis=1)))
    rates = np.log2(np.array(slack[:-1]) / slack[1:])
    assert (rates > 1.7).all(), rates


def test_most_blocks_that_are_kept_are_crossed():
    """Pruning 32³ blocks against the zero set of the gyroid, on a sample of them."""
    a = np.arange(32) / 32
    lo = np.stack(np.meshgrid(a, a, a, indexing="ij"), axis=-1).reshape(-1, 3)
    lo = np.random.default_rng(0).choice(lo, 3000, replace=False)
    bounds = GYROID.range(lo, lo + 1 / 32)
    kept = (bounds[:, 0] <= 0) & (bounds[:, 1] >= 0)
    u = np.array(np.meshgrid(*[np.linspace(0, 1, 5)] * 3)).reshape(3, -1).T / 32
    f = GYROID((lo[kept, None] + u).reshape(-1, 3)).reshape(kept.sum(), -1)
    crossed = (f.min(axis=1) <= 0) & (f.max(axis=1) >= 0)
    assert crossed.mean() > 0.85
    g = GYROID((lo[~kept, None] + u).reshape(-1, 3)).reshape((~kept).sum(), -1)
    assert (np.sign(g) == np.sign(g[:, :1])).all()


def test_fourier_modes_rebuild_the_field():
    rng = np.random.default_rng(3)
    field = random_field(rng, period=(1.0, 2.0, 0.5))
    waves, amplitude = field.modes()
    p = rng.random((40, 3))
    series = np.exp(2j * np.pi * (p / field.period) @ waves.T) @ amplitude
    np.testing.assert_allclose(series.imag, 0, atol=1e-13)
    np.testing.assert_allclose(series.real, field(p), atol=1e-12)
    assert len(np.unique(waves, axis=0)) == len(waves)


def test_lipschitz_follows_period_and_linear_map():
    bound = GYROID.lipschitz
    assert bound == pytest.approx(6 * np.pi * np.sqrt(2))
    half = TrigField(GYROID.coef, GYROID.factor, period=0.5)
    assert half.lipschitz == pytest.approx(2 * bound)
    assert GYROID.placed(3 * np.eye(3)).lipschitz == pytest.approx(3 * bound)
    assert TrigField([2.0], [[0, 0, 0]]).lipschitz == 0.0


def test_bounds_hold_one_period():
    field = TrigField([1.0], [[1, 0, 0]], period=(1, 2, 3))
    np.testing.assert_array_equal(field.bounds, [[0, 0, 0], [1, 2, 3]])
    turned = field.placed([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(turned.bounds, [[-2, 0, 0], [0, 1, 3]], atol=1e-15)


# --------------------------------------------------------------------------------- algebra


@given(terms, terms)
def test_sums_and_products_are_those_of_the_values(a, b):
    f, g = field_of(a), field_of(b)
    p = np.random.default_rng(0).random((20, 3))
    u, v = naive(f, p), naive(g, p)
    tol = 1e-12 * (1 + np.abs(f.coef).sum()) * (1 + np.abs(g.coef).sum())
    for got, want in [
        (f + g, u + v),
        (f - g, u - v),
        (f * g, u * v),
        (2 * f - 1.5, 2 * u - 1.5),
        (1 - f, 1 - u),
        (-f, -u),
    ]:
        np.testing.assert_allclose(naive(got, p), want, atol=tol)


@given(terms)
def test_text_is_read_back(pairs):
    field = field_of(pairs)
    again = TrigField.parse(str(field))
    np.testing.assert_array_equal(again.coef, field.coef)
    np.testing.assert_array_equal(again.factor, field.factor)


def test_equal_terms_are_merged_and_cancelled_ones_dropped():
    field = TrigField([1.0, 2.0, 0.5, -0.5], [[1, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 0]])
    np.testing.assert_array_equal(field.coef, [3.0])
    assert len((GYROID - GYROID).coef) == 0
    np.testing.assert_array_equal((GYROID - GYROID)(np.ones((2, 3))), 0.0)
    assert str(GYROID - GYROID) == "0"


def test_notation():
    p = np.random.default_rng(0).random((30, 3))
    X, Y, Z = 2 * np.pi * p.T
    for text, want in [
        ("cos(3X-2Y+Z)", np.cos(3 * X - 2 * Y + Z)),
        ("sin(-X + 2*Z)", np.sin(-X + 2 * Z)),
        ("-.5cosX*sinY+2e-1", -0.5 * np.cos(X) * np.sin(Y) + 0.2),
        ("sqrt(2) (cosX - 1) (1 + sinX)", np.sqrt(2) * (np.cos(X) - 1) * (1 + np.sin(X))),
        (
            "2 sum[sinX] sum[cos2Y]",
            2 * np.sin([X, Y, Z]).sum(0) * np.cos([2 * X, 2 * Y, 2 * Z]).sum(0),
        ),
        (
            "sum[cosX sin2Y]",
            np.cos(X) * np.sin(2 * Y) + np.cos(Y) * np.sin(2 * Z) + np.cos(Z) * np.sin(2 * X),
        ),
    ]:
        np.testing.assert_allclose(TrigField.parse(text)(p), want, atol=1e-13, err_msg=text)
    assert TrigField.parse("cosX", period=2.0)([[1.0, 0, 0]])[0] == pytest.approx(-1.0)


@pytest.mark.parametrize(
    "text",
    ["", "cosX +", "cosX sinQ", "sum[cosX", "sum[cosX)", "2 ** cosX", "cos()", "cos(X Y)", "cosX)",
     "cos33X", "cos(20X+20X)", "x", "__import__", "(" * 300 + "1" + ")" * 300, "cosX / 2",
     "* cosX"],
)  # fmt: skip
def test_text_outside_the_notation_is_refused(text):
    with pytest.raises(InputError, match="trigonometric notation"):
        TrigField.parse(text)


@given(st.text(alphabet="cosin23XYZ()[]+-* .sumqrt", max_size=30))
def test_any_text_is_read_or_refused(text):
    try:
        field = TrigField.parse(text)
    except InputError:
        return
    assert np.isfinite(field([[0.1, 0.2, 0.3]])).all()


# ---------------------------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TrigField([[1.0]], [[0, 0, 0]]), "coef"),
        (lambda: TrigField([np.nan], [[0, 0, 0]]), "coef must be finite"),
        (lambda: TrigField([1.0], [[0, 0]]), "factor"),
        (lambda: TrigField([1.0], [[0.0, 0, 0]]), "whole numbers"),
        (lambda: TrigField([1.0], [[0, 65, 0]]), "0..64"),
        (lambda: TrigField([1.0], [[0, -1, 0]]), "0..64"),
        (lambda: TrigField([1.0], [[1, 0, 0]], period=0.0), "period must be positive"),
        (lambda: TrigField([1.0], [[1, 0, 0]], linear=np.ones((3, 3))), "regular matrix"),
        (lambda: TrigField([1.0], [[1, 0, 0]], linear=np.eye(2)), "regular matrix"),
        (lambda: GYROID + TrigField([1.0], [[1, 0, 0]], period=2.0), "different cells"),
        (lambda: GYROID + GYROID.placed(SKEW), "different cells"),
        (lambda: GYROID + np.ones(3), "operand"),
        (lambda: TrigField([1.0], [[63, 0, 0]]) * TrigField([1.0], [[3, 0, 0]]), "above 32"),
        (lambda: GYROID.range(np.zeros((2, 3)), np.ones((1, 3))), "one shape"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_fields_are_immutable_and_can_be_pickled():
    with pytest.raises(AttributeError):
        GYROID.coef = np.ones(3)
    for array in (GYROID.coef, GYROID.factor, GYROID.period):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 7
    again = pickle.loads(pickle.dumps(GYROID))
    p = np.random.default_rng(0).random((9, 3))
    np.testing.assert_array_equal(again(p), GYROID(p))
    assert "cosX sinY" in repr(GYROID)
    assert "12 terms" in repr(random_field(np.random.default_rng(0), m=12))


def test_expanding_an_equation_is_cheap():
    """All tables together must not slow an import down."""
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        for _ in range(40):
            TrigField.parse("sum[cos2X] + 2 sum[sin2X cosY sin3Z] + 2 sum[sin2X cos3Y sinZ]")
        best = min(best, time.process_time() - start)
    assert best < 0.05
