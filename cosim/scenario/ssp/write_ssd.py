"""Write SystemStructure.ssd and check it against the schema of SSP 1.0."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from lxml import etree

from cosim.core import InputError
from cosim.scenario.ssp.names import (
    FMU_TYPE,
    LINK_ANNOTATION,
    LINK_FMU_ANNOTATION,
    NAMESPACES,
    OMS,
    OMS_ANNOTATION,
    OSP,
    OSP_ANNOTATION,
    OWN,
    PARAMETER_SET,
    REST_ANNOTATION,
    RUN_ANNOTATION,
    tag,
)
from cosim.scenario.ssp.structure import Element, Structure

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
        version="1.0",
        name=structure.name,
        generationTool="auv-cosim",
    )
    system = _sub(root, "ssd", "System", name=structure.name)
    if structure.description:
        system.set("description", structure.description)
    elements = _sub(system, "ssd", "Elements")
    for element in structure.elements:
        _element(elements, element)
    if structure.wires:
        _connections(system, structure)
    annotations = _sub(system, "ssd", "Annotations")
    _openmodelica(annotations, structure)
    for name, toml in structure.links.items():
        _own(annotations, LINK_ANNOTATION, "link", toml, name=name)
    if structure.units:
        units = _sub(root, "ssd", "Units")
        for name, exponents in structure.units.items():
            unit = _sub(units, "ssc", "Unit", name=name)
            _sub(unit, "ssc", "BaseUnit", **exponents)
    _experiment(root, structure)
    if structure.rest:
        annotations = _sub(root, "ssd", "Annotations")
        _own(annotations, REST_ANNOTATION, "scenario", structure.rest)
    etree.indent(root)
    text: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8")
    check_schema(text, "SystemStructureDescription", where=structure.name)
    return text + b"\n"


def check_schema(xml: bytes, kind: str, *, where: str) -> None:
    """Check XML against the schema `kind`.xsd of SSP 1.0.

    Raises
    ------
    InputError : not valid; says the line.
    """
    schema = _schema(kind)
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    if not schema.validate(etree.fromstring(xml, parser)):
        first = schema.error_log[0]
        raise InputError(
            "not valid by the schema of SSP 1.0",
            where=f"{where}:{first.line}",
            expected=f"{kind}.xsd",
            got=first.message,
        )


def _schema(kind: str) -> Any:
    folder = files("fmpy").joinpath("ssp", "schema")
    return etree.XMLSchema(file=str(folder.joinpath(f"{kind}.xsd")))


def _sub(parent: Any, prefix: str, local: str, /, **attributes: str) -> Any:
    return etree.SubElement(parent, tag(prefix, local), attributes)


def _own(annotations: Any, kind: str, local: str, toml: str | None, /, **attributes: str) -> None:
    holder = _sub(annotations, "ssc", "Annotation", type=kind)
    inside = etree.SubElement(holder, f"{{{OWN}}}{local}", attributes, nsmap={None: OWN})
    if toml is not None:
        inside.text = "\n" + toml


def _element(parent: Any, element: Element) -> None:
    component = _sub(
        parent, "ssd", "Component", name=element.name, type=FMU_TYPE, source=element.source
    )
    if element.connectors:
        connectors = _sub(component, "ssd", "Connectors")
        for connector in element.connectors:
            made = _sub(connectors, "ssd", "Connector", name=connector.name, kind=connector.kind)
            kind = _sub(made, "ssc", connector.type)
            if connector.unit is not None and connector.type == "Real":
                kind.set("unit", connector.unit)
    if element.values:
        bindings = _sub(component, "ssd", "ParameterBindings")
        values = _sub(_sub(bindings, "ssd", "ParameterBinding"), "ssd", "ParameterValues")
        bound = _sub(values, "ssv", "ParameterSet", version="1.0", name=PARAMETER_SET)
        parameters = _sub(bound, "ssv", "Parameters")
        for name, value in element.values.items():
            holder = _sub(parameters, "ssv", "Parameter", name=name)
            made = _sub(holder, "ssv", value.type, value=value.text)
            if value.unit is not None and value.type == "Real":
                made.set("unit", value.unit)
    if element.link is not None:
        annotations = _sub(component, "ssd", "Annotations")
        _own(annotations, LINK_FMU_ANNOTATION, "link", element.link[1], name=element.link[0])


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
        if wire.link is not None:
            _own(_sub(made, "ssd", "Annotations"), LINK_ANNOTATION, "link", None, name=wire.link)


def _openmodelica(annotations: Any, structure: Structure) -> None:
    holder = _sub(annotations, "ssc", "Annotation", type=OMS_ANNOTATION)
    inside = etree.SubElement(holder, f"{{{OMS}}}Annotations")
    information = etree.SubElement(inside, f"{{{OMS}}}SimulationInformation")
    etree.SubElement(
        information,
        f"{{{OMS}}}FixedStepMaster",
        description="oms-ma",
        stepSize=repr(structure.step_s),
        absoluteTolerance=_TOLERANCE,
        relativeTolerance=_TOLERANCE,
    )


def _experiment(root: Any, structure: Structure) -> None:
    experiment = _sub(
        root, "ssd", "DefaultExperiment", startTime="0.0", stopTime=repr(structure.end_s)
    )
    annotations = _sub(experiment, "ssd", "Annotations")
    holder = _sub(annotations, "ssc", "Annotation", type=OSP_ANNOTATION)
    algorithm = etree.SubElement(holder, f"{{{OSP}}}Algorithm")
    etree.SubElement(algorithm, f"{{{OSP}}}FixedStepAlgorithm", baseStepSize=repr(structure.step_s))
    _own(annotations, RUN_ANNOTATION, "run", structure.run)
