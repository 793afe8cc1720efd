"""A unit in base units, as FMI and SSP define it (BaseUnit: FMI 2.0.4 2.2.2, SSP 1.0 4.6)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


class UnitBase(NamedTuple):
    """Value in base units = factor * value + offset.

    Attributes
    ----------
    exponents : of each of `BASES`.
    """

    exponents: tuple[int, ...]
    factor: float = 1.0
    offset: float = 0.0

    @classmethod
    def of(cls, attributes: Mapping[str, str] | Mapping[str, int]) -> UnitBase:
        """Read the attributes of a BaseUnit; `ValueError` for what are no numbers."""
        exponents = tuple(int(attributes.get(base, 0)) for base in BASES)
        return cls(
            exponents, float(attributes.get("factor", 1)), float(attributes.get("offset", 0))
        )

    def attributes(self) -> dict[str, str]:
        """Return the attributes of a BaseUnit that are not the usual ones."""
        found = {base: str(n) for base, n in zip(BASES, self.exponents, strict=True) if n}
        found |= {} if self.factor == 1.0 else {"factor": repr(self.factor)}
        return found | ({} if self.offset == 0.0 else {"offset": repr(self.offset)})

    def convert(self, value: float, to: UnitBase) -> float:
        """Convert a value to another unit of the same exponents."""
        if (self.factor, self.offset) == (to.factor, to.offset):
            return value
        return (self.factor * value + self.offset - to.offset) / to.factor
