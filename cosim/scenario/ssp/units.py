"""Units of a system's variables, with their base units, as an archive lists them."""

from __future__ import annotations

from typing import Any

from cosim.master import System
from fmu_src.units import UNITS

_EXPONENTS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


def units_of(system: System, warnings: list[str]) -> dict[str, dict[str, str]]:
    """Name -> exponents, factor and offset; two FMUs that mean different things are warned of."""
    found: dict[str, dict[str, str]] = {
        name: {k: str(e) for k, e in exponents.items()} for name, exponents in UNITS.items()
    }
    used: set[str] = {"s"}
    for component_name, component in system.components.items():
        model = component.description.model
        used |= {p.unit for p in component.description.ports.values() if p.unit is not None}
        for unit in getattr(model, "unitDefinitions", None) or ():
            base = _base(unit)
            if base is None:
                continue
            known = found.setdefault(unit.name, base)
            if known != base:
                warnings.append(
                    f"component {component_name!r} defines the unit {unit.name!r} in its own way; "
                    "the archive has it as others do"
                )
    return {name: found[name] for name in sorted(used & set(found))}


def _base(unit: Any) -> dict[str, str] | None:
    base = unit.baseUnit
    if base is None:
        return None
    exponents = {k: str(int(getattr(base, k) or 0)) for k in _EXPONENTS}
    found = {k: e for k, e in exponents.items() if e != "0"}
    for key, neutral in (("factor", 1.0), ("offset", 0.0)):
        value = float(getattr(base, key, None) or neutral)
        if value != neutral:
            found[key] = repr(value)
    return found
