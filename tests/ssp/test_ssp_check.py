"""Rules for what other tools refuse: each seen in an archive that has it, none in our own."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest
from shared import sampled
from ssp.archives import LINKED, component, connection, export, ssd, write
from typer.testing import CliRunner

from cosim.cli import app
from cosim.core import InputError
from cosim.scenario import SSP_TOOLS, SspTool, check_ssp

SOURCE = "resources/p.fmu"
OMS = (
    '<ssd:Annotations><ssc:Annotation type="org.openmodelica"><oms:Annotations xmlns:oms="https://'
    'raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd">'
    '<oms:SimulationInformation><oms:FixedStepMaster description="oms-ma" stepSize="0.1"/>'
    "</oms:SimulationInformation></oms:Annotations></ssc:Annotation></ssd:Annotations>"
)
END = '<ssd:DefaultExperiment stopTime="1.0"/>'
UNITS = (
    '<ssd:Units><ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit><ssc:Unit name="km"><ssc:'
    'BaseUnit m="1" factor="1000"/></ssc:Unit><ssc:Unit name="s"><ssc:BaseUnit s="1"/></ssc:Unit>'
    "</ssd:Units>"
)


def typed(name: str, kind: str, of: str, inside: str = "") -> str:
    """A component with one connector `c`."""
    return (
        f'<ssd:Component name="{name}" source="{SOURCE}"><ssd:Connectors><ssd:Connector name="c" '
        f'kind="{kind}"><ssc:{of}/>{inside}</ssd:Connector></ssd:Connectors></ssd:Component>'
    )


def joined(first: str, second: str, inside: str = "") -> str:
    """Two components with their connectors joined."""
    one = typed("a", "output", first)
    two = typed("b", "input", second)
    wire = connection("a:c", "b:c", inside)
    return f"<ssd:Elements>{one}{two}</ssd:Elements><ssd:Connections>{wire}</ssd:Connections>"


def only(element: str) -> str:
    return f"<ssd:Elements>{element}</ssd:Elements>"


NOTE = '<ssd:Annotations><ssc:Annotation type="x"/></ssd:Annotations>'
BOUND = (
    "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet "
    'version="1.0" name="p"><ssv:Parameters><ssv:Parameter name="c"><ssv:String value="x"/>'
    "</ssv:Parameter></ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>"
    '<ssd:ParameterMapping><ssm:ParameterMapping version="1.0"><ssm:MappingEntry source="c" '
    'target="d"><ssc:LinearTransformation factor="2"/></ssm:MappingEntry></ssm:ParameterMapping>'
    "</ssd:ParameterMapping></ssd:ParameterBinding></ssd:ParameterBindings>"
)
LINEAR = '<ssc:LinearTransformation factor="2"/>'

FOUND: dict[str, tuple[str, str, str]] = {
    "hyphen": (only(component("a-b", SOURCE)), "", "name-no-identifier"),
    "top": (only(component("a", SOURCE)), NOTE, "more-at-top"),
    "component": (only(component("a", SOURCE, inside=NOTE)), "", "more-in-component"),
    "geometry": ('<ssd:SystemGeometry x1="0" x2="1" y1="0" y2="1"/>', "", "more-in-system"),
    "dictionary": (
        only('<ssd:SignalDictionaryReference name="d" dictionary="d"/>'),
        "",
        "signal-dictionary",
    ),
    "nested": (only('<ssd:System name="s"/>'), "", "nested-system"),
    "no fmu": (
        only('<ssd:Component name="a" type="application/x-fmu-package" source="x"/>'),
        "",
        "no-fmu",
    ),
    "type": (only(typed("a", "output", "Float64")), "", "connector-type"),
    "array": (only(typed("a", "output", "Real", '<ssc:Dimension size="2"/>')), "", "array"),
    "loose": (
        only(typed("a", "output", "Real"))
        + f"<ssd:Connections>{connection('a:c', 'a:d')}</ssd:Connections>",
        "",
        "loose-connection",
    ),
    "outer": (
        '<ssd:Connectors><ssd:Connector name="o" kind="output"><ssc:Real/></ssd:Connector>'
        "</ssd:Connectors>"
        + only(typed("a", "output", "Real"))
        + f"<ssd:Connections>{connection('a:c', ':o')}</ssd:Connections>",
        "",
        "outer-connection",
    ),
    "types": (joined("Real", "Integer"), "", "types-differ"),
    "units": (joined('Real unit="m"', 'Real unit="s"'), UNITS, "units-differ"),
    "factors": (joined('Real unit="m"', 'Real unit="km"'), UNITS, "unit-conversion"),
    "linear": (joined("Real", "Real", LINEAR), "", "transformed-connection"),
    "mapped": (only(component("a", SOURCE, inside=BOUND)), "", "transformed-parameter"),
    "mapping": (only(component("a", SOURCE, inside=BOUND)), "", "parameter-mapping"),
    "text": (
        only(component("a", SOURCE, inside=BOUND.replace("String", "Enumeration"))),
        "",
        "parameter-type",
    ),
    "bound": (only(component("a", SOURCE, inside=BOUND)), "", "parameters-as-argument"),
    "of system": (BOUND + only(component("a", SOURCE)), "", "system-parameters"),
    "two sets": (
        only(
            component(
                "a",
                SOURCE,
                inside=BOUND.replace("</ssd:ParameterBindings>", "")
                + BOUND.replace("<ssd:ParameterBindings>", ""),
            )
        ),
        "",
        "several-parameter-sets",
    ),
    "free": (only(typed("a", "input", "Real")), "", "input-without-source"),
    "no stop": (only(component("a", SOURCE)), "", "no-stop"),
    "no step": (only(component("a", SOURCE)), "", "no-step"),
}


O, L, E, F = SSP_TOOLS
REFUSED: dict[str, set[str]] = {
    "name-no-identifier": {O},
    "other-prefix": {O, L, E},
    "more-at-top": {O},
    "more-in-component": {O},
    "more-in-system": {O},
    "no-openmodelica-annotation": {O},
    "signal-dictionary": {O, L, E},
    "nested-system": {L, E},
    "no-fmu": {O, L, E, F},
    "no-co-simulation": {O, L, E, F},
    "connector-type": {O, L, F},
    "parameter-type": {L, E},
    "array": {O, L, E, F},
    "loose-connection": {O, L, E, F},
    "outer-connection": {L, E},
    "types-differ": {O, E},
    "units-differ": {O},
    "fmi-version": {O, L, F},
    "input-without-source": {F},
    "ssp-version": {E, F},
    "no-step": {L},
}
"""Rule -> the tools that do not load such an archive."""
DIFFERENT: dict[str, set[str]] = {
    "signal-dictionary": {F},
    "connector-type": {E},
    "parameter-type": {O},
    "unit-conversion": {L, E, F},
    "transformed-connection": {O, F},
    "transformed-parameter": {O},
    "parameter-mapping": {L, E, F},
    "system-parameters": {L, E, F},
    "several-parameter-sets": {L},
    "parameters-as-argument": {F},
    "value-references": {O},
    "no-stop": {O},
}
"""Rule -> the tools that run another system than such an archive describes."""


def effects(code: str) -> set[tuple[str, str]]:
    """What a rule says of which tool."""
    refused = {(tool, "refused") for tool in REFUSED.get(code, ())}
    return refused | {(tool, "different") for tool in DIFFERENT.get(code, ())}


@pytest.mark.parametrize("case", FOUND)
def test_what_a_tool_refuses_is_named(tmp_path: Path, case: str) -> None:
    """The rule, with every tool that it is about and what that does, and where it is broken."""
    system, more, code = FOUND[case]
    end = "" if case == "no stop" else END
    text = ssd(system + OMS, more.replace(NOTE, "") + end + (NOTE if NOTE in more else ""))
    found = check_ssp(write(tmp_path / "a.ssp", {"SystemStructure.ssd": text}))
    assert {(f.tool, f.effect) for f in found.findings if f.code == code} == effects(code)
    assert all(f.where.startswith("SystemStructure.ssd:") and f.cure for f in found.findings)


def test_every_rule_is_seen(native_fmus_of_fmi3: Path, tmp_path: Path) -> None:
    """By the archives above, and by those of FMUs and versions here."""
    with zipfile.ZipFile(native_fmus_of_fmi3 / "WaveField.fmu") as fmu:
        xml = fmu.read("modelDescription.xml").decode()
    zero = xml.replace('valueReference="1"', 'valueReference="0"', 1)
    kinds = {
        "ours": xml,
        "zero": zero,
        "old": '<fmiModelDescription fmiVersion="1.0"/>',
    }
    fmus = {
        f"{name}.fmu": write(tmp_path / f"{name}.fmu", {"modelDescription.xml": text}).read_bytes()
        for name, text in kinds.items()
    }
    listed = "".join(component(name, f"{name}.fmu") for name in kinds)
    text = ssd(only(listed)).replace('version="1.0" name', 'version="2.0" name')
    text = (
        text.replace("ssc:", "c:")
        .replace("xmlns:ssc", "xmlns:c")
        .replace(
            "</ssd:System>",
            '<ssd:Annotations><c:Annotation type="x"/></ssd:Annotations></ssd:System>',
        )
    )
    found = check_ssp(write(tmp_path / "a.ssp", {"SystemStructure.ssd": text, **fmus}))
    here = {(f.tool, f.code, f.got) for f in found.findings}
    assert ("omsimulator", "fmi-version", "Component 'old': FMI 1.0") in here
    assert ("libcosim", "fmi-version", "Component 'ours': FMI 3.0") in here
    references = [got for _, code, got in here if code == "value-references"]
    assert references == ["Component 'zero': value references begin at 0"]
    assert ("ecos", "ssp-version", "version 2.0") in here
    unseen = {*REFUSED, *DIFFERENT} - {code for _, _, code in FOUND.values()}
    assert {code for _, code, _ in here} >= unseen
    assert len(unseen) == 6
    for code in unseen:
        assert {(f.tool, f.effect) for f in found.findings if f.code == code} == effects(code)


@pytest.mark.parametrize("links", sampled(["annotate", "fmu"], 2))
def test_our_archives_are_taken_by_all(native_fmus: Path, tmp_path: Path, links: str) -> None:
    """A hyphen in the name of the scenario and of a link: identifiers in the archive."""
    done = export(LINKED.format(events="grid"), native_fmus, tmp_path, links, name="up-and-down")  # type: ignore[arg-type]
    found = check_ssp(done.path)
    assert {tool: found.takes(tool) for tool in SSP_TOOLS} == dict.fromkeys(SSP_TOOLS, True)
    assert {(f.tool, f.code) for f in found.findings} == {("fmpy", "parameters-as-argument")}


def test_verb_has_codes_of_exit_and_json(tmp_path: Path) -> None:
    text = ssd(only(component("a", SOURCE)), END)
    path = write(tmp_path / "a.ssp", {"SystemStructure.ssd": text})
    run = CliRunner().invoke
    refused = run(app, ["ssp", "check", str(path), "--for", "omsimulator", "--json"])
    assert refused.exit_code == 1
    (finding,) = json.loads(refused.stdout)["findings"]
    assert finding["code"] == "no-openmodelica-annotation"
    tool: SspTool = "fmpy"
    assert run(app, ["ssp", "check", str(path), "--for", tool]).exit_code == 0
    listed = run(app, ["ssp", "check", str(path)])
    assert "ecos takes it" in listed.stdout
    assert "libcosim refuses it" in listed.stdout
    unknown = run(app, ["ssp", "check", str(path), "--for", "simulink"]).exception
    assert isinstance(unknown, InputError)
    assert "there is no tool 'simulink'" in str(unknown)
