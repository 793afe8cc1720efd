"""modelDescription.xml of a component for FMI 2.0 co-simulation.

Outputs are declared `initial="exact"` with a start, and every output states its direct
feedthrough, empty where there is none: an importer that is told nothing must assume that
every output depends on every input, and sees algebraic loops that are not there.
"""

from __future__ import annotations

from xml.etree import ElementTree as ET

from .spec import ComponentSpec, Variable
from .units import UNITS

LOG_CATEGORIES = {
    "logStatusWarning": "Something was unusual, the result stands.",
    "logStatusDiscard": "A step could not be computed.",
    "logStatusError": "A call was refused: what, why, and what would have been accepted.",
    "logStatusFatal": "The instance cannot go on.",
    "logAll": "Every message.",
}


def fmi2_xml(spec: ComponentSpec, guid: str, *, tool: str, needs_tool: bool) -> bytes:
    """The model description as UTF-8 XML.

    Parameters
    ----------
    spec : the component.
    guid : its hash, `ComponentSpec.guid`.
    tool : generationTool, with its version.
    needs_tool : whether a Python host is needed.
    """
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=spec.name,
        guid=guid,
        description=spec.description,
        version="1",
        license="MIT",
        generationTool=tool,
        variableNamingConvention="structured",
    )
    ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=spec.name,
        needsExecutionTool=_bool(needs_tool),
        canHandleVariableCommunicationStepSize="true",
        canInterpolateInputs="false",
        canBeInstantiatedOnlyOncePerProcess="false",
        canNotUseMemoryManagementFunctions="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    _units(root, spec)
    categories = ET.SubElement(root, "LogCategories")
    for name, text in LOG_CATEGORIES.items():
        ET.SubElement(categories, "Category", name=name, description=text)
    ET.SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        stopTime=repr(spec.stop_time),
        stepSize=repr(spec.step_size),
    )
    variables = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(spec.variables):
        _variable(variables, reference, variable)
    _structure(root, spec)
    ET.indent(root)
    xml: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return xml + b"\n"


def _bool(value: bool) -> str:  # noqa: FBT001 - a formatter of one value
    return "true" if value else "false"


def _units(root: ET.Element, spec: ComponentSpec) -> None:
    used = sorted({v.unit for v in spec.variables if v.unit is not None})
    if not used:
        return
    definitions = ET.SubElement(root, "UnitDefinitions")
    for name in used:
        unit = ET.SubElement(definitions, "Unit", name=name)
        ET.SubElement(unit, "BaseUnit", {k: str(e) for k, e in UNITS[name].items()})


def _variable(parent: ET.Element, reference: int, v: Variable) -> None:
    element = ET.SubElement(
        parent,
        "ScalarVariable",
        name=v.name,
        valueReference=str(reference),
        description=v.description,
        causality=v.causality,
        variability=v.variability,
    )
    if v.causality != "input":
        element.set("initial", "exact")  # an input's is exact by definition, and not written
    kind = ET.SubElement(element, v.kind)
    if v.unit is not None:
        kind.set("unit", v.unit)
    convert = repr if v.kind == "Real" else (lambda value: str(int(value)))
    for attribute, value in (("min", v.minimum), ("max", v.maximum), ("start", v.start)):
        if value is not None:
            kind.set(attribute, convert(float(value)))


def _structure(root: ET.Element, spec: ComponentSpec) -> None:
    structure = ET.SubElement(root, "ModelStructure")
    index = {v.name: i + 1 for i, v in enumerate(spec.variables)}
    produced = [v for v in spec.variables if v.causality == "output"]
    if not produced:
        return
    unknowns = ET.SubElement(structure, "Outputs")
    for v in produced:
        ET.SubElement(
            unknowns,
            "Unknown",
            index=str(index[v.name]),
            dependencies=" ".join(str(i) for i in sorted(index[n] for n in v.depends_on)),
            dependenciesKind=" ".join("dependent" for _ in v.depends_on),
        )
