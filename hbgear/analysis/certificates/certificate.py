"""Certificates: what was proved of a point, with the exact decimals from which the proof is repeated.

A certificate holds the coefficients of the equations, the order of the contacts, and a box of the unknowns. These are
all that the proof needs; enclosures, multipliers and the sentence follow from them.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from os import PathLike
from pathlib import Path
from typing import Any

from hbgear.analysis.certificates.conditions import NotCertifiedError
from hbgear.analysis.certificates.proof import prove
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.atomic_write import atomic_write
from hbgear.common.text.messages import shortened
from hbgear.continuation.results.branch import Branch

FORMAT = "hbgear certificate, version 1"
"""First entry of a file."""

NAMES = {"motion": "periodic motion", "LP": "fold", "PD": "period doubling", "GR": "grazing point"}
"""Names of the kinds of points."""


MAX_FREQUENCY_CHANGE = 1e-2
"""Largest relative distance of the certified Omega from that of the point: beyond it, it is another point."""


def _decimals(texts: Any, count: int) -> Any:
    """Return decimals as texts; raises if one of them is no finite decimal."""
    if len(texts) != count or not all(isinstance(text, str) and Decimal(text).is_finite() for text in texts):
        raise ValueError(f"{shortened(repr(texts))} are not {count} decimals")
    return tuple(texts)


@dataclass(frozen=True, eq=False, repr=False)
class Certificate:
    """Proof that a periodic motion or a special point exists, is unique in a box, and is stable or not.

    Attributes
    ----------
    kind : {"motion", "LP", "PD", "GR"}
        Kind of point.
    label : str
        Label of the point, such as "LP1".
    Omega : tuple of str
        Decimals between which Omega lies; both are the same for a motion, whose Omega is prescribed.
    instants : tuple of tuple of str
        Decimals between which the phases of the contact instants lie [rad].
    multipliers : tuple of tuple of str
        Real part, imaginary part and radius of a disc for each multiplier.
    stable : bool or None
        Whether all multipliers are proved to lie inside the unit circle, apart from the multiplier 1 of a fold and -1
        of a period doubling. False if one is proved to lie outside. None if neither is proved.
    uniqueness : float
        Half width of the box in which the point is unique, relative to the sizes of states, Omega and one radian.
    claim : dict
        Coefficients, order of contacts and box: the exact decimals from which the proof is repeated.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.ContactInstants(hb.SpurPair()), "Omega", (0.9, 0.6))
    >>> proof = hb.analysis.certify(curve["LP1"])
    >>> [bound[:12] for bound in proof.Omega], proof.stable
    (['0.7080316187', '0.7080316187'], True)
    """

    kind: str
    label: str
    Omega: tuple[str, str]
    instants: tuple[tuple[str, str], ...]
    multipliers: tuple[tuple[str, str, str], ...]
    stable: bool | None
    uniqueness: float
    claim: dict[str, Any]

    def __repr__(self) -> str:
        return f"<Certificate of a {NAMES[self.kind]} {self.label}: Omega in [{self.Omega[0]}, {self.Omega[1]}]>"

    def __str__(self) -> str:
        return f"{self.statement}\n{self.assumptions}"

    @property
    def statement(self) -> str:
        """One sentence that states the proved properties, in Omega."""
        return self.statement_in("Omega", self.Omega)

    def statement_in(self, quantity: str, bounds: tuple[str, str]) -> str:
        """Return the `statement` in another quantity, such as the speed of the pinion.

        Parameters
        ----------
        quantity : str
            Name of the quantity, with its unit.
        bounds : tuple of str
            Decimals between which the quantity lies.

        Returns
        -------
        str
            One sentence.
        """
        special = {
            "LP": " with multiplier 1 (a nondegenerate fold)",
            "PD": " with multiplier -1, which it passes with nonzero speed",
            "GR": " with one quadratic grazing contact",
            "motion": "",
        }[self.kind]
        is_point = bounds[0] == bounds[1]
        region = f"at {quantity} = {bounds[0]}" if is_point else f"with {quantity} in [{', '.join(bounds)}]"
        count = len(self.instants)
        contacts = f"{count} transversal contact instants" if count else "no contact instants"
        rest = "all multipliers" if self.kind in ("motion", "GR") else "all other multipliers"
        stability = {
            True: f"{rest} lie inside the unit circle",
            False: "a multiplier lies outside of the unit circle",
            None: "it is not proved where the multipliers lie",
        }[self.stable]
        return (
            f"Proved: the equations have exactly one periodic motion{special} {region} in a box of relative half width "
            f"{self.uniqueness:.0e}; it has {contacts} in a period of {self.claim['equations']['nu']} x 2 pi, every "
            f"gap lies strictly between its breakpoints elsewhere, and {stability}."
        )

    @property
    def assumptions(self) -> str:
        """One sentence that states the assumptions."""
        return (
            "Assumed: the coefficients are exactly the decimals that the certificate lists; Arb, hbgear and the "
            "machine compute as specified."
        )

    def verify(self) -> Certificate:
        """Repeat the proof from the exact decimals.

        Returns
        -------
        Certificate
            The certificate that the decimals give.

        Raises
        ------
        NotCertifiedError
            If a condition fails; the message states which one. The condition "stated numbers" fails if this certificate
            has other numbers than the proof gives.
        ValueError
            If the decimals are not those of a certificate.
        """
        try:
            proved = Certificate.of(self.claim, self.label)
        except (KeyError, TypeError, IndexError, InvalidOperation) as error:
            raise ValueError(f"the certificate is damaged ({type(error).__name__}: {error})") from None
        if not self._follows_from(proved):
            raise NotCertifiedError(
                "stated numbers",
                f"the proof gives a {NAMES[proved.kind]} with Omega between {proved.Omega[0]} and "
                f"{proved.Omega[1]}, and not all numbers that the certificate states; certify the point again",
            )
        return proved

    def _follows_from(self, proved: Certificate) -> bool:
        """Return whether all intervals and discs of this certificate contain those of a proof."""
        intervals = zip((self.Omega, *self.instants), (proved.Omega, *proved.instants), strict=False)
        discs = zip(self.multipliers, proved.multipliers, strict=False)
        counts = len(self.instants) == len(proved.instants) and len(self.multipliers) == len(proved.multipliers)
        same = counts and (self.kind, self.stable) == (proved.kind, proved.stable)
        return (
            same
            and self.uniqueness <= proved.uniqueness
            and all(Fraction(low) <= Fraction(x) and Fraction(y) <= Fraction(high) for (low, high), (x, y) in intervals)
            and all(
                abs(Fraction(x) - Fraction(a)) + abs(Fraction(y) - Fraction(b)) + Fraction(r) <= Fraction(radius)
                for (x, y, radius), (a, b, r) in discs
            )
        )

    @staticmethod
    def of(claim: dict[str, Any], label: str) -> Certificate:
        """Return the certificate of a claim, which is proved; raises NotCertifiedError if a condition fails."""
        proof = prove(claim)
        return Certificate(kind=claim["kind"], label=label, claim=claim, **proof._asdict())

    @checked_arguments()
    def attached_to(self, branch: Branch) -> Branch:
        """Return a branch whose special point has this certificate; files, tables and figures then show it.

        Parameters
        ----------
        branch : Branch
            Branch with the special point that was certified.

        Returns
        -------
        Branch
            The same branch; ``branch["LP1"].certificate`` is the certificate as plain data, see `from_dict`.

        Raises
        ------
        ValueError
            If the branch has no special point of this label, kind and frequency.

        Examples
        --------
        >>> import hbgear as hb
        >>> curve = hb.trace(hb.ContactInstants(hb.SpurPair()), "Omega", (0.9, 0.6))
        >>> curve = hb.analysis.certify(curve["LP1"]).attached_to(curve)
        >>> hb.analysis.Certificate.from_dict(curve["LP1"].certificate).stable
        True
        """
        Omega = float(self.Omega[0])
        for i, point in enumerate(branch.special):
            distance = abs(point.parameters.get("Omega", float("inf")) - Omega)
            if (point.label, point.kind) == (self.label, self.kind) and distance <= MAX_FREQUENCY_CHANGE * Omega:
                certified = dataclasses.replace(point, certificate=self.to_dict())
                special = (*branch.special[:i], certified, *branch.special[i + 1 :])
                return dataclasses.replace(branch, special=special)
        labels = ", ".join(point.label for point in branch.special) or "none"
        raise ValueError(
            f"the certificate of a {NAMES[self.kind]} {self.label or 'without a label'} at Omega = {Omega:.8g} fits no "
            f"special point of the branch ({labels}); attach it to the branch of the point"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as plain data."""
        return {
            "format": FORMAT,
            "kind": self.kind,
            "label": self.label,
            "statement": self.statement,
            "assumptions": self.assumptions,
            "Omega": list(self.Omega),
            "instants": [list(x) for x in self.instants],
            "multipliers": [list(x) for x in self.multipliers],
            "stable": self.stable,
            "uniqueness": self.uniqueness,
            "claim": self.claim,
        }

    @staticmethod
    def from_dict(data: dict[str, Any]) -> Certificate:
        """Return the certificate of plain data; the proof is not repeated, see `verify`.

        Raises
        ------
        ValueError
            If the data are not those of a certificate.
        """
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            file_format = data.get("format") if isinstance(data, dict) else data
            raise ValueError(f"format = {shortened(repr(file_format))}: need '{FORMAT}'")
        try:
            certificate = Certificate(
                kind=data["kind"],
                label=str(data["label"]),
                Omega=_decimals(data["Omega"], 2),
                instants=tuple(_decimals(bounds, 2) for bounds in data["instants"]),
                multipliers=tuple(_decimals(bounds, 3) for bounds in data["multipliers"]),
                stable=data["stable"],
                uniqueness=float(data["uniqueness"]),
                claim=dict(data["claim"]),
            )
            _ = NAMES[certificate.kind], certificate.statement  # which needs the rest of the data
        except (KeyError, TypeError, InvalidOperation, ValueError) as error:
            raise ValueError(f"the certificate is damaged ({type(error).__name__}: {error})") from None
        return certificate

    @checked_arguments()
    def save(self, path: str | PathLike[str]) -> None:
        """Write the certificate to a JSON file.

        Parameters
        ----------
        path : str or PathLike
            Name of the file.
        """
        with atomic_write(path) as file:
            file.write((json.dumps(self.to_dict(), indent=1) + "\n").encode())

    @staticmethod
    def load(path: str | PathLike[str]) -> Certificate:
        """Read a certificate; the proof is not repeated, see `verify`.

        Parameters
        ----------
        path : str or PathLike
            Name of the file.

        Returns
        -------
        Certificate
            The certificate.

        Raises
        ------
        ValueError
            If the file is not a certificate.
        """
        return Certificate.from_dict(json.loads(Path(path).read_text(encoding="utf-8")))
