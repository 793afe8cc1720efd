"""The shared library of an FMU: its path, and its functions with their C types."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import fmpy

from cosim.core import ComponentError
from cosim.fmu.description import FmuDescription
from cosim.fmu.inspect.platforms import FMI2, this_machine
from cosim.fmu.port import TYPE_MAPPINGS, FmiVersion

PREFIX: Final[Mapping[FmiVersion, str]] = MappingProxyType({"2.0": "fmi2", "3.0": "fmi3"})
_TYPES: Final[Mapping[str, Any]] = MappingProxyType(
    {
        "p": ctypes.c_void_p,
        "s": ctypes.c_char_p,
        "i": ctypes.c_int,
        "z": ctypes.c_size_t,
        "d": ctypes.c_double,
        "b": ctypes.c_bool,
        "-": None,
    }
)


def _accessors(version: FmiVersion, signature: str) -> dict[str, str]:
    """The functions that get and set variables, one pair per type that is exchanged."""
    kinds = [m.getter_type for m in TYPE_MAPPINGS[version].values() if m.kind is not None]
    return {f"{way}{kind}": signature for way in ("Get", "Set") for kind in kinds}


_SIGNATURES: Final[Mapping[FmiVersion, Mapping[str, str]]] = MappingProxyType(
    {
        "2.0": {
            "Instantiate": "p<sisspii",
            "FreeInstance": "-<p",
            "SetDebugLogging": "i<pizp",
            "SetupExperiment": "i<piddid",
            "EnterInitializationMode": "i<p",
            "ExitInitializationMode": "i<p",
            "Terminate": "i<p",
            "Reset": "i<p",
            **_accessors("2.0", "i<ppzp"),
            "DoStep": "i<pddi",
            "GetBooleanStatus": "i<pip",
            "GetFMUstate": "i<pp",
            "SetFMUstate": "i<pp",
            "FreeFMUstate": "i<pp",
            "SerializedFMUstateSize": "i<ppp",
            "SerializeFMUstate": "i<pppz",
            "DeSerializeFMUstate": "i<ppzp",
        },
        "3.0": {
            "InstantiateCoSimulation": "p<sssbbbbpzppp",
            "FreeInstance": "-<p",
            "SetDebugLogging": "i<pbzp",
            "EnterConfigurationMode": "i<p",
            "ExitConfigurationMode": "i<p",
            "EnterInitializationMode": "i<pbddbd",
            "ExitInitializationMode": "i<p",
            "Terminate": "i<p",
            "Reset": "i<p",
            **_accessors("3.0", "i<ppzpz"),
            "DoStep": "i<pddbpppp",
            "GetFMUState": "i<pp",
            "SetFMUState": "i<pp",
            "FreeFMUState": "i<pp",
            "SerializedFMUStateSize": "i<ppp",
            "SerializeFMUState": "i<pppz",
            "DeserializeFMUState": "i<ppzp",
        },
    }
)
"""FMI version -> name without prefix -> result < arguments, each a letter of `_TYPES`."""
_ALTERED_SEARCH_PATH = 0x8
"""Makes Windows look beside a library for those that it needs."""


class LoadedLibrary:
    """The functions of a loaded library, looked up on first use.

    So a foreign FMU may lack functions that are not called, though the standard asks for all.
    """

    def __init__(self, library: Path, version: FmiVersion) -> None:
        self._name = library.name
        self._version = version
        self._dll = ctypes.CDLL(str(library), winmode=_ALTERED_SEARCH_PATH)
        self._functions: dict[str, Any] = {}

    def function(self, name: str) -> Any:
        """Return a function, named without prefix.

        Raises
        ------
        AttributeError : the library has no such function.
        """
        found = self._functions.get(name)
        if found is None:
            found = self._dll[PREFIX[self._version] + name]
            result, arguments = _SIGNATURES[self._version][name].split("<")
            found.restype = _TYPES[result]
            found.argtypes = [_TYPES[letter] for letter in arguments]
            self._functions[name] = found
        return found

    def address(self, name: str) -> int:
        """Return the address of a function, named without prefix."""
        return int(ctypes.cast(self.function(name), ctypes.c_void_p).value or 0)

    def unload(self) -> None:
        """Unload the library; none of its functions may be called afterwards."""
        self._functions.clear()
        fmpy.freeLibrary(self._dll._handle)  # noqa: SLF001 - ctypes has no public name


def load_binary(description: FmuDescription, folder: Path, component: str) -> LoadedLibrary:
    """Load the library of an FMU that is unpacked in `folder`.

    Raises
    ------
    ComponentError : no library for this machine, one of another name, or it does not load.
    """
    try:
        return LoadedLibrary(_library_of(description, folder), description.version)
    except OSError as error:
        here = this_machine()
        sources = (folder / "sources").is_dir()
        raise ComponentError(
            "the FMU cannot be loaded",
            where=f"component {component!r} ({description.path})",
            expected=f"a library for {here.architecture} {here.system} that loads",
            got=str(error),
            hint="it brings its C sources: fmpy compile" if sources else None,
        ) from error


def _library_of(description: FmuDescription, folder: Path) -> Path:
    """Return the library for this machine, or raise an `OSError` that lists what there is."""
    identifier = description.model.coSimulation.modelIdentifier
    here = this_machine()
    tuple_name = f"{here.architecture}-{here.system}"
    short = [name for name, platform in FMI2.items() if platform == here]
    folders = [*short, tuple_name] if description.version == "2.0" else [tuple_name]
    binaries = folder / "binaries"
    for name in folders:
        library = binaries / name / f"{identifier}{here.suffix}"
        if library.is_file():
            return library
        others = sorted(p.name for p in library.parent.glob(f"*{here.suffix}"))
        if others:
            raise OSError(
                f"binaries/{name} holds {', '.join(others)}, but the model identifier is "
                f"{identifier}"
            )
    platforms = sorted(p.name for p in binaries.glob("*") if p.is_dir())
    raise OSError(
        f"it has no binary for {folders[0]}, only for {', '.join(platforms)}"
        if platforms
        else f"it has no binary for {folders[0]}, nor for any other platform"
    )
