"""Units that components declare mean what their names say."""

from __future__ import annotations

import re

import pytest

from cosim.fmu.export import UNITS

pint = pytest.importorskip("pint", reason="the other side of the comparison")
BASES = {"kg": "kilogram", "m": "meter", "s": "second", "rad": "radian"}


@pytest.mark.parametrize("name", sorted(UNITS))
def test_units_have_the_exponents_that_pint_finds(name: str) -> None:
    """All are coherent: their factor is 1."""
    found = pint.UnitRegistry()(re.sub(r"([a-z])(\d)", r"\1^\2", name)).to_base_units()
    declared = {BASES[base]: power for base, power in UNITS[name].items()}
    assert dict(found.unit_items()) == declared
    assert found.magnitude == 1
