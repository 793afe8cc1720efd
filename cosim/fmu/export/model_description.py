"""modelDescription.xml of a component for co-simulation in FMI 2.0 and 3.0.

Outputs are declared `initial="exact"` with a start, and every output states its direct
feedthrough, empty where there is none: an importer that is told nothing must assume that
every output depends on every input, and sees algebraic loops that are not there.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from cosim.fmu.export.spec import ComponentSpec, Variable
from cosim.fmu.export.units import UNITS

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
    """The model description of FMI 2.0 as UTF-8 XML.

    Parameters
    ----------
    spec : the component.
    guid : its hash, `ComponentSpec.guid`.
    tool : generationTool, with its version.
    needs_tool : whether a Python host is needed.
    derivatives : whether directional derivatives are provided.
    sources : files of sources/ to compile for a platform that has no binary.
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
    for reference, variable in enumerate(spec.variables):
        _variable(variables, reference, variable)
    _structure(root, spec)
    return as_bytes(root)


def fmi3_xml(spec: ComponentSpec, token: str, *, tool: str) -> bytes:
    """The model description of FMI 3.0 as UTF-8 XML, for a native FMU.

    Beside the table of variables it has `time`, the independent variable that FMI 3.0 asks
    for, with the value reference after the last.
    """
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=spec.name,
        instantiationToken=token,
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
        needsExecutionTool="false",
        canBeInstantiatedOnlyOncePerProcess="false",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        providesDirectionalDerivatives="true",
        providesAdjointDerivatives="true",
        canHandleVariableCommunicationStepSize="true",
        canReturnEarlyAfterIntermediateUpdate="false",
        providesIntermediateUpdate="false",
        hasEventMode="false",
    )
    _units(root, spec)
    _categories_and_experiment(root, spec)
    variables = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(spec.variables):
        _variable_of_fmi3(variables, reference, variable)
    ET.SubElement(
        variables,
        "Float64",
        name="time",
        valueReference=str(len(spec.variables)),
        description="time",
        causality="independent",
        variability="continuous",
    )
    structure = ET.SubElement(root, "ModelStructure")
    reference_of = {v.name: i for i, v in enumerate(spec.variables)}
    for v in spec.variables:
        if v.causality == "output":
            _unknown(
                ET.SubElement(structure, "Output", valueReference=str(reference_of[v.name])),
                sorted(reference_of[n] for n in v.depends_on),
            )
    return as_bytes(root)


def as_bytes(root: ET.Element) -> bytes:
    """UTF-8 XML, indented, with a final newline."""
    ET.indent(root)
    xml: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return xml + b"\n"


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
    _type_attributes(ET.SubElement(element, v.kind), v)


def _variable_of_fmi3(parent: ET.Element, reference: int, v: Variable) -> None:
    element = ET.SubElement(
        parent,
        {"Real": "Float64", "Integer": "Int32"}[v.kind],
        name=v.name,
        valueReference=str(reference),
        description=v.description,
        causality=v.causality,
        variability=v.variability,
    )
    if v.causality != "input":
        element.set("initial", "exact")
    _type_attributes(element, v)


def _type_attributes(kind: ET.Element, v: Variable) -> None:
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
        _unknown(
            ET.SubElement(unknowns, "Unknown", index=str(index[v.name])),
            sorted(index[n] for n in v.depends_on),
        )


def _unknown(element: ET.Element, dependencies: Sequence[int]) -> None:
    element.set("dependencies", " ".join(str(i) for i in dependencies))
    element.set("dependenciesKind", " ".join("dependent" for _ in dependencies))
