"""Continuation of general equations: interface of a problem, sparse matrices, compiled loops of the user."""

import ast
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation.augmented.null_vectors import borders_of, null_vectors
from hbgear.continuation.numerics.linear import Factors, bordered, slogdet
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem

CONTINUATION = Path(hb.__file__).parent / "continuation"
sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))


def words_of(path):
    """Names, imports and one-word strings of a file of code, without documentation and messages."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        for field in ("id", "attr", "arg", "name", "module"):
            if isinstance(word := getattr(node, field, None), str):
                yield word.removeprefix("hbgear")
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " not in node.value:
            yield node.value.removeprefix("hbgear")


def test_continuation_has_no_term_of_mechanics():
    """No frequency, harmonics, gaps or gears, and no test of attributes of a problem."""
    for path in CONTINUATION.rglob("*.py"):
        for word in words_of(path):
            assert not re.search("omega|harmonic|clearance|backlash|gear|hasattr", word.lower()), (path, word)


# ---- a plane curve


@pytest.mark.slow
def test_figure_of_eight():
    """x^2 (1 - x^2) = p^2: folds at p = 1/2, x = sqrt(1/2), and two branches that cross at the origin."""
    from any_equations import eight

    curve = eight()
    np.testing.assert_allclose(curve.X[:, 0] ** 2 * (1 - curve.X[:, 0] ** 2), curve.values**2, atol=1e-10)
    assert [point.label for point in curve.special] == ["LP1", "BP1"]
    assert curve["LP1"].parameters["p"] == pytest.approx(0.5, abs=1e-12)
    assert curve["LP1"].X[0] == pytest.approx(0.5**0.5, abs=1e-7)
    assert np.hypot(curve["BP1"].X[0], curve["BP1"].parameters["p"]) < 1e-8
    other = hb.switch(curve, "BP1")
    assert (
        np.sign(other.X[len(other) // 2, 0] * other.values[len(other) // 2]) == -1
    )  # the curve traced has x = p there
    assert np.sign(curve.X[-1, 0] * curve.values[-1]) == 1


# ---- a sparse Jacobian


def test_bratu():
    """The fold of the continuous problem: p = 8 max (t / cosh t)^2, and of n points by h^2."""
    from any_equations import bratu

    t = 1.1996786402577339  # t tanh t = 1
    exact = 8 * (t / np.cosh(t)) ** 2
    errors = []
    for n in (99, 199):
        curve = bratu(n)
        assert curve.status is hb.Status.EVENT and curve["high1"].X.max() == pytest.approx(4.0, abs=1e-9)
        errors.append(curve["LP1"].parameters["p"] - exact)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=1e-3)


@pytest.mark.slow
def test_the_fold_of_bratu_in_a_second_parameter():
    """Folds with q > 0, sparse, against traces at a fixed q; and the cusp, beyond which a trace has none."""
    from any_equations import FINE, Bratu, bratu, cusp

    folds = cusp(bratu(99))
    assert folds.status is hb.Status.EVENT and [point.label for point in folds.special] == ["CP1", "far1"]
    q = folds["CP1"].parameters["q"]
    assert q == pytest.approx(0.2458, abs=1e-4)  # of the continuous problem
    problem = Bratu(99)
    for value, count in ((0.98 * q, 2), (1.02 * q, 0)):
        curve = hb.trace(problem, "p", (0.0, 8.0), np.zeros(99), at={"q": value}, settings=FINE)
        found = [point.parameters["p"] for point in curve.special if point.kind == "LP"]
        assert len(found) == count
        for i, p in zip((0, len(folds) - 2), found, strict=False):  # the lower and the upper fold
            held = hb.trace(
                hb.continuation.FoldProblem(problem, "p"), "q", (folds.values[i], value), folds[i], settings=FINE
            )
            assert held.tracked["p"][-1] == pytest.approx(p, rel=1e-8)


def test_a_large_sparse_problem_stays_sparse(monkeypatch):
    from any_equations import Bratu

    monkeypatch.setattr(np.linalg, "solve", lambda *_: pytest.fail("dense solution"))
    problem = Bratu(10_000)
    curve = hb.trace(
        problem,
        "p",
        (0.0, 1.0),
        np.zeros(10_000),
        settings=hb.NewtonSettings(tolerance=1e-8),
        steps=hb.StepControl(first_step=0.5, max_step=0.5),
    )
    assert curve.status is hb.Status.REACHED_END
    t = 0.37929  # u(1/2) = 2 log cosh t, p = 8 t^2 / cosh^2 t
    for _ in range(50):
        t = (np.cosh(t) ** 2 / 8) ** 0.5
    assert curve.X[-1].max() == pytest.approx(2 * np.log(np.cosh(t)), rel=1e-6)


@pytest.mark.parametrize("shift", [0.0, 1e-3, -0.7])
def test_bordered_sparse_and_dense_agree(shift):
    from scipy import sparse

    rng = np.random.default_rng(1)
    n = 40
    A = np.where(rng.uniform(size=(n, n)) < 0.2, rng.uniform(size=(n, n)), 0.0) + np.diag(rng.uniform(1, 2, n))
    A -= (np.linalg.eigvals(A).real.min() + shift) * np.eye(n)
    S = sparse.csc_array(A)
    b, c = rng.normal(size=(2, n))
    x = rng.normal(size=n + 1)
    np.testing.assert_allclose(Factors(bordered(S, b, c)).solve(x), np.linalg.solve(bordered(A, b, c), x), rtol=1e-8)
    sign, log = slogdet(bordered(S, b, c, 0.3))
    assert (sign, log) == pytest.approx(np.linalg.slogdet(bordered(A, b, c, 0.3)), rel=1e-9)
    dense, sparse_ = borders_of(A)[:2], borders_of(S)[:2]
    assert null_vectors(A, *dense)[2] == pytest.approx(null_vectors(S, *sparse_)[2], rel=1e-5, abs=1e-12)


# ---- names of parameters, compiled loops


class Circle:
    """x^2 + Omega^2 = 1: the parameter is called Omega, and may be negative."""

    def evaluate(self, X, Omega):
        return np.array([X[0] ** 2 + Omega**2 - 1]), np.array([[2 * X[0]]])


def test_a_parameter_called_omega_of_a_users_problem():
    curve = hb.trace(Circle(), "Omega", (-2, 2), start_at(0.8, Omega=0.6))
    assert curve.status is hb.Status.CLOSED
    np.testing.assert_allclose([point.parameters["Omega"] for point in curve.special], [1, -1], atol=1e-12)


def start_at(x, **parameters):
    return hb.Point(np.array([x]), parameters, 0.0, 0, None, np.zeros(0, np.int8), np.nan, None)


class Looped(Circle):
    """The circle with its own continuation loop, which returns the points of `rows_of`."""

    def __init__(self):
        self.asked = []

    def compiled_continuation(self, name, parameters):
        self.asked.append((name, dict(parameters)))
        return self.rows

    def rows(self, history, count, size, step, span, control, limits, rows):
        """Equal steps along the circle x = cos s, p = sin s, in the direction of the tangent."""
        u, t = history
        made, angle = 0, np.arctan2(u[0, 1], u[0, 0])
        scale = np.array([max(size[0], abs(u[0, 0])), size[1]])
        way = np.sign(t[0] @ [-u[0, 1], u[0, 0]])
        while made < len(rows):
            angle += way * 0.02
            x, p = np.cos(angle), np.sin(angle)
            tangent = way * np.array([-p, x])
            rows[made] = x, p, *(tangent / np.linalg.norm(tangent / scale)), step, way, 1, 1e-16
            made += 1
            if not span[0] < p < span[1]:
                break
        return made, step, 0, 0.0


def test_a_problem_may_have_its_own_loop():
    """Points are those of the loop, and the curve is the one traced point by point."""
    looped = Looped()
    curve, alone = (hb.trace(p, "Omega", (-2, 2), start_at(0.6, Omega=-0.8)) for p in (looped, Circle()))
    assert curve.status is alone.status is hb.Status.CLOSED and looped.asked[0] == ("Omega", {})
    assert [point.label for point in curve.special] == [point.label for point in alone.special] == ["LP1", "LP2"]
    for branch in (curve, alone):
        np.testing.assert_allclose(branch.X[:, 0] ** 2 + branch.values**2, 1, atol=1e-9)
    turns = np.diff(np.unwrap(np.arctan2(curve.values, curve.X[:, 0])))
    assert np.isclose(np.abs(turns), 0.02, rtol=1e-9).mean() > 0.9


def test_abilities_are_read_once():
    class Asked(Circle):
        asked = 0

        def __getattribute__(self, name):
            if name in {"pursuit", "events", "layout", "smooth"}:
                type(self).asked += 1
            return super().__getattribute__(name)

    full = as_problem(Asked())
    before = Asked.asked
    assert isinstance(full, ContinuationProblem) and as_problem(full) is full
    hb.trace(full, "Omega", (-2, 2), start_at(0.8, Omega=0.6))
    assert Asked.asked == before


def test_invalid_problems():
    with pytest.raises(TypeError, match=r"problem with evaluate; got a SpurPair: give HarmonicBalance\(model\)"):
        hb.trace(hb.SpurPair(), "Omega", (1.0, 0.5))
    with pytest.raises(
        TypeError, match=r"needs a HarmonicBalance, .* or another problem with evaluate; got a SpurPair"
    ):
        as_problem(hb.SpurPair())
