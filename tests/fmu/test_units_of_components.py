"""Units that components declare mean what their names say."""

from __future__ import annotations

import re
from fractions import Fraction

import pytest

from cosim.fmu import UNITS

pint = pytest.importorskip("pint", reason="the other side of the comparison")
BASES = {"kg": "kilogram", "m": "meter", "s": "second", "A": "ampere", "K": "kelvin"}


@pytest.mark.parametrize("name", sorted(UNITS))
def test_units_have_the_exponents_that_pint_finds(name: str) -> None:
    """All are coherent: their factor is 1. A radian counts as nothing there."""
    found = pint.UnitRegistry()(re.sub(r"([a-z])(\d)", r"\1^\2", name)).to_base_units()
    exponents = dict(found.units._units) if hasattr(found, "units") else {}
    declared = {BASES[base]: power for base, power in UNITS[name].items() if base != "rad"}
    assert {unit: Fraction(p) for unit, p in exponents.items() if unit != "radian"} == declared
    assert getattr(found, "magnitude", found) == 1
