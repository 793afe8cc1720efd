"""All components by the name of their FMU."""

from __future__ import annotations

from types import MappingProxyType

from fmu_src.auv_plant.variables import SPEC as AUV_PLANT
from fmu_src.delayed_plant.variables import SPEC as DELAYED_PLANT
from fmu_src.hinf_controller.variables import PAPER_SPEC, SPEC as HINF_CONTROLLER
from fmu_src.wave_field.variables import SPEC as WAVE_FIELD

CATALOGUE = MappingProxyType(
    {
        spec.name: spec
        for spec in (AUV_PLANT, HINF_CONTROLLER, DELAYED_PLANT, PAPER_SPEC, WAVE_FIELD)
    }
)
"""NAME -> component, for NAME.fmu."""
