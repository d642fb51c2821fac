"""Quantities with units: what is taken, what is refused and how."""

import dataclasses
import pickle
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

import hbgear
import hbgear as hb
from hbgear.cli.quantities import parameter_value
from hbgear.common import units
from hbgear.common.ranges import POSITIVE, Range
from hbgear.common.units import USUAL, OptionalQuantityField, QuantityField, to_si
from hbgear.harmonic.models.frequency_units import Omega_of


@dataclass(frozen=True)
class Thing:
    size: QuantityField = QuantityField("m", POSITIVE, Range(1e-5, 0.1))
    angle: QuantityField = QuantityField("rad", default=0.5)
    other: OptionalQuantityField = OptionalQuantityField("m")


@pytest.mark.parametrize(
    ("value", "unit", "number"),
    [
        ("3 mm", "m", 0.003),
        ("3mm", "m", 0.003),
        ("80 µm", "m", 80e-6),
        ("80um", "m", 80e-6),
        (0.25, "m", 0.25),
        ("200 Nm", "N m", 200.0),
        ("200 N m", "N m", 200.0),
        ("0.2 kN*m", "N m", 200.0),
        ("90 deg", "rad", 1.5707963267949),
        ("1 inch", "m", 0.0254),
        ("5 %", "", 0.05),
        ("206 GPa", "Pa", 206e9),
        ("3e8 N/m", "N/m", 3e8),
        ("60 r/min", "rad/s", 6.28318530717959),
        ("60/min", "rad/s", 6.28318530717959),
        ("60 1/min", "rad/s", 6.28318530717959),
        ("60 min⁻¹", "rad/s", 6.28318530717959),
        ("60 U/min", "rad/s", 6.28318530717959),
        ("60 RPM", "rad/s", 6.28318530717959),
        ("1 rev/s", "rad/s", 6.28318530717959),
        ("1 U/s", "rad/s", 6.28318530717959),
        ("1 cycle/s", "rad/s", 6.28318530717959),
        ("2 cycles / s", "Hz", 2.0),
        ("5 meter/s", "m/s", 5.0),
        ("5 newton*meter/s", "W", 5.0),
        ("60 rad/min", "rad/s", 1.0),
        ("200 N·m", "N m", 200.0),
        ("0.5 kg·m²", "kg m^2", 0.5),
        ("10 N/(mm·µm)", "N/m^2", 1e10),
        ("-12 deg", "rad", -0.20943951023932),
    ],
)
def test_quantities_are_read(value, unit, number):
    assert to_si("x", "y", value, unit) == pytest.approx(number, rel=1e-14)


def test_a_pint_quantity_is_read():
    import pint

    assert to_si("x", "y", pint.UnitRegistry().Quantity(3.0, "mm"), "m") == 0.003


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [
        ("3", "m", "has no unit"),
        ("3 kg", "m", "must be a quantity in m"),
        ("three", "m", "must be a quantity in m"),
        ("mm", "m", "must be a quantity in m"),
        ("9e9**9e9 m", "m", "must be a quantity"),
        ("3 mm", "", "must be a number"),
        ("2,5 mm", "m", "must be a quantity in m.*; the decimal mark is a point"),
        (float("nan"), "m", "finite"),
        (True, "m", "finite"),
        (None, "m", "finite"),
        ("", "m", "must be a quantity"),
        ("1e999 m", "m", "finite"),
        ("50 Hz", "rad/s", "must be a quantity in rad/s .* such as '1500 r/min'"),
        ("50 1/s", "rad/s", "must be a quantity in rad/s"),
        ("3 mm; 4", "m", "must be a quantity"),
        ([1], "m", "finite"),
    ],
)
def test_invalid_quantities_are_refused(value, unit, said):
    with pytest.raises(ValueError, match=said):
        to_si("x", "y", value, unit)


