"""Write SystemStructure.ssd and check it against the schema of its version of SSP."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import tomli_w
from lxml import etree

from cosim.core import InputError, printable
from cosim.scenario.ssp.names import (
    FMU_TYPE,
    LINEAR,
    LINK_ANNOTATION,
    LINK_FMU_ANNOTATION,
    NAMES_ANNOTATION,
    NAMESPACES,
    OMS,
    OMS_ANNOTATION,
    OMS_SOLVER,
    OSP,
    OSP_ANNOTATION,
    OWN,
    PARAMETER_SET,
    REST_ANNOTATION,
    RUN_ANNOTATION,
    SIGNALS_ANNOTATION,
    tag,
)
from cosim.scenario.ssp.structure import FLOATS, Element, Structure, Value

_TOLERANCE = "1e-6"  # required by OMSimulator; a fixed-step master does not use it


def ssd_bytes(structure: Structure) -> bytes:
    """Write the description as UTF-8 XML, valid by the schema.

    Raises
    ------
    InputError : not valid, for instance because of a name in the scenario.
    """
    spaces = {name: NAMESPACES[name] for name in ("ssc", "ssd", "ssv")}
    root = etree.Element(
        tag("ssd", "SystemStructureDescription"),
        nsmap={**spaces, "osp": OSP, "oms": OMS},
        version=structure.version,
        name=structure.name,
        generationTool="auv-cosim",
    )
    system = _sub(root, "ssd", "System", name=structure.name)
    if structure.description:
        system.set("description", printable(structure.description))
    elements = _sub(system, "ssd", "Elements")
    for element in structure.elements:
        _element(elements, element, structure.version)
    if structure.wires:
        _connections(system, structure)
    _annotations(_sub(system, "ssd", "Annotations"), structure)
    if structure.units:
        units = _sub(root, "ssd", "Units")
        for name, base in structure.units.items():
            unit = _sub(units, "ssc", "Unit", name=name)
            _sub(unit, "ssc", "BaseUnit", **base.attributes())
    _experiment(root, structure)
    etree.indent(root)
    text: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8")
    check_schema(text, "SystemStructureDescription", where=structure.name)
    return text + b"\n"


def check_schema(xml: bytes, kind: str, *, where: str) -> None:
    """Check XML against the schema `kind`.xsd of the version of SSP that it names.

    Raises
    ------
    InputError : not valid; says the line.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    root = etree.fromstring(xml, parser)
    version = "2.0" if root.get("version") == "2.0" else "1.0"
    schema = _schema(kind, version)
    if not schema.validate(root):
        first = schema.error_log[0]
        raise InputError(
            f"not valid by the schema of SSP {version}",
            where=f"{where}:{first.line}",
            expected=f"{kind}.xsd",
            got=first.message,
        )


def _schema(kind: str, version: str) -> Any:
    """Return a schema: of SSP 1.0 as FMPy has it, of SSP 2.0 from the folder beside."""
    folder = files("fmpy").joinpath("ssp", "schema")
    if version == "2.0":
        folder = files("cosim.scenario.ssp").joinpath("schema_2_0")
    return etree.XMLSchema(file=str(folder.joinpath(f"{kind}.xsd")))


def _sub(parent: Any, prefix: str, local: str, /, **attributes: str) -> Any:
    return etree.SubElement(parent, tag(prefix, local), attributes)


def _own(annotations: Any, kind: str, local: str, toml: str | None, /, **attributes: str) -> None:
    holder = _sub(annotations, "ssc", "Annotation", type=kind)
    inside = etree.SubElement(holder, f"{{{OWN}}}{local}", attributes, nsmap={None: OWN})
    if toml is not None:
        inside.text = "\n" + toml


def _element(parent: Any, element: Element, version: str) -> None:
    component = _sub(
        parent, "ssd", "Component", name=element.name, type=FMU_TYPE, source=element.source
    )
    if element.connectors:
        connectors = _sub(component, "ssd", "Connectors")
        for connector in element.connectors:
            made = _sub(connectors, "ssd", "Connector", name=connector.name, kind=connector.kind)
            kind = _sub(made, "ssc", connector.type)
            if connector.unit is not None and connector.type in FLOATS:
                kind.set("unit", connector.unit)
            _dimensions(made, connector.shape)
    if element.values:
        bindings = _sub(component, "ssd", "ParameterBindings")
        values = _sub(_sub(bindings, "ssd", "ParameterBinding"), "ssd", "ParameterValues")
        bound = _sub(values, "ssv", "ParameterSet", version=version, name=PARAMETER_SET)
        parameters = _sub(bound, "ssv", "Parameters")
        for name, value in element.values.items():
            _value(_sub(parameters, "ssv", "Parameter", name=name), value)


