"""Build the native FMU of a component: its body, as C or as data, its binaries, the archive.

A body is the hand-written C of its kind and the model: compiled for it, or, without a compiler, as
data that a prebuilt binary of its kind reads.
"""

from __future__ import annotations

import functools
import os
import re
import zlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree as ET

from cosim.fmu.compiled.prebuilt import prebuilt_file, why_none_prebuilt
from cosim.fmu.export.documentation import documentation_files
from cosim.fmu.export.model_description import as_bytes, fmi2_xml, fmi3_xml
from cosim.fmu.export.native.compiler import STANDARD, shared_library
from cosim.fmu.export.native.kinds import FILES, record
from cosim.fmu.export.native.link_step import link_step_header
from cosim.fmu.export.native.model import NativeModel
from cosim.fmu.export.native.model_c import c_files
from cosim.fmu.export.native.model_data import data_header, model_data
from cosim.fmu.export.native.target_platforms import PLATFORMS, Platform, host
from cosim.fmu.export.spec import ComponentSpec
from cosim.fmu.export.terminal_file import terminal_files
from cosim.fmu.export.zip_file import deterministic_zip

KINDS = tuple(kind for kind in FILES if kind != "waves")
"""The kinds of behaviour of which a binary reads its model."""
_MODEL = "resources/model.bin"
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
_COMMON = ("message.c", "instance.c", "saved.c")
_INCLUDED = re.compile(rb'^#include "(.+)"', re.MULTILINE)
_NAMED = re.compile(rb"\bV_\w+")


@dataclass(frozen=True)
class _Body:
    """What a binary is compiled from, and what it reads.

    Attributes
    ----------
    sources : the files of sources/ by name.
    compiled : those of them to compile.
    resources : what the binary reads, by path in the archive.
    """

    sources: dict[str, bytes]
    compiled: list[str]
    resources: dict[str, bytes]


def build_native_fmu(
    spec: ComponentSpec,
    destination: Path,
    version: str,
    platforms: Sequence[Platform] = (),
    binaries: Mapping[Platform, bytes] | None = None,
) -> Path:
    """Write `destination`/NAME.fmu and return its path; two builds give the same bytes.

    Parameters
    ----------
    version : of FMI, "2.0" or "3.0".
    platforms : to cross-compile for; none: this machine, by its own compiler.
    binaries : those of its kind, which read the model: nothing is compiled.

    Raises
    ------
    InputError : no compiler, or a component that is too large for a binary that reads it.
    """
    model = record(spec)
    identity = _guid(model, version, as_data=bool(binaries))
    body = _body(model, version, identity, as_data=bool(binaries))
    archive = {**_fmu_files(spec, version, identity, body.compiled), **body.resources}
    archive.update({f"sources/{name}": text for name, text in body.sources.items()})
    if not binaries:
        targets = platforms or [host()]

        def binary(target: Platform) -> bytes:
            return shared_library(
                spec.name, body.sources, body.compiled, target, cross=bool(platforms)
            )

        with ThreadPoolExecutor(min(len(targets), os.cpu_count() or 1)) as pool:
            binaries = dict(zip(targets, pool.map(binary, targets), strict=True))
    for target, library in binaries.items():
        archive[f"binaries/{target.folder(version)}/{spec.name}{target.suffix}"] = library
    return deterministic_zip(archive, destination / f"{spec.name}.fmu")


def guid(spec: ComponentSpec, version: str) -> str:
    """Return the hash that shows whether a compiled FMU is up to date; the binary checks it too."""
    return _guid(record(spec), version, as_data=False)


def prebuilt_binaries(spec: ComponentSpec, version: str) -> dict[Platform, bytes]:
    """Return the prebuilt binaries for a component; none if there are none for its kind."""
    if why_none_prebuilt() is not None:
        return {}
    kind = record(spec).kind
    found = {
        target: prebuilt_file(_binary_path(kind, version, target)) for target in PLATFORMS.values()
    }
    return {
        target: zlib.decompress(file.read_bytes())
        for target, file in found.items()
        if file is not None
    }


