"""Pack what there is in Python as an FMU: a system, a design, a component, a vehicle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from cosim.core import AnyPath, InputError
from cosim.fmu.export.catalogue import CATALOGUE
from cosim.fmu.export.controller import controller_spec
from cosim.fmu.export.flavours import FMI_VERSION, Flavour
from cosim.fmu.export.fmu_file import FmuTarget, checked_name, model_name, write_fmu
from cosim.fmu.export.plant import plant_spec
from cosim.fmu.export.spec import ComponentSpec
from cosim.fmu.python_code import Component
from cosim.hinf import DelayLTI, Result
from cosim.models import DelaySystem


@runtime_checkable
class Packable(Protocol):
    """What can be packed as an FMU beside systems and designs, as a vehicle can."""

    def fmu_spec(self, name: str) -> ComponentSpec:
        """Specify its component, with this name of the model."""


def spec_of(what: Any, name: str, **settings: Any) -> ComponentSpec:
    """Specify the component that something is as an FMU.

    Parameters
    ----------
    what : a `DelaySystem` (its plant, Eq. (7)), a `DelayLTI` (from u to z), a design (its
        controller), a built-in component by name, a system by name or file, a specification, or
        what has `fmu_spec`.
    name : of the model; those of built-in components and specifications have their own.
    settings : `initial` of a system; `sample_time`, `limits`, `observer`, `watch`, `envelope` of a
        design.

    Raises
    ------
    InputError : nothing that can be packed, settings that it has not, or as `plant_spec` and
        `controller_spec`.
    """
    if isinstance(what, Component):
        raise InputError(
            "a component in Python flies in its own process alone",
            where=type(what).__name__,
            expected="a system, a design, a vehicle or a component in C",
            hint="Scenario(...).add(name, component), or pythonfmu for other tools",
        )
    if isinstance(what, str):
        what = CATALOGUE.get(what, what)
    for kinds, known, specify in _PACKED:
        if isinstance(what, kinds):
            other = [key for key in settings if key not in known]
            if other:
                raise InputError.unknown(
                    "setting", other[0], known, where=f"the FMU of {what!r:.80}"
                )
            found: ComponentSpec = specify(what, name, **settings)
            return found
    raise InputError(
        "this cannot be packed as an FMU",
        where="what",
        expected="a system, a design, a vehicle, a component by name, or its specification",
        got=f"{type(what).__name__}",
    )


_PACKED: tuple[tuple[Any, Sequence[str], Callable[..., ComponentSpec]], ...] = (
    (ComponentSpec, (), lambda spec, _: spec),
    (
        Result,
        ("sample_time", "limits", "observer", "watch", "envelope"),
        lambda design, name, **settings: controller_spec(design, name, **settings)[0],
    ),
    (
        DelaySystem | str,
        ("initial",),
        lambda system, name, **settings: plant_spec(system, name, **settings)[0],
    ),
    (
        DelayLTI,
        ("initial",),
        lambda model, name, **settings: plant_spec(model.plant(), name, **settings)[0],
    ),
    (Packable, (), lambda packable, name: packable.fmu_spec(name)),
)
"""Types, the settings that they take, and what specifies their component."""


def pack(
    what: Any,
    path: AnyPath,
    *,
    name: str | None = None,
    flavour: Flavour = "native",
    clocked: bool = False,
    **settings: Any,
) -> Path:
    """Write something as an FMU that other tools load; return its path.

        >>> from cosim import DelaySystem, analyse, pack
        >>> system = DelaySystem(A=[[-1]], B=[[1]])
        >>> plant = pack(system, "plant.fmu", initial=[2.0])
        >>> controller = pack(analyse(system, [[-1.0]]), "controller.fmu", sample_time=0.1)
        >>> controller.name, controller.exists()
        ('controller.fmu', True)

    Parameters
    ----------
    what, settings : as of `spec_of`.
    path : the file to write.
    name : of the model; by default the stem of the file.
    flavour, clocked : as of `build_fmu`.

    Raises
    ------
    InputError : as `spec_of`; no such flavour, no compiler, or a file that cannot be written.
    """
    if flavour not in FMI_VERSION:
        raise InputError.unknown("flavour", flavour, FMI_VERSION, where="pack")
    target = Path(path)
    chosen = model_name(target) if name is None else checked_name(name)
    write_fmu(spec_of(what, chosen, **settings), target, FmuTarget(flavour, clocked=clocked))
    return target
