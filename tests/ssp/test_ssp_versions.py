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
    component,
    connection,
    execute_scenario,
    export,
    loaded,
    ssd,
    write,
)

from cosim.core import InputError
from cosim.fmu import CATALOGUE
from cosim.scenario import FmuCache, export_ssp, import_ssp, load, prepare
from cosim.scenario.ssp.archive import Archive
from cosim.scenario.ssp.names import NAMESPACES, SSD, identifiers
from cosim.scenario.ssp.parameters import BoundValue, bound_values, values_for
from cosim.scenario.ssp.units import UnitBase

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


def test_names_become_distinct_identifiers() -> None:
    """Names that are identifiers stay, also where another one would become them."""
    found = identifiers(["a_b", "a-b", "a.b", "1st", "-", "a b"])
    assert found["a_b"] == "a_b"
    assert len(set(found.values())) == len(found)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) for name in found.values())


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
    space = f"{{{NAMESPACES['ssd']}}}"
    components = {c.get("name"): c for c in root.iter(f"{space}Component")}
    for holder in list(root.iter(f"{{{NAMESPACES['ssc']}}}Annotation")):
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


def test_units_are_converted_before_a_mapping_transforms(native_fmus: Path, tmp_path: Path) -> None:
    """SSP 1.0, 5.3.2.1: and not at all if the entry says so."""
    from cosim.fmu import describe_fmu  # noqa: PLC0415

    fmu = describe_fmu(native_fmus / "DelayedPlant.fmu")
    units = {"ms": UnitBase((("s", 1),), 1e-3, 0.0)}
    path = write(tmp_path / "a.ssp", {"SystemStructure.ssd": ssd("")})
    with Archive(path) as archive:

        def value(unit: str | None) -> float:
            bound = BoundValue("delay.d", "Real", ("250",), unit, "here", factor=2.0, offset=1.0)
            found: float = values_for(archive, "p", [bound], fmu, units)["delay.d"]
            return found

        assert value("ms") == 0.25 * 2.0 + 1.0
        assert value(None) == 250.0 * 2.0 + 1.0
        assert value("s") == 501.0


def test_mapping_may_suppress_the_conversion_of_units(tmp_path: Path) -> None:
    """Then the value has no unit any more; the transformation holds all the same."""
    entry = '<ssm:MappingEntry source="late" target="{}" suppressUnitConversion="{}"><ssc:LinearT'
    entry += 'ransformation factor="0.001"/></ssm:MappingEntry>'
    inside = (
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet "
        'version="1.0" name="p"><ssv:Parameters><ssv:Parameter name="late"><ssv:Real value="250" '
        'unit="ms"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>'
        '<ssd:ParameterMapping><ssm:ParameterMapping version="1.0">'
        + entry.format("a", "true")
        + entry.format("b", "false")
        + "</ssm:ParameterMapping></ssd:ParameterMapping></ssd:ParameterBinding>"
        "</ssd:ParameterBindings>"
    )
    path = write(tmp_path / "a.ssp", {"SystemStructure.ssd": ssd(inside, END)})
    with Archive(path) as archive:
        system = archive.xml(SSD, "SystemStructureDescription")[0]
        found = {v.name: (v.unit, v.factor) for v in bound_values(archive, system, SSD)}
    assert found == {"a": (None, 0.001), "b": ("ms", 0.001)}


def test_arrays_and_types_of_fmi_3_need_2_0(tmp_path: Path) -> None:
    """Values of every type come back; SSP 1.0 has no arrays."""
    c_fmu("every_fmi3.c", every(), tmp_path)
    before = loaded(ARRAYS, tmp_path)
    prepared = prepare(before, FmuCache(tmp_path, tmp_path, flavour="native"))
    with pytest.raises(InputError, match=r"SSP 1\.0 has no connectors(.*\n)*.*--ssp 2\.0"):
        export_ssp(prepared, tmp_path / "a.ssp")
    export_ssp(prepared, tmp_path / "a.ssp", version="2.0")
    again = import_ssp(tmp_path / "a.ssp", tmp_path / "again.toml")
    values = load(str(again.path)).scenario.components["every"].parameters
    assert values == before.scenario.components["every"].parameters


def test_catalogue_has_no_identifier_to_change() -> None:
    """Names of built-in models are file names in archives as they are."""
    assert identifiers(CATALOGUE) == {name: name for name in CATALOGUE}
