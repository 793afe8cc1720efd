"""All built-in components by the name of their FMU."""

from __future__ import annotations

from types import MappingProxyType

from cosim.fmu.export.components import component_module
from cosim.fmu.export.spec import ComponentSpec

_CONTROLLERS = component_module("hinf_controller.variables")
_SPECS: tuple[ComponentSpec, ...] = (
    component_module("auv_plant.variables").SPEC,
    _CONTROLLERS.SPEC,
    component_module("delayed_plant.variables").SPEC,
    _CONTROLLERS.PAPER_SPEC,
    component_module("wave_field.variables").SPEC,
)

CATALOGUE = MappingProxyType({spec.name: spec for spec in _SPECS})
"""NAME -> component, for NAME.fmu."""
