"""Export a scenario as an SSP archive; links become annotations or FMUs."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import tomli_w

from cosim.core import AnyPath, InputError, not_written
from cosim.fmu.export import deterministic_zip
from cosim.master import Component, System
from cosim.scenario.assembly import assemble
from cosim.scenario.fields import Part
from cosim.scenario.preparation import PreparedScenario
from cosim.scenario.schema import ScenarioPart
from cosim.scenario.ssp.elements import (
    ArchiveElements,
    Resources,
    archive_elements,
    fold_maps,
)
from cosim.scenario.ssp.names import SSD, SspVersion, identifiers, ignored_by_others
from cosim.scenario.ssp.ssp_units import units_of
from cosim.scenario.ssp.structure import Element, Structure, Wire
from cosim.scenario.ssp.write_ssd import ssd_bytes

Links = Literal["annotate", "fmu"]

GIVEN_SIGNALS = ("reference", "inputs")
"""Tables of a scenario that an element plays, and that an annotation keeps."""

_EXPORTED = {
    *("title", "description", "run", "components", "connections", "connect", "links"),
    *(*GIVEN_SIGNALS, "disturbance", "design", "computed", "sensors"),
}


@dataclass(frozen=True)
class SspExport:
    """The archive that was written.

    Attributes
    ----------
    components : names of the elements in the archive, which are identifiers.
    links : by name: "annotation", "FMU", or "wire" for a transport link without delay.
    resources : paths in the archive.
    warnings : sentences about what other tools do differently, or what is left out.
    """

    path: Path
    components: tuple[str, ...]
    connections: int
    links: Mapping[str, str]
    resources: tuple[str, ...]
    step_s: float
    end_s: float
    warnings: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """Return what `cosim ssp export --json` prints."""
        return {
            "ssp": str(self.path),
            "components": list(self.components),
            "connections": self.connections,
            "links": dict(self.links),
            "resources": list(self.resources),
            "step": self.step_s,
            "end": self.end_s,
            "warnings": list(self.warnings),
        }


def export_ssp(
    prepared: PreparedScenario,
    path: AnyPath,
    links: Links = "annotate",
    version: SspVersion = "1.0",
) -> SspExport:
    """Write a scenario as an archive; the same scenario gives the same bytes.

        >>> from pathlib import Path
        >>> from cosim import DelaySystem, Scenario
        >>> from cosim.scenario import FmuCache, export_ssp, prepare
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> archive = export_ssp(prepare(lag.loaded(), FmuCache(Path("fmus"), Path())), "lag.ssp")
        >>> archive.components, archive.step_s, archive.path.name
        (('lag',), 0.1, 'lag.ssp')

    Parameters
    ----------
    prepared : the scenario with its FMUs and its gain.
    links : "annotate": annotations, which other tools ignore; "fmu": FMUs.
    version : of SSP; arrays and the types of FMI 3.0 need 2.0, which fewer tools read.

    Raises
    ------
    InputError : something that SSP cannot express, a file that cannot be written, or a link FMU
        without a compiler.
    """
    path, scenario = Path(path), prepared.loaded.scenario
    if links == "fmu":  # other tools step on a grid: export its points
        run = scenario.run.model_copy(update={"events": "grid"})
        scenario = scenario.model_copy(update={"run": run})
    system = system_of(prepared, scenario)
    resources = Resources()
    tomls = {name: _toml(part) for name, part in scenario.links.items()}
    built = archive_elements(system, resources, links, tomls, version)
    single = {
        name: (one.terms[0][1], one.offset)
        for name, one in prepared.maps.items()
        if len(one.terms) == 1
    }
    fold_maps(built, resources, single)
    warnings = [*built.warnings, *_left_out(prepared, system, version)]
    units = units_of(system, warnings)
    names = identifiers(e.name for e in built.elements)
    structure = Structure(
        version=version,
        name=identifiers([prepared.loaded.name])[prepared.loaded.name],
        description=scenario.title,
        elements=[_with_known_units(replace(e, name=names[e.name]), units) for e in built.elements],
        labels={plain: name for name, plain in names.items() if plain != name},
        wires=[_renamed(wire, names) for wire in built.wires],
        units=units,
        links=built.annotated,
        run=_toml(scenario.run),
        signals=_signals(scenario, built, names),
        rest=tomli_w.dumps(
            {key: x for key, x in scenario.to_data().items() if key in _inexpressible(scenario)}
        ),
        step_s=system.comm_schedule.step_ns / 1e9,
        start_s=system.comm_schedule.at_s(0),
        end_s=system.comm_schedule.at_s(system.comm_schedule.end_ns),
    )
    try:
        content = {SSD: ssd_bytes(structure), **resources.files}
    except InputError:
        raise
    except ValueError as error:  # lxml's, of a text parameter
        raise InputError(
            "a text of this scenario cannot be written to XML",
            where=prepared.loaded.name,
            expected="no control characters",
            got=str(error),
        ) from error
    _write(content, path)
    return SspExport(
        path=path,
        components=tuple(e.name for e in structure.elements),
        connections=len(built.wires),
        links=_link_forms(built),
        resources=tuple(sorted(resources.files)),
        step_s=structure.step_s,
        end_s=structure.end_s,
        warnings=tuple(warnings),
    )


def system_of(prepared: PreparedScenario, scenario: ScenarioPart) -> System:
    """Assemble the system that the master would run, with the designed gain as parameters."""
    worst_case = prepared.worst_case
    made = assemble(scenario, prepared.fmus, parameters=prepared.gain, worst_case=worst_case)
    return made.system


def _toml(part: Part) -> str:
    """Return a table of the scenario with every key that has a value."""
    return tomli_w.dumps(part.model_dump(by_alias=True, exclude_none=True))


def _inexpressible(scenario: ScenarioPart) -> list[str]:
    """Return the parts that SSP cannot express."""
    return sorted(name for name in scenario.model_fields_set - _EXPORTED if getattr(scenario, name))


def _left_out(prepared: PreparedScenario, system: System, version: SspVersion) -> list[str]:
    """Return sentences about what the archive does not contain."""
    scenario = prepared.loaded.scenario
    sentences = list(ignored_by_others(_inexpressible(scenario), ()))
    if scenario.design is not None:
        sentences.append("[design]: its gain is exported as parameters; its proof is left out")
    if system.algorithm != "jacobi":
        sentences.append(
            f"run.algorithm = {system.algorithm!r}: other tools step in their own order"
        )
    for name, component in system.components.items():
        sentences += _left_out_of(name, component, version)
    for policies, what in (
        (("midpoint", "linear"), "hold these inputs over a step"),
        (("previous",), "do not delay these inputs by a step"),
    ):
        inputs = sorted({str(c.target) for c in system.connections if c.policy in policies})
        if inputs:
            sentences.append(f"other tools {what}: {', '.join(inputs)}")
    return sentences


def _left_out_of(name: str, component: Component, version: SspVersion) -> Iterator[str]:
    """Yield sentences about what the archive does not contain of a component."""
    if component.every_ns is not None:
        yield (f"component {name!r}: its own step of {component.every_ns / 1e9:g} s is left out")
    if component.description.version == "3.0" and version == "1.0":
        yield (
            f"component {name!r} is an FMU of FMI {component.description.version}, which "
            "SSP 1.0 does not cover; many tools refuse it"
        )
    if component.description.needs_execution_tool:
        yield f"component {name!r} needs another program, such as a Python host"
    if component.feedthrough is not None:
        yield (
            f"component {name!r}: its feedthrough is left out: other tools read what its FMU "
            "declares"
        )
    if component.isolate:
        yield (
            f"component {name!r}: isolate is left out: each tool has its own way to run an FMU "
            "in another process"
        )


def _signals(
    scenario: ScenarioPart, built: ArchiveElements, names: Mapping[str, str]
) -> tuple[str, str | None]:
    """Return the tables that an import has again, and the element that plays them.

    It cannot have a disturbance again, which is found from the design.
    """
    if scenario.disturbance is not None:
        return "", None
    data = {key: x for key, x in scenario.to_data().items() if key in GIVEN_SIGNALS}
    return tomli_w.dumps(data), names[built.signals] if built.signals is not None else None


def _link_forms(built: ArchiveElements) -> dict[str, str]:
    words = {name: "wire" if name in built.wired else "annotation" for name in built.annotated}
    return words | dict.fromkeys(built.element_of, "FMU")


def _renamed(wire: Wire, names: Mapping[str, str]) -> Wire:
    (source, output), (target, into) = wire.source, wire.target
    return replace(wire, source=(names[source], output), target=(names[target], into))


def _with_known_units(element: Element, units: Collection[str]) -> Element:
    return replace(
        element,
        connectors=[c if c.unit in units else replace(c, unit=None) for c in element.connectors],
        values={
            name: v if v.unit in units else replace(v, unit=None)
            for name, v in element.values.items()
        },
    )


def _write(content: Mapping[str, bytes], path: Path) -> None:
    with not_written("the archive", path):
        deterministic_zip(content, path)
