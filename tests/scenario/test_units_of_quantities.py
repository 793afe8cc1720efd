"""The table of units is Pint's: every name of it, every prefix, every plural."""

from __future__ import annotations

import re
from decimal import Decimal
from fractions import Fraction
from functools import cache
from typing import Any

import pytest

from cosim.scenario.quantity import QuantityError, _named, _table

pint = pytest.importorskip("pint", reason="the other side of the comparison")

BASES = ("kilogram", "meter", "second", "ampere", "kelvin", "mole", "candela", "radian", "bit")
NAME = re.compile(r"[A-Za-zµμΩ°]+|%")


@cache
def registry() -> Any:
    return pint.UnitRegistry(non_int_type=Decimal)


def of_pint(name: str) -> tuple[float, float, tuple[Fraction, ...]] | None:
    """Factor, offset and exponents as Pint has them; None for what is no unit of physics."""
    try:
        zero = registry().Quantity(Decimal(0), registry().Unit(name)).to_base_units()
        one = registry().Quantity(Decimal(1), registry().Unit(name)).to_base_units()
        exponents = {str(base): Fraction(e) for base, e in one.unit_items()}
    except Exception:  # noqa: BLE001 - Pint raises many kinds
        return None
    if not set(exponents) <= set(BASES) or not isinstance(one.magnitude, Decimal):
        return None
    found = tuple(exponents.get(base, Fraction(0)) for base in BASES)
    return float(one.magnitude - zero.magnitude), float(zero.magnitude), found


def of_table(name: str) -> tuple[float, float, tuple[Fraction, ...]] | None:
    try:
        factor, offset, measured = _named(name)
    except QuantityError:
        return None
    return float(factor), float(offset), measured.exponents


def test_every_unit_of_pint_is_in_the_table() -> None:
    names = [name for name in list(registry()._units) if NAME.fullmatch(name)]
    assert len(names) > 400
    assert {n: of_table(n) for n in names} == {n: of_pint(n) for n in names}


def test_the_table_has_no_units_of_its_own() -> None:
    units, prefixes = _table()
    assert {n for n in units if (of_pint(n) is None) != (units[n] is None)} == set()
    assert {p: float(size) for p, size in prefixes.items()} == {
        p: float(found.value) for p, found in registry()._prefixes.items() if p
    }


@pytest.mark.parametrize("plural", ["", "s"])
def test_prefixes_and_plurals_are_read_as_pint_reads_them(plural: str) -> None:
    """Every hundredth of fifty thousand: prefix, unit, plural."""
    units, prefixes = _table()
    made = [p + unit + plural for p in ("", *prefixes) for unit in units if unit not in "%°"]
    some = made[:: 101 if plural else 83]
    wrong = {n: (of_table(n), of_pint(n)) for n in some if of_table(n) != of_pint(n)}
    assert not wrong


@pytest.mark.parametrize("name", ["kn", "kms", "Pas", "mdegC", "xm", "Ss", "furlongg", "°", "kkm"])
def test_what_is_close_to_a_unit_is_decided_alike(name: str) -> None:
    assert of_table(name) == of_pint(name)
