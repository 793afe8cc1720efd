"""What a unit's name means, against tables written elsewhere."""

from __future__ import annotations

import math

import pytest
from scipy import constants

from cosim.fmu import UNITS
from cosim.fmu.inspect.units import BASES, si_of_name


@pytest.mark.parametrize("name", sorted(UNITS))
def test_units_of_our_components_mean_what_they_declare(name: str) -> None:
    """Compare with the exponents that the FMUs are built with."""
    found = si_of_name(name)
    assert found is not None
    declared = UNITS[name]
    assert found.exponents == tuple(declared.get(base, 0) for base in BASES)
    assert found.factor == 1.0


@pytest.mark.parametrize(
    ("name", "factor", "offset"),
    [
        ("km/h", constants.kmh, 0.0),
        ("bar", constants.bar, 0.0),
        ("deg", constants.degree, 0.0),
        ("degC", 1.0, constants.zero_Celsius),
        ("min", constants.minute, 0.0),
        ("h", constants.hour, 0.0),
        ("kWh", 1e3 * constants.hour, 0.0),
        ("mm2", 1e-6, 0.0),
        ("N*m^2", 1.0, 0.0),
        ("J/(kg.K)", 1.0, 0.0),
        ("s-1", 1.0, 0.0),
        ("uPa", constants.micro, 0.0),
    ],
)
def test_factors_and_offsets(name: str, factor: float, offset: float) -> None:
    """The same numbers as in scipy.constants (CODATA and SI)."""
    found = si_of_name(name)
    assert found is not None
    assert math.isclose(found.factor, factor, rel_tol=1e-12)
    assert found.offset == offset


@pytest.mark.parametrize(
    "name", ["", "g", "C", "F", "pH", "kg/m/s", "m/s.kg", "furlong", "m**2", "T" * 100, "mm9.mm9/0"]
)
def test_ambiguous_unit_names_are_not_read(name: str) -> None:
    """Ambiguous, unknown or overlong names give None."""
    assert si_of_name(name) is None
