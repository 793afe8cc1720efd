"""Find the FMUs of the catalogue: in a folder as <flavour>/NAME.fmu, prebuilt, or built now."""

from __future__ import annotations

import functools
import hashlib
import re
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cosim.core import AnyPath, InputError, cache_folder, copy_whole
from cosim.fmu.compiled.prebuilt import prebuilt_file, source_digest
from cosim.fmu.export.catalogue import CATALOGUE
from cosim.fmu.export.flavours import DEFAULT_FLAVOUR, FMI_VERSION
from cosim.fmu.export.identity import kept_guid
from cosim.fmu.export.native.target_platforms import Platform, host
from cosim.fmu.export.spec import ClockVariable, ComponentSpec, Variable


@dataclass(frozen=True)
class Built:
    """An FMU that exists now, and whether it was built for this call."""

    name: str
    path: Path
    new: bool


def ensure_fmu(
    name: str,
    root: Path,
    *,
    flavour: str = DEFAULT_FLAVOUR,
    platforms: Sequence[Platform] = (),
    force: bool = False,
) -> Built:
    """Return the FMU `name` of the catalogue; build it below `root`/`flavour` if there is none.

    The FMU below `root`/`flavour` is taken if it is up to date, otherwise the prebuilt one.

    `platforms`: those to cross-compile a native FMU for; none: those of the prebuilt FMU, or this
    machine, by its own compiler. `force`: build it in any case.

    Raises
    ------
    KeyError : no such component or flavour.
    InputError : no compiler for a native FMU that has to be built.
    """
    path = root / flavour / f"{name}.fmu"
    if not force and path.is_file() and _up_to_date(path, name, flavour, platforms):
        return Built(name, path, new=False)
    ready = None if force or platforms else prebuilt_file(f"{flavour}/{name}.fmu")
    if ready is not None:
        return Built(name, ready, new=False)
    build_fmu(CATALOGUE[name], path.parent, flavour, platforms, prebuilt=False)
    return Built(name, path, new=True)


def ensure_made(spec: ComponentSpec, root: Path, flavour: str = DEFAULT_FLAVOUR) -> Path:
    """Return the FMU of a specification below `root`/`flavour`; build it if there is none.

    It lies in a folder of its own, named by what it is made of.

    Raises
    ------
    InputError : as `build_fmu`.
    """
    digest = hashlib.sha256(f"{source_digest()} {spec.guid({})}".encode()).hexdigest()[:16]
    path = root / flavour / digest / f"{spec.name}.fmu"
    if not path.is_file():
        build_fmu(spec, path.parent, flavour)
    return path


def build_fmu(
    component: str | ComponentSpec,
    folder: AnyPath = "fmus",
    flavour: str = DEFAULT_FLAVOUR,
    platforms: Sequence[Platform] = (),
    *,
    prebuilt: bool = True,
    clocked: bool = False,
) -> Path:
    """Write `folder`/NAME.fmu of a component and return its path.

        >>> from cosim import build_fmu
        >>> from cosim.fmu import describe_fmu
        >>> path = build_fmu("PaperController")
        >>> path.as_posix(), describe_fmu(path).ports["u[1]"].causality
        ('fmus/PaperController.fmu', 'output')

    Parameters
    ----------
    component : the name of a built-in component, such as "AuvPlant", or a specification.
    flavour : "native" (C, FMI 2.0), "native-fmi3" (C, FMI 3.0) or "python" (pythonfmu).
    platforms : the platforms to cross-compile a native FMU for; none: those that are prebuilt, or
        this machine, by its own compiler.
    prebuilt : whether to use the binaries in the wheel: the FMU of a built-in component; for any
        other component a binary of its kind, which reads the model and computes the same bits.
    clocked : with event mode and input Clocks (FMI 3.0): a sampled controller samples when its
        Clock ticks, a packet link sends and delivers when its two Clocks do. Without event mode it
        behaves like the FMU without Clocks.

    Raises
    ------
    InputError : no such component or flavour, one that has no clocked FMU, no compiler for a
        native FMU, or a component that is too large for a prebuilt binary.
    """
    if isinstance(component, str) and component not in CATALOGUE:
        raise InputError.unknown("component", component, CATALOGUE, where="build_fmu")
    if flavour not in FMI_VERSION:
        raise InputError.unknown("flavour", flavour, FMI_VERSION, where="build_fmu")
    if clocked:
        return _build_clocked(component, Path(folder), flavour, platforms)
    if isinstance(component, str):
        ready = prebuilt_file(f"{flavour}/{component}.fmu") if prebuilt and not platforms else None
        if ready is not None:
            target = Path(folder) / ready.name
            copy_whole(ready, target)
            return target
    # what packs FMUs is loaded here: a run rarely makes one
    from cosim.fmu.export.native.native_package import (  # noqa: PLC0415
        build_native_fmu,
        prebuilt_binaries,
    )

    spec = CATALOGUE[component] if isinstance(component, str) else component
    if flavour == "python":
        from cosim.fmu.export.python.python_package import build_python_fmu  # noqa: PLC0415

        return build_python_fmu(spec, Path(folder))
    version = FMI_VERSION[flavour]
    binaries = prebuilt_binaries(spec, version) if prebuilt and not platforms else {}
    return build_native_fmu(spec, Path(folder), version, platforms, binaries)


