"""What a unit's name means, against tables written elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
from fmu.packed import inspected
from scipy import constants

from cosim.fmu import UNITS

NEAR, FAR = 1.0005, 1.002
"""Factors are often rounded: one that is as near to the name's as this is right, the other not."""
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Units" guid="{{1}}">
 <CoSimulation modelIdentifier="Units"/>
 <UnitDefinitions><Unit name="{name}"><BaseUnit {base}/></Unit></UnitDefinitions>
 <ModelVariables>
  <ScalarVariable name="u" valueReference="0" causality="input"><Real start="0" unit="{name}"/>
  </ScalarVariable>
 </ModelVariables>
 <ModelStructure/>
</fmiModelDescription>
"""


def what_is_found(name: str, base: Mapping[str, float], folder: Path) -> list[str]:
    """What is found of a unit of this name that is defined so."""
    written = " ".join(f'{key}="{value!r}"' for key, value in base.items())
    found = inspected(DESCRIPTION.format(name=name, base=written), folder).findings
    assert {f.code for f in found if f.level == "error"} <= {"unit-base"}
    return [f.what for f in found if f.code == "unit-base"]


@pytest.mark.parametrize("name", sorted(UNITS))
def test_units_of_our_components_mean_what_they_declare(name: str, tmp_path: Path) -> None:
    """Compare with the exponents that the FMUs are built with; that of rad does not count."""
    declared = UNITS[name]
    assert what_is_found(name, declared, tmp_path) == []
    assert what_is_found(name, {**declared, "factor": FAR}, tmp_path) == [
        f"factor {FAR:g}, the name says 1"
    ]
    for base in ("kg", "m", "s", "A", "K", "mol", "cd"):
        (what,) = what_is_found(name, {**declared, base: declared.get(base, 0) + 1}, tmp_path)
        assert "the name says" in what
    assert what_is_found(name, {**declared, "rad": declared.get("rad", 0) + 1}, tmp_path) == []


@pytest.mark.parametrize(
    ("name", "exponents", "factor", "offset"),
    [
        ("km/h", {"m": 1, "s": -1}, constants.kmh, 0.0),
        ("bar", {"kg": 1, "m": -1, "s": -2}, constants.bar, 0.0),
        ("deg", {"rad": 1}, constants.degree, 0.0),
        ("degC", {"K": 1}, 1.0, constants.zero_Celsius),
        ("min", {"s": 1}, constants.minute, 0.0),
        ("h", {"s": 1}, constants.hour, 0.0),
        ("kWh", {"kg": 1, "m": 2, "s": -2}, 1e3 * constants.hour, 0.0),
        ("mm2", {"m": 2}, 1e-6, 0.0),
        ("N*m^2", {"kg": 1, "m": 3, "s": -2}, 1.0, 0.0),
        ("J/(kg.K)", {"m": 2, "s": -2, "K": -1}, 1.0, 0.0),
        ("s-1", {"s": -1}, 1.0, 0.0),
        ("uPa", {"kg": 1, "m": -1, "s": -2}, constants.micro, 0.0),
    ],
)
def test_factors_and_offsets(
    name: str, exponents: Mapping[str, int], factor: float, offset: float, tmp_path: Path
) -> None:
    """The same numbers as in scipy.constants (CODATA and SI), and no others."""
    true = {**exponents, "factor": factor, "offset": offset}
    assert what_is_found(name, true, tmp_path) == []
    for near in (NEAR, 1 / NEAR):
        assert what_is_found(name, {**true, "factor": near * factor}, tmp_path) == []
    for far in (FAR * factor, factor / FAR):
        (what,) = what_is_found(name, {**true, "factor": far}, tmp_path)
        assert what == f"factor {far:g}, the name says {factor:g}"
    (what,) = what_is_found(name, {**true, "offset": offset + 1.0}, tmp_path)
    assert what == f"offset {offset + 1.0:g}, the name says {offset:g}"


@pytest.mark.parametrize(
    "name", ["", "g", "C", "F", "pH", "kg/m/s", "m/s.kg", "furlong", "m**2", "T" * 100, "mm9.mm9/0"]
)
def test_ambiguous_unit_names_are_not_read(name: str, tmp_path: Path) -> None:
    """Ambiguous, unknown or overlong names say nothing, however the unit is defined."""
    for base in ({"m": 1}, {"kg": 1, "s": -2, "factor": 1e-3}, {"cd": 1, "offset": 5.0}):
        assert what_is_found(name, base, tmp_path) == []
