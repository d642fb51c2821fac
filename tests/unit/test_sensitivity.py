"""Derivatives of located points against central differences of the points located again with other parameters."""

import math
import pickle

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation.events import event_at
from hbgear.continuation.newton import refine, solve
from hbgear.continuation.problem import as_problem
from hbgear.harmonic.sensitivity import _At, _asked, _names, _remembering
from hbgear.harmonic.special import EXTREMA

CLOSE = 1e-6  # of a derivative, relative
LEAST = 1e-8  # of Omega for a change of the parameter by its own size: below it a derivative is rounding


def located(problem, equations, U, here):
    """The special point solved for anew."""
    based = equations.based(U, here)
    return refine(based, solve(based, U, here), here).X


def differences(point, parameters=None):
    """Derivatives of (X, p) by differences of points located at h and 2h to both sides; one-sided at ends of ranges."""
    problem, here, parameter = _asked(point, parameters)
    names = _names(problem, here, parameter, parameters)
    at = _At(_remembering(problem, point, 8), point, here, parameter, names)
    equations = at.equations()
    first = located(at.problem, equations, np.append(at.X, here[parameter]), here)
    out = []
    for name in names:
        h = 2e-5 * at.problem.unit_of(name, here[name])
        moved = {}
        for k in (-2, -1, 1, 2):
            try:
                moved[k] = located(at.problem, equations, first, {**here, name: here[name] + k * h}) - first
            except ValueError:
                continue
        if -1 in moved:
            out.append((8 * (moved[1] - moved[-1]) - (moved[2] - moved[-2])) / (12 * h))
        else:
            out.append((4 * moved[1] - moved[2]) / (2 * h))
    return names, np.array(out), at


def check(point, parameters=None):
    found = hb.sensitivity(point, parameters)
    names, expected, at = differences(point, parameters)
    assert found.parameters == names
    unit = np.array([at.problem.unit_of(name, at.here[name]) for name in names])
    p, size = expected[:, -1], max(abs(point.parameters[at.parameter]), 1e-3)
    error = np.abs(found.slopes[0] - p)
    bad = error > CLOSE * np.abs(p) + LEAST * size / unit
    told = [(n, a, b) for n, a, b, wrong in zip(names, found.slopes[0], p, bad, strict=True) if wrong]
    assert not told, told
    # the amplitude: its gradient along the differences of the unknowns
    measure = found.quantities[-2] if found.quantities[-1].endswith("[m]") else found.quantities[-1]
    layout, X = point.layout, point.X
    for name, dX, slope, one in zip(names, expected[:, :-1], found.of(measure).values(), unit, strict=True):
        length = np.linalg.norm(dX)
        h = 1e-5 / length if length else 1.0
        rate = float(layout.measure(measure, X + h * dX) - layout.measure(measure, X - h * dX)) / (2 * h)
        assert slope == pytest.approx(rate, rel=1e-5, abs=1e-7 / one), (name, measure)
    return found


@pytest.fixture(scope="module")
def spur():
    pair = hb.SpurPair(e=(0.1, 0.02), eps=(0.1,), reference=(38000.0, 37.6e-6, 15000.0, 25.0))
    return hb.trace(hb.HarmonicBalance(pair, 8), "Omega", (2.6, 0.4))


def test_every_point_of_a_spur_pair(spur):
    kinds = {point.kind for point in spur.special}
    assert {"LP", "PD", "GR"} <= kinds
    for kind in kinds & {"LP", "PD", "GR"}:
        found = check(next(point for point in spur.special if point.kind == kind))
        assert {"eps[0]", "e[1]", "reference[0]", "b"} <= set(found.parameters)
        assert found.quantities[:3] == ("Omega", "mesh Hz", "pinion r/min")


@pytest.mark.parametrize("measure", ["rms", "H1", "pp2", "max", "mean"])
def test_peaks(spur, measure):
    tops = hb.peaks(spur, measure, accuracy=None)
    top = tops[0] if measure == "mean" else max(tops, key=lambda point: point.amplitude(measure))
    found = check(top)
    assert found.quantities[-2] == measure
    if measure in EXTREMA:  # of the peak found by searching, whose amplitude is flat
        for name in ("zeta", "e[0]"):
            h = 1e-3 * found.values[found.parameters.index(name)]
            sizes = []
            for side in (1, -1):
                model = spur.problem.model.replace(**{name: spur.problem.model.entries.get(name, 0.05) + side * h})
                span = top.parameters["Omega"] + np.array([0.03, -0.03])
                curve = hb.trace(hb.HarmonicBalance(model, 8), "Omega", tuple(span), top.X, special=False)
                peaks = hb.peaks(curve, measure, accuracy=None)
                sizes.append(max(point.amplitude(measure) for point in peaks))
            assert found.of(measure)[name] == pytest.approx((sizes[0] - sizes[1]) / (2 * h), rel=1e-4)


MODELS = {
    "duffing": (hb.Duffing(), (0.8, 1.6)),
    "rotor": (hb.GearRotorBearing(), None),
    "helical": (hb.HelicalPair(), None),
    "double": (hb.DoubleHelicalPair(zeta=0.05), (1.0, 0.8)),
}


@pytest.mark.parametrize("name", MODELS)
def test_every_parameter_of_every_model(name):
    model, span = MODELS[name]
    curve = hb.trace(hb.HarmonicBalance(model, 5), "Omega", span or model.default_span)

    for kind in dict.fromkeys(point.kind for point in curve.special):
        if kind in ("LP", "PD", "GR"):
            print(kind)
            found = check(next(point for point in curve.special if point.kind == kind))
            assert set(found.parameters) == set(model.parameters) | set(model.entries)
