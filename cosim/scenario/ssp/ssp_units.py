"""Units of variables in base units, for writing and for reading archives."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from cosim.fmu import UnitBase
from cosim.fmu.export import UNITS
from cosim.master import System
from cosim.scenario.ssp.names import tag


def units_of(system: System, warnings: list[str]) -> dict[str, UnitBase]:
    """Return the units that variables have; warn of FMUs that define one differently."""
    found = {name: UnitBase.of(exponents) for name, exponents in UNITS.items()}
    used: set[str] = {"s"}
    for component_name, component in system.components.items():
        used |= {p.unit for p in component.description.ports.values() if p.unit is not None}
        for name, base in component.description.units.items():
            if found.setdefault(name, base) != base:
                warnings.append(
                    f"component {component_name!r} defines the unit {name!r} differently; the "
                    "archive has the definition of the others"
                )
    return {name: found[name] for name in sorted(used & set(found))}


def units_in(root: Any) -> dict[str, UnitBase]:
    """Return the units that an SSD defines."""
    found = {}
    path = f"{tag('ssd', 'Units')}/{tag('ssc', 'Unit')}"
    for unit in root.findall(path):
        base = unit.find(tag("ssc", "BaseUnit"))
        with suppress(ValueError):  # skip malformed units
            if base is not None:
                found[str(unit.get("name"))] = UnitBase.of(dict(base.attrib))
    return found
