"""Every registered law passes through file, TOML, plot and peaks, or is refused by name with the reason."""

import math
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numba
import numpy as np
import pytest
import scipy
from machines import single_mass
from pages import TEXTS, blocks

import hbgear as hb
from hbgear.harmonic.models import model_registry
from hbgear.io.machines.structure_file import read_structure
from hbgear.io.machines.toml_file import TomlFileError
from hbgear.mechanics.laws import registry
from hbgear.mechanics.laws.mesh_contacts import MeshContacts, ToothContact
from hbgear.mechanics.models import describe, differing_fields


@numba.njit
def quintic(d, v, tau, k):
    return k[0] * d**5, 5 * k[0] * d**4, 0.0


PRESENT = hb.mechanics.Periodic.rectangular(0.3, 0.0, 0.6)
LEVEL = hb.mechanics.Periodic.trapezoidal(0.2, 0.1, 0.3, 0.2)

EXAMPLES = {
    "cubic": (hb.Cubic(0.3), "k3 = 0.3"),
    "piecewise": (
        hb.mechanics.PiecewiseLinear((-0.1, 0.2), (1.0, 0.1, 2.0), 0.05, hb.mechanics.Series(1.0, (-0.1,))),
        "corners = [-0.1, 0.2]\nslopes = [1.0, 0.1, 2.0]\nforce_at_zero = 0.05\neps = [0.1]",
    ),
    "backlash": (hb.Backlash(0.1, 2.0), "b = 0.1\nk = 2.0"),
    "unilateral": (hb.Unilateral(2.0, 0.1), "k = 2.0\ngap = 0.1"),
    "jenkins": (hb.mechanics.Jenkins(1.0, 0.05, 0.01), "k = 1.0\nlimit = 0.05\nresidual = 0.01"),
    "coulomb": (hb.mechanics.Coulomb(0.05, 10.0), "limit = 0.05\nk = 10.0"),
    "hunt-crossley": (
        hb.mechanics.HuntCrossley(2.0, 0.5, 0.1, sides=2),
        "k = 2.0\ncontact_damping = 0.5\ngap = 0.1\nsides = 2",
    ),
    "kelvin-voigt": (hb.mechanics.KelvinVoigt(2.0, 0.5, 0.1, 2), "k = 2.0\nc = 0.5\ngap = 0.1\nsides = 2"),
    "clipped kelvin-voigt": (hb.mechanics.ClippedKelvinVoigt(2.0, 0.5, -0.1), "k = 2.0\nc = 0.5\ngap = -0.1"),
    "iwan": (hb.mechanics.Iwan((0.5, 0.5), (0.02, 0.1)), "k = [0.5, 0.5]\nlimit = [0.02, 0.1]"),
    "parallel": (hb.mechanics.Parallel((hb.Backlash(0.1, 2.0), hb.Cubic(0.1))), "its field laws is"),
    "tooth contact": (ToothContact(PRESENT, hb.mechanics.Series(0.1)), "its field level is"),
    "mesh contacts": (
        MeshContacts((ToothContact(PRESENT, LEVEL), ToothContact(PRESENT, hb.mechanics.Series(-0.2), -1))),
        "its field contacts is",
    ),
    "compiled": (hb.mechanics.CompiledLaw(quintic, (0.3,), rated=False), "its field function is"),
}
"""Of every law of hbgear an example and its keys in TOML, or the reason for which it has none."""


VECTOR_LAWS = {"component", "radial clearance", "polynomial", "directed", "sliding teeth"}
"""Laws of several displacements and their directions, see `tests/truth/test_vector_elements.py`."""

LAWS_OF_TWO_ELEMENTS = {"contact friction"}
"""Laws that need the force of another element, see `tests/truth/test_friction_limits.py`."""


LAWS_OF_TIME_INTEGRATION = {"rigid friction"}
"""Laws that a balance refuses, see `tests/truth/test_rigid_friction.py`."""


def system(law):
    return single_mass(law, F=0.2, mean=0.1, name="x")


