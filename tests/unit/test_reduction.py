"""Reduced structures against the full ones."""

import numpy as np
import pytest
from machines import cantilever
from scipy import sparse
from scipy.linalg import expm

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.mechanics.reduction import reduce, reduced_within


def chain(n, law=None, dense=False, damping=0.02):
    """Return n masses between walls, driven at the first, with an element to ground at the last."""
    K = sparse.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1]).tocsr()
    first, last = np.eye(n)[0], np.eye(n)[-1]
    M = sparse.eye_array(n).tocsr()
    if dense:
        M, K = M.toarray(), K.toarray()
    element = hb.Element(last, law or hb.Cubic(k1=0.0, k3=0.5), name="ground")
    return hb.System(M, damping * K, K, [element], hb.Load(cosine={1: 0.1 * first}))


def first_frequency(n):
    """Return the first natural frequency of the chain between walls in closed form."""
    return 2 * np.sin(np.pi / (2 * (n + 1)))


def test_frequencies_are_those_of_the_chain():
    """With a negligible element the frequencies agree with the closed form of the chain to 1e-10."""
    n = 80
    found = reduce(chain(n, hb.Unilateral(k=1e-14, gap=0.0)), 10)
    closed = 2 * np.sin(np.arange(1, 11) * np.pi / (2 * (n + 1)))
    np.testing.assert_allclose(found.frequencies, closed, rtol=1e-10)
    np.testing.assert_allclose(found.basis.T @ (found.full.M @ found.basis), np.eye(found.basis.shape[1]), atol=1e-12)


def test_all_modes_but_one_lose_nothing():
    """Together with the static responses the basis is then complete."""
    full = chain(12)
    found = reduce(full, 11)
    assert found.basis.shape == (12, 12)
    assert found.error([0.0, 0.3, 1.1]).max() < 1e-10


def test_error_falls_with_the_fourth_power_of_the_frequencies_kept():
    """Static responses leave a fraction (w / w_r)^2 of a mode; its share of the receptance decreases likewise."""
    w, full = 0.05, chain(200)
    modes = np.array([10, 20, 40])
    errors = [reduce(full, int(r)).error(w)[0] for r in modes]
    slope = np.polyfit(np.log(modes), np.log(errors), 1)[0]
    assert slope < -2.5


def test_static_response_is_exact():
    full = chain(100, hb.Backlash(b=0.1))
    assert reduce(full, 3).error(0.0)[0] < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("law", [hb.Cubic(k1=0.0, k3=0.5), hb.Unilateral(k=0.3, gap=0.5)])
def test_curve_and_multipliers_of_the_full_chain(law):
    n = 40
    w = first_frequency(n)
    full, found = chain(n, law, dense=True), reduce(chain(n, law), 20)
    curves = [hb.trace(hb.HarmonicBalance(s, 7), "Omega", (0.8 * w, 1.3 * w)) for s in (full, found.system)]
    assert [p.kind for p in curves[0].special] == [p.kind for p in curves[1].special]
    for a, b in zip(curves[0].special, curves[1].special, strict=True):
        assert b.parameters["Omega"] == pytest.approx(a.parameters["Omega"], rel=2e-6)
    i = int(np.argmin(np.abs(curves[1].values - w)))
    X, here = curves[1].X[i], curves[1].parameters_at(i)
    mus = [curve.problem.multipliers(X, **here)[:6] for curve in curves]
    np.testing.assert_allclose(np.sort(np.abs(mus[0])), np.sort(np.abs(mus[1])), rtol=2e-4)


def test_flexibility_of_the_modes_left_out():
    """The flexibility agrees to 1e-9 with the sum over the neglected modes of the dense structure."""
    n, modes = 60, 12
    full = chain(n, hb.Unilateral(k=0.3, gap=0.5), dense=True)
    found = reduce(chain(n, hb.Unilateral(k=0.3, gap=0.5)), modes)
    w = np.eye(n)[-1]
    squares, shapes = np.linalg.eigh(full.K + 0.3 * np.outer(w, w))
    exact = np.sum((w @ shapes[:, modes:]) ** 2 / squares[modes:])
    np.testing.assert_allclose(found.flexibility, [[exact]], rtol=1e-9)
    assert found.modulation() == pytest.approx(0.3 * exact, rel=1e-9)
    assert found.modulation([0.1]) == pytest.approx(0.1 * exact, rel=1e-9)
    for swing in ([0.1, 0.2], [-0.1], [np.nan]):
        with pytest.raises(ValueError, match="one for each element"):
            found.modulation(swing)


