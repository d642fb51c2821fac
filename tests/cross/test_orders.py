"""Harmonic balance with selected orders as unknowns against the balance with all orders."""

import itertools

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic.equations.harmonic_selection import HarmonicSelection, tooth_orders
from hbgear.mechanics.series.fourier import places, to_real


def two_stages(first=21, second=10, law=None, e=None, **kwargs):
    """Three inertias in series, coupled by two meshes with different tooth frequencies."""

    def one(w, p, k):
        stiffness = hb.mechanics.Series(k, (0.0,) * (p - 1) + (0.15 * k,), (0.0,) * (2 * p - 1) + (0.05 * k,))
        force = hb.Backlash(b=1.0, stiffness=stiffness) if law is None else law(stiffness)
        error = hb.mechanics.Series(0.0, (), (0.0,) * (p - 1) + (0.02,)) if e is None else e(p)
        return hb.Element(w, force, error, damping=0.06, name=f"mesh {p}")

    elements = [one([1.0, -1.0, 0.0], first, 1.0), one([0.0, 0.6, -1.0], second, 1.4)]
    load = hb.Load(constant=[0.3, 0.0, -0.5])
    fields = {"M": np.diag([1.0, 2.0, 1.6]), "C": np.zeros((3, 3)), "K": np.zeros((3, 3))}
    return hb.System(**{**fields, "elements": elements, "load": load, **kwargs})


def compared(sparse, model, X, Omega, **settings):
    """R, dR/dX, dR/dOmega of a balance with selected orders, and the same entries of the balance with all orders."""
    whole = hb.HarmonicBalance(model, sparse.H, nu=sparse.nu, **settings)
    some = (np.arange(sparse.m)[:, None] * (2 * sparse.H + 1) + places(sparse.orders)).ravel()
    a = sparse.linearise(X, "Omega", Omega=Omega)
    rows, kept = sparse.rows(X), to_real(whole.compiled({}).piecewise.retained.T)
    away = np.setdiff1d(np.arange(rows.shape[1]), places(sparse.orders))
    rows[:, away] = -kept[:, away]  # at omitted orders the structure does not move
    b = whole.linearise(rows.ravel(), "Omega", Omega=Omega)
    return (a.R, b.R[some]), (a.dR_dX, b.dR_dX[np.ix_(some, some)]), (a.dR_dp, b.dR_dp[some])


def stepped(p):
    """A transmission error with kinks, p periods per revolution."""
    from hbgear.gears.trains.train import in_order

    return in_order(hb.mechanics.Periodic.table([0.0, 1.0, 4.0], [0.0, 0.05, -0.03]), p, 0.3)


def rough(d, v, tau):
    """A law without compiled code."""
    return d + 0.2 * d**3, 1.0 + 0.6 * d**2, np.zeros_like(d)


MODELS = {
    "backlash": two_stages(3, 2),
    "errors with corners": two_stages(3, 2, e=stepped),
    "cubic": two_stages(3, 2, law=lambda k: hb.Cubic(1.0, 0.1)),
    "turning": two_stages(3, 2, speed=hb.mechanics.SpeedTerms(np.array([[0, 0.1, 0], [-0.1, 0, 0], [0, 0, 0]]), 1.0)),
    "tied": two_stages(
        3,
        2,
        M=np.eye(3),
        elements=[*two_stages(3, 2).elements, hb.Element([1.0, -1.0, 0.0], hb.Cubic(0.1, 0.2), name="parallel")],
    ),
}


@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize("nu", [1, 2])
@pytest.mark.parametrize("name", MODELS)
def test_rows_and_columns_of_the_balance_with_all_orders(name, nu, sampled, rng):
    model = MODELS[name]
    sparse = hb.HarmonicBalance(model, nu=nu, sampled=sampled, orders=(2, 3, 4, 6, 7, 9, 12))
    if nu == 1:
        assert sparse.orders.tolist() == [0, 2, 3, 4, 6, 7, 9, 12]
    X = rng.standard_normal(sparse.size)
    for a, b in compared(sparse, model, X, 0.7, sampled=sampled):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * np.abs(b).max())


