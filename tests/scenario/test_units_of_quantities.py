"""The table of units is Pint's: every name of it, every prefix, every plural."""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal
from fractions import Fraction
from functools import cache
from importlib.resources import files
from typing import Any

import pytest

from cosim.scenario import ExpressionError, ScenarioPart, formula

pint = pytest.importorskip("pint", reason="the other side of the comparison")

SYMBOLS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad", "bit")
BASES = ("kilogram", "meter", "second", "ampere", "kelvin", "mole", "candela", "radian", "bit")
NAME = re.compile(r"[A-Za-zµμΩ°]+|%")


@cache
def registry() -> Any:
    return pint.UnitRegistry(non_int_type=Decimal)


def of_pint(name: str) -> tuple[float, float, tuple[Fraction, ...]] | None:
    """What 0 and 1 of it are in SI, and the exponents; None for what is no unit of physics."""
    try:
        zero = registry().Quantity(Decimal(0), registry().Unit(name)).to_base_units()
        one = registry().Quantity(Decimal(1), registry().Unit(name)).to_base_units()
        exponents = {str(base): Fraction(e) for base, e in one.unit_items()}
    except Exception:  # noqa: BLE001 - Pint raises many kinds
        return None
    if not set(exponents) <= set(BASES) or not isinstance(one.magnitude, Decimal):
        return None
    found = tuple(exponents.get(base, Fraction(0)) for base in BASES)
    return float(zero.magnitude), float(one.magnitude), found


def is_as_pint(name: str) -> bool:
    """Whether an expression reads a unit as Pint does: its values, its dimension, or as none."""
    known = of_pint(name)
    try:
        values = tuple(formula(f"{number} {name}").number() for number in (0, 1))
    except ExpressionError:
        return known is None
    if known is None or values != known[:2]:
        return False
    try:  # what is subtracted has the same dimension
        formula(f"1 {name} - {product(known[2])}")
    except ExpressionError:
        return False
    return True


def product(exponents: Sequence[Fraction]) -> str:
    """A quantity with these exponents of the base units, as an expression."""
    powers = ["(1 m) / (1 m)"]
    for base, exponent in zip(SYMBOLS, exponents, strict=True):
        if exponent.denominator == 2:
            powers.append(f"sqrt(1 {base}) ** {exponent.numerator}")
        elif exponent:
            powers.append(f"(1 {base}) ** {exponent}")
    return " * ".join(powers)


@cache
def table() -> tuple[dict[str, bool], dict[str, float]]:
    """The file of units: by name whether it is one, and the prefixes."""
    units: dict[str, bool] = {}
    prefixes: dict[str, float] = {}
    for line in files("cosim.core").joinpath("units.txt").read_text("utf-8").splitlines():
        match line.split():
            case ["#", *_]:
                pass
            case ["prefix", size, *names]:
                prefixes |= dict.fromkeys(names, float(size))
            case ["refused", *names]:
                units |= dict.fromkeys(names, False)
            case [_, _, _, *names]:
                units |= dict.fromkeys(names, True)
    return units, prefixes


WORDS = {"and", "or", "not", "in", "is", "if", "else", "t", "x", "pi", "e"}
"""Names that are something else in an expression."""


def test_every_unit_of_pint_is_in_the_table() -> None:
    """With its value, its offset and its dimension."""
    names = [name for name in list(registry()._units) if NAME.fullmatch(name)]
    assert len(names) > 400
    assert [name for name in names if name not in WORDS and not is_as_pint(name)] == []


def test_the_table_has_no_units_of_its_own() -> None:
    """Nor prefixes."""
    units, prefixes = table()
    assert {n for n, known in units.items() if (of_pint(n) is not None) != known} == set()
    assert prefixes == {p: float(found.value) for p, found in registry()._prefixes.items() if p}


@pytest.mark.parametrize("plural", ["", "s"])
def test_prefixes_and_plurals_are_read_as_pint_reads_them(plural: str) -> None:
    """Every hundredth of fifty thousand: prefix, unit, plural."""
    units, prefixes = table()
    made = [p + unit + plural for p in ("", *prefixes) for unit in units if unit not in "%°"]
    some = made[:: 101 if plural else 83]
    assert [name for name in some if name not in WORDS and not is_as_pint(name)] == []


@pytest.mark.parametrize("name", ["kn", "kms", "Pas", "mdegC", "xm", "Ss", "furlongg", "°", "kkm"])
def test_what_is_close_to_a_unit_is_decided_alike(name: str) -> None:
    """By one letter more, or with two prefixes."""
    assert is_as_pint(name)


def test_an_inch_is_a_length_where_a_word_is_none() -> None:
    """In a value "in" is a unit, in an expression it is not."""
    medium = {"nodes": {"a": [0.0], "b": ["1 in"]}, "data_rate": 1000}
    data = {"title": "t", "run": {"end": 1.0, "step": 0.1}, "components": {"a": {"fmu": "A"}}}
    read = ScenarioPart.model_validate({**data, "medium": {"bay": medium}}).medium["bay"]
    assert read.nodes["b"] == [0.0254]
    with pytest.raises(ExpressionError):
        formula("1 in")
