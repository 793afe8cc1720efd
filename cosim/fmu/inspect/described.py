"""Read and check a model description: its schema, and every rule about what stands in it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from cosim.fmu.inspect.declared_model import XML, DeclaredModel, known_version, read_declared_model
from cosim.fmu.inspect.definitions import definition_findings
from cosim.fmu.inspect.findings import Finding, finding
from cosim.fmu.inspect.markup import schema_findings
from cosim.fmu.inspect.references import reference_findings
from cosim.fmu.inspect.structure import structure_findings
from cosim.fmu.inspect.variable_rules import variable_findings

_DEPENDENCIES = {"dependent", "constant", "fixed", "tunable", "discrete"}
_SCHEMAS = {
    1: "fmi1/fmiModelDescription.xsd",
    2: "fmi2/fmi2ModelDescription.xsd",
    3: "fmi3/fmi3ModelDescription.xsd",
}


def describe_root(root: Any) -> tuple[DeclaredModel | None, list[Finding]]:
    """Read and check a model description from its root element.

    Returns
    -------
    The description, None if it is of no known version, and the findings.
    """
    version = root.get("fmiVersion")
    if root.tag != "fmiModelDescription":
        return None, [finding("xml-schema", XML, f"the root element is {root.tag!s}")]
    if not known_version(version):
        return None, [finding("version-unknown", XML, f"fmiVersion is {version!r}")]
    model = read_declared_model(root)
    with _known_kinds(root) as odd:
        findings = odd + schema_findings(root, _SCHEMAS[model.major], XML)
    for check in (definition_findings, variable_findings, reference_findings, structure_findings):
        findings += check(model)
    return model, findings


@contextmanager
def _known_kinds(root: Any) -> Iterator[list[Finding]]:
    """Leave out kinds of dependencies that the standard does not have; return findings about them.

    They break the schema, and what they are about is clear all the same: a rule of their own.
    """
    odd = [
        (element, text)
        for element in root.iterfind("ModelStructure//*[@dependenciesKind]")
        if not _DEPENDENCIES.issuperset((text := element.get("dependenciesKind")).split())
    ]
    for element, _ in odd:
        del element.attrib["dependenciesKind"]
    try:
        yield [
            finding(
                "dependency-kind", f"{XML}:{element.sourceline}", f"dependenciesKind is {text!r}"
            )
            for element, text in odd
        ]
    finally:
        for element, text in odd:
            element.set("dependenciesKind", text)
