"""Build the native FMU of a component: C of its equations, binaries, the archive."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree as ET

from cosim.fmu.export.deterministic_zip import deterministic_zip
from cosim.fmu.export.documentation import documentation_files
from cosim.fmu.export.model_description import as_bytes, fmi2_xml, fmi3_xml
from cosim.fmu.export.native.compiler import STANDARD, shared_library
from cosim.fmu.export.native.kinds import COMMON, model_files
from cosim.fmu.export.native.target_platforms import Platform, host
from cosim.fmu.export.spec import ComponentSpec
from cosim.fmu.export.terminal_file import terminal_files

_TOOL = "auv-cosim"
_COMPILERS = {
    None: "gcc",
    "x86_64-darwin": "clang",
    "aarch64-darwin": "clang",
    "x86_64-windows": "VisualC",
}
"""Platform of a build configuration -> compiler."""
_VISUAL_C = ("/std:c11", "/O2", "/fp:strict")
"""Strict: without contraction, and in the order of the source, as `STANDARD` has it."""
_HEADERS = {
    "2.0": ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    "3.0": ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
_HEADERS_OF = (
    ("delay_line.c", "delay_line.h"),
    ("vehicle.c", "plant.c"),
    ("draws.c", "draws.h"),
    ("packet_link.c", "clock.h"),
    ("transport_link.c", "clock.h"),
    ("table.c", "clock.h"),
    ("tape.c", "tape.h"),
    ("sampled_clocked.c", "sampled.c"),
    ("sampled_clocked.c", "clocked.h"),
    ("packet_link_clocked.c", "packet_link.c"),
    ("packet_link_clocked.c", "clocked.h"),
    ("packet_link_clocked.c", "clock.h"),
    ("fmi3_clocked.c", "fmi3.c"),
    ("observer.c", "delay_line.c"),
    ("observer.c", "delay_line.h"),
    ("observer.c", "plant.c"),
    ("observer.c", "watch.h"),
    ("instance_watched.c", "instance.c"),
    ("sampled_watched.c", "sampled.c"),
    ("sampled_watched.c", "watch.h"),
)
"""C file of a kind of behaviour -> file that it includes beside `_OWN_HEADERS`."""
_OWN_HEADERS = ("arithmetic.h", "behaviour.h", "instance.h", "message.h", "variable.h")


@functools.cache
def _shell(name: str) -> bytes:
    folder = files("cosim.fmu.export.native") / "c"
    foreign = folder / "headers" / name
    path = foreign if foreign.is_file() else folder / name
    return path.read_bytes().replace(b"\r\n", b"\n")


def sources(spec: ComponentSpec, version: str, identity: str) -> tuple[dict[str, bytes], list[str]]:
    """Return the files of sources/ by name, and those of them to compile.

    Parameters
    ----------
    version : of FMI, "2.0" or "3.0".
    identity : GUID or instantiation token, which the binary checks.
    """
    generated, own = model_files(spec, identity)
    found, compiled = hand_written(own, version)
    found |= {name: text.encode() for name, text in generated.items()}
    return found, sorted([*compiled, "model.c"])


def hand_written(own: Sequence[str], version: str) -> tuple[dict[str, bytes], list[str]]:
    """Return the hand-written files of sources/ by name, and those of them to compile.

    Parameters
    ----------
    own : C files beside `COMMON`.
    version : of FMI, "2.0" or "3.0".
    """
    shell = "fmi2.c" if version == "2.0" else "fmi3.c"
    if any(name.endswith("_clocked.c") for name in own):
        shell = "fmi3_clocked.c"
    # one that ends so includes the file without it
    common = [name for name in COMMON if f"{name.removesuffix('.c')}_watched.c" not in own]
    compiled = [*common, *own, shell]
    headers = [*_OWN_HEADERS, *_HEADERS[version]]
    headers += [header for source, header in _HEADERS_OF if source in compiled]
    return {name: _shell(name) for name in (*compiled, *headers)}, sorted(compiled)


def guid(spec: ComponentSpec, version: str) -> str:
    """Return the hash that shows whether a built FMU is up to date; the binary checks it too."""
    content, _ = sources(spec, version, "")
    options = " ".join(STANDARD).encode()
    archive = fmu_files(spec, version, "", _to_compile(content))
    return spec.guid({**content, **archive, "options": options})


def build_native_fmu(
    spec: ComponentSpec, destination: Path, version: str, platforms: Sequence[Platform] = ()
) -> Path:
    """Write `destination`/NAME.fmu and return its path; two builds give the same bytes.

    Parameters
    ----------
    version : of FMI, "2.0" or "3.0".
    platforms : to cross-compile for; none: this machine, by its own compiler.

    Raises
    ------
    InputError : no compiler.
    """
    identity = guid(spec, version)
    content, compiled = sources(spec, version, identity)
    archive = fmu_files(spec, version, identity, compiled)
    archive.update({f"sources/{name}": text for name, text in content.items()})
    targets = platforms or [host()]

    def binary(target: Platform) -> bytes:
        return shared_library(spec.name, content, compiled, target, cross=bool(platforms))

    with ThreadPoolExecutor(min(len(targets), os.cpu_count() or 1)) as pool:
        for target, library in zip(targets, pool.map(binary, targets), strict=True):
            path = f"binaries/{target.folder(version)}/{spec.name}{target.suffix}"
            archive[path] = library
    return deterministic_zip(archive, destination / f"{spec.name}.fmu")


def _to_compile(content: Mapping[str, bytes]) -> list[str]:
    return sorted(name for name in content if name.endswith(".c"))


def fmu_files(
    spec: ComponentSpec, version: str, identity: str, compiled: Sequence[str]
) -> dict[str, bytes]:
    """Return the archive without sources and binaries; `compiled` : the sources to compile."""
    archive = {**documentation_files(spec), **spec.resource_files()}
    archive["documentation/licenses/fmi-headers.txt"] = _shell("license.txt")
    archive |= terminal_files(spec)
    if version == "2.0":
        archive["modelDescription.xml"] = fmi2_xml(
            spec, identity, tool=_TOOL, needs_tool=False, derivatives=True, sources=compiled
        )
    else:
        archive["modelDescription.xml"] = fmi3_xml(spec, identity, tool=_TOOL)
        archive["sources/buildDescription.xml"] = _build_description(spec, compiled)
        archive["terminalsAndIcons/icon.png"] = archive.pop("model.png")
    return archive


def _build_description(spec: ComponentSpec, compiled: Sequence[str]) -> bytes:
    """Return buildDescription.xml: options belong to a compiler, and a platform to a configuration.

    The first is of no platform, for all that have none of their own.
    """
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    for platform, compiler in _COMPILERS.items():
        configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=spec.name)
        if platform is not None:
            configuration.set("platform", platform)
        options = _VISUAL_C if compiler == "VisualC" else STANDARD
        listed = ET.SubElement(
            configuration,
            "SourceFileSet",
            language="C99",
            compiler=compiler,
            compilerOptions=" ".join(options),
        )
        for name in compiled:
            ET.SubElement(listed, "SourceFile", name=name)
        if compiler != "VisualC":
            ET.SubElement(configuration, "Library", name="m", external="true")
    return as_bytes(root)