def _value(holder: Any, value: Value) -> None:
    made = _sub(holder, "ssv", value.type)
    if value.shape and value.type == "String":
        for text in value.texts:
            _sub(made, "ssv", "Value", value=text)
    else:
        made.set("value", " ".join(value.texts))
    if value.unit is not None and value.type in FLOATS:
        made.set("unit", value.unit)
    _dimensions(holder, value.shape)


def _dimensions(holder: Any, shape: tuple[int, ...]) -> None:
    for size in shape:
        _sub(holder, "ssc", "Dimension", size=str(size))


def _connections(system: Any, structure: Structure) -> None:
    connections = _sub(system, "ssd", "Connections")
    for wire in structure.wires:
        made = _sub(
            connections,
            "ssd",
            "Connection",
            startElement=wire.source[0],
            startConnector=wire.source[1],
            endElement=wire.target[0],
            endConnector=wire.target[1],
        )
        if (wire.factor, wire.offset) != (1.0, 0.0):
            # of the numbers as they are, whatever the units of the two ends
            made.set("suppressUnitConversion", "true")
            numbers = {"factor": repr(wire.factor), "offset": repr(wire.offset)}
            _sub(made, "ssc", LINEAR, **numbers)
        if wire.link is not None:
            _own(_sub(made, "ssd", "Annotations"), LINK_ANNOTATION, "link", None, name=wire.link)


def _annotations(annotations: Any, structure: Structure) -> None:
    """Add OMSimulator's annotation, which it wants first, and those of this project."""
    _openmodelica(annotations, structure)
    for name, toml in structure.links.items():
        _own(annotations, LINK_ANNOTATION, "link", toml, name=name)
    for element in structure.elements:
        if element.link is not None:
            name, toml = element.link
            _own(annotations, LINK_FMU_ANNOTATION, "link", toml, name=name, element=element.name)
    if structure.labels:
        _own(annotations, NAMES_ANNOTATION, "names", tomli_w.dumps(structure.labels))
    toml, player = structure.signals
    if toml:
        of = {} if player is None else {"element": player}
        _own(annotations, SIGNALS_ANNOTATION, "signals", toml, **of)
    if structure.rest:
        _own(annotations, REST_ANNOTATION, "scenario", structure.rest)


def _openmodelica(annotations: Any, structure: Structure) -> None:
    """Set OMSimulator's master and step: attributes for its importer in Python, a child in C++."""
    holder = _sub(annotations, "ssc", "Annotation", type=OMS_ANNOTATION)
    inside = etree.SubElement(holder, f"{{{OMS}}}Annotations")
    step = repr(structure.step_s)
    information = etree.SubElement(
        inside,
        f"{{{OMS}}}SimulationInformation",
        name=OMS_SOLVER,
        method="oms_ma",
        fixedStepSize=step,
    )
    etree.SubElement(
        information,
        f"{{{OMS}}}FixedStepMaster",
        description="oms-ma",
        stepSize=step,
        absoluteTolerance=_TOLERANCE,
        relativeTolerance=_TOLERANCE,
    )


def _experiment(root: Any, structure: Structure) -> None:
    experiment = _sub(
        root,
        "ssd",
        "DefaultExperiment",
        startTime=repr(structure.start_s),
        stopTime=repr(structure.end_s),
    )
    annotations = _sub(experiment, "ssd", "Annotations")
    holder = _sub(annotations, "ssc", "Annotation", type=OSP_ANNOTATION)
    algorithm = etree.SubElement(holder, f"{{{OSP}}}Algorithm")
    etree.SubElement(algorithm, f"{{{OSP}}}FixedStepAlgorithm", baseStepSize=repr(structure.step_s))
    _own(annotations, RUN_ANNOTATION, "run", structure.run)
