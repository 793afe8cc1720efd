"""Read the name of a unit as SI, to compare it with the unit's definition.

Only unambiguous names are read. The exponent of rad is not compared: tools differ in writing it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

BASES = ("kg", "m", "s", "A", "K", "mol", "cd")


class Si(NamedTuple):
    """Exponents of `BASES`, and value_in_SI = factor · value + offset."""

    exponents: tuple[int, ...]
    factor: float
    offset: float = 0.0


def _unit(factor: float = 1.0, offset: float = 0.0, /, **exponents: int) -> Si:
    return Si(tuple(exponents.get(base, 0) for base in BASES), factor, offset)


_PREFIXED = {
    "m": _unit(m=1),
    "g": _unit(1e-3, kg=1),
    "s": _unit(s=1),
    "A": _unit(A=1),
    "K": _unit(K=1),
    "mol": _unit(mol=1),
    "cd": _unit(cd=1),
    "N": _unit(kg=1, m=1, s=-2),
    "Pa": _unit(kg=1, m=-1, s=-2),
    "J": _unit(kg=1, m=2, s=-2),
    "W": _unit(kg=1, m=2, s=-3),
    "V": _unit(kg=1, m=2, s=-3, A=-1),
    "Ohm": _unit(kg=1, m=2, s=-3, A=-2),
    "ohm": _unit(kg=1, m=2, s=-3, A=-2),
    "S": _unit(kg=-1, m=-2, s=3, A=2),
    "H": _unit(kg=1, m=2, s=-2, A=-2),
    "Wb": _unit(kg=1, m=2, s=-2, A=-1),
    "T": _unit(kg=1, s=-2, A=-1),
    "Wh": _unit(3600.0, kg=1, m=2, s=-2),
    "bar": _unit(1e5, kg=1, m=-1, s=-2),
}
_PLAIN = {
    "1": _unit(),
    "rad": _unit(),
    "sr": _unit(),
    "deg": _unit(math.pi / 180.0),
    "%": _unit(0.01),
    "min": _unit(60.0, s=1),
    "h": _unit(3600.0, s=1),
    "degC": _unit(1.0, 273.15, K=1),
    "°C": _unit(1.0, 273.15, K=1),
    "t": _unit(1e3, kg=1),
    "l": _unit(1e-3, m=3),
    "L": _unit(1e-3, m=3),
}
_PREFIXES = {"T": 1e12, "G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "d": 1e-1, "c": 1e-2}
_PREFIXES |= {"m": 1e-3, "u": 1e-6, "µ": 1e-6, "n": 1e-9, "p": 1e-12}
_AMBIGUOUS = ("g", "pH")  # the acceleration of gravity; acidity
_NAMED = (
    {
        prefix + name: Si(unit.exponents, factor * unit.factor)
        for prefix, factor in _PREFIXES.items()
        for name, unit in _PREFIXED.items()
    }
    | _PREFIXED
    | _PLAIN
)
KNOWN: Mapping[str, Si] = MappingProxyType(
    {name: unit for name, unit in _NAMED.items() if name not in _AMBIGUOUS}
)
"""Unambiguous names; a name of its own goes before a prefixed one (min is a minute)."""

_FACTOR = re.compile(r"(?P<name>1|%|°C|[A-Za-zµ]+)\^?(?P<power>-?[0-9])?")
_LONGEST = 40


def si_of_name(name: str) -> Si | None:
    """Return the meaning of `m/s2`, `N.m`, `kg*m^2` or `W/(m2.K)`; None for an ambiguous name.

    An offset counts only for a unit that stands alone: per degC is per K.
    """
    text = name.strip()
    if not text or len(text) > _LONGEST:
        return None
    above, slash, below = text.partition("/")
    if slash:
        if below.startswith("(") and below.endswith(")"):
            below = below[1:-1]
        elif re.search(r"[.*·]", below):
            return None  # a/b.c is ambiguous
    over = _product(above)
    under = _product(below) if slash else _unit()
    if over is None or under is None:
        return None
    if not (0.0 < over.factor < math.inf and 0.0 < under.factor < math.inf):
        return None
    exponents = tuple(a - b for a, b in zip(over.exponents, under.exponents, strict=True))
    alone = KNOWN.get(text)
    return Si(exponents, over.factor / under.factor, alone.offset if alone else 0.0)


def _product(text: str) -> Si | None:
    exponents = [0] * len(BASES)
    factor = 1.0
    for part in re.split(r"[.*·]", text):
        found = _FACTOR.fullmatch(part.strip())
        if found is None or found["name"] not in KNOWN:
            return None
        unit = KNOWN[found["name"]]
        power = int(found["power"] or 1)
        exponents = [e + power * u for e, u in zip(exponents, unit.exponents, strict=True)]
        factor *= unit.factor**power
    return Si(tuple(exponents), factor)
