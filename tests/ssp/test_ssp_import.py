"""Archives of other tools: nested systems, parameters in files, mappings, units."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from ssp.archives import component, connection, execute_scenario, loaded, signals, ssd, write

from cosim.core import InputError
from cosim.scenario import import_ssp, load

EXPERIMENT = '<ssd:DefaultExperiment startTime="0" stopTime="1.5"/>\n'
UNITS = (
    '<ssd:Units><ssc:Unit name="ms"><ssc:BaseUnit s="1" factor="0.001"/></ssc:Unit>'
    '<ssc:Unit name="kg"><ssc:BaseUnit kg="1"/></ssc:Unit></ssd:Units>\n'
)
OURS = """
title = "Section 5"
[run]
end = 1.5
step = 0.01
[components.plant]
fmu = "DelayedPlant"
[components.plant.parameters]
"delay.d" = 0.25
"initial.x[1]" = 4.0
"F.amplitude" = 0.25
[components.pilot]
fmu = "PaperController"
[components.pilot.parameters]
"K[1,1]" = 0.5
[[connections]]
from = "plant.x"
to = "pilot.x"
[[connections]]
from = "pilot.u"
to = "plant.u"
"""


def values(*rows: str, name: str = "set") -> str:
    listed = "".join(rows)
    return (
        f'<ssv:ParameterSet version="1.0" name="{name}"><ssv:Parameters>{listed}'
        "</ssv:Parameters></ssv:ParameterSet>"
    )


def real(name: str, value: float, unit: str | None = None) -> str:
    more = "" if unit is None else f' unit="{unit}"'
    return f'<ssv:Parameter name="{name}"><ssv:Real value="{value}"{more}/></ssv:Parameter>'


def bound(inside: str, more: str = "", mapping: str = "") -> str:
    kept = f"<ssd:ParameterValues>{inside}</ssd:ParameterValues>" if inside else ""
    return (
        f"<ssd:ParameterBindings><ssd:ParameterBinding {more}>{kept}{mapping}"
        "</ssd:ParameterBinding></ssd:ParameterBindings>"
    )


def standalone(xml: str, space: str) -> str:
    """An .ssv or .ssm of its own: namespaces declared."""
    names = "".join(
        f' xmlns:{p}="http://ssp-standard.org/SSP1/SystemStructure{n}"'
        for p, n in (("ssc", "Common"), ("ssv", "ParameterValues"), ("ssm", "ParameterMapping"))
    )
    return xml.replace(f"<{space}", f"<{space}{names}", 1)


def nested(plant: str = "", pilot: str = "", outer: str = "") -> str:
    """Plant and pilot in a system each, connected through the systems' own connectors."""
    inner = (
        '<ssd:System name="{0}"><ssd:Connectors>{1}</ssd:Connectors>{4}'
        "<ssd:Elements>{2}</ssd:Elements><ssd:Connections>{3}</ssd:Connections></ssd:System>\n"
    )
    port = '<ssd:Connector name="{}" kind="{}"><ssc:Real/></ssd:Connector>'
    vessel = inner.format(
        "vessel",
        port.format("thrust", "input") + port.format("a", "output") + port.format("b", "output"),
        component("plant", "resources/DelayedPlant.fmu", "u[1]", "x[1] x[2]", plant),
        connection(":thrust", "plant:u[1]")
        + connection("plant:x[1]", ":a")
        + connection("plant:x[2]", ":b"),
        outer,
    )
    bridge = inner.format(
        "bridge",
        port.format("c", "input") + port.format("d", "input") + port.format("out", "output"),
        component("the pilot", "resources/PaperController.fmu", "x[1] x[2]", "u[1]", pilot),
        connection(":c", "the pilot:x[1]")
        + connection(":d", "the pilot:x[2]")
        + connection("the pilot:u[1]", ":out"),
        "",
    )
    wires = (
        connection("vessel:a", "bridge:c")
        + connection("vessel:b", "bridge:d")
        + connection("bridge:out", "vessel:thrust")
    )
    return (
        f"<ssd:Elements>{vessel}{bridge}</ssd:Elements><ssd:Connections>{wires}</ssd:Connections>"
    )


def archive(folder: Path, fmus: Path, system: str, more: str = EXPERIMENT, **files: str) -> Path:
    entries: dict[str, str | bytes] = {"SystemStructure.ssd": ssd(system, more)}
    for name in ("DelayedPlant", "PaperController", "AuvPlant", "HinfController"):
        entries[f"resources/{name}.fmu"] = (fmus / f"{name}.fmu").read_bytes()
    named = {name.replace("__", "/").replace("_dot_", "."): t for name, t in files.items()}
    return write(folder / "foreign.ssp", entries | named)


