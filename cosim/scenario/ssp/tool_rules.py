"""What other tools refuse in an archive or do differently: rules, read from their sources.

OMSimulator 3.0 (the importer in C++, which also reads SSP 2.0), libcosim 0.11, Ecos 0.7 and
FMPy 0.3.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

from lxml import etree

from cosim.scenario.ssp.names import (
    FMU_TYPE,
    IDENTIFIER,
    NAMESPACES,
    OMS,
    OMS_ANNOTATION,
    OSP,
    OSP_ANNOTATION,
    tag,
)
from cosim.scenario.ssp.tool_facts import ArchiveFacts

SspTool = Literal["omsimulator", "libcosim", "ecos", "fmpy"]
"""A tool that loads archives and whose rules are known."""

SSP_TOOLS: tuple[SspTool, ...] = ("omsimulator", "libcosim", "ecos", "fmpy")
"""All of them."""

Effect = Literal["refused", "different"]
"""The tool does not load the archive, or another system runs than the archive describes."""

Found = Iterator[tuple[Any, str]]
"""Elements at fault and what is there."""


@dataclass(frozen=True, eq=False)
class ToolRule:
    """Something that tools do not take.

    Attributes
    ----------
    code : name of the rule.
    effects : tool -> what happens there.
    reason : why.
    cure : what to do.
    """

    code: str
    effects: dict[SspTool, Effect]
    reason: str
    cure: str
    find: Callable[[ArchiveFacts], Found]


def _named(element: Any) -> str:
    name = element.get("name")
    return str(etree.QName(element).localname) + (f" {name!r}" if name is not None else "")


def _not_identifiers(facts: ArchiveFacts) -> Found:
    for element in (facts.root, *facts.systems, *facts.components):
        if not IDENTIFIER.fullmatch(element.get("name", "")):
            yield element, _named(element)


def _other_prefixes(facts: ArchiveFacts) -> Found:
    prefixes = {uri: prefix for prefix, uri in NAMESPACES.items()}
    seen = set()
    for element in facts.root.iter(tag=etree.Element):
        uri = etree.QName(element).namespace
        if uri in prefixes and element.prefix != prefixes[uri] and uri not in seen:
            seen.add(uri)
            yield element, f"prefix {element.prefix or '(none)'} for {uri}"


def _children_beside(parents: list[Any], *allowed: str) -> Found:
    for parent in parents:
        for child in parent.iterchildren(tag=etree.Element):
            if etree.QName(child).localname not in allowed:
                inside = etree.QName(child).localname
                yield child, f"{inside} in {_named(parent)}"


def _more_at_top(facts: ArchiveFacts) -> Found:
    return _children_beside([facts.root], "System", "Units", "Enumerations", "DefaultExperiment")


def _more_in_component(facts: ArchiveFacts) -> Found:
    return _children_beside(facts.components, "Connectors", "ElementGeometry", "ParameterBindings")


def _more_in_system(facts: ArchiveFacts) -> Found:
    return _children_beside(
        facts.systems,
        *("ElementGeometry", "ParameterBindings", "Connectors", "Connections", "Elements"),
        "Annotations",
    )


def _no_master(facts: ArchiveFacts) -> Found:
    for system in facts.systems:
        first = system.find(f"{tag('ssd', 'Annotations')}/{tag('ssc', 'Annotation')}")
        own = first is not None and first.get("type") == OMS_ANNOTATION
        if not own or next(first.iter(f"{{{OMS}}}SimulationInformation"), None) is None:
            yield (
                system,
                f"{_named(system)}: "
                + ("no annotation" if first is None else f"{first.get('type')} first"),
            )


def _other_elements(facts: ArchiveFacts) -> Found:
    for reference in facts.root.iter(tag("ssd", "SignalDictionaryReference")):
        yield reference, _named(reference)


def _nested(facts: ArchiveFacts) -> Found:
    for system in facts.systems:
        if system is not facts.top:
            yield system, _named(system)


def _no_fmu(facts: ArchiveFacts) -> Found:
    for component in facts.components:
        kind = component.get("type", FMU_TYPE)
        if kind != FMU_TYPE:
            yield component, f"{_named(component)}: {kind}"


def _types(*allowed: str) -> Callable[[ArchiveFacts], Found]:
    """Find connectors of types other than these."""

    def find(facts: ArchiveFacts) -> Found:
        for owner, connector, kind in facts.connectors():
            name = None if kind is None else etree.QName(kind).localname
            if name not in allowed and (name is not None or owner.tag == tag("ssd", "Component")):
                yield connector, f"{_named(owner)}, {_named(connector)}: {name or 'no type'}"

    return find


def _values(*allowed: str) -> Callable[[ArchiveFacts], Found]:
    """Find parameter values of types other than these."""

    def find(facts: ArchiveFacts) -> Found:
        for parameter in facts.everywhere("ssv", "Parameter"):
            for kind in parameter.iterchildren(tag=etree.Element):
                name = etree.QName(kind)
                if name.namespace == NAMESPACES["ssv"] and name.localname not in allowed:
                    yield parameter, f"{_named(parameter)}: {name.localname}"

    return find


def _arrays(facts: ArchiveFacts) -> Found:
    for dimension in facts.everywhere("ssc", "Dimension"):
        owner = dimension.getparent()
        yield owner, _named(owner)


def _transformed_connections(facts: ArchiveFacts) -> Found:
    for connection, _ in facts.connections():
        for child in connection.iterchildren(tag=etree.Element):
            name = etree.QName(child).localname
            if name.endswith("Transformation"):
                yield connection, f"{_ends(connection)}: {name}"


def _ends(connection: Any) -> str:
    ends = (
        f"{connection.get(f'{side}Element') or ''}.{connection.get(f'{side}Connector')}"
        for side in ("start", "end")
    )
    return " -> ".join(end.removeprefix(".") for end in ends)


def _transformed_parameters(facts: ArchiveFacts) -> Found:
    for entry in facts.everywhere("ssm", "MappingEntry"):
        for child in entry.iterchildren(tag=etree.Element):
            name = etree.QName(child).localname
            if name.endswith("Transformation"):
                yield entry, f"{entry.get('source')} to {entry.get('target')}: {name}"


def _mappings(facts: ArchiveFacts) -> Found:
    for mapping in facts.root.iter(tag("ssd", "ParameterMapping")):
        yield mapping, _named(mapping.getparent().getparent().getparent())


def _bound_to_systems(facts: ArchiveFacts) -> Found:
    for system in facts.systems:
        for bindings in system.iterfind(tag("ssd", "ParameterBindings")):
            yield bindings, _named(system)


def _any_parameters(facts: ArchiveFacts) -> Found:
    bindings = [e for e in facts.root.iter(tag("ssd", "ParameterBindings")) if len(e)]
    if bindings:
        yield bindings[0], f"{len(bindings)} elements with parameters"


def _several_sets(facts: ArchiveFacts) -> Found:
    for component in facts.components:
        path = f"{tag('ssd', 'ParameterBindings')}/{tag('ssd', 'ParameterBinding')}"
        bindings = component.findall(path)
        if len(bindings) > 1:
            yield bindings[1], f"{_named(component)}: {len(bindings)} parameter sets"


def _outer_connectors(facts: ArchiveFacts) -> Found:
    for connection, _ in facts.connections():
        if not (connection.get("startElement") and connection.get("endElement")):
            yield connection, _ends(connection)


def _loose_ends(facts: ArchiveFacts) -> Found:
    for connection, ends in facts.connections():
        if any(connector is None for _, connector in ends):
            yield connection, _ends(connection)


def _pairs(facts: ArchiveFacts) -> Iterator[tuple[Any, list[Any]]]:
    """Yield connections with the elements of the types of both ends."""
    kinds = {connector: kind for _, connector, kind in facts.connectors()}
    for connection, ends in facts.connections():
        both = [kinds.get(connector) for _, connector in ends]
        if both[0] is not None and both[1] is not None:
            yield connection, both


def _mixed_types(facts: ArchiveFacts) -> Found:
    for connection, both in _pairs(facts):
        names = [etree.QName(kind).localname for kind in both]
        if names[0] != names[1] and set(names) != {"Integer", "Enumeration"}:
            yield connection, f"{_ends(connection)}: {' -> '.join(names)}"


def _unequal_units(*, dimensions: bool) -> Callable[[ArchiveFacts], Found]:
    """Find connections between units of other dimensions, or of other factors or offsets."""

    def find(facts: ArchiveFacts) -> Found:
        for connection, both in _pairs(facts):
            one, other = (facts.units.get(kind.get("unit", "")) for kind in both)
            if one is None or other is None or one == other:
                continue
            if (one.exponents != other.exponents) == dimensions:
                units = " -> ".join(kind.get("unit") for kind in both)
                yield connection, f"{_ends(connection)}: {units}"

    return find


def _of_fmi(*versions: str) -> Callable[[ArchiveFacts], Found]:
    """Find components whose FMUs are of these versions."""

    def find(facts: ArchiveFacts) -> Found:
        for component, fmu in facts.fmus.items():
            if fmu.version in versions:
                yield component, f"{_named(component)}: FMI {fmu.version}"

    return find


def _no_co_simulation(facts: ArchiveFacts) -> Found:
    for component, fmu in facts.fmus.items():
        if "CoSimulation" not in fmu.kinds or component.get("implementation") == "ModelExchange":
            yield component, f"{_named(component)}: {', '.join(fmu.kinds) or 'FMI ' + fmu.version}"


def _references_not_in_order(facts: ArchiveFacts) -> Found:
    for component, fmu in facts.fmus.items():
        if fmu.version.startswith("3") and fmu.references != tuple(
            range(1, len(fmu.references) + 1)
        ):
            yield component, f"{_named(component)}: value references begin at {min(fmu.references)}"


def _inputs_without_source(facts: ArchiveFacts) -> Found:
    fed = {connector for _, ends in facts.connections() for _, connector in ends}
    for owner, connector, _ in facts.connectors():
        if owner is not facts.top and connector.get("kind") == "input" and connector not in fed:
            yield connector, f"{_named(owner)}, {_named(connector)}"


def _version_2(facts: ArchiveFacts) -> Found:
    if facts.root.get("version") != "1.0":
        yield facts.root, f"version {facts.root.get('version')}"


def _no_osp_step(facts: ArchiveFacts) -> Found:
    experiment = facts.root.find(tag("ssd", "DefaultExperiment"))
    holders = () if experiment is None else experiment.iter(tag("ssc", "Annotation"))
    for holder in holders:
        if holder.get("type") == OSP_ANNOTATION and len(holder.findall(f"{{{OSP}}}Algorithm")):
            return
    yield facts.root, "no step"


def _no_stop(facts: ArchiveFacts) -> Found:
    experiment = facts.root.find(tag("ssd", "DefaultExperiment"))
    if experiment is None or experiment.get("stopTime") is None:
        yield facts.root, "no stopTime"


def _refused(*tools: SspTool) -> dict[SspTool, Effect]:
    return dict.fromkeys(tools, "refused")


def _different(*tools: SspTool) -> dict[SspTool, Effect]:
    return dict.fromkeys(tools, "different")


_EXPORT = "cosim ssp export writes it so; or import the archive and export it again"

RULES: tuple[ToolRule, ...] = (
    ToolRule(
        "name-no-identifier",
        _refused("omsimulator"),
        "names of archives, systems and components are parts of references there: a letter, then "
        "letters, digits and _",
        f"rename it; {_EXPORT}",
        _not_identifiers,
    ),
    ToolRule(
        "other-prefix",
        _refused("omsimulator", "libcosim", "ecos"),
        "the tool compares the text before the colon, not the namespace",
        "use the prefixes ssd, ssc, ssv, ssm",
        _other_prefixes,
    ),
    ToolRule(
        "more-at-top",
        _refused("omsimulator"),
        "beside System, Units, Enumerations and DefaultExperiment it takes nothing in the "
        "description: no Annotations, MetaData or Signature",
        f"move annotations into the System; {_EXPORT}",
        _more_at_top,
    ),
    ToolRule(
        "more-in-component",
        _refused("omsimulator"),
        "a Component may have Connectors, ElementGeometry and ParameterBindings: no Annotations",
        f"move annotations into the System; {_EXPORT}",
        _more_in_component,
    ),
    ToolRule(
        "more-in-system",
        _refused("omsimulator"),
        "a System may have no SystemGeometry, SignalDictionaries, GraphicalElements or MetaData",
        f"delete it, it does not change the run; {_EXPORT}",
        _more_in_system,
    ),
    ToolRule(
        "no-openmodelica-annotation",
        _refused("omsimulator"),
        "it takes the kind of each system and its master from the first annotation of the System, "
        f"{OMS_ANNOTATION}, and no other",
        f"put that annotation first; {_EXPORT}",
        _no_master,
    ),
    ToolRule(
        "signal-dictionary",
        {**_refused("omsimulator", "libcosim", "ecos"), **_different("fmpy")},
        "it has no signal dictionaries; in FMPy their signals stay at zero",
        "connect the components directly: import the archive and export it again",
        _other_elements,
    ),
    ToolRule(
        "nested-system",
        _refused("libcosim", "ecos"),
        "it takes components only, no systems in systems",
        "flatten it: import the archive and export it again",
        _nested,
    ),
    ToolRule(
        "no-fmu",
        _refused(*SSP_TOOLS),
        "the component is not an FMU",
        "an FMU in its place",
        _no_fmu,
    ),
    ToolRule(
        "no-co-simulation",
        _refused(*SSP_TOOLS),
        "the tool steps FMUs for co-simulation",
        "an FMU for co-simulation",
        _no_co_simulation,
    ),
    ToolRule(
        "connector-type",
        _refused("omsimulator"),
        "it takes connectors of type Real, Integer, Boolean and Enumeration",
        "leave out connectors that are not connected; write Float64 as Real, Int32 as Integer",
        _types("Real", "Integer", "Boolean", "Enumeration"),
    ),
    ToolRule(
        "connector-type",
        {**_refused("libcosim"), **_different("ecos")},
        "it takes connectors of type Real, Integer, Boolean and String; Ecos takes others for Real",
        "leave out connectors that are not connected; write Float64 as Real, Int32 as Integer",
        _types("Real", "Integer", "Boolean", "String"),
    ),
    ToolRule(
        "connector-type",
        _refused("fmpy"),
        "it sets and reads Real, Integer, Boolean and Enumeration",
        "leave out connectors that are not connected",
        _types("Real", "Integer", "Boolean", "Enumeration"),
    ),
    ToolRule(
        "parameter-type",
        _different("omsimulator"),
        "it sets parameters of type Real, Integer and Boolean and skips the others",
        "write Float64 as Real; set the others in the FMU",
        _values("Real", "Integer", "Boolean"),
    ),
    ToolRule(
        "parameter-type",
        _refused("libcosim", "ecos"),
        "it takes parameters of type Real, Integer, Boolean and String",
        "write Float64 as Real and Int32 as Integer; set the others in the FMU",
        _values("Real", "Integer", "Boolean", "String"),
    ),
    ToolRule(
        "array",
        _refused(*SSP_TOOLS),
        "it has no arrays",
        "an FMU with scalar variables",
        _arrays,
    ),
    ToolRule(
        "loose-connection",
        _refused(*SSP_TOOLS),
        "an end of the connection is no connector of a component or system",
        "list the connector, with its type",
        _loose_ends,
    ),
    ToolRule(
        "outer-connection",
        _refused("libcosim", "ecos"),
        "it takes connections between components only",
        "connect the components directly: import the archive and export it again",
        _outer_connectors,
    ),
    ToolRule(
        "types-differ",
        _refused("omsimulator", "ecos"),
        "the ends of a connection must be of one type",
        "an FMU that converts between the two",
        _mixed_types,
    ),
    ToolRule(
        "units-differ",
        _refused("omsimulator"),
        "the units of a connection measure different things",
        "correct the unit, or leave it out",
        _unequal_units(dimensions=True),
    ),
    ToolRule(
        "unit-conversion",
        _different("libcosim", "ecos", "fmpy"),
        "it passes values on as they are, whatever the units",
        "an FMU that converts between the two",
        _unequal_units(dimensions=False),
    ),
    ToolRule(
        "transformed-connection",
        _different("omsimulator", "fmpy"),
        "it passes values on as they are, without the transformation",
        "an FMU that transforms between the two",
        _transformed_connections,
    ),
    ToolRule(
        "transformed-parameter",
        _different("omsimulator"),
        "it sets the value as it is in the parameter set, without the transformation",
        "write the transformed value: import the archive and export it again",
        _transformed_parameters,
    ),
    ToolRule(
        "parameter-mapping",
        _different("libcosim", "ecos", "fmpy"),
        "it ignores mappings: it sets the variables of the names in the parameter set",
        "write values by the names of the variables: import the archive and export it again",
        _mappings,
    ),
    ToolRule(
        "system-parameters",
        _different("libcosim", "ecos", "fmpy"),
        "it ignores parameters of a system",
        "bind them to the components: import the archive and export it again",
        _bound_to_systems,
    ),
    ToolRule(
        "several-parameter-sets",
        _different("libcosim"),
        "it sets the first parameter set of each component, or those of one name",
        "one parameter set for each component: import the archive and export it again",
        _several_sets,
    ),
    ToolRule(
        "parameters-as-argument",
        _different("fmpy"),
        "it sets no parameters of the archive: simulate_ssp takes them as an argument",
        "simulate_ssp(file, parameter_set=...), names with the component in front",
        _any_parameters,
    ),
    ToolRule(
        "fmi-version",
        _refused("libcosim"),
        "it loads FMUs of FMI 1.0 and 2.0",
        "the FMU in FMI 2.0",
        _of_fmi("3.0"),
    ),
    ToolRule(
        "fmi-version",
        _refused("omsimulator"),
        "it loads FMUs of FMI 2.0 and 3.0",
        "the FMU in FMI 2.0",
        _of_fmi("1.0"),
    ),
    ToolRule(
        "fmi-version",
        _refused("fmpy"),
        "simulate_ssp loads FMUs of FMI 1.0 and 2.0",
        "the FMU in FMI 2.0",
        _of_fmi("3.0"),
    ),
    ToolRule(
        "value-references",
        _different("omsimulator"),
        "it takes the value references in ModelStructure of FMI 3.0 for positions of variables, "
        "counted from 1: wrong dependencies, or a crash at 0",
        "value references from 1 in the order of the variables, as built-in FMUs have",
        _references_not_in_order,
    ),
    ToolRule(
        "input-without-source",
        _refused("fmpy"),
        "it expects a connection for every input that is a connector",
        "leave out connectors that are not connected",
        _inputs_without_source,
    ),
    ToolRule(
        "ssp-version",
        _refused("ecos", "fmpy"),
        "it reads SSP 1.0",
        "cosim ssp export --ssp 1.0",
        _version_2,
    ),
    ToolRule(
        "no-step",
        _refused("libcosim"),
        "without its annotation of the DefaultExperiment it does not know the step",
        f"the annotation {OSP_ANNOTATION} with a FixedStepAlgorithm; {_EXPORT}",
        _no_osp_step,
    ),
    ToolRule(
        "no-stop",
        _different("omsimulator"),
        "without a stopTime it runs for one second",
        "a DefaultExperiment with a stopTime",
        _no_stop,
    ),
)
