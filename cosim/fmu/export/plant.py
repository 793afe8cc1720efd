"""Export a system in the form of Eq. (7) as a plant FMU."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cosim.core import InputError, counted
from cosim.fmu.export.components import component_module
from cosim.fmu.export.fmu_file import FmuTarget, checked_name, model_name, write_fmu
from cosim.fmu.export.spec import ComponentSpec
from cosim.hinf import system_by_name
from cosim.models import DelaySystem, paper_example

_VARIABLES = component_module("delayed_plant.variables")
_PAPER_F = (paper_example.F_AMPLITUDE, paper_example.F_OMEGA)


@dataclass(frozen=True)
class PlantFmu:
    """An exported plant FMU.

    Attributes
    ----------
    path, name : the file and its model name.
    kind : flavour and platforms.
    system : the exported system.
    delays : parameter -> its start value [s].
    step : start value of `solver.step` [s].
    """

    path: Path
    name: str
    kind: FmuTarget
    system: DelaySystem
    delays: dict[str, float]
    step: float


def export_plant(
    system: str | DelaySystem,
    path: Path,
    *,
    kind: FmuTarget | None = None,
    name: str | None = None,
    initial: Sequence[float] | None = None,
) -> PlantFmu:
    """Write the FMU of a system.

    Parameters
    ----------
    system : a system, a built-in name, or a `.toml` file.
    path : the FMU to write.
    name : of the model; by default the stem of `path`.
    initial : x(t) for t <= start; by default zero, for `paper` the state of its section 5.

    Raises
    ------
    InputError : as `plant_spec`; no compiler, or a file that cannot be written.
    """
    chosen = model_name(path) if name is None else checked_name(name)
    kind = kind or FmuTarget()
    spec, given = plant_spec(system, chosen, initial=initial)
    write_fmu(spec, path, kind)
    delays = _VARIABLES.plant_delays(given)
    lengths = zip(_VARIABLES.delay_names(len(delays)), (delay.d for delay in delays), strict=True)
    return PlantFmu(path, chosen, kind, given, dict(lengths), spec.step_size)


def plant_spec(
    system: str | DelaySystem, name: str, *, initial: Sequence[float] | None = None
) -> tuple[ComponentSpec, DelaySystem]:
    """Specify the plant of a system; return the system that it is as well.

    Parameters
    ----------
    system, initial : as of `export_plant`.
    name : of the model.

    Raises
    ------
    InputError : no such system, a file without one, or an initial state that does not fit.
    """
    if isinstance(system, str):
        named = system_by_name(system)
        # filters and integrals are no part of the plant
        given = named.plant or named.system
        of_file = system.endswith(".toml")
        origin = "the system's file" if of_file else f"the system `{system}`"
    else:
        given, origin = system, f"the system `{system.name}`" if system.name else "a system"
    paper = system == "paper"
    usual = paper_example.INITIAL_STATE if paper else (0.0,) * given.A.shape[0]
    start = usual if initial is None else tuple(initial)
    if len(start) != len(usual) or not all(map(math.isfinite, start)):
        raise InputError(
            "the initial state does not fit the system",
            where="`initial`",
            expected=f"{counted(len(usual), 'finite number')}, one per state",
            got=", ".join(map(repr, start)),
        )
    spec: ComponentSpec = _VARIABLES.delayed_plant_spec(
        given,
        name=name,
        initial=start,
        F=_PAPER_F if paper else (0.0, 1.0),
        origin=f"The start values are those of {origin}.",
    )
    return spec, given