def _build_clocked(
    component: str | ComponentSpec, folder: Path, flavour: str, platforms: Sequence[Platform]
) -> Path:
    """Build the FMU with Clocks of a sampled controller or a packet link, by a compiler."""
    from cosim.fmu.export.native.native_package import build_native_fmu  # noqa: PLC0415

    spec = CATALOGUE[component] if isinstance(component, str) else component
    clocks = _clocks_of(spec)
    if flavour != "native-fmi3" or not clocks:
        raise InputError(
            "this FMU has no Clock",
            where="build_fmu: clocked",
            expected="flavour native-fmi3, and a sampled controller or a packet link",
            got=f"{flavour}, {spec.name}",
        )
    variables = tuple(_with_period(spec, variable) for variable in spec.variables)
    clocked = replace(spec, variables=variables, clocks=clocks)
    return build_native_fmu(clocked, folder, "3.0", platforms)


def _with_period(spec: ComponentSpec, variable: Variable) -> Variable:
    """Return a variable; a sample time of zero starts at the usual step: a Clock needs a period."""
    if (variable.name, variable.start) != ("sample_time", 0.0):
        return variable
    return replace(variable, start=spec.step_size)


def _clocks_of(spec: ComponentSpec) -> tuple[ClockVariable, ...]:
    """Return the Clocks that a component can have."""
    inputs = tuple(v.name for v in spec.variables if v.causality == "input")
    if spec.behaviour.endswith(":StateFeedback"):
        text = "ticks every sample_time; inputs are read at its ticks"
        return (ClockVariable("clock", "fixed", text, inputs),)
    if spec.behaviour.endswith(":LinkChannel") and spec.constants["kind"] == "packet":
        received = tuple(v.name for v in spec.variables if v.name.startswith("y["))
        return (
            ClockVariable("send", "fixed", "ticks when a message is sent", inputs),
            ClockVariable("arrive", "countdown", "ticks when messages arrive", received),
        )
    return ()


def ensure_all(
    root: Path,
    names: Iterable[str] = (),
    *,
    flavour: str = DEFAULT_FLAVOUR,
    platforms: Sequence[Platform] = (),
    force: bool = False,
) -> list[Built]:
    """Call `ensure_fmu` for the names given, by default all of the catalogue."""
    return [
        ensure_fmu(name, root, flavour=flavour, platforms=platforms, force=force)
        for name in (names or CATALOGUE)
    ]


def _up_to_date(path: Path, name: str, flavour: str, platforms: Sequence[Platform]) -> bool:
    identity, entries = inside_fmu(path)
    version = FMI_VERSION[flavour]
    machines = [] if flavour == "python" else platforms or [host()]
    wanted = {f"binaries/{p.folder(version)}/{name}{p.suffix}" for p in machines}
    return identity == _guid(name, flavour) and wanted <= entries


@functools.cache
def _guid(name: str, flavour: str) -> str:
    """Return the GUID of a build by the present code."""
    return kept_guid(f"{flavour}/{name}", cache_folder(), lambda: guid_of(CATALOGUE[name], flavour))


def guid_of(spec: ComponentSpec, flavour: str) -> str:
    """Return the GUID of a component in a flavour."""
    if flavour == "python":
        from cosim.fmu.export.python.python_package import guid as python_guid  # noqa: PLC0415

        return python_guid(spec)
    from cosim.fmu.export.native.native_package import guid as native_guid  # noqa: PLC0415

    return native_guid(spec, FMI_VERSION[flavour])


def inside_fmu(path: Path) -> tuple[str, set[str]]:
    """Return the GUID or token and the names of all entries; empty for what is not an FMU."""
    try:
        with zipfile.ZipFile(path) as archive:
            text = archive.read("modelDescription.xml").decode("utf-8", "replace")
            entries = set(archive.namelist())
    except (OSError, KeyError, zipfile.BadZipFile):
        return "", set()
    found = re.search(r'\b(?:guid|instantiationToken)="([^"]*)"', text)
    return found.group(1) if found else "", entries