def write_machine(folder, name, keys):
    """Write the machine of `system` as files."""
    for matrix, value in (("M", 1.0), ("C", 0.1), ("K", 1.0)):
        scipy.io.mmwrite(folder / f"{matrix}.mtx", np.array([[value]]))
    text = f"""
        [matrices]
        M = "M.mtx"
        C = "C.mtx"
        K = "K.mtx"
        names = ["q1"]
        [[element]]
        name = "x"
        direction = {{ q1 = 1.0 }}
        law = "{name}"
        {keys}
        [[load]]
        constant = {{ q1 = 0.1 }}
        cosine = {{ 1 = {{ q1 = 0.2 }} }}
        """
    (folder / "machine.toml").write_text(text)
    return folder / "machine.toml"


@pytest.fixture
def curve_of():
    curves = []

    def trace(law):
        curves.append(hb.trace(hb.HarmonicBalance(system(law), 5), "Omega", (0.8, 1.8)))
        return curves[-1]

    yield trace
    plt.close("all")


def assert_same_machine(first, second):
    """Compare all fields of `System` and the equations; a machine of a file also has parameters by name."""
    written, made = (describe(one)["fields"] for one in (first, second))
    assert {name: written[name] for name in made} == made
    one, other = (hb.HarmonicBalance(model, 5) for model in (first, second))
    X = np.linspace(-1.0, 1.0, one.size)
    for a, b in zip(one.evaluate(X, Omega=1.1), other.evaluate(X, Omega=1.1), strict=True):
        np.testing.assert_array_equal(a, b)


def check_results(curve):
    """Plot and peaks of a curve."""
    (peak, *_) = hb.analysis.peaks(curve, accuracy=None)
    assert peak.amplitude() == pytest.approx(curve.amplitude().max(), rel=0.02)
    assert len(hb.plot.response(curve).lines) > 0


@pytest.fixture(autouse=True)
def same_registry():
    """Remove the laws that a test registers after it."""
    before = [(table, dict(table)) for table in (registry.LAWS, registry._BY_CLASS)]
    yield
    for table, entries in before:
        table.clear()
        table.update(entries)


def test_every_law_of_hbgear_has_an_example():
    own = {name for name, entry in registry.LAWS.items() if entry.build.__module__.startswith("hbgear.")}
    assert own == EXAMPLES.keys() | VECTOR_LAWS | LAWS_OF_TWO_ELEMENTS | LAWS_OF_TIME_INTEGRATION


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_registered_law_passes_through_everything(name, tmp_path, curve_of):
    law, keys = EXAMPLES[name]
    curve = curve_of(law)
    assert curve.status.complete
    check_results(curve)
    if registry.LAWS[name].no_toml:
        with pytest.raises(TomlFileError, match=f"'{name}' cannot be given in TOML: {keys}"):
            read_structure(write_machine(tmp_path, name, ""))
    else:
        assert_same_machine(read_structure(write_machine(tmp_path, name, keys)), system(law))
    curve.save(tmp_path / "curve.npz")
    again = hb.load(tmp_path / "curve.npz")
    np.testing.assert_array_equal(again.X, curve.X)
    if name == "compiled":  # the only law that a file cannot hold
        with pytest.raises(ValueError, match="field function of the law CompiledLaw is not data"):
            model_registry.rebuild_problem(again.meta)
        return
    problem = model_registry.rebuild_problem(again.meta)
    assert_same_machine(problem.model, system(law))
    check_results(hb.load(tmp_path / "curve.npz", problem))


def recipe():
    """The first block of the recipe for a force law, as it stands in the documentation."""
    _, page = TEXTS["docs/extending.md"].split("\n## A force law\n", 1)
    return page.split("```python\n", 1)[1].split("```", 1)[0]