def test_rule_of_the_orders_of_meshes():
    two = HarmonicSelection((10, 21))
    kept = set(two.selected(21 * 6, 1).tolist())
    wanted = {abs(10 * a + 21 * b) for a in range(-6, 7) for b in range(-6, 7) if (1 + abs(a)) * (1 + abs(b)) <= 7}
    assert {k for k in wanted if k <= 126} <= kept and {5, 15, 26, 16} <= kept  # including half orders of mesh 10
    assert len(kept) < 70
    sizes = [two.selected(H, 1) for H in range(1, 200)]
    assert all(set(a.tolist()) <= set(b.tolist()) for a, b in itertools.pairwise(sizes))
    for H in (7, 63, 126):
        assert np.array_equal(two.of_length(2 * len(two.selected(H, 1)) - 1, 1), two.selected(H, 1))
        assert np.array_equal(two.selected(2 * H + 1, 2)[two.selected(2 * H + 1, 2) % 2 == 0], 2 * two.selected(H, 1))
    assert two.of_length(4, 1) is None
    assert HarmonicSelection((1,)).selected(9, 1).tolist() == list(range(10))
    assert tooth_orders(two_stages(21, 10)) == (10, 21) and tooth_orders(two_stages(4, 2)) == (2,)
    unbalance = hb.Load(cosine={1: [0.0, 0.01, 0.0]}, sine={1: [0.0, 0.0, 0.01]}, power=2)
    assert tooth_orders(two_stages(40, 80, load=(two_stages().loads[0], unbalance))) == (1, 40)
    side = {40 * a + b for a in range(1, 5) for b in (-1, 1)} | {1, 2, 3, 4, 40, 80, 120, 160}
    kept = set(HarmonicSelection((1, 40)).selected(360, 1).tolist())
    assert side <= kept and 201 not in kept and len(kept) < 100
    given = HarmonicSelection(given=(3, 5))
    assert given.selected(5, 1).tolist() == [0, 3, 5] and given.selected(10, 1).tolist() == [0, 2, 3, 5, 6, 8, 10]


def test_one_tooth_frequency_needs_all_orders():
    assert hb.HarmonicBalance(hb.SpurPair(), 8, orders="meshes").selection is None


@pytest.fixture(scope="module")
def train():
    return two_stages()


@pytest.fixture(scope="module")
def curves(train):
    """Curves with few orders, and three with orders selected from the error of the previous curve."""
    found = [hb.trace(hb.HarmonicBalance(train, 6, orders="meshes"), "Omega", (0.085, 0.07), stability=False)]
    for _ in range(3):
        found.append(hb.trace(found[-1].problem.with_harmonics_of(found[-1], 5e-11), "Omega", (0.085, 0.07)))
    return found