def test_residual_flexibility_with_free_motion():
    """Three free masses joined by an element and a spring: the only retained mode is the free motion."""
    spring = hb.Element([1, -1, 0], hb.Unilateral(k=2.0, gap=-1.0), name="spring")
    K = np.array([[0.0, 0, 0], [0, 1, -1], [0, -1, 1]])
    found = reduce(hb.System(np.eye(3), 0.01 * K, K, [spring]), 1)
    closed = K + 2.0 * np.outer([1, -1, 0], [1, -1, 0])
    squares, shapes = np.linalg.eigh(closed)
    exact = np.sum((np.array([1, -1, 0]) @ shapes[:, 1:]) ** 2 / squares[1:])
    np.testing.assert_allclose(found.flexibility, [[exact]], rtol=1e-7)


@pytest.mark.parametrize("zeta", [0.0, 0.02])
def test_bound_on_the_growth_of_a_mode(zeta):
    """Switching the stiffness between 1 - mu and 1 + mu at twice the frequency causes at least 60 % of the bound."""
    mu, T = 0.05, 2 * np.pi
    slow, fast = (expm(T / 4 * np.array([[0, 1], [-(1 + k), -2 * zeta]])) for k in (-mu, mu))
    largest = np.abs(np.linalg.eigvals(fast @ slow @ fast @ slow)).max()
    rate, bound = np.log(largest) / T, mu / (2 * np.sqrt(1 - zeta**2)) - zeta
    assert 0.6 * mu / 2 < rate + zeta < mu / 2 and rate < bound


def test_no_more_multipliers_above_the_bound_than_the_reduced_system_has():
    """The bound and the count hold for the full chain at a motion that opens and closes its stop."""
    n, modes, beta = 40, 20, 0.1
    law = hb.Unilateral(k=0.3, gap=0.5)
    full, found = chain(n, law, dense=True, damping=beta), reduce(chain(n, law, damping=beta), modes)
    w = first_frequency(n)
    problem = hb.HarmonicBalance(full, 7, reduce=False)
    mu = np.abs(problem.multipliers(problem.start(w), Omega=w))
    # damping ratio beta w_r / 2 rises with the frequency: of the neglected modes the lowest one decays most slowly
    lowest = found.frequencies[-1]
    assert found.modulation() < beta * lowest  # the neglected modes alone are stable
    bound = np.exp((found.modulation() / 2 - beta * lowest / 2) * lowest * 2 * np.pi / w)
    assert np.sum(mu > bound) <= 2 * found.system.n < len(mu)
    assert np.sum(mu > bound) >= modes  # the bound is not too large


def test_full_motion_from_the_reduced_one():
    n = 60
    w = 1.02 * first_frequency(n)
    full, found = chain(n, dense=True), reduce(chain(n), 25)
    q = []
    for system in (full, found.system):
        problem = hb.HarmonicBalance(system, 5)
        curve = hb.trace(problem, "Omega", (0.8 * w, w), stability=False, accuracy=None)
        q.append(problem.motion(curve.X[-1], Omega=w))
    np.testing.assert_allclose(found.motion(q[1]), q[0], atol=1e-5 * np.abs(q[0]).max())


def test_free_motion_stays_free():
    """Two discs on a free shaft, driven in opposite directions, with backlash at a coupling: peaks agree to 1e-4."""
    n = 50
    K = sparse.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1]).tolil()
    K[0, 0] = K[-1, -1] = 1.0
    gap = np.zeros(n)
    gap[20], gap[21] = 1.0, -1.0
    K[20, 20] -= 1
    K[21, 21] -= 1
    K[20, 21] = K[21, 20] = 0.0
    drive = np.zeros(n)
    drive[0], drive[-1] = 0.1, -0.1
    M, K = sparse.eye_array(n).tocsr(), K.tocsr()
    full = hb.System(
        M,
        0.05 * K,
        K,
        [hb.Element(gap, hb.Backlash(b=0.05), damping=0.05)],
        hb.Load(constant=drive, cosine={1: 0.5 * drive}),
    )
    found = reduce(full, 25)
    assert found.frequencies[0] < 1e-6 < found.frequencies[1]
    dense = hb.System(M.toarray(), 0.05 * K.toarray(), K.toarray(), full.elements, full.load)
    problems = [hb.HarmonicBalance(s, 7) for s in (dense, found.system)]
    curves = [hb.trace(one, "Omega", (0.02, 0.09), stability=False, accuracy=None) for one in problems]
    peaks = [curve.amplitude("pp2").max() for curve in curves]
    assert peaks[1] == pytest.approx(peaks[0], rel=1e-4)


