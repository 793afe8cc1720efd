"""Archives whose FMUs do not declare dependencies, and scenarios with cut loops as archives."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from cli.shell import cosim
from master.scalar import scalar_fmu
from ssp.archives import component, connection, execute_scenario, loaded, ssd, write

from cosim.scenario import FmuCache, export_ssp, import_ssp, load, prepare

EXPERIMENT = '<ssd:DefaultExperiment startTime="0" stopTime="1"/>\n'
LOOP = (("p:y", "q:u"), ("q:y", "p:u"))
ELEMENTS = "".join(component(name, "resources/scalar.fmu", "u", "x y") for name in ("p", "q"))


def archive(folder: Path, *wires: tuple[str, str], declared: bool) -> Path:
    fmu = scalar_fmu(folder, declared=declared)
    connections = "".join(connection(*wire) for wire in wires)
    system = (
        f"<ssd:Elements>{ELEMENTS}</ssd:Elements><ssd:Connections>{connections}</ssd:Connections>"
    )
    entries: dict[str, str | bytes] = {
        "SystemStructure.ssd": ssd(system, EXPERIMENT),
        "resources/scalar.fmu": fmu.read_bytes(),
    }
    return write(folder / "foreign.ssp", entries)


def test_loop_of_undeclared_dependencies_is_cut_on_import(tmp_path: Path) -> None:
    """The key is in the scenario, and its description, the notes and the result say so."""
    path = tmp_path / "s.toml"
    done = import_ssp(archive(tmp_path, *LOOP, declared=False), path, step=0.1)
    assert done.keys_set == {"run.unknown_feedthrough": "previous"}
    assert done.to_json()["keys_set"] == done.keys_set
    note = next(words for words in done.unsupported if "unknown_feedthrough" in words)
    assert "delayed by one step: q.y -> p.u" in note
    data = tomllib.loads(path.read_text("utf-8"))
    assert data["run"]["unknown_feedthrough"] == "previous"
    assert note in data["description"]
    run = execute_scenario(load(str(path)), tmp_path)
    assert np.array_equal(run.signal("p", "u")[1:], run.signal("q", "y")[:-1])
    assert np.array_equal(run.signal("q", "u"), run.signal("p", "y"))


@pytest.mark.parametrize(("declared", "wires"), [(False, LOOP[:1]), (True, LOOP), (True, LOOP[:1])])
def test_no_key_is_set_where_it_is_not_needed_or_does_not_help(
    tmp_path: Path, wires: tuple[tuple[str, str], ...], *, declared: bool
) -> None:
    path = tmp_path / "s.toml"
    done = import_ssp(archive(tmp_path, *wires, declared=declared), path, step=0.1)
    assert done.keys_set == {}
    assert "unknown_feedthrough" not in path.read_text("utf-8")


def test_people_read_of_the_key(tmp_path: Path) -> None:
    archive(tmp_path, *LOOP, declared=False)
    done = cosim("ssp", "import", "foreign.ssp", "-o", "s.toml", "--step", "0.1", cwd=tmp_path)
    assert done.code == 0, done.err
    assert 'run.unknown_feedthrough = "previous" is set' in " ".join(done.err.split())
    ran = cosim("run", "s.toml", "--fmus", tmp_path, "--out", "t.mcap", cwd=tmp_path)
    assert ran.code == 0, ran.err
    assert "q.y -> p.u is delayed by one step (0.1 s)" in ran.out


def test_export_keeps_the_key_and_names_what_it_leaves_out(tmp_path: Path) -> None:
    """There and back: the run is the same; feedthrough and policies are named as left out."""
    scalar_fmu(tmp_path, declared=False).rename(tmp_path / "unknown.fmu")
    text = (
        'title = "Loop"\n[run]\nend = 1.0\nstep = 0.1\nunknown_feedthrough = "previous"\n'
        '[components.p]\nfmu = "unknown.fmu"\nparameters = {x0 = 1.0, e = 0.3}\n'
        '[components.q]\nfmu = "unknown.fmu"\nfeedthrough = ["y"]\n'
        '[[connections]]\nfrom = "p.y"\nto = "q.u"\n'
        '[[connections]]\nfrom = "q.y"\nto = "p.u"\npolicy = "previous"\n'
    )
    scenario = loaded(text, tmp_path)
    done = export_ssp(prepare(scenario, FmuCache(tmp_path, tmp_path)), tmp_path / "out.ssp")
    assert any("'q': its feedthrough is left out" in words for words in done.warnings)
    assert any("do not delay these inputs by a step: p.u" in words for words in done.warnings)
    back = import_ssp(tmp_path / "out.ssp", tmp_path / "back.toml")
    assert back.keys_set == {}
    assert load(str(back.path)).scenario.run.unknown_feedthrough == "previous"
    ours, theirs = (execute_scenario(one, tmp_path) for one in (scenario, load(str(back.path))))
    for name in ("p", "q"):
        assert np.array_equal(ours.signal(name, "y"), theirs.signal(name, "y"))
