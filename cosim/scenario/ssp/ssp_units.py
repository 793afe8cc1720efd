"""Units of variables in base units, for writing and for reading archives."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

from cosim.fmu import FmuDescription
from cosim.fmu.export import UNITS
from cosim.master import System
from cosim.scenario.ssp.names import tag

_EXPONENTS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


def units_of(system: System, warnings: list[str]) -> dict[str, dict[str, str]]:
    """Return name -> exponents, factor and offset; warn of FMUs that define a unit differently."""
    found: dict[str, dict[str, str]] = {
        name: {k: str(e) for k, e in exponents.items()} for name, exponents in UNITS.items()
    }
    used: set[str] = {"s"}
    for component_name, component in system.components.items():
        used |= {p.unit for p in component.description.ports.values() if p.unit is not None}
        for unit in component.description.model.units:
            if unit.base is None:
                continue
            base = _short(unit.base)
            known = found.setdefault(unit.name, base)
            if known != base:
                warnings.append(
                    f"component {component_name!r} defines the unit {unit.name!r} differently; the "
                    "archive has the definition of the others"
                )
    return {name: found[name] for name in sorted(used & set(found))}


def _short(base: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes of a BaseUnit that are not the usual ones."""
    found = {k: str(int(base[k])) for k in _EXPONENTS if int(base.get(k, "0"))}
    for key, neutral in (("factor", 1.0), ("offset", 0.0)):
        value = float(base.get(key, neutral))
        if value != neutral:
            found[key] = repr(value)
    return found


class UnitBase(NamedTuple):
    """A unit in base units: value in base units = factor * value + offset."""

    exponents: tuple[tuple[str, int], ...]
    factor: float
    offset: float


def units_in(root: Any) -> dict[str, UnitBase]:
    """Return the units that an SSD defines."""
    found = {}
    path = f"{tag('ssd', 'Units')}/{tag('ssc', 'Unit')}"
    for unit in root.findall(path):
        base = unit.find(tag("ssc", "BaseUnit"))
        with suppress(ValueError):  # skip malformed units
            if base is not None:
                found[str(unit.get("name"))] = _of_texts(dict(base.attrib))
    return found


def units_of_fmu(fmu: FmuDescription) -> dict[str, UnitBase]:
    """Return the units that an FMU defines."""
    return {u.name: _of_texts(u.base) for u in fmu.model.units if u.base is not None}


def _of_texts(base: Mapping[str, str]) -> UnitBase:
    exponents = tuple((k, int(base[k])) for k in _EXPONENTS if int(base.get(k, "0")) != 0)
    return UnitBase(exponents, float(base.get("factor", "1")), float(base.get("offset", "0")))


def converted(value: float, of: UnitBase, to: UnitBase) -> float:
    """Convert a value to another unit; a ValueError if the dimensions differ."""
    if of.exponents != to.exponents:
        raise ValueError("the units measure different things")
    if (of.factor, of.offset) == (to.factor, to.offset):
        return value
    return (of.factor * value + of.offset - to.offset) / to.factor