@pytest.mark.slow
def test_a_law_by_the_recipe_passes_through_everything(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    space = {"__name__": "mine"}
    exec(recipe(), space)
    Tanh, curve = space["Tanh"], space["curve"]
    check_results(curve)
    curve.save("part.npz")
    again = hb.load("part.npz")
    problem = model_registry.rebuild_problem(again.meta)
    assert problem.model.elements[0].law == Tanh()
    assert_same_machine(problem.model, curve.problem.model)
    check_results(hb.load("part.npz", problem))
    written = read_structure(write_machine(tmp_path, "Tanh", "k = 0.5\nw = 0.2"))
    assert written.elements[0].law == Tanh(0.5, 0.2)
    assert hb.validate(again, 1, landing="nearest").ok
    both = system(hb.mechanics.Parallel((Tanh(0.5), hb.Cubic(0.1))))
    assert_same_machine(model_registry.rebuild_model(describe(both)), both)


def test_a_law_that_is_not_registered_is_named_with_a_remedy(tmp_path, curve_of):
    @dataclass(frozen=True)
    class Own(hb.mechanics.Law):
        k: float = 1.0

        def force(self, d, v, tau):
            return self.k * np.arctan(d), self.k / (1 + d**2), 0 * d

    about = describe(system(Own()))
    assert about["left_out"] == ["elements"]
    with pytest.raises(ValueError, match=r"does not hold its \['elements'\].*law Own is not registered: put @"):
        model_registry.rebuild_model(about)
    hb.mechanics.register_law(Own)
    known = describe(system(Own(2.0)))
    assert "left_out" not in known and not differing_fields(about, known)
    assert model_registry.rebuild_model(known).elements[0].law == Own(2.0)
    curve_of(Own()).save(tmp_path / "own.npz")
    registry.LAWS.pop("Own")
    registry._BY_CLASS.pop(Own)
    again = hb.load(tmp_path / "own.npz")
    with pytest.raises(KeyError, match=r"law 'Own' \(.*test_registered_laws:.*\) is not registered: import the mod"):
        model_registry.rebuild_problem(again.meta)


def test_a_class_that_is_defined_again_replaces_the_first(tmp_path):
    for k in (1.0, 2.0):
        space = {"__name__": "mine", "K": k}
        exec(recipe().replace("k: float = 1.0", "k: float = K").split("load = ")[0], space)
    assert registry.LAWS["Tanh"].build is space["Tanh"] and space["Tanh"]().k == 2.0


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"k": "stiff"}, "Tanh: k = 'stiff' must be a number"),
        ({"k": True}, "must be a number"),
        ({"kk": 1.0}, "Tanh has no field 'kk'; did you mean 'k'"),
    ],
)
def test_damaged_fields_of_a_law_are_refused(fields, message):
    exec(recipe().split("load = ")[0], {"__name__": "mine"})
    with pytest.raises((ValueError, KeyError), match=message):
        registry.LAWS["Tanh"].from_fields(fields)


def test_invalid_registrations_are_refused():
    with pytest.raises(TypeError, match="Plain must be a dataclass derived from"):

        @hb.mechanics.register_law
        class Plain(hb.mechanics.Law):
            def force(self, d, v, tau):
                return d, 1 + 0 * d, 0 * d

    with pytest.raises(TypeError, match=r"needs a class derived from .*, got 3"):
        hb.mechanics.register_law(3)
    with pytest.raises(ValueError, match=r"the name 'cubic' belongs to hbgear\.mechanics\.laws\.laws\.Cubic; give ano"):

        @hb.mechanics.register_law(name="cubic")
        @dataclass(frozen=True)
        class Cubic(hb.mechanics.Law):
            k3: float

            def force(self, d, v, tau):
                return self.k3 * d**3, 3 * self.k3 * d**2, 0 * d

    @hb.mechanics.register_law(name="damped")
    @dataclass(frozen=True)
    class Damped(hb.mechanics.Law):
        damping: float = 1.0

        def force(self, d, v, tau):
            return self.damping * v, 0 * d, self.damping + 0 * d

    with pytest.raises(ValueError, match="'damped' cannot be given in TOML: its field damping has the name of a key"):
        registry.LAWS["damped"].from_toml({})
    assert math.isfinite(model_registry.rebuild_model(describe(system(Damped(0.5)))).elements[0].law.damping)


def test_the_recipe_is_the_block_that_the_documentation_runs():
    assert recipe().strip() in {block.text.strip() for block in blocks("python")}