def write_binary(kind: str, version: str, folder: Path, target: Platform) -> None:
    """Cross-compile the binary of a kind to where it is looked for below the folder of a wheel.

    Raises
    ------
    InputError : no cross compiler.
    """
    sources, compiled = _sources_of_data(kind, version)
    path = folder / _binary_path(kind, version, target)
    path.parent.mkdir(parents=True, exist_ok=True)
    library = shared_library(kind, sources, compiled, target, cross=True)
    path.write_bytes(zlib.compress(library, 9))


def _binary_path(kind: str, version: str, target: Platform) -> str:
    """Return where the binary of a kind lies, compressed, below the folder of what is prebuilt."""
    return f"binaries/fmi{version[0]}/{target.tuple_name}/{kind}{target.suffix}.z"


def _guid(model: NativeModel, version: str, *, as_data: bool) -> str:
    body = _body(model, version, "", as_data=as_data)
    archive = _fmu_files(model.spec, version, "", body.compiled)
    options = " ".join(STANDARD).encode()
    return model.spec.guid({**body.sources, **body.resources, **archive, "options": options})


def _body(model: NativeModel, version: str, identity: str, *, as_data: bool) -> _Body:
    """Return the body of a component; `identity` : GUID or instantiation token, which it checks."""
    if as_data:
        sources, compiled = _sources_of_data(model.kind, version)
        data = model_data(model, _named_in_c(model.kind), identity)
        return _Body(sources, compiled, {_MODEL: data})
    compiled = [*_to_compile(model.kind, version, clocked=bool(model.spec.clocks)), "model.c"]
    written = {name: text.encode() for name, text in c_files(model, identity).items()}
    return _Body(_with_headers(compiled, written), sorted(compiled), {})


def _sources_of_data(kind: str, version: str) -> tuple[dict[str, bytes], list[str]]:
    """Return the sources of the binary of a kind by name, and those of them to compile."""
    compiled = [*_to_compile(kind, version, clocked=False), "tape.c"]
    header = data_header(_named_in_c(kind)).encode()
    return _with_headers(compiled, {"model.h": header}), sorted(compiled)


def _to_compile(kind: str, version: str, *, clocked: bool) -> list[str]:
    """Return the hand-written C files of a kind of behaviour."""
    own = FILES[kind]
    shell = f"fmi{version[0]}"
    if clocked:
        own = (*own[:-1], own[-1].replace(".c", "_clocked.c"))
        shell += "_clocked"
    # one that ends so includes the file without it
    common = [name for name in _COMMON if name.replace(".c", "_watched.c") not in own]
    return [*common, *own, f"{shell}.c"]


@functools.cache
def _named_in_c(kind: str) -> tuple[str, ...]:
    """Return the value references that the C of a kind names, for `model_data`."""
    compiled = _to_compile(kind, "2.0", clocked=False)
    texts = _with_headers(compiled, {"model.h": b""}).values()
    return tuple(sorted({name.decode() for text in texts for name in _NAMED.findall(text)}))


def _with_headers(compiled: Sequence[str], written: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return files by name, with all that they include; `written` : those made for a component."""
    found: dict[str, bytes] = {}
    ahead = [*compiled]
    while ahead:
        name = ahead.pop()
        if name not in found:
            found[name] = written[name] if name in written else _hand_written(name)
            ahead += [included.decode() for included in _INCLUDED.findall(found[name])]
    return found


@functools.cache
def _hand_written(name: str) -> bytes:
    """Return a file of c/, or the one header that is made of Python."""
    if name == "link_step.h":
        return link_step_header().encode()
    folder = files("cosim.fmu.export.native") / "c"
    foreign = folder / "headers" / name
    path = foreign if foreign.is_file() else folder / name
    return path.read_bytes().replace(b"\r\n", b"\n")


def _fmu_files(
    spec: ComponentSpec, version: str, identity: str, compiled: Sequence[str]
) -> dict[str, bytes]:
    """Return the archive without sources and binaries; `compiled` : the sources to compile."""
    archive = {**documentation_files(spec), **spec.resource_files()}
    archive["documentation/licenses/fmi-headers.txt"] = _hand_written("license.txt")
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
