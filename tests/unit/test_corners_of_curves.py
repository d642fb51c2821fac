"""Steps over corners of curves, where derivatives jump or have the slope of a square root."""

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.solvers.corner import Corner, step_over_corner
from hbgear.continuation.solvers.newton import NewtonSettings
from hbgear.mechanics import Periodic, Series
from hbgear.mechanics.laws.mesh_contacts import MeshContacts, ToothContact


class Grazing:
    """x + c y = p,   y + k x + b sqrt(max(x, 0)) = 0: the equations of a fold next to a grazing contact at x = 0."""

    def __init__(self, b, c, k):
        self.b, self.c, self.k = b, c, k

    def evaluate(self, X, p):
        (x, y), root = X, np.sqrt(max(X[0], 0.0))
        slope = self.k + (self.b / (2 * root) if x > 0 else 0.0)
        return np.array([x + self.c * y - p, y + self.k * x + self.b * root]), np.array([[1.0, self.c], [slope, 1.0]])

    def at(self, x):
        """Return the point (x, y, p) of the curve and its unit tangent, x growing."""
        root = np.sqrt(max(x, 0.0))
        y, slope = -self.k * x - self.b * root, -self.k - (self.b / (2 * root) if x > 0 else 0.0)
        tangent = np.array([1.0, slope, 1.0 + self.c * slope])
        return np.array([x, y, x + self.c * y]), tangent / np.linalg.norm(tangent)

    def step(self, x, sign):
        """Return the point beyond the corner from the point at x, and its direction."""
        u, tangent = self.at(x)
        J = np.column_stack([self.evaluate(u[:2], u[2])[1], [-1.0, 0.0]])
        orientation = int(np.sign(np.linalg.det(np.vstack([J, sign * tangent]))))
        equations = CurveEquations(as_problem(self), "p", {})
        corner = Corner(equations, NewtonSettings(), u, sign * tangent, orientation, np.ones(3))
        point, length = step_over_corner(corner, 1e-7, 20.0)
        at = np.append(point.solution.X, point.solution.value)
        assert np.linalg.norm(at - u) == pytest.approx(length)
        return at, point.direction


@pytest.mark.parametrize("b, c, k", [(1, 0.3, 0.2), (1, -0.3, 0), (5, 0.3, 0.1), (0.2, 2, 0), (-1, 0.3, 0.4)])
def test_a_curve_leaves_along_the_boundary_and_comes_back(b, c, k):
    """The exact curve is parabolic beyond x = 0; its parameter turns back there if b c > 0."""
    problem = Grazing(b, c, k)
    there, direction = problem.step(-1e-8, 1)
    exact, tangent = problem.at(there[0])
    assert there[0] > 1e-6
    np.testing.assert_allclose(there, exact, rtol=0, atol=1e-15)
    np.testing.assert_allclose(direction, tangent, rtol=0, atol=1e-6)
    assert (direction[2] < 0) == (b * c > 0)
    back, direction = problem.step(1e-15, -1)
    exact, tangent = problem.at(back[0])
    assert back[0] < -1e-7
    np.testing.assert_allclose(back, exact, rtol=0, atol=1e-15)
    np.testing.assert_allclose(direction, -tangent, rtol=0, atol=1e-6)


@pytest.mark.parametrize("distance", [1e-3, 1e-6, -1e-6])
@pytest.mark.parametrize("where", ["extremum", "breakpoint"])
def test_difference_steps_keep_a_distance_from_contacts_of_teeth(where, distance):
    """A motion a + cos(theta) whose lowest point, or whose value at theta = 2, lies at a distance from the level."""
    stiffness = Periodic.rectangular(1.0, 0.0, 0.5, start=2.0)
    law = MeshContacts((ToothContact(stiffness, Series(0.4)),))
    problem = hb.HarmonicBalance(single_mass(law, F=0.3), 8)
    X = np.zeros(problem.size)
    X[:2] = 0.4 + distance - (-1.0 if where == "extremum" else np.cos(2.0)), 1.0
    step = problem.difference_step(X, {"Omega": 1.0})
    assert step * np.linalg.norm(X) == pytest.approx(min(1e-2 * abs(distance), 1e-5 * np.linalg.norm(X)), rel=1e-3)