def test_motions_in_mesh_are_those_of_all_orders(train, curves):
    """Without loss of contact the motion is smooth, and the selected orders represent it to 1e-8."""
    curve = curves[-1]
    whole = hb.HarmonicBalance(train, curve.problem.H)
    assert curve.problem.size < 0.6 * whole.size
    for i in (0, len(curve) // 2, -1):
        here = {"Omega": float(curve.values[i])}
        X = solve(whole, whole.from_layout(curve.X[i], curve.layout), here).X
        size = np.abs(X).max()
        np.testing.assert_allclose(curve.layout.spread(curve.X[i]), whole.rows(X), rtol=0, atol=1e-8 * size)
        np.testing.assert_allclose(np.abs(curve.multipliers[i]), np.abs(whole.multipliers(X, **here)), atol=1e-8)
        for name in ("rms", "pp2", "H21", "H10", "H31"):
            assert curve[i].amplitude(name) == pytest.approx(whole.layout.measure(name, X, 0), abs=1e-8)


@pytest.fixture(scope="module")
def lost():
    """A curve with loss of contact, with orders selected from the error of a coarse curve."""
    model = two_stages(7, 4)
    first = hb.trace(hb.HarmonicBalance(model, 6, orders="meshes"), "Omega", SPAN, accuracy=None)
    return hb.trace(first.problem.with_harmonics_of(first, 2e-5), "Omega", SPAN)


SPAN = (0.32, 0.22)


@pytest.mark.slow
def test_special_points_are_those_of_all_orders(lost):
    kinds = {point.kind for point in lost.special}
    assert {"LP", "GR"} <= kinds
    # the error of one inner grazing point with H = 90 exceeds the difference from the curve of selected orders
    whole = hb.HarmonicBalance(lost.problem.model, 2 * lost.problem.refined_problem.H)
    for point in lost.special:
        equations = point.event.equations(whole, "Omega", point)
        if equations is None or not point.located:
            continue
        U = np.append(whole.from_point(point), point.parameters["Omega"])
        found = solve(equations.with_borders_at(U, {}), U, {}).X[-1]
        assert abs(found - point.parameters["Omega"]) < 3 * point.error + 1e-8, point.label


def test_omitted_terms_count_in_the_error(lost):
    problem = lost.problem
    whole = hb.HarmonicBalance(problem.model, problem.H)
    i = int(lost.amplitude("rms", 1).argmax())
    here = {"Omega": float(lost.values[i])}
    X = solve(whole, whole.from_layout(lost.X[i], lost.layout), here).X
    missing = np.linalg.norm((whole.rows(X) - problem.rows(lost.X[i]))[:, 1:]) / np.sqrt(2)
    assert missing > 1e-6
    assert 0.3 * missing < lost.error[i] < 30 * missing
    finer = problem.refined_problem
    assert finer.truncation(finer.resized(lost.X[i]), **here) > 0
    np.testing.assert_array_equal(problem.resized(finer.resized(lost.X[i])), lost.X[i])


def test_saved_and_shown(lost, tmp_path):
    lost.save(tmp_path / "sparse.npz")
    again = hb.load(tmp_path / "sparse.npz", problem=lost.problem)
    assert again.layout == lost.layout and again.layout.orders is not None
    np.testing.assert_array_equal(again.X, lost.X)
    for name in ("rms", "H7", "H4", "H3"):
        np.testing.assert_array_equal(again.amplitude(name), lost.amplitude(name))
    missing = next(k for k in range(1, lost.layout.harmonics) if k not in lost.layout.orders)
    assert not lost.amplitude(f"H{missing}").any()
    assert lost[0].coefficients(0).shape == (2 * lost.layout.harmonics + 1,)


def test_a_file_knows_its_orders(tmp_path):
    pair = hb.SpurPair()
    for orders in ((1, 2, 3, 5, 8), None):
        curve = hb.trace(hb.HarmonicBalance(pair, 8, orders=orders), "Omega", (1.3, 1.2))
        curve.save(tmp_path / "some.npz")
        again = hb.load(tmp_path / "some.npz")
        problem = again.layout.problem_of(again.meta)
        assert problem.orders.tolist() == curve.problem.orders.tolist()
        assert problem.refined_problem.orders.tolist() == curve.problem.refined_problem.orders.tolist()
        np.testing.assert_array_equal(
            problem.residual(again.X[3], Omega=again.values[3]),
            curve.problem.residual(curve.X[3], Omega=curve.values[3]),
        )


@pytest.mark.slow
def test_motions_integrated_in_time(lost):
    report = hb.validate(lost, points=2, landing="nearest")
    assert report.ok, report.summary


def test_auto_takes_more_orders_where_they_are_needed():
    model = two_stages(7, 4)
    problem = hb.HarmonicBalance(model, "auto", orders="meshes", tolerance=1e-4)
    curve = hb.trace(problem, "Omega", (0.33, 0.29), stability=False, special=False)
    assert curve.status.complete
    assert curve.layout.harmonics > problem.H and curve.error.max() < 1e-4


@pytest.mark.parametrize(
    ("orders", "message"),
    [("teeth", "need 'meshes'"), ((), "at least one"), ((0, 2), "orders"), ((1.5,), "orders"), ([[2, "a"]], "orders")],
)
def test_orders_that_are_none(orders, message):
    with pytest.raises((ValueError, TypeError), match=message):
        hb.HarmonicBalance(two_stages(3, 2), orders=orders)


def test_given_orders_do_not_vary():
    with pytest.raises(ValueError, match="auto"):
        hb.HarmonicBalance(two_stages(3, 2), "auto", orders=(2, 3))


def test_omitted_excitation_is_reported():
    with pytest.warns(UserWarning, match="which is not an unknown"):
        hb.HarmonicBalance(two_stages(3, 2), orders=(2, 4, 6, 9))
