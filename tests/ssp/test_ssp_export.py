"""Content of exported archives, refusals and warnings."""

from __future__ import annotations

import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp.ssd import find_components, read_ssd
from lxml import etree
from ssp.archives import LINKED, SSP1, Links, execute_scenario, export, loaded, signals

from cosim.core import InputError
from cosim.fmu.inspect import inspect_fmu
from cosim.scenario import import_ssp, load

OWN = "urn:auv-cosim:ssp:1"
"""Namespace of the annotations of this project (docs/reference/ssp.md)."""
NAMES = ("plant.x[1]", "plant.x[2]", "plant.z[1]", "controller.u[1]")


def description(ssp: Path) -> etree._Element:
    with zipfile.ZipFile(ssp) as packed:
        return etree.fromstring(packed.read("SystemStructure.ssd"))


@pytest.mark.parametrize("links", ["annotate", "fmu"])
def test_archive_is_read_by_fmpy_and_its_schema(
    native_fmus: Path, tmp_path: Path, links: str
) -> None:
    """Elements, connections, parameters and units, as a foreign reader finds them."""
    done = export(LINKED.format(events="align"), native_fmus, tmp_path, links)  # type: ignore[arg-type]
    found = read_ssd(str(done.path))
    assert found.version == "1.0"
    components = {c.name: c for c in find_components(found.system)}
    assert tuple(components) == done.components
    assert len(found.system.connections) == done.connections
    values = {
        p.name: (p.type, p.value, p.unit)
        for p in components["plant"].parameterBindings[0].parameterValues[0].parameters
    }
    assert values["delay.d"] == ("Real", "0.21", "s")
    with zipfile.ZipFile(done.path) as packed:
        assert packed.namelist() == sorted(packed.namelist())
        assert set(done.resources) == set(packed.namelist()) - {"SystemStructure.ssd"}
        assert {i.date_time for i in packed.infolist()} == {(1980, 1, 1, 0, 0, 0)}


@pytest.mark.slow
@pytest.mark.parametrize("links", ["annotate", "fmu"])
def test_same_scenario_gives_the_same_bytes(native_fmus: Path, tmp_path: Path, links: str) -> None:
    found = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        done = export(LINKED.format(events="align"), native_fmus, folder, links)  # type: ignore[arg-type]
        found.append(done.path.read_bytes())
    assert found[0] == found[1]


def test_link_annotation_has_every_parameter(native_fmus: Path, tmp_path: Path) -> None:
    """As TOML, by the keys of a scenario; each connection names its link."""
    done = export(LINKED.format(events="align"), native_fmus, tmp_path)
    assert done.links == {"up-link": "annotation", "downlink": "annotation"}
    assert any("ignore" in w and "up-link" in w and "--links fmu" in w for w in done.warnings)
    root = description(done.path)
    own = {e.get("name"): tomllib.loads(e.text) for e in root.iter(f"{{{OWN}}}link") if e.text}
    assert own["downlink"] == {"kind": "transport", "delay": 0.034}
    assert own["up-link"]["jitter"]["sigma"] == 0.02
    assert own["up-link"]["loss"]["p_exit"] == 0.4
    assert own["up-link"]["data_rate"] == 9600
    assert {"offset", "order", "on_loss", "playout", "frame_size"} <= set(own["up-link"])
    over = [c for c in root.iter(f"{{{SSP1}Description}}Connection") if len(c)]
    assert len(over) == 3


@pytest.mark.parametrize("events", ["align", "grid"])
def test_annotated_links_come_back(native_fmus: Path, tmp_path: Path, events: str) -> None:
    """Exported and imported: the same rows at the same points, bit for bit."""
    text = LINKED.format(events=events)
    done = export(text, native_fmus, tmp_path)
    again = import_ssp(done.path, tmp_path / "again.toml")
    assert set(again.links) == {"up-link", "downlink"}
    assert not again.unsupported
    one, other = (
        execute_scenario(loaded(text, tmp_path), native_fmus),
        execute_scenario(load(str(again.path)), native_fmus),
    )
    assert np.array_equal(one.points_ns, other.points_ns)
    before, after = signals(one, *NAMES), signals(other, *NAMES)
    assert all(np.array_equal(before[name], after[name]) for name in NAMES)
    assert np.abs(before["controller.u[1]"]).max() > 0.1


MEDIUM = """
[medium.bay]
nodes = {{ base = [0], vehicle = ["plant.x[1]"] }}
data_rate = 9600
speed = 100.0
[links.up-link]
kind = "packet"
medium = "bay"
from = "vehicle"
to = "base"
sample_time = 0.03
frame_size = 80
[links.noise]
kind = "packet"
medium = "bay"
from = "base"
to = "vehicle"
sample_time = 0.07
frame_size = 40
[links.downlink]
"""
SHARED = (
    LINKED[: LINKED.index("[links.up-link]")] + MEDIUM + LINKED.partition("[links.downlink]")[2]
)


