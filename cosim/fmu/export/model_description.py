"""Write modelDescription.xml of a component for co-simulation in FMI 2.0 and 3.0.

Outputs are declared `initial="exact"` with a start, and every output declares its direct
feedthrough, empty if it has none: otherwise an importer must assume that it depends on every
input, and finds algebraic loops that do not exist.

Value references are the places of the variables, counted from 1: OMSimulator takes them for
places, and some tools take 0 for none.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from cosim.fmu.export.spec import UNITS, ComponentSpec, Variable

LOG_CATEGORIES = {
    "logStatusWarning": "Something was unusual, the result stands.",
    "logStatusDiscard": "A step could not be computed.",
    "logStatusError": "A call was refused: what, why, and what would have been accepted.",
    "logStatusFatal": "The instance cannot go on.",
    "logAll": "Every message.",
}


def fmi2_xml(
    spec: ComponentSpec,
    guid: str,
    *,
    tool: str,
    needs_tool: bool,
    derivatives: bool = False,
    sources: Sequence[str] = (),
) -> bytes:
    """Return the model description of FMI 2.0 as UTF-8 XML.

    Parameters
    ----------
    guid : `ComponentSpec.guid`.
    tool : generationTool, with its version.
    needs_tool : whether a Python host is needed.
    derivatives : whether directional derivatives are provided.
    sources : files of sources/ to compile for a platform that has no binary.
    """
    root = _root(spec, "2.0", "guid", guid, tool)
    simulation = ET.SubElement(
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
    if derivatives:
        simulation.set("providesDirectionalDerivative", "true")
    if sources:
        listed = ET.SubElement(simulation, "SourceFiles")
        for name in sources:
            ET.SubElement(listed, "File", name=name)
    _units(root, spec)
    _categories_and_experiment(root, spec)
    variables = ET.SubElement(root, "ModelVariables")
    for reference, v in enumerate(spec.variables, 1):
        element = _variable(variables, "ScalarVariable", reference, v)
        _type_attributes(ET.SubElement(element, v.kind), v)
    structure = ET.SubElement(root, "ModelStructure")
    if any(v.causality == "output" for v in spec.variables):
        _outputs(ET.SubElement(structure, "Outputs"), "Unknown", "index", spec)
    return as_bytes(root)


def fmi3_xml(spec: ComponentSpec, token: str, *, tool: str) -> bytes:
    """Return the model description of FMI 3.0 as UTF-8 XML, for a native FMU.

    After the table of variables comes `time`, the independent variable that FMI 3.0 requires,
    with the next value reference; then the Clock of a component that has one.
    """
    root = _root(spec, "3.0", "instantiationToken", token, tool)
    ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=spec.name,
        needsExecutionTool="false",
        canBeInstantiatedOnlyOncePerProcess="false",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        providesDirectionalDerivatives="true",
        providesAdjointDerivatives="true",
        canHandleVariableCommunicationStepSize="true",
        canReturnEarlyAfterIntermediateUpdate="false",
        providesIntermediateUpdate="false",
        hasEventMode=_bool(bool(spec.clocks)),
    )
    _units(root, spec)
    _categories_and_experiment(root, spec)
    variables = ET.SubElement(root, "ModelVariables")
    for reference, v in enumerate(spec.variables, 1):
        tag = {"Real": "Float64", "Integer": "Int32"}[v.kind]
        element = _variable(variables, tag, reference, v)
        _type_attributes(element, v)
        clocks = [i for i, c in enumerate(spec.clocks) if v.name in c.variables]
        if clocks:
            element.set("clocks", " ".join(str(len(spec.variables) + 2 + i) for i in clocks))
            element.set("variability", "discrete")
    ET.SubElement(
        variables,
        "Float64",
        name="time",
        valueReference=str(len(spec.variables) + 1),
        description="time",
        causality="independent",
        variability="continuous",
    )
    for reference, clock in enumerate(spec.clocks, len(spec.variables) + 2):
        ET.SubElement(
            variables,
            "Clock",
            name=clock.name,
            valueReference=str(reference),
            description=clock.description,
            causality="input",
            intervalVariability=clock.variability,
        )
    _outputs(ET.SubElement(root, "ModelStructure"), "Output", "valueReference", spec)
    return as_bytes(root)


def as_bytes(root: ET.Element) -> bytes:
    """Return UTF-8 XML, indented, with a final newline."""
    ET.indent(root)
    xml: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return xml + b"\n"


def _root(spec: ComponentSpec, version: str, identity: str, value: str, tool: str) -> ET.Element:
    return ET.Element(
        "fmiModelDescription",
        {"fmiVersion": version, "modelName": spec.name, identity: value},
        description=spec.description,
        version="1",
        license="MIT",
        generationTool=tool,
        variableNamingConvention="structured",
    )


def _categories_and_experiment(root: ET.Element, spec: ComponentSpec) -> None:
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


def _variable(parent: ET.Element, tag: str, reference: int, v: Variable) -> ET.Element:
    element = ET.SubElement(
        parent,
        tag,
        name=v.name,
        valueReference=str(reference),
        description=v.description,
        causality=v.causality,
        variability=v.variability,
    )
    if v.causality != "input":
        element.set("initial", "exact")  # an input's is exact by definition, and not written
    return element


def _type_attributes(kind: ET.Element, v: Variable) -> None:
    if v.unit is not None:
        kind.set("unit", v.unit)
    convert = repr if v.kind == "Real" else (lambda value: str(int(value)))
    for attribute, value in (("min", v.minimum), ("max", v.maximum), ("start", v.start)):
        if value is not None:
            kind.set(attribute, convert(float(value)))


def _outputs(parent: ET.Element, tag: str, attribute: str, spec: ComponentSpec) -> None:
    """Add the outputs with their dependencies, by index or value reference: both count from 1."""
    numbers = {v.name: number for number, v in enumerate(spec.variables, 1)}
    for v in spec.variables:
        if v.causality == "output":
            element = ET.SubElement(parent, tag, {attribute: str(numbers[v.name])})
            known = sorted(numbers[name] for name in v.depends_on)
            element.set("dependencies", " ".join(map(str, known)))
            element.set("dependenciesKind", " ".join("dependent" for _ in known))
