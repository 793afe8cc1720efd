"""Check sources, documentation, and capabilities that a user should know of."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from cosim.fmu.inspect.declared_model import DeclaredModel
from cosim.fmu.inspect.findings import Finding, finding

SOURCES = "sources/"
_CODE = (".c", ".cc", ".cpp", ".cxx")
_DOCUMENTATION = {
    1: ("documentation/_main.html",),
    2: ("documentation/index.html",),
    3: ("documentation/index.html",),
}


def content_findings(model: DeclaredModel, names: Collection[str], build: Any) -> Iterator[Finding]:
    """Check the rest of an FMU; `build` is the root of buildDescription.xml or None."""
    yield from _sources(model, names, build)
    wanted = _DOCUMENTATION[model.major]
    if not any(name in names for name in wanted):
        yield finding("documentation", "documentation/", f"there is no {wanted[0]}")
    for interface in model.interfaces:
        if interface.is_true("needsExecutionTool"):
            tool = model.attributes.get("generationTool", "a tool that it does not name")
            yield finding("needs-tool", interface.kind, f"it needs {tool}")
        if interface.is_true("canBeInstantiatedOnlyOncePerProcess"):
            yield finding("once-per-process", interface.kind, "only one instance per process")


def source_files(model: DeclaredModel, build: Any) -> list[str]:
    """Return the paths inside the FMU of all source files that a description lists."""
    if model.major == 3:
        listed = [] if build is None else [e.get("name", "") for e in build.iter("SourceFile")]
    else:
        listed = [name for interface in model.interfaces for name in interface.sources]
    return [SOURCES + name for name in dict.fromkeys(listed)]


def _sources(model: DeclaredModel, names: Collection[str], build: Any) -> Iterator[Finding]:
    listed = source_files(model, build)
    for name in listed:
        if name not in names:
            yield finding("sources-missing", name, "a listed source file is not packed")
    packed = [name for name in names if name.startswith(SOURCES) and name.endswith(_CODE)]
    if packed and not listed and model.major > 1:
        described = "buildDescription.xml" if model.major == 3 else "SourceFiles"
        what = f"{len(packed)} source files are packed, and no {described} lists one"
        yield finding("sources-unlisted", SOURCES, what)
