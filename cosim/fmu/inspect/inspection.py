"""Inspect an FMU without loading its binary."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cosim.fmu.inspect.archive import CheckedArchive, open_archive
from cosim.fmu.inspect.binaries import binary_entries, binary_findings
from cosim.fmu.inspect.content import SOURCES, content_findings
from cosim.fmu.inspect.declared_model import XML, DeclaredModel
from cosim.fmu.inspect.described import describe_root
from cosim.fmu.inspect.findings import Finding, ordered
from cosim.fmu.inspect.library import Binary, read_binary
from cosim.fmu.inspect.markup import MAX_XML, parse_xml, schema_findings
from cosim.fmu.inspect.terminals import BUILD, TERMINALS, build_findings, terminal_findings

_MOST_BINARY = 512 << 20


@dataclass(frozen=True, slots=True)
class Inspection:
    """The result of inspecting an FMU: its content and the findings.

    Attributes
    ----------
    path, sha256, size : the file [bytes].
    names : every path inside, sorted.
    unpacked_bytes : their size [bytes].
    may_be_unpacked : whether the archive is safe to unpack.
    model : the description, or None if it cannot be read.
    binaries : the headers of every library.
    findings : errors first.
    """

    path: Path
    sha256: str
    size: int
    names: tuple[str, ...]
    unpacked_bytes: int
    may_be_unpacked: bool
    model: DeclaredModel | None
    binaries: tuple[Binary, ...]
    findings: tuple[Finding, ...]

    @property
    def valid(self) -> bool:
        """Whether no finding is an error."""
        return not any(each.level == "error" for each in self.findings)

    def with_findings(self, more: Iterable[Finding]) -> Inspection:
        """Return the inspection with further findings."""
        return replace(self, findings=tuple(ordered([*self.findings, *more])))


def inspect_fmu(path: Path) -> Inspection:
    """Inspect an FMU of any FMI version; nothing is unpacked or run.

    Raises
    ------
    InputError : no such file, no ZIP file, no modelDescription.xml, or another XML in its place.
    """
    archive = open_archive(path)
    archive.read_all()
    findings = list(archive.findings)
    xml = archive.read(XML, MAX_XML)
    model = None
    root, found = parse_xml(xml, XML)
    findings += found
    if root is not None:
        model, found = describe_root(root)
        findings += found
    names = sorted(archive.entries)
    binaries = [
        read_binary(folder, name, content)
        for folder, name in binary_entries(names)
        if (content := archive.read(name, _MOST_BINARY)) is not None
    ]
    if model is not None:
        build, found = _further(archive, model)
        findings += found
        sources = any(name.startswith(SOURCES) for name in names)
        findings += binary_findings(model, names, binaries, sources=sources)
        findings += content_findings(model, names, build)
    return Inspection(
        path=path,
        sha256=archive.sha256,
        size=archive.size,
        names=tuple(names),
        unpacked_bytes=archive.unpacked_bytes,
        may_be_unpacked=archive.may_be_unpacked,
        model=model,
        binaries=tuple(binaries),
        findings=tuple(ordered(findings)),
    )


def _further(archive: CheckedArchive, model: DeclaredModel) -> tuple[Any, list[Finding]]:
    """Check the other XML files of FMI 3; return the build description's root and findings."""
    build = None
    findings: list[Finding] = []
    schemas = ((BUILD, "fmi3BuildDescription"), (TERMINALS, "fmi3TerminalsAndIcons"))
    for name, schema in schemas:
        if model.major != 3 or name not in archive.entries:
            continue
        root, found = parse_xml(archive.read(name, MAX_XML), name)
        findings += found
        if root is None:
            continue
        findings += schema_findings(root, f"fmi3/{schema}.xsd", name)
        if name == BUILD:
            findings += build_findings(root, model)
            build = root
        else:
            findings += terminal_findings(root, model, archive.entries)
    return build, findings
