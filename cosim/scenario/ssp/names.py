"""Names of SSP 1.0 and of this project's annotations in it."""

from __future__ import annotations

from types import MappingProxyType

SSD = "SystemStructure.ssd"
"""The file of an archive that describes the system."""

NAMESPACES = MappingProxyType(
    {
        "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
        "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
        "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
        "ssm": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
    }
)
"""Prefix -> namespace; libcosim and Ecos recognise only these prefixes."""

OWN = "urn:auv-cosim:ssp:1"
"""Namespace of the content of the annotations below."""

RUN_ANNOTATION = "auv-cosim.run"
"""Of the DefaultExperiment: a `<run>` with the table [run] of a scenario as TOML."""

REST_ANNOTATION = "auv-cosim.scenario"
"""Of the description: a `<scenario>` with the parts that SSP cannot express, as TOML."""

LINK_ANNOTATION = "auv-cosim.link"
"""Of the System: a `<link name="...">` with [links.NAME] of a scenario as TOML, every key.

Of a Connection: an empty `<link name="...">`, the link that this connection goes over.
"""

LINK_FMU_ANNOTATION = "auv-cosim.link-fmu"
"""Of a Component that is a link FMU: the `<link>` that it implements."""

OSP_ANNOTATION = "com.opensimulationplatform"
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
"""libcosim takes its step from an annotation of the DefaultExperiment."""

OMS_ANNOTATION = "org.openmodelica"
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
"""OMSimulator takes master and step from an annotation of the System."""

PARAMETER_SET = "parameters"
"""Name of every parameter set: Ecos applies those of one name together."""

FMU_TYPE = "application/x-fmu-sharedlibrary"


def tag(prefix: str, name: str) -> str:
    """Return a name in a namespace, as lxml writes it."""
    return f"{{{NAMESPACES[prefix]}}}{name}"