@pytest.mark.parametrize("modes", [0, 12, -3, 2.5, True])
def test_number_of_modes_is_checked(modes):
    with pytest.raises(ValueError, match="must be a whole number"):
        reduce(chain(12), modes)


def test_mass_is_checked():
    full = chain(12)
    M = full.M.toarray()
    M[3, 3] = 0.0
    with pytest.raises(ValueError, match="'q4' has no positive mass"):
        reduce(hb.System(M, full.C, full.K, full.elements, full.load), 4)


def driveline(seed, count, unbalance=0.0):
    """Return two free shafts with random stiffness and inertia, one mesh, and balanced torques at the far ends."""
    rng = np.random.default_rng(seed)
    springs, inertias = 10 ** rng.uniform(6, 8, (2, count - 1)), 10 ** rng.uniform(-4, 0, (2, count))
    shafts = [sparse.diags_array([-k, np.r_[k, 0] + np.r_[0, k], -k], offsets=[-1, 0, 1]) for k in springs]
    r_1, r_2, torque = 0.0313, 0.0777, 137.3
    mesh, load = np.zeros(2 * count), np.zeros(2 * count)
    mesh[count - 1], mesh[count] = r_1, -r_2
    load[0], load[-1] = torque, -torque * r_2 / r_1 * (1 + unbalance)
    K, M = sparse.block_diag(shafts, format="csr"), sparse.diags_array(inertias.ravel())
    gap = hb.Element(mesh, hb.Backlash(b=1e-5, k=1e8), hb.mechanics.Series(cosine=(1e-6,)), damping=1e2, name="mesh")
    return hb.System(M, 1e-6 * K, K, [gap], hb.Load(constant=load))


@pytest.mark.parametrize("seed", range(6))
def test_a_free_driveline_stays_balanced(seed):
    """The torques do no work on the free rotation except by rounding; full and reduced models have the same motion."""
    full = driveline(seed, 150)
    small = hb.mechanics.reduce(full, modes=20)
    Omega = 0.5 * small.frequencies[1]
    one, other = hb.HarmonicBalance(full, 4), hb.HarmonicBalance(small.system, 4)
    X = one.start(Omega)
    error = np.abs(small.error(Omega * np.arange(1, 5))).max()
    np.testing.assert_allclose(other.start(Omega), X, rtol=0, atol=(1e-8 + 10 * error) * np.abs(X).max())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("share", [1e-3, 1.0])
def test_a_driveline_out_of_balance_is_refused_also_when_reduced(seed, share):
    full = driveline(seed, 40, share)
    for model in (full, hb.mechanics.reduce(full, modes=20).system):
        with pytest.raises(ValueError, match="on a motion that nothing holds"):
            hb.HarmonicBalance(model, 4)


def test_responses_to_inertia_are_exact_where_few_modes_are():
    """The error decreases with the number of corrections, from below 1e-3 to below 1e-9."""
    full, w = chain(200), 4 * first_frequency(200)
    errors = [reduce(full, 12, corrections=s).error(w)[0] for s in (1, 2, 4)]
    assert 1e-9 < errors[1] < 0.1 * errors[0] < 1e-3 and errors[2] < 1e-9
    with pytest.raises(ValueError, match="corrections"):
        reduce(full, 12, corrections=0)