def test_a_field_reads_and_is_frozen():
    thing = Thing("3 mm", other="1 m")
    assert (thing.size, thing.angle, thing.other) == (0.003, 0.5, 1.0)
    assert Thing("3 mm").other is None
    assert dataclasses.replace(thing, size="4 mm").size == 0.004
    assert pickle.loads(pickle.dumps(thing)) == thing and hash(thing) == hash(Thing(0.003, other=1))
    with pytest.raises(dataclasses.FrozenInstanceError):
        thing.size = 1.0  # type: ignore[misc]
    with pytest.raises(TypeError, match="size"):
        Thing()


@pytest.mark.parametrize(("value", "said"), [(3, "beyond any machine .* '3 mm'"), (-1e-3, "be positive")])
def test_a_field_refuses_other_units(value, said):
    with pytest.raises(ValueError, match=f"Thing: size = .*{said}"):
        Thing(value)


@pytest.mark.parametrize(("unit", "name"), [(unit, name) for unit, factors in USUAL.items() for name in factors])
def test_usual_units_are_those_of_pint(monkeypatch, unit, name):
    texts = [
        f"{number}{space}{name}"
        for number in ("3", "-12.5", "80e-1", ".7", "97.4857", "5.", "0")
        for space in ("", " ")
    ]
    by_table = [to_si("x", "y", text, unit) for text in texts]
    monkeypatch.setattr(units, "USUAL", {})
    assert by_table == [to_si("x", "y", text, unit) for text in texts]


def test_pint_waits_for_a_text_in_a_unit_that_is_not_usual():
    code = (
        "import sys, hbgear as hb\n"
        "g = hb.gears.Gear(25, 0.003, 0.02); print('pint' in sys.modules)\n"
        "g = hb.gears.Gear(25, '3 mm', '20mm', '20 deg'); print('pint' in sys.modules)\n"
        "g = hb.gears.Gear(25, '0.3 cm', 0.02); print('pint' in sys.modules)"
    )
    root = Path(hbgear.__file__).parents[1]
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert out.stdout.split() == ["False", "False", "True"]


@pytest.mark.parametrize("text", ["1 m/", "1 m*", "1 m//m", "3 N/ m /"])
def test_units_that_end_in_an_operator_are_refused(text):
    with pytest.raises(ValueError, match="must be a quantity in m with its unit"):
        to_si("Gear", "module", text, "m")


@pytest.mark.parametrize(("unit", "example"), [("um", "such as '10 um'"), ("m", "such as '3 mm'")])
@pytest.mark.parametrize("value", ["200", "1 N"])
def test_messages_have_an_example_of_any_unit(value, unit, example):
    with pytest.raises(ValueError, match=example):
        to_si("A", "b", value, unit)


def test_a_speed_without_its_unit_is_refused():
    """Omega = 9000 of this pair would be 1.3e8 r/min."""
    pair = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25))
    with pytest.raises(ValueError, match=r"--to 9000: Omega = 9000 is a speed of 1.3e\+08 r/min; .* --to 9000r/min"):
        Omega_of(pair, "--to", "9000")
    assert Omega_of(hb.SpurPair(), "--to", "9000") == 9000.0  # no scales: a warning follows from the modes
    assert Omega_of(pair, "--to", "9000/min") == Omega_of(pair, "--to", "9000 r/min")


@pytest.mark.parametrize("text", ["1,5", "9000,5 r/min", "+,5"])
def test_numbers_with_a_comma_are_refused_with_the_decimal_mark(text):
    """Without letters the text has no unit, so the message does not name the scales of the model."""
    pair = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25))
    for model in (pair, hb.SpurPair()) if "r/min" not in text else (pair,):
        with pytest.raises(ValueError, match=r"^--from.*need a .*; the decimal mark is a point$"):
            Omega_of(model, "--from", text)
    with pytest.raises(ValueError, match=r"^--set zeta.*; the decimal mark is a point$"):
        parameter_value(pair.labels, "--set", "zeta", text.removesuffix(" r/min"))
