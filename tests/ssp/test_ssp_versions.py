"""SSP 2.0, signal dictionaries, arrays, and archives of before."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from foreign.c_fmu import c_fmu, every
from lxml import etree
from ssp.archives import (
    LINKED,
    SSP1,
    component,
    connection,
    execute_scenario,
    export,
    loaded,
    ssd,
    write,
)

from cosim.core import InputError
from cosim.fmu.export import CATALOGUE
from cosim.scenario import FmuCache, export_ssp, import_ssp, load, prepare

END = '<ssd:DefaultExperiment stopTime="1.5"/>'
ASSERTION = """
[[assertions]]
name = "a"
always = "plant.x[1] < 99"
"""
ARRAYS = """
title = "arrays"
[run]
end = 1.0
step = 0.1
[components.every]
fmu = "every_fmi3.fmu"
[components.every.parameters]
n = 1
"Float64.row" = [[1.5, 2.0, 3.0]]
"Float32.row" = [0.5, 0.25]
"UInt64.row" = [1, 18446744073709551615]
"Int8.in" = -128
"Boolean.row" = [true, false]
"String.row" = ["a b", ""]
"""


IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
THREE = """
title = "three that are alike"
[run]
end = 1.0
step = 0.1
[components.a-b]
fmu = "WaveField"
[components.a--b]
fmu = "WaveField"
[components.a_b]
fmu = "WaveField"
"""


@pytest.mark.parametrize("name", ["1st", "-", "a b", "a.b", "a_b"])
def test_names_become_distinct_identifiers(native_fmus: Path, tmp_path: Path, name: str) -> None:
    """Names that are identifiers stay, also where another one would become them."""
    done = export(THREE, native_fmus, tmp_path, name=name)
    with zipfile.ZipFile(done.path) as packed:
        root = etree.fromstring(packed.read("SystemStructure.ssd"))
    assert "a_b" in done.components
    assert len(set(done.components)) == 3
    assert all(IDENTIFIER.fullmatch(one) for one in (*done.components, root.get("name")))
    assert (root.get("name") == name) == (name == "a_b")
    again = import_ssp(done.path, tmp_path / "again.toml")
    assert set(again.names) == set(done.components)
    assert again.names["a_b"] == "a_b"
    assert set(again.names.values()) == {"a-b", "a--b", "a_b"}


def test_archive_of_2_0_comes_back(native_fmus: Path, tmp_path: Path) -> None:
    """Valid by the schema of 2.0 (checked as it is written), names with hyphens restored."""
    text = LINKED.format(events="grid").replace("plant", "the-plant")
    prepared = prepare(
        loaded(text, tmp_path), FmuCache(native_fmus.parent, tmp_path, flavour="native")
    )
    done = export_ssp(prepared, tmp_path / "t.ssp", "fmu", "2.0")
    assert "the_plant" in done.components
    with zipfile.ZipFile(done.path) as packed:
        xml = packed.read("SystemStructure.ssd")
    versions = {e.get("version") for e in etree.fromstring(xml).iter() if e.get("version")}
    assert versions == {"2.0"}
    again = import_ssp(done.path, tmp_path / "again.toml")
    assert not again.unsupported
    assert set(again.names.values()) == {"the-plant", "controller", "exosystem"}
    assert set(again.links) == {"up-link", "downlink"}
    one = execute_scenario(loaded(text, tmp_path), native_fmus)
    other = execute_scenario(load(str(again.path)), native_fmus)
    assert np.array_equal(one.signal("the-plant", "x[1]"), other.signal("the-plant", "x[1]"))


def test_archive_of_before_comes_back(native_fmus: Path, tmp_path: Path) -> None:
    """Annotations of the components and of the whole description, names with hyphens."""
    text = LINKED.format(events="grid") + ASSERTION
    done = export(text, native_fmus, tmp_path, "fmu")
    with zipfile.ZipFile(done.path) as packed:
        entries = {name: packed.read(name) for name in packed.namelist()}
    root = etree.fromstring(entries["SystemStructure.ssd"])
    space = f"{{{SSP1}Description}}"
    components = {c.get("name"): c for c in root.iter(f"{space}Component")}
    for holder in list(root.iter(f"{{{SSP1}Common}}Annotation")):
        kind, parent = holder.get("type"), None
        if kind == "auv-cosim.link-fmu":
            parent = components[holder[0].attrib.pop("element")]
        elif kind == "auv-cosim.scenario":
            parent = root
        elif kind == "auv-cosim.names":
            holder.getparent().remove(holder)
        if parent is not None:
            etree.SubElement(parent, f"{space}Annotations").append(holder)
    entries["SystemStructure.ssd"] = etree.tostring(root).replace(b'"up_link"', b'"up-link"')
    again = import_ssp(write(tmp_path / "old.ssp", entries), tmp_path / "old.toml")
    assert set(again.links) == {"up-link", "downlink"}
    assert not again.unsupported
    assert load(str(again.path)).scenario.assertions


def test_signal_dictionary_passes_signals_on(native_fmus: Path, tmp_path: Path) -> None:
    """Between systems: two references to one dictionary have the same signals."""
    reference = '<ssd:SignalDictionaryReference name="{}" dictionary="bus"/>'
    inner = (
        '<ssd:System name="s"><ssd:Elements>'
        + component("q", "resources/PaperController.fmu", "x[1] x[2]", "u[1]")
        + reference.format("there")
        + "</ssd:Elements><ssd:Connections>"
        + "".join(connection(f"there:x{i}", f"q:x[{i}]") for i in (1, 2))
        + connection("q:u[1]", "there:u")
        + "</ssd:Connections></ssd:System>"
    )
    system = (
        "<ssd:Elements>"
        + component("p", "resources/DelayedPlant.fmu", "u[1]", "x[1] x[2]")
        + inner
        + reference.format("here")
        + "</ssd:Elements><ssd:Connections>"
        + "".join(connection(f"p:x[{i}]", f"here:x{i}") for i in (1, 2))
        + connection("here:u", "p:u[1]")
        + '</ssd:Connections><ssd:SignalDictionaries><ssd:SignalDictionary name="bus"/>'
        + "</ssd:SignalDictionaries>"
    )
    fmus = {
        f"resources/{name}.fmu": (native_fmus / f"{name}.fmu").read_bytes()
        for name in ("DelayedPlant", "PaperController")
    }
    path = write(tmp_path / "bus.ssp", {"SystemStructure.ssd": ssd(system, END), **fmus})
    again = import_ssp(path, tmp_path / "bus.toml", step=0.01)
    rows = {(c.source, c.target) for c in load(str(again.path)).scenario.connections}
    assert rows == {
        ("p.x[1]", "s_q.x[1]"),
        ("p.x[2]", "s_q.x[2]"),
        ("s_q.u[1]", "p.u[1]"),
    }


UNITS = (
    '<ssd:Units><ssc:Unit name="ms"><ssc:BaseUnit s="1" factor="0.001"/></ssc:Unit></ssd:Units>\n'
)


def delays(fmus: Path, folder: Path, unit: str, *entries: str) -> list[float]:
    """The delays of two plants, from 250 of a unit by the entries of a mapping."""
    bound = (
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet "
        'version="1.0" name="p"><ssv:Parameters><ssv:Parameter name="late"><ssv:Real value="250" '
        f"{unit}/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>"
        '<ssd:ParameterMapping><ssm:ParameterMapping version="1.0">'
        + "".join(entries)
        + "</ssm:ParameterMapping></ssd:ParameterMapping></ssd:ParameterBinding>"
        "</ssd:ParameterBindings>"
    )
    plants = "".join(component(name, "resources/DelayedPlant.fmu") for name in ("p", "q"))
    system = ssd(f"{bound}<ssd:Elements>{plants}</ssd:Elements>", UNITS + END)
    fmu = (fmus / "DelayedPlant.fmu").read_bytes()
    content = {"SystemStructure.ssd": system, "resources/DelayedPlant.fmu": fmu}
    again = import_ssp(write(folder / "a.ssp", content), folder / "a.toml", step=0.01)
    parts = load(str(again.path)).scenario.components
    return [float(parts[name].parameters["delay.d"]) for name in ("p", "q")]


def entry(of: str, factor: float, offset: float = 0.0, more: str = "") -> str:
    """An entry of a mapping for the delay of a plant."""
    return (
        f'<ssm:MappingEntry source="late" target="{of}.delay.d" {more}><ssc:LinearTransformation '
        f'factor="{factor}" offset="{offset}"/></ssm:MappingEntry>'
    )


@pytest.mark.parametrize(
    ("unit", "delay_s"),
    [('unit="ms"', 0.25 * 2.0 + 1.0), ("", 250.0 * 2.0 + 1.0), ('unit="s"', 501.0)],
)
def test_units_are_converted_before_a_mapping_transforms(
    native_fmus: Path, tmp_path: Path, unit: str, delay_s: float
) -> None:
    """SSP 1.0, 5.3.2.1; units that the archive does not define are those of the FMU."""
    found = delays(native_fmus, tmp_path, unit, entry("p", 2.0, 1.0), entry("q", 0.001))
    assert found[0] == delay_s


def test_mapping_may_suppress_the_conversion_of_units(native_fmus: Path, tmp_path: Path) -> None:
    """Then the value has no unit any more; the transformation holds all the same."""
    suppressed = (f'suppressUnitConversion="{word}"' for word in ("true", "false"))
    entries = [entry(of, 0.001, more=more) for of, more in zip(("p", "q"), suppressed, strict=True)]
    found = delays(native_fmus, tmp_path, 'unit="ms"', *entries)
    assert found == [250.0 * 0.001, 0.25 * 0.001]


def test_arrays_and_types_of_fmi_3_need_2_0(tmp_path: Path) -> None:
    """Values of every type come back; SSP 1.0 has no arrays."""
    c_fmu("every_fmi3.c", every(), tmp_path)
    before = loaded(ARRAYS, tmp_path)
    prepared = prepare(before, FmuCache(tmp_path, tmp_path, flavour="native"))
    with pytest.raises(InputError, match=r"SSP 1\.0 has no connectors(.*\n)*.*`ssp` 2\.0"):
        export_ssp(prepared, tmp_path / "a.ssp")
    export_ssp(prepared, tmp_path / "a.ssp", version="2.0")
    again = import_ssp(tmp_path / "a.ssp", tmp_path / "again.toml")
    values = load(str(again.path)).scenario.components["every"].parameters
    assert values == before.scenario.components["every"].parameters


def test_catalogue_has_no_identifier_to_change(native_fmus: Path, tmp_path: Path) -> None:
    """Names of built-in models are file names in archives as they are."""
    assert [name for name in CATALOGUE if not IDENTIFIER.fullmatch(name)] == []
    assert export(THREE, native_fmus, tmp_path).resources == ("resources/WaveField.fmu",)