@pytest.mark.parametrize("links", ["annotate", "fmu"])
def test_links_over_a_medium_come_back_as_annotations_and_are_no_fmus(
    native_fmus: Path, tmp_path: Path, links: Links
) -> None:
    """With the link that is connected to nothing, since it is heard; a warning names each."""
    text = SHARED.format(events="align" if links == "annotate" else "grid")
    done = export(text, native_fmus, tmp_path, links)
    down = "FMU" if links == "fmu" else "annotation"
    assert done.links == {"up-link": "annotation", "noise": "annotation", "downlink": down}
    if links == "fmu":
        warned = {w.split("'")[1]: w for w in done.warnings if "and no FMU" in w}
        assert {*warned} == {"up-link", "noise"}
        assert "shares the medium 'bay'" in warned["up-link"]
        assert "other tools connect directly" in warned["up-link"]
    again = import_ssp(done.path, tmp_path / "again.toml")
    one = execute_scenario(loaded(text, tmp_path), native_fmus)
    other = execute_scenario(load(str(again.path)), native_fmus)
    assert np.array_equal(one.points_ns, other.points_ns)
    before, after = signals(one, *NAMES), signals(other, *NAMES)
    assert all(np.array_equal(before[name], after[name]) for name in NAMES)
    assert one.statistics == other.statistics
    assert one.statistics["up-link"]["receiver_sending"]


def test_link_fmus_come_back_as_links(native_fmus: Path, tmp_path: Path) -> None:
    """On the grid, since that is where the archive's links are."""
    done = export(LINKED.format(events="align"), native_fmus, tmp_path, "fmu")
    assert done.links == {"up-link": "FMU", "downlink": "FMU"}
    again = import_ssp(done.path, tmp_path / "again.toml")
    assert set(again.links) == {"up-link", "downlink"}
    assert set(again.names) == {"plant", "controller", "exosystem"}
    one = execute_scenario(loaded(LINKED.format(events="grid"), tmp_path), native_fmus)
    other = execute_scenario(load(str(again.path)), native_fmus)
    before, after = signals(one, *NAMES), signals(other, *NAMES)
    assert all(np.array_equal(before[name], after[name]) for name in NAMES)


def test_link_fmus_act_as_links_in_the_master(native_fmus: Path, tmp_path: Path) -> None:
    """The archive is run as it is, its link FMUs like any other components."""
    done = export(LINKED.format(events="align"), native_fmus, tmp_path, "fmu")
    plain = tmp_path / "plain.ssp"
    with zipfile.ZipFile(done.path) as old, zipfile.ZipFile(plain, "w") as new:
        for name in old.namelist():
            text = old.read(name)
            new.writestr(name, text.replace(b"auv-cosim.link-fmu", b"other"))
    again = import_ssp(plain, tmp_path / "again.toml")
    assert not again.links
    assert len(again.names) == 5
    one = execute_scenario(loaded(LINKED.format(events="grid"), tmp_path), native_fmus)
    other = execute_scenario(load(str(again.path)), native_fmus)
    before, after = signals(one, *NAMES), signals(other, *NAMES)
    assert all(np.array_equal(before[name], after[name]) for name in NAMES)


@pytest.mark.parametrize("links", ["annotate", "fmu"])
def test_path_and_designed_gain_come_back(native_fmus: Path, tmp_path: Path, links: str) -> None:
    """A reference becomes an exact table, a design its gain."""
    text = load("auv-acoustic").text.replace("end = 180.0", "end = 20.0")
    done = export(text, native_fmus, tmp_path, links)  # type: ignore[arg-type]
    assert "signals" in done.components
    assert any("[design]" in w for w in done.warnings)
    again = import_ssp(done.path, tmp_path / "again.toml")
    grid = text.replace('events = "align"', 'events = "grid"') if links == "fmu" else text
    one, other = (
        execute_scenario(loaded(grid, tmp_path), native_fmus),
        execute_scenario(load(str(again.path)), native_fmus),
    )
    names = ("plant.eta.x", "plant.eta.psi", "plant.nu.r", "controller.force.y")
    before, after = signals(one, *names), signals(other, *names)
    assert np.array_equal(one.points_ns, other.points_ns)
    assert all(np.array_equal(before[name], after[name]) for name in names)


def test_reference_that_stands_still_is_a_start_value(native_fmus: Path, tmp_path: Path) -> None:
    text = (
        'title = "t"\n[run]\nend = 1.0\nstep = 0.1\n[components.controller]\n'
        'fmu = "HinfController"\n[reference]\ntarget = "controller.reference"\n'
        'axes = ["x"]\npoints = [[0.0, 2.5]]\n'
    )
    done = export(text, native_fmus, tmp_path)
    assert done.components == ("controller",)
    again = import_ssp(done.path, tmp_path / "again.toml")
    values = load(str(again.path)).scenario.components["controller"].parameters
    assert values == {"reference.x": 2.5}


