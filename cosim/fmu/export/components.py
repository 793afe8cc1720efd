"""Load the components, from `fmu_src/` in a checkout or `cosim/components/` once installed.

Both are loaded under the name `cosim.components`, so that both give the same FMUs.
"""

from __future__ import annotations

import importlib
import sys
from importlib.machinery import ModuleSpec
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType

PACKAGE = "cosim.components"
_ROOT = Path(__file__).parents[3]


def components_folder() -> Path:
    """Return the folder that has one folder per component.

    Raises
    ------
    ModuleNotFoundError : neither an installed package nor a checkout has it.
    """
    places = (_ROOT / "cosim" / "components", _ROOT / "fmu_src")
    for folder in places:
        if folder.is_dir():
            return folder
    raise ModuleNotFoundError(
        f"the components are missing\n  expected: {places[0]} or {places[1]}\n"
        "  try: install auv-cosim again"
    )


def component_module(module: str) -> ModuleType:
    """Import a module of a component, such as "auv_plant.variables".

    Raises
    ------
    ModuleNotFoundError : there is no such component or module.
    """
    if PACKAGE not in sys.modules:
        spec = ModuleSpec(PACKAGE, None, is_package=True)
        spec.submodule_search_locations = [str(components_folder())]
        sys.modules.setdefault(PACKAGE, module_from_spec(spec))  # of two threads the first one's
    return importlib.import_module(f"{PACKAGE}.{module}")