def test_a_structure_too_large_for_its_modes_is_reduced_for_a_curve():
    """A chain of 1600 masses: motions agree with direct solutions, multipliers with an explicitly reduced model."""
    n = 1600
    w = first_frequency(n)
    span = 0.97 * w, 1.01 * w
    system = chain(n, damping=2.0)
    problem, directly = (hb.HarmonicBalance(system, 3, reduce=reduce) for reduce in (True, False))
    settings = {"special": False, "accuracy": None}
    curve = hb.trace(problem, "Omega", span, **settings)
    assert curve.status == "reached_end" and curve.multipliers.shape == (len(curve), 32)
    reduction = curve.meta["structure"]
    assert reduction["of"] == n and reduction["modes"] < 100 and 0 < reduction["error"] < 1e-9
    X, Omega = curve.X[len(curve) // 2], curve.values[len(curve) // 2]
    own = solve(directly, X, {"Omega": Omega}).X
    np.testing.assert_allclose(X, own, rtol=0, atol=1e-8 * np.abs(own).max())
    motion = curve.problem.motion(X, Omega=Omega)
    np.testing.assert_allclose(motion, directly.motion(own, Omega=Omega), rtol=0, atol=1e-7 * np.abs(motion).max())
    assert curve.problem.dof_names == directly.dof_names and motion.shape == (n, 7)
    small = hb.HarmonicBalance(reduce(system, 60).system, 3)
    mu = small.multipliers(X, Omega=Omega)[:6]
    np.testing.assert_allclose(problem.multipliers(X, Omega=Omega)[:6], mu, rtol=1e-5)
    with pytest.raises(ValueError, match=r"1600 coordinates, .*\. The limit is 1500 .* 256 modes below"):
        directly.multipliers(X, Omega=Omega)
    again = curve.problem.restricted_to("Omega", *span, {})
    assert again is curve.problem and again.restricted_to("Omega", w, 100 * w, {}) is not again


def test_a_structure_whose_modes_all_matter_is_solved_directly():
    """Far above the first 256 natural frequencies the structure is not reduced."""
    problem = hb.HarmonicBalance(chain(1600), 2)
    with pytest.raises(ValueError, match=r"cube of their number.*stability=False"):
        hb.trace(problem, "Omega", (0.5, 0.6), progress=lambda _: pytest.fail("refused after a point"))
    assert problem.restricted_to("Omega", 0.5, 0.6, {}).compiled({}).structure.n == 1600
    assert hb.HarmonicBalance(chain(40), 2).restricted_to("Omega", 0.5, 0.6, {}).compiled({}).structure.n == 40


def test_a_structure_known_to_its_rounding_only_is_reduced_to_it():
    """The stiffness of a beam of 300 elements has condition number 1e11, so its responses are less exact than 1e-9."""
    n = 300
    (M, K), tip = map(sparse.csr_array, cantilever(n)), np.eye(2 * n)[-2]
    beam = hb.System(M, 1e-4 * K, K, [hb.Element(tip, hb.Unilateral(1.0, 0.1))], hb.Load(cosine={1: 0.1 * tip}))
    found = reduced_within(beam, 80.0)
    assert found is not None and found[0].system.n < 50
    assert 1e-9 < found[1] < 1e-5
    small = found[0].system
    flexibility = small.W[:, 0] @ np.linalg.solve(small.K, small.W[:, 0])
    assert flexibility == pytest.approx(1 / 3, rel=1e-5)  # L^3 / (3 E I)


def test_the_lowest_mode_of_a_fine_mesh_keeps_its_stiffness():
    """Rounding of K relative to the highest of 2400 modes exceeds the lowest squared frequency, 3.516^2."""
    n = 1200
    (M, K), tip = map(sparse.csr_array, cantilever(n)), np.eye(1, 2 * n, 2 * n - 2)[0]
    stop = hb.Element(tip, hb.Unilateral(0.01, 0.1))
    found = reduce(hb.System(M, 0.2 * M, K, [stop], hb.Load(cosine={1: tip})), 6)
    small = found.system
    lowest = np.sqrt(np.linalg.eigvalsh(small.K)[0])
    assert lowest == pytest.approx(1.875104068711961**2, rel=1e-4)
    assert small.W[:, 0] @ np.linalg.solve(small.K, small.W[:, 0]) == pytest.approx(1 / 3, rel=1e-4)  # L^3 / (3 E I)
    assert found.frequencies[0] == pytest.approx(np.sqrt(lowest**2 + 0.01 * 2**2), rel=1e-4)


@pytest.mark.slow
def test_a_mesh_too_fine_for_all_its_coordinates_is_to_be_reduced():
    """The message called the motion of the lowest mode, which the clamp holds, one that no stiffness holds."""
    (M, K), tip = cantilever(600), np.eye(1, 1200, 1198)[0]
    C = 0.2 * M + 0.1 * np.outer(tip, tip)  # with modal damping, the real modes are accurate
    beam = hb.System(M, C, K, [hb.Element(tip, hb.Cubic(k3=0.05))], hb.Load(cosine={1: 0.02 * tip}))
    words = r"stiffness over mass is below 1e-12 of the largest.*hb\.mechanics\.reduce"
    with pytest.warns(hb.mechanics.ImplausibleInputWarning), pytest.raises(ValueError, match=words):
        hb.HarmonicBalance(beam, 3).start(2.0)
    hb.HarmonicBalance(hb.mechanics.reduce(beam, 10).system, 3).start(2.0)
