"""Motions with two prescribed frequencies without a common base: two meshes, or a mesh and an engine order.

    d_k + G(w_k) [p_k(d, d') - kr d_k + g_k] = d2_k,   w_k = k_1 Omega / nu + k_2 Omega_2,   Omega_2 = ratio Omega
    d2_k = W^T Z^-1 [F_k + W (kr + i w c) e_k] - e_k,   k = (0, k_2)

F_k are the harmonics of the second load, e_k the prescribed displacements of the elements that follow the second
frequency; stiffness of their laws varies with the second phase, too. Each excitation is periodic in one phase, so the
motion lies on a torus.

References
----------
Schilder, Vogt, Schreiber & Osinga (2006), Int. J. Numer. Meth. Eng. 67, https://doi.org/10.1002/nme.1632.
Guskov & Thouverez (2012), J. Vib. Acoust. 134(3), https://doi.org/10.1115/1.4005823.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.autonomous.tori.basis import TorusBasis
from hbgear.harmonic.autonomous.tori.ends import smoothness_event
from hbgear.harmonic.autonomous.tori.layout import SECOND
from hbgear.harmonic.autonomous.tori.problem import TorusProblem
from hbgear.harmonic.autonomous.tori.stability import birkhoff_weights, stability_remark
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.structure.derived_model import DerivedModel
from hbgear.mechanics.laws.vector_laws import vector_groups
from hbgear.mechanics.models import Model, System
from hbgear.mechanics.plausibility import warn
from hbgear.mechanics.serialization import to_plain
from hbgear.mechanics.series.fourier import Series, to_complex
from hbgear.mechanics.structures.elements import Element, Load

COMMON_BASE_TOLERANCE = 1e-6
"""Distance of q times the ratio from a whole number, below which both frequencies have a common base."""

_COMMON_BASE_HARMONICS = 40
"""Largest harmonic that counts for a common base [-]: higher ones are small, and every ratio is near some p/q."""

_FREQUENCY_STEP = 1e-6
"""Relative step of the differences of the linear response in the frequency."""


class _FirstTone(DerivedModel):
    """A model in which some elements have no alternating prescribed displacement; it belongs to the second tone."""

    def __init__(self, model: Model, elements: tuple[str, ...]) -> None:
        super().__init__(model)
        self.elements = elements

    def replace(self, /, **changes: float) -> _FirstTone:
        return _FirstTone(self.model.replace(**changes), self.elements)

    def system(self) -> System:
        """Return the system of the model with mean displacements of these elements."""
        system = self.model.system()

        def resting(element: Element) -> Element:
            mean = Series(mean=float(element.displacement.mean))
            return dataclasses.replace(element, displacement=mean) if element.name in self.elements else element

        return dataclasses.replace(system, elements=[resting(element) for element in system.elements])


class TwoToneProblem(TorusProblem):
    """Motions with two prescribed frequencies: a problem for `trace` in Omega or a parameter of the model.

    Parameters
    ----------
    model : Model
        Model with the first excitation.
    ratio : float
        Omega_2 / Omega.
    load : Load, optional
        Load of the second frequency on the coordinates, without constant part. Default: none.
    elements : sequence of str, optional
        Names of the elements whose prescribed displacements and laws follow the second frequency. Default: none.
    harmonics : (int, int), optional
        H_1 and H_2, highest harmonics of both frequencies. Default: (9, 9).
    dense : int, optional
        Factor of the number of samples of the forces. Default: 1.
    band : float, optional
        Highest frequency over Omega. All harmonics up to H_1 and H_2 below it are kept instead of the diamond; use it
        for motions whose spectrum decays slowly, such as irregular impacts. By default the diamond.
    half : (int, int), optional
        Doubled tori with frequencies k_1 Omega / 2 + k_2 Omega_2 / 2, where (k_1, k_2) is even or equals this pair
        modulo 2: (1, 0), (0, 1) or (1, 1). H_1, H_2 count halves, and ``Omega_2`` of the results is half of the second
        frequency. By default tori of single periods.

    Raises
    ------
    ValueError
        If the ratio is a small rational number, the load has a constant part, an element does not exist or has a
        displacement with breakpoints, some elements of a varying law of several displacements are missing, or as of
        `TorusProblem`.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.harmonic.TwoToneProblem(hb.Duffing(), 2**0.5, hb.Load(cosine={1: [0.1]}), harmonics=(3, 3))
    >>> problem.resolution
    'H = (3, 3)'
    """

    free_phase = False
    singular_hint = "a gap that stays open without load: load the system"

    @checked_arguments()
    def __init__(
        self,
        model: Model,
        ratio: float,
        load: Load | None = None,
        elements: Sequence[str] = (),
        harmonics: tuple[int, int] = (9, 9),
        dense: int = 1,
        band: float | None = None,
        half: tuple[int, int] | None = None,
    ) -> None:
        checked("TwoToneProblem", "ratio", ratio, POSITIVE)
        for i in (0, 1):
            counted(f"harmonics[{i}]", harmonics[i], 200)
        counted("dense", dense, 20)
        if half not in (None, (1, 0), (0, 1), (1, 1)):
            raise ValueError(f"half = {half}: doubled tori are of the kinds (1, 0), (0, 1) and (1, 1)")
        if band is not None:
            checked("TwoToneProblem", "band", band, POSITIVE)
        nu = 1 if half is None else 2
        lower = min(harmonics[0], _COMMON_BASE_HARMONICS), min(harmonics[1], _COMMON_BASE_HARMONICS)
        require_no_common_base(ratio, lower)
        self.ratio, self.load, self.elements, self._model = float(ratio), load or Load(), tuple(elements), model
        if self.load.constant is not None and np.any(self.load.constant):
            raise ValueError("the second load has a constant part; add it to the load of the model")
        system = model.system()
        names = [element.name for element in system.elements]
        for name in self.elements:
            if name not in names:
                raise ValueError(f"no element '{name}'; there are {', '.join(names)}")
            if not isinstance(system.elements[names.index(name)].displacement, Series):
                raise ValueError(f"element '{name}' has a displacement with breakpoints, a Periodic; give a Series")
        if any(len(vector) != system.n for vector in self.load.vectors()):
            raise ValueError(f"the vectors of the second load need {system.n} entries, one for each coordinate")
        self._second = np.array([name in self.elements for name in names])
        for rows, law in vector_groups([element.law for element in system.elements]):
            if not law.steady and len(set(self._second[rows].tolist())) > 1:
                missing = ", ".join(names[j] for j in rows if not self._second[j])
                raise ValueError(f"a law of several displacements varies with one frequency; add {missing} to elements")
        first = _FirstTone(model, self.elements) if self.elements else model
        balance = HarmonicBalance(first, max(lower[0], nu), nu=nu)
        scaled = None if band is None else nu * band
        super().__init__(balance, TorusBasis(*harmonics, False, dense, scaled, float(ratio), half))
        self._warn_of_truncated_excitation(system)

    def _warn_of_truncated_excitation(self, system: System) -> None:
        """Warn if harmonics of the second excitation are not among the unknowns."""
        series = [element.displacement for element in system.elements if element.name in self.elements]
        highest = max([self.load.order, *(displacement.order for displacement in series)])
        if [0, highest * self.balance.nu] not in self.basis.k.tolist():
            warn(
                f"the second excitation has {highest} harmonics, and {self.resolution} leaves some of them out; the "
                "response to those up to twice as many harmonics is a part of the stated errors, and the others are "
                "left out: give more harmonics"
            )

    def fit(self, t: Array, d: Array, Omega: float) -> Array:
        """Return unknowns from the displacements of the elements of a settled motion, as a start of `trace`.

        Parameters
        ----------
        t : ndarray, shape (T,)
            Equidistant instants, over many periods of both excitations.
        d : ndarray, shape (m, T)
            Displacements of the elements.
        Omega : float
            Frequency of the first excitation.

        Returns
        -------
        ndarray, shape (n + 1,)
            Coefficients, from averages with weights that suppress the ends, and the second frequency.

        Examples
        --------
        >>> import hbgear as hb
        >>> import numpy as np
        >>> problem = hb.harmonic.TwoToneProblem(hb.Duffing(), 2**0.5, hb.Load(cosine={1: [0.1]}), harmonics=(3, 3))
        >>> t = np.linspace(0.0, 2000.0, 20001)
        >>> X = problem.fit(t, np.cos(0.8 * t)[None], 0.8)
        >>> bool(abs(problem.layout.measure("rms", X[:-1]) - 0.5**0.5) < 1e-6)
        True
        """
        second = self.ratio * Omega / self.balance.nu
        w = self.basis.k @ np.array([Omega / self.balance.nu, second])
        weights = birkhoff_weights(len(t))
        c = 2.0 * np.array([(weights * d) @ np.exp(-1j * wk * t) for wk in w]).T
        c[:, 0] *= 0.5
        return np.append(self.basis.to_real(c).ravel(), second)

    def with_borders_at(self, X: Array, parameters: Mapping[str, float], renew: bool = False) -> TwoToneProblem:
        """Return the problem itself: both phases are prescribed."""
        return self

    def start(self, **parameters: float) -> Array:
        """Return the mean and the linear response to both excitations."""
        c = np.zeros((self.balance.m, len(self.basis.k)), dtype=complex)
        rows = to_complex(self.balance.rows(self.balance.start(**parameters)))
        positions, orders = self.basis.periodic(rows.shape[1])
        c[:, positions] = rows[:, orders]
        Omega_2 = self.ratio * parameters["Omega"] / self.balance.nu
        c += self._second_response({**parameters, SECOND: Omega_2})
        return np.append(self.basis.to_real(c).ravel(), Omega_2)

    @property
    def model(self) -> Model:
        """The model with all excitations except the second load."""
        return self._model

    def events(self, parameter: str) -> tuple[Any, ...]:
        """Return the end at which the spectrum does not decay."""
        return (smoothness_event(),)

    def remarks(self, branch: Branch) -> Sequence[str]:
        """Return where the stability is not determined; the ratio is given, so that no frequencies lock."""
        return (stability_remark(branch),)

    def describe(self) -> dict[str, Any]:
        """Return the data for the header of a file, with the second excitation."""
        out = super().describe()
        load = to_plain(self.load)
        band = None if self.basis.band is None else self.basis.band / self.balance.nu
        half = None if self.basis.half is None else list(self.basis.half)
        second = {"ratio": self.ratio, "load": load, "elements": list(self.elements), "band": band, "half": half}
        return out | {"torus": out["torus"] | second}

    # ---- equations

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """Return the residual with its derivatives; the last equation prescribes the second frequency."""
        evaluation, n = super().linearise(X, name, **parameters), len(X) - 1
        values = {**parameters, SECOND: float(X[-1])}
        h = _FREQUENCY_STEP * values[SECOND]
        second, up, down = (self._second_response({**values, SECOND: values[SECOND] + dw}) for dw in (0.0, h, -h))
        evaluation.R[:n] -= self.basis.to_real(second).ravel()
        evaluation.dR_dX[:n, n] -= self.basis.to_real((up - down) / (2 * h)).ravel()
        weight = evaluation.size / values[SECOND]
        evaluation.R[n] = weight * (values[SECOND] - self.ratio * parameters["Omega"] / self.balance.nu)
        evaluation.dR_dX[n] = 0.0
        evaluation.dR_dX[n, n] = weight
        evaluation.dR_dp[n] = -weight * self.ratio / self.balance.nu if name == "Omega" else 0.0
        return evaluation

    def _phases(self, evaluator: Evaluator, theta: Array) -> list[Array]:
        return [
            self.balance.nu * theta[:, 1] if is_second else tau
            for is_second, tau in zip(self._second, super()._phases(evaluator, theta), strict=True)
        ]

    def _displacements(self, parameters: Mapping[str, float]) -> ComplexArray:
        """Return the harmonics (K, m) of the prescribed displacements of the second frequency."""
        out = np.zeros((len(self.basis.k), len(self._second)), dtype=complex)
        if not self.elements:
            return out
        changes = {name: x for name, x in parameters.items() if name not in ("Omega", SECOND)}
        for j, element in enumerate(self._model.replace(**changes).system().elements):
            if self._second[j] and isinstance(element.displacement, Series):
                series = element.displacement
                out[:, j] = self._harmonics(dict(enumerate(series.cosine, 1)), dict(enumerate(series.sine, 1)))
        return out

    def _harmonics(self, cosine: Mapping[int, Any], sine: Mapping[int, Any], *shape: int) -> ComplexArray:
        """Return coefficients (K, ...) of a function of the second phase from its harmonics by order."""
        out = np.zeros((len(self.basis.k), *shape), dtype=complex)
        for factor, table in ((1.0, cosine), (-1j, sine)):
            for order, value in table.items():
                position = self.basis.positions.get((0, order * self.balance.nu))
                if position is not None:
                    out[position] += factor * np.asarray(value)
        return out

    def _second_loads(self, parameters: Mapping[str, float]) -> ComplexArray:
        """Return the loads (K, n) of the second frequency, with the loads by prescribed displacements."""
        structure = self.evaluator_at(parameters).structure
        power = (self.balance.nu * parameters[SECOND]) ** self.load.power
        out = power * self._harmonics(self.load.cosine, self.load.sine, structure.n)
        w = self.basis.k[:, 1] * parameters[SECOND]
        e = self._displacements(parameters)
        out += ((structure.kr + 1j * w[:, None] * structure.c) * e) @ structure.W.T
        return out

    def _second_response(self, parameters: Mapping[str, float]) -> ComplexArray:
        """Return the displacements (m, K) of the linear structure by the second excitation."""
        structure = self.evaluator_at(parameters).structure
        F, out = self._second_loads(parameters), -self._displacements(parameters).T
        for i in np.flatnonzero(np.abs(F).max(axis=1)):
            w = float(self.basis.k[i, 1]) * parameters[SECOND]
            out[:, i] += structure.W.T @ structure.solve(w, F[i][:, None])[:, 0]
        return out


def require_no_common_base(ratio: float, harmonics: tuple[int, int]) -> None:
    """Raise ValueError if two frequencies of the ratio Omega_2 / Omega have a common base within the harmonics."""
    for q in range(1, 2 * harmonics[1] + 1):
        p = round(ratio * q)
        if 0 < p <= 2 * harmonics[0] and abs(ratio * q - p) < COMMON_BASE_TOLERANCE and math.gcd(p, q) == 1:
            raise ValueError(
                f"Omega_2 / Omega = {ratio:.9g} = {p}/{q}: both frequencies have the common base Omega / {q}, and the "
                f"motion is periodic. Use hb.HarmonicBalance with the base as Omega: orders {q}, {2 * q}, ... for the "
                f"first excitation and {p}, {2 * p}, ... for the second one"
            )


@checked_arguments()
def two_tones(
    model: Model,
    ratio: float,
    span: tuple[float, float],
    *,
    load: Load | None = None,
    elements: Sequence[str] = (),
    harmonics: tuple[int, int] = (9, 9),
    dense: int = 1,
    band: float | None = None,
    half: tuple[int, int] | None = None,
    parameter: str = "Omega",
    **options: Any,
) -> Branch:
    """Trace motions with two prescribed frequencies that have no common base, such as two meshes on different shafts.

        d(t) = Re sum_k c_k e^{i (k_1 + k_2 ratio) Omega t},   |k_1| / H_1 + |k_2| / H_2 <= 1

    Parameters
    ----------
    model : Model
        Model with the first excitation.
    ratio : float
        Omega_2 / Omega, no small rational number.
    span : (float, float)
        First and last value of the parameter.
    load : Load, optional
        Load of the second frequency on the coordinates, without constant part. Default: none.
    elements : sequence of str, optional
        Names of the elements whose prescribed displacements and laws follow the second frequency, such as the second
        mesh. Default: none.
    harmonics : (int, int), optional
        H_1 and H_2, highest harmonics of both frequencies. Default: (9, 9). Gaps need more of both.
    dense : int, optional
        Factor of the number of samples of the forces; larger ones reduce the error with gaps. Default: 1.
    band : float, optional
        Highest frequency over Omega; see `TwoToneProblem`. By default the harmonics fill a diamond.
    half : (int, int), optional
        Kind of doubled tori; see `TwoToneProblem`. Give a ``start``, such as of `TwoToneProblem.fit`.
    parameter : str, optional
        Parameter of the curve. Default: "Omega".
    **options
        Arguments of `trace`.

    Returns
    -------
    Branch
        Curve of tori, with ``tracked["Omega_2"]``. `Branch.amplitude` has the measures "rms", "pp2", "max" and "mean".
        The only multiplier is the mean factor by which the slowest disturbance changes in a period 2 pi / Omega; the
        stability is undecided where its error is too large.

    Raises
    ------
    ValueError
        As of `TwoToneProblem`.
    NoConvergence
        If no motion is found at the first value.

    Examples
    --------
    >>> import hbgear as hb
    >>> second = hb.Load(cosine={1: [0.1]})
    >>> curve = hb.analysis.two_tones(hb.Duffing(k3=0.1, F=0.1), 2**0.5, (0.5, 0.7), load=second, harmonics=(5, 5))
    >>> bool(abs(curve.tracked["Omega_2"][-1] / 0.7 - 2**0.5) < 1e-12)
    True
    """
    problem = TwoToneProblem(model, ratio, load, elements, harmonics, dense, band, half)
    return trace(problem, parameter, span, **({"cover": False, "accuracy": None} | options))
