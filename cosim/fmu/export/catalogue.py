"""All built-in components by the name of their FMU."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING, Final

from cosim.fmu.export.components import component_module

if TYPE_CHECKING:
    from cosim.fmu.export.spec import ComponentSpec

_PLACES: Final = {
    "AuvPlant": ("auv_plant", "SPEC"),
    "HinfController": ("hinf_controller", "SPEC"),
    "DelayedPlant": ("delayed_plant", "SPEC"),
    "PaperController": ("hinf_controller", "PAPER_SPEC"),
    "WaveField": ("wave_field", "SPEC"),
    "Sensor": ("sensor", "SPEC"),
}
"""Name -> folder of the component, and the name of its specification there."""


class _Catalogue(Mapping[str, "ComponentSpec"]):
    """The components by name, each loaded when it is asked for: most runs know the names only."""

    def __getitem__(self, name: str) -> ComponentSpec:
        return _loaded(name)

    def __contains__(self, name: object) -> bool:
        return name in _PLACES

    def __iter__(self) -> Iterator[str]:
        return iter(_PLACES)

    def __len__(self) -> int:
        return len(_PLACES)


@cache
def _loaded(name: str) -> ComponentSpec:
    folder, attribute = _PLACES[name]
    found: ComponentSpec = getattr(component_module(f"{folder}.variables"), attribute)
    if found.name != name:
        raise ValueError(f"the component {found.name} is listed as {name}")
    return found


CATALOGUE: Final[Mapping[str, ComponentSpec]] = _Catalogue()
"""NAME -> component, for NAME.fmu."""
