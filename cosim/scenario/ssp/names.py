"""Names of SSP 1.0 and 2.0 and of this project's annotations in them.

OMSimulator refuses an archive with annotations of the whole description or of a Component; of a
System, a Connection and the DefaultExperiment it takes them, so ours are there. Of a System it
reads the first annotation only, which must be its own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from types import MappingProxyType
from typing import Literal

SspVersion = Literal["1.0", "2.0"]
"""Versions of the standard that archives are written by."""

SSD = "SystemStructure.ssd"
"""The file of an archive that describes the system."""

NAMESPACES = MappingProxyType(
    {
        "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
        "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
        "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
        "ssm": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
        "ssb": "http://ssp-standard.org/SSP1/SystemStructureSignalDictionary",
    }
)
"""Prefix -> namespace, of both versions; most tools recognise only these prefixes."""

OWN = "urn:auv-cosim:ssp:1"
"""Namespace of the content of the annotations below."""

RUN_ANNOTATION = "auv-cosim.run"
"""Of the DefaultExperiment: a `<run>` with the table [run] of a scenario as TOML."""

REST_ANNOTATION = "auv-cosim.scenario"
"""Of the System: a `<scenario>` with the parts that SSP cannot express, as TOML."""

LINK_ANNOTATION = "auv-cosim.link"
"""Of the System: a `<link name="...">` with [links.NAME] of a scenario as TOML, every key.

Of a Connection: an empty `<link name="...">`, the link that this connection goes over.
"""

LINK_FMU_ANNOTATION = "auv-cosim.link-fmu"
"""Of the System: a `<link name="..." element="...">` for each element that is a link FMU."""

SIGNALS_ANNOTATION = "auv-cosim.signals"
"""Of the System: `<signals element="...">`, the paths and time series of the scenario, as TOML.

The element, if there is one, plays those that move in other tools; an import has all again in its
place.
"""

LINEAR = "LinearTransformation"
NAMES_ANNOTATION = "auv-cosim.names"
"""Of the System: `<names>`, the names in the scenario of elements named otherwise here, as TOML."""

OSP_ANNOTATION = "com.opensimulationplatform"
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
"""libcosim takes its step from an annotation of the DefaultExperiment."""

OMS_ANNOTATION = "org.openmodelica"
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
"""OMSimulator takes master and step from an annotation of the System."""

PARAMETER_SET = "parameters"
"""Name of every parameter set: Ecos applies those of one name together."""

OMS_SOLVER = "oms_ma_default"
"""OMSimulator's importer in Python gives components without a solver the one of this name."""

FMU_TYPE = "application/x-fmu-sharedlibrary"

IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
"""What OMSimulator takes as the name of an archive, a system, or an element."""


def identifiers(names: Iterable[str]) -> dict[str, str]:
    """Return a distinct identifier for each name: the name itself, if it is one."""
    names = list(names)
    found = {name: name for name in names if IDENTIFIER.fullmatch(name)}
    for name in names:
        if name not in found:
            plain = re.sub(r"[^A-Za-z0-9_]+", "_", name) or "system"
            plain = plain if plain[0].isalpha() else f"s_{plain.lstrip('_')}"
            number, free = 2, plain
            while free in found.values():
                number, free = number + 1, f"{plain}_{number}"
            found[name] = free
    return found


def tag(prefix: str, name: str) -> str:
    """Return a name in a namespace, as lxml writes it."""
    return f"{{{NAMESPACES[prefix]}}}{name}"


def ignored_by_others(tables: Iterable[str], links: Iterable[str]) -> Iterator[str]:
    """Yield sentences about annotations: tables of a scenario, and links between components."""
    for name in sorted(tables):
        yield f"[{name}] is an annotation of this project: other tools ignore it"
    for name in sorted(links):
        yield (
            f"link {name!r} is an annotation of this project: other tools ignore it, and connect "
            "directly what is connected over it"
        )