@pytest.fixture(scope="module")
def expected(native_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    run = execute_scenario(loaded(OURS, tmp_path_factory.mktemp("ours")), native_fmus)
    return run.signal("plant", "x[1]")


def test_nested_systems_with_files_and_mappings_run_as_one(
    native_fmus: Path, tmp_path: Path, expected: np.ndarray
) -> None:
    """Inline values, an .ssv renamed and scaled by an .ssm, and a value bound further out."""
    plant = bound(values(real("delay.d", 250.0, "ms"), real("F.amplitude", 7.0)))
    mapping = '<ssd:ParameterMapping source="resources/names.ssm"/>'
    pilot = bound("", 'source="resources/gain%20one.ssv"', mapping)
    outer = bound(values(real("F.amplitude", 0.25), real("initial.x[1]", 4.0)), 'prefix="plant."')
    ssm = (
        '<ssm:ParameterMapping version="1.0"><ssm:MappingEntry source="half gain" target="K[1,1]">'
        '<ssc:LinearTransformation factor="2" offset="0.1"/></ssm:MappingEntry>'
        "</ssm:ParameterMapping>"
    )
    ssp = archive(
        tmp_path,
        native_fmus,
        nested(plant, pilot, outer),
        UNITS + EXPERIMENT,
        **{
            "resources/gain one.ssv": standalone(
                values(real("half gain", 0.2), real("unused", 3.0)), "ssv:ParameterSet"
            ),
            "resources/names.ssm": standalone(ssm, "ssm:ParameterMapping"),
        },
    )
    done = import_ssp(ssp, tmp_path / "theirs.toml", step=0.01)
    assert done.names == {"vessel.plant": "vessel_plant", "bridge.the pilot": "bridge_the_pilot"}
    assert done.connections == 3
    assert not done.unsupported
    scenario = load(str(done.path))
    assert scenario.scenario.components["vessel_plant"].parameters == {
        "delay.d": 0.25,
        "F.amplitude": 0.25,
        "initial.x[1]": 4.0,
    }
    assert scenario.scenario.components["bridge_the_pilot"].parameters == {"K[1,1]": 0.5}
    run = execute_scenario(scenario, native_fmus)
    found = signals(run, "vessel_plant.x[1]")["vessel_plant.x[1]"]
    assert np.array_equal(found, expected)


def test_step_and_end_are_found_or_asked_for(native_fmus: Path, tmp_path: Path) -> None:
    """SSP does not say a step: the FMUs' own, a tool's annotation, or an option."""
    done = import_ssp(archive(tmp_path, native_fmus, nested()), tmp_path / "t.toml")
    assert (done.step_s, done.end_s) == (0.01, 1.5)
    assert any("step" in note for note in done.unsupported)
    later = (
        '<ssd:DefaultExperiment startTime="0.5" stopTime="1.5"><ssd:Annotations>'
        '<ssc:Annotation type="com.opensimulationplatform"><osp:Algorithm xmlns:osp='
        '"http://opensimulationplatform.com/SSP/OSPAnnotations">'
        '<osp:FixedStepAlgorithm baseStepSize="0.02"/></osp:Algorithm></ssc:Annotation>'
        "</ssd:Annotations></ssd:DefaultExperiment>"
    )
    done = import_ssp(archive(tmp_path, native_fmus, nested(), later), tmp_path / "t.toml")
    assert (done.step_s, done.end_s) == (0.02, 1.5)
    assert load(str(tmp_path / "t.toml")).scenario.run.start == 0.5
    done = import_ssp(
        archive(tmp_path, native_fmus, nested(), ""), tmp_path / "t.toml", step=0.005, end=2.0
    )
    assert (done.step_s, done.end_s) == (0.005, 2.0)


TWO = "<ssd:Elements>{}{}</ssd:Elements><ssd:Connections>{}</ssd:Connections>"
PLANT = component("p", "resources/DelayedPlant.fmu", "u[1] w[1]", "x[1] x[2]")
PILOT = component("q", "resources/PaperController.fmu", "x[1] x[2]", "u[1]")
VESSEL = component("v", "resources/AuvPlant.fmu", "force.x", "eta.x")

PACKAGE = PILOT.replace("source=", 'type="application/x-ssp-package" source=')

BAD = {
    "no element": (TWO.format(PLANT, PILOT, connection("p:x[1]", "r:x[1]")), "unknown element"),
    "no input": (TWO.format(PLANT, PILOT, connection("p:x[1]", "q:x[7]")), "no input 'x\\[7\\]'"),
    "no output": (TWO.format(PLANT, PILOT, connection("p:y", "q:x[1]")), "no output 'y'"),
    "two sources": (
        TWO.format(PLANT, PILOT, connection("p:x[1]", "q:x[1]") + connection("p:x[2]", "q:x[1]")),
        "two sources",
    ),
    "transformed": (
        TWO.format(
            PLANT,
            PILOT,
            connection("p:x[1]", "q:x[1]", "<ssc:BooleanMappingTransformation/>"),
        ),
        "transforms its values",
    ),
    "no variable": (
        TWO.format(
            component(
                "p", "resources/DelayedPlant.fmu", "", "x[1]", bound(values(real("dely.d", 1)))
            ),
            "",
            "",
        ).replace("<ssd:Connections></ssd:Connections>", ""),
        "did you mean delay.d",
    ),
    "wrong type": (
        "<ssd:Elements>"
        + component(
            "p",
            "resources/DelayedPlant.fmu",
            "",
            "x[1]",
            bound(
                values('<ssv:Parameter name="delay.d"><ssv:String value="long"/></ssv:Parameter>')
            ),
        )
        + "</ssd:Elements>",
        "wrong type",
    ),
    "wrong unit": (
        "<ssd:Elements>"
        + component(
            "p",
            "resources/DelayedPlant.fmu",
            "",
            "x[1]",
            bound(values(real("delay.d", 1.0, "kg"))),
        )
        + "</ssd:Elements>",
        "measure different things",
    ),
    "no file": (
        "<ssd:Elements>"
        + component("p", "resources/DelayedPlant.fmu", "", "x[1]", bound("", 'source="a.ssv"'))
        + "</ssd:Elements>",
        "there is no such entry",
    ),
    "no fmu": ("<ssd:Elements>" + component("p", "resources/No.fmu") + "</ssd:Elements>", "No.fmu"),
    "circle": (
        '<ssd:Elements><ssd:System name="s"><ssd:Connectors>'
        '<ssd:Connector name="i" kind="input"/><ssd:Connector name="o" kind="output"/>'
        f"</ssd:Connectors><ssd:Elements>{PILOT}</ssd:Elements><ssd:Connections>"
        + connection(":i", ":o")
        + connection(":i", "q:x[1]")
        + "</ssd:Connections></ssd:System></ssd:Elements><ssd:Connections>"
        + connection("s:o", "s:i")
        + "</ssd:Connections>",
        "in a circle",
    ),
    "two names": (TWO.format(PLANT, PLANT, connection("p:x[1]", "p:u[1]")), "one name"),
    "no components": ("", "without components"),
    "no source": ('<ssd:Elements><ssd:Component name="p"/></ssd:Elements>', "no source"),
    "no number": (
        "<ssd:Elements>"
        + component(
            "p",
            "resources/DelayedPlant.fmu",
            "",
            "x[1]",
            bound(values(real("delay.d", float("nan")))),
        )
        + "</ssd:Elements>",
        "finite number",
    ),
    "another kind": (
        f"<ssd:Elements>{PACKAGE}</ssd:Elements>",
        "not an FMU is not supported",
    ),
    "dictionary": (
        '<ssd:Elements><ssd:SignalDictionaryReference name="a" dictionary="d"/></ssd:Elements>',
        "unknown signal dictionary",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_archive_that_cannot_be_run_is_refused(
    native_fmus: Path, tmp_path: Path, case: str
) -> None:
    """One precise message each; no scenario is left behind."""
    system, message = BAD[case]
    system = system.replace("<ssd:Connections></ssd:Connections>", "")
    ssp = archive(tmp_path, native_fmus, system, UNITS + EXPERIMENT)
    with pytest.raises(InputError, match=message) as caught:
        import_ssp(ssp, tmp_path / "theirs.toml")
    assert "foreign.ssp" in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["foreign.ssp"]


ESCAPES = ("../outside.fmu", "/etc/passwd", "resources/../../x.fmu", "file:///etc/passwd",
           "http://localhost/x.fmu", "..\\x.fmu", "resources/%2e%2e/%2e%2e/x.fmu")  # fmt: skip


@pytest.mark.parametrize("source", ESCAPES)
def test_nothing_outside_of_the_archive_is_touched(
    native_fmus: Path, tmp_path: Path, source: str
) -> None:
    """Sources that lead out are refused, and so is an archive with an entry that does."""
    system = f"<ssd:Elements>{component('p', source)}</ssd:Elements>"
    ssp = archive(tmp_path, native_fmus, system)
    folder = tmp_path / "in"
    folder.mkdir()
    with pytest.raises(InputError, match=r"outside the archive|no such entry"):
        import_ssp(ssp, folder / "theirs.toml")
    with zipfile.ZipFile(ssp, "a") as packed:
        packed.writestr("../outside.fmu", b"x")
    with pytest.raises(InputError, match=r"\.\./outside\.fmu: this archive is not unpacked"):
        import_ssp(ssp, folder / "theirs.toml")
    assert not (tmp_path / "outside.fmu").exists()
    assert list(folder.iterdir()) == []


HOSTILE = {
    "empty": b"",
    "text": b"not a zip at all",
    "cut": b"PK\x03\x04" + bytes(40),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_no_zip_is_no_archive(tmp_path: Path, case: str) -> None:
    (tmp_path / "x.ssp").write_bytes(HOSTILE[case])
    with pytest.raises(InputError, match="not an SSP archive"):
        import_ssp(tmp_path / "x.ssp", tmp_path / "x.toml")


def test_missing_archive_or_description_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        import_ssp(tmp_path / "none.ssp", tmp_path / "x.toml")
    ssp = write(tmp_path / "x.ssp", {"a.txt": "a"})
    with pytest.raises(InputError, match=r"there is no SystemStructure\.ssd"):
        import_ssp(ssp, tmp_path / "x.toml")


def test_xml_with_entities_or_without_end_is_refused(tmp_path: Path) -> None:
    """Neither expanded nor followed."""
    bomb = ssd("&b;").replace(
        "<ssd:SystemStructureDescription",
        '<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]>\n<ssd:SystemStructureDescription',
        1,
    )
    for text, message in (
        (bomb, "document type"),
        ("<a><b></a>", "not XML"),
        ("<a/>", "not a file of SSP"),
    ):
        ssp = write(tmp_path / "x.ssp", {"SystemStructure.ssd": text})
        with pytest.raises(InputError, match=message):
            import_ssp(ssp, tmp_path / "x.toml")


def test_compression_bombs_are_not_unpacked(tmp_path: Path) -> None:
    """A description of a hundred megabytes of blanks, in a hundred kilobytes."""
    ssp = write(tmp_path / "x.ssp", {"SystemStructure.ssd": b" " * (100 * 2**20)})
    assert ssp.stat().st_size < 2**18
    with pytest.raises(InputError, match="this archive is not unpacked"):
        import_ssp(ssp, tmp_path / "x.toml")


def test_fmu_that_is_none_is_refused(tmp_path: Path) -> None:
    text = ssd(f"<ssd:Elements>{component('p', 'resources/p.fmu')}</ssd:Elements>", EXPERIMENT)
    ssp = write(tmp_path / "x.ssp", {"SystemStructure.ssd": text, "resources/p.fmu": b"PK"})
    with pytest.raises(InputError, match=r"x\.ssp: resources/p\.fmu: not a valid FMU"):
        import_ssp(ssp, tmp_path / "x.toml")


def test_entry_that_is_damaged_is_named(native_fmus: Path, tmp_path: Path) -> None:
    ssp = archive(tmp_path, native_fmus, f"<ssd:Elements>{PLANT}</ssd:Elements>")
    data = bytearray(ssp.read_bytes())
    place = data.index(b"resources/DelayedPlant.fmu") + 2000
    data[place : place + 50] = bytes(50)
    ssp.write_bytes(data)
    with pytest.raises(InputError, match="cannot be read"):
        import_ssp(ssp, tmp_path / "x.toml")


def test_connection_from_nowhere_keeps_the_start_value(native_fmus: Path, tmp_path: Path) -> None:
    """An input of the outermost system has no source here, which is named."""
    system = (
        '<ssd:Connectors><ssd:Connector name="wind" kind="input"/></ssd:Connectors>'
        f"<ssd:Elements>{PLANT}</ssd:Elements><ssd:Connections>"
        + connection(":wind", "p:w[1]")
        + "</ssd:Connections>"
    )
    done = import_ssp(archive(tmp_path, native_fmus, system), tmp_path / "t.toml", step=0.01)
    assert done.connections == 0
    assert any("p.w[1]" in note for note in done.unsupported)


def test_archive_that_the_schema_does_not_allow_is_read_with_a_note(
    native_fmus: Path, tmp_path: Path
) -> None:
    """Some tools write empty lists, and annotations first."""
    system = (
        "<ssd:Annotations><ssc:Annotation type='a'/></ssd:Annotations><ssd:Connectors/>"
        f"<ssd:Elements>{PLANT}</ssd:Elements><ssd:Connections/>"
    )
    done = import_ssp(archive(tmp_path, native_fmus, system), tmp_path / "t.toml", step=0.01)
    assert done.names == {"p": "p"}
    assert any(
        "schema of SSP 1.0" in note and "SystemStructure.ssd:" in note for note in done.unsupported
    )