def test_transport_link_without_delay_is_a_wire(native_fmus: Path, tmp_path: Path) -> None:
    text = LINKED.format(events="grid").replace("delay = 0.034", "delay = 0.0")
    done = export(text, native_fmus, tmp_path, "fmu")
    assert done.links["downlink"] == "wire"
    assert "downlink" not in done.components
    assert "downlink" in import_ssp(done.path, tmp_path / "again.toml").links


def test_a_link_that_an_assertion_names_comes_back(native_fmus: Path, tmp_path: Path) -> None:
    """Though nothing is connected over it; so does a link whose delay varies."""
    assertion = """
[links.free]
kind = "packet"
sample_time = 0.03
[[assertions]]
name = "young"
always = "free.age < 1 s"
"""
    varying = "delay = { times = [0.0, 2.0], delays = [0.03, 0.05] }"
    text = LINKED.format(events="grid").replace("delay = 0.034", varying) + assertion
    for links, warned in (("annotate", set()), ("fmu", {"free", "downlink"})):
        done = export(text, native_fmus, tmp_path, links)  # type: ignore[arg-type]
        assert {w.split("'")[1] for w in done.warnings if "and no FMU" in w} == warned
        back = load(str(import_ssp(done.path, tmp_path / "again.toml").path))
        assert {*back.scenario.links} == {"up-link", "downlink", "free"}
        execute_scenario(back, native_fmus)


def test_link_too_fast_for_the_step_is_warned_of(native_fmus: Path, tmp_path: Path) -> None:
    text = LINKED.format(events="grid").replace("delay = 0.034", "delay = 0.004")
    done = export(text, native_fmus, tmp_path, "fmu")
    assert any("'downlink'" in w and "0.004" in w for w in done.warnings)


def test_link_fmus_of_the_archive_are_in_order(native_fmus: Path, tmp_path: Path) -> None:
    """The project's own check finds nothing to complain of."""
    done = export(LINKED.format(events="grid"), native_fmus, tmp_path, "fmu")
    with zipfile.ZipFile(done.path) as packed:
        packed.extractall(tmp_path / "out")
    made = [r for r in done.resources if "Link_" in r]
    assert len(made) == 2
    for name in made:
        findings = inspect_fmu(tmp_path / "out" / name).findings
        assert all(each.level == "note" for each in findings), findings


def test_archive_that_cannot_be_written_is_refused(native_fmus: Path, tmp_path: Path) -> None:
    (tmp_path / "test.ssp").mkdir()
    with pytest.raises(InputError, match="the output is a folder"):
        export(LINKED.format(events="grid"), native_fmus, tmp_path)


SIGNALS = """\
title = "Section 5 with signals of its own"

[run]
end = 2.0
step = 0.05

[components.plant]
fmu = "DelayedPlant"

[components.controller]
fmu = "PaperController"

[computed.seen]
first = "2 * plant.x[1] - 1 / (3 + t / 1 s)"

[sensors.gyro]
noise = 0.25
resolution = 0.125

[[connections]]
from = "seen.first"
to = "controller.x[1]"
gain = 0.5
offset = 0.1
link = "up"

[[connections]]
from = "plant.x[2]"
to = "controller.x[2]"
sensor = "gyro"

[[connections]]
from = "controller.u[1]"
to = "plant.u[1]"
gain = -0.75

[links.up]
kind = "packet"
sample_time = 0.1
delay = 0.15
"""


@pytest.mark.parametrize("links", ["annotate", "fmu"])
def test_signals_of_a_scenario_come_back(native_fmus: Path, tmp_path: Path, links: str) -> None:
    """A gain and an offset as a transformation, the others as FMUs: the same rows, bit for bit."""
    done = export(SIGNALS, native_fmus, tmp_path, links)  # type: ignore[arg-type]
    found = [
        (e.get("factor"), e.get("offset"))
        for e in description(done.path).iter(f"{{{SSP1}Common}}LinearTransformation")
    ]
    assert sorted(found) == [("-0.75", "0.0"), ("0.5", "0.1")]
    assert not any("to_" in name for name in done.components)
    again = import_ssp(done.path, tmp_path / "again.toml")
    one = execute_scenario(loaded(SIGNALS, tmp_path), native_fmus)
    other = execute_scenario(load(str(again.path)), native_fmus)
    before, after = signals(one, *NAMES), signals(other, *NAMES)
    assert all(np.array_equal(before[name], after[name]) for name in NAMES)
    assert np.ptp(before["controller.u[1]"]) > 0.1


def test_the_state_of_a_link_that_is_no_fmu_is_refused_with_the_reason(
    native_fmus: Path, tmp_path: Path
) -> None:
    text = (
        'title = "t"\n[run]\nend = 1.0\nstep = 0.1\n[components.controller]\n'
        'fmu = "PaperController"\n[[connections]]\nfrom = "free.age"\nto = "controller.x[1]"\n'
        '[links.free]\nkind = "packet"\nsample_time = 0.03\n'
    )
    with pytest.raises(InputError, match="only if the link is an FMU") as caught:
        export(text, native_fmus, tmp_path, "fmu")
    assert caught.value.got == "link 'free': nothing is connected over it"
