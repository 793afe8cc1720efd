"""What the rules about other tools look at: an archive's elements, values and FMUs."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

from lxml import etree

from cosim.core import InputError
from cosim.scenario.ssp.archive import BROKEN, MAX_FMU, Archive
from cosim.scenario.ssp.names import NAMESPACES, SSD, tag
from cosim.scenario.ssp.units import UnitBase, units_in


class FmuFacts(NamedTuple):
    """The version of an FMU, its kinds of use, and the value references in the file's order."""

    version: str
    kinds: tuple[str, ...]
    references: tuple[int, ...]


class ArchiveFacts:
    """An archive's description; `place` says where an element is.

    Attributes
    ----------
    root : the root of SystemStructure.ssd.
    systems, components : of all depths.
    """

    def __init__(self, archive: Archive) -> None:
        self.archive = archive
        self.root = archive.xml(SSD, "SystemStructureDescription")
        self.systems = list(self.root.iter(tag("ssd", "System")))
        self.components = list(self.root.iter(tag("ssd", "Component")))

    @property
    def top(self) -> Any:
        """The outermost system, or None."""
        return self.root.find(tag("ssd", "System"))

    def place(self, element: Any) -> str:
        """Return entry and line of an element."""
        entry = self._entry_of.get(element.getroottree().getroot(), SSD)
        return f"{entry}:{element.sourceline}"

    @cached_property
    def units(self) -> dict[str, UnitBase]:
        """The units that the description defines."""
        return units_in(self.root)

    @cached_property
    def _entry_of(self) -> dict[Any, str]:
        kinds = {
            ".ssv": "SystemStructureParameterValues",
            ".ssm": "SystemStructureParameterMapping",
        }
        found = {}
        for entry in self.archive.names():
            kind = kinds.get(entry[-4:].lower())
            if kind is not None:
                found[self.archive.xml(entry, kind)] = entry
        return found

    def everywhere(self, prefix: str, name: str) -> Iterator[Any]:
        """Yield elements of a name in the description and in the .ssv and .ssm files."""
        for root in (self.root, *self._entry_of):
            yield from root.iter(tag(prefix, name))

    def connectors(self) -> Iterator[tuple[Any, Any, Any]]:
        """Yield each connector of a component or system, its owner, and the element of its type."""
        for owner in (*self.components, *self.systems):
            for connector in owner.iterfind(
                f"{tag('ssd', 'Connectors')}/{tag('ssd', 'Connector')}"
            ):
                kinds = [c for c in connector.iterchildren(tag=etree.Element) if _is_type(c)]
                yield owner, connector, kinds[0] if kinds else None

    def connections(self) -> Iterator[tuple[Any, list[tuple[Any, Any]]]]:
        """Yield each connection, with owner and connector of both ends; None: there is none."""
        owners = self._owners
        for system in self.systems:
            path = f"{tag('ssd', 'Connections')}/{tag('ssd', 'Connection')}"
            for connection in system.iterfind(path):
                ends = []
                for side in ("start", "end"):
                    name = connection.get(f"{side}Element")
                    owner = system if not name else owners.get((system, name))
                    wanted = connection.get(f"{side}Connector")
                    found = None
                    for connector in (
                        ()
                        if owner is None
                        else owner.iterfind(f"{tag('ssd', 'Connectors')}/{tag('ssd', 'Connector')}")
                    ):
                        found = connector if connector.get("name") == wanted else found
                    ends.append((owner, found))
                yield connection, ends

    @cached_property
    def _owners(self) -> dict[tuple[Any, str], Any]:
        return {
            (system, element.get("name", "")): element
            for system in self.systems
            for holder in system.iterfind(tag("ssd", "Elements"))
            for element in holder.iterchildren(tag=etree.Element)
        }

    @cached_property
    def fmus(self) -> dict[Any, FmuFacts]:
        """Component -> facts of its FMU; components whose FMU cannot be read are left out."""
        found: dict[Any, FmuFacts] = {}
        read: dict[str, FmuFacts | None] = {}
        for component in self.components:
            source = component.get("source", "")
            if source not in read:
                try:
                    entry = self.archive.entry(source, SSD, self.place(component))
                    read[source] = _fmu_facts(self.archive.read(entry, MAX_FMU))
                except InputError:
                    read[source] = None
            facts = read[source]
            if facts is not None:
                found[component] = facts
        return found


def _is_type(element: Any) -> bool:
    name = etree.QName(element)
    return name.namespace == NAMESPACES["ssc"] and name.localname not in ("Dimension", "Annotation")


def _fmu_facts(content: bytes) -> FmuFacts | None:
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as fmu:
            root = etree.fromstring(fmu.read("modelDescription.xml"), parser)
        variables = root.find("ModelVariables")
        listed = [] if variables is None else list(variables.iterchildren(tag=etree.Element))
        references = tuple(int(v.get("valueReference", "0")) for v in listed)
    except (*BROKEN, etree.XMLSyntaxError, KeyError, ValueError):
        return None
    uses = ("CoSimulation", "ModelExchange", "ScheduledExecution")
    kinds = tuple(kind for kind in uses if root.find(kind) is not None)
    return FmuFacts(root.get("fmiVersion", ""), kinds, references)
