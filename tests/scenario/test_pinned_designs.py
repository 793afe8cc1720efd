"""Gains are designed once: named by [design] file, or kept beside the scenario by a run."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from cli.shell import cosim
from shared import sampled, spread

from cosim import hinf
from cosim.core import InputError
from cosim.fmu.export import CATALOGUE
from cosim.hinf import Result, check_certificate, system_by_name
from cosim.hinf.certificate import certificate_bytes
from cosim.scenario import (
    FmuCache,
    PreparedScenario,
    builtin_names,
    execute_unrecorded,
    load,
    open_session,
    prepare,
    run,
)
from cosim.study import Study, builtin_studies, load_study, plan_of

DESIGNS = Path(str(files("cosim.scenario").joinpath("library", "designs")))
MINE = """\
title = "Section 5 with a system and a gain of its own"
connect = ["plant.x -> controller.x", "controller.u -> plant.u"]

[run]
end = 1.0
step = 0.1

[components.plant]
fmu = "DelayedPlant"

[components.controller]
fmu = "PaperController"

[design]
system = "paper"
"""


def shipped(name: str) -> Any:
    """A design that comes with the package, as JSON values."""
    return json.loads((DESIGNS / f"{name}.json").read_bytes())


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A scenario of a user, whose design has to be made."""
    path = tmp_path / "mine.toml"
    path.write_text(MINE, "utf-8")
    return path


@pytest.fixture
def no_solver() -> Iterator[None]:
    """Neither a conic solver nor a singular value decomposition answers."""

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("a run whose design exists asked a solver")

    with (
        patch("clarabel.DefaultSolver", refuse),
        patch("cosim.hinf.design", refuse),
        patch("numpy.linalg.svd", refuse),
    ):
        yield


def prepared(path: str | Path, fmus: Path, *settings: str) -> PreparedScenario:
    """A prepared scenario with native FMUs."""
    loaded = load(str(path), settings)
    return prepare(loaded, FmuCache(fmus.parent, loaded.folder, flavour="native"))


def ran(path: Path, fmus: Path, *more: str) -> Any:
    """JSON of `cosim run`."""
    result = cosim(
        *("run", path, "--json", "--flavour", "native", "--fmus", fmus.parent, *more),
        cwd=path.parent,
    )
    assert result.code == 0, result.err
    return result.json


# what comes with the package


@pytest.mark.parametrize(
    "path", sampled(spread(sorted(DESIGNS.iterdir()), 3), 4), ids=lambda path: path.stem
)
def test_a_shipped_design_is_proved_and_holds_what_is_printed(path: Path) -> None:
    """Exactly, from the file alone, with its figures and a worst case of six digits."""
    data = json.loads(path.read_bytes())
    assert check_certificate(data).valid
    found = Result.from_json(data, where=path.name)
    assert found.exact_norm is not None
    assert found.worst_case is not None
    numbers = (found.worst_case.gain, found.worst_case.omega)
    assert all(value == float(f"{value:.5e}") for value in numbers)
    assert found.worst_case.gain == pytest.approx(found.exact_norm, rel=1e-5)


WITHOUT = {"shared-channel", "slots-against-random-access"}
"""Scenarios about channels, with several vehicles or none that is controlled: no design of one."""


@pytest.mark.parametrize("name", sorted({*builtin_names()} - WITHOUT))
@pytest.mark.usefixtures("no_solver")
def test_every_built_in_scenario_names_its_design(name: str, native_fmus: Path) -> None:
    """The system of the design is the one that the scenario describes."""
    found = prepared(name, native_fmus)
    part = found.loaded.scenario.design
    assert part is not None
    assert part.file is not None
    assert found.source is not None
    assert (found.source.file, found.source.made) == (part.file, False)
    assert found.design is not None
    assert found.design.K.tolist() == shipped(part.file)["K"]
    assert found.problem is not None
    assert (found.problem.vehicle is not None) == (part.system == "auv")
    if found.problem.vehicle is not None:
        assert found.problem.vehicle.loop_delay == found.design.system.feedback_delay


@pytest.mark.usefixtures("no_solver")
def test_a_built_in_scenario_runs_without_a_solver(native_fmus: Path) -> None:
    """The worst case, the measured gain and every assumption included."""
    outcome, _ = execute_unrecorded(prepared("auv-worst-case", native_fmus, "run.end=5"))
    assert outcome.metrics["worst_case"]["gain"] == 2.35284
    assert outcome.metrics["exact_norm"] == shipped("auv-1.25s")["figures"]["exact_norm"]
    assert all(outcome.metrics["assumptions"].values())


@pytest.mark.parametrize("name", builtin_studies())
def test_the_scenario_of_a_built_in_study_names_its_design(name: str) -> None:
    """So that no study writes beside the package's scenarios."""
    part = load_study(name).base.scenario.design
    assert part is not None
    assert part.file is not None


def test_the_controller_starts_with_the_shipped_gain() -> None:
    """One source: the FMU holds the certificate of the design, byte for byte."""
    assert CATALOGUE["HinfController"].certificate == certificate_bytes(shipped("auv-1.25s"))
    paper = json.loads(CATALOGUE["PaperController"].certificate or b"")
    assert paper["K"] == shipped("paper-printed-gain")["K"]


def test_the_printed_run_names_its_design(tmp_path: Path, native_fmus: Path) -> None:
    """For people in a line, for scripts in --json."""
    options = ("--flavour", "native", "--fmus", str(native_fmus.parent))
    seen = cosim("run", "paper-worst-case", *options, cwd=tmp_path)
    assert "design: paper-printed-gain, its proof checked again" in seen.out


# a file of one's own


def own(folder: Path, design: Any, table: str) -> Path:
    """A scenario that names the design `own.json`."""
    (folder / "own.json").write_text(json.dumps(design), "utf-8")
    path = folder / "flight.toml"
    path.write_text(MINE.replace('system = "paper"\n', f'file = "own.json"\n{table}'), "utf-8")
    return path


@pytest.mark.parametrize("table", ["", 'system = "paper"\n'])
@pytest.mark.usefixtures("no_solver")
def test_a_saved_design_is_used_unchanged(table: str, tmp_path: Path, native_fmus: Path) -> None:
    """It is found beside the scenario, whatever the working directory is."""
    found = prepared(own(tmp_path, shipped("paper-printed-gain"), table), native_fmus)
    assert found.design is not None
    assert found.design.K.tolist() == [[0.6432, -0.5679]]


def test_a_design_that_was_saved_before_its_worst_case_was_kept_is_read(native_fmus: Path) -> None:
    """Then it is found again, to six digits."""
    before = shipped("paper-printed-gain")
    del before["figures"]["worst_case"]
    old = Result.from_json(before, where="old")
    new = Result.from_json(shipped("paper-printed-gain"), where="new")
    assert old.worst_case is None
    cache = FmuCache(native_fmus.parent, Path.cwd(), flavour="native")

    def worst_case(design: hinf.Result, *settings: str) -> hinf.delay_lti.WorstCase:
        loaded = load("paper-worst-case", settings)
        named = prepare(loaded, cache).problem
        assert named is not None
        found = prepare(loaded, cache, saved=(named, design)).worst_case
        assert found is not None
        return found

    assert worst_case(old) == worst_case(new) == new.worst_case
    other = worst_case(new, "disturbance.omega=3.0")
    assert other.omega == 3.0
    assert other.gain == float(f"{other.gain:.5e}")


def another_gain(data: Any) -> None:
    data["K"][0][0] += 1e-12


def bold(data: Any) -> None:
    data["claim"]["gamma"] = data["variables"]["gamma"] = "5"


def without_figures(data: Any) -> None:
    del data["figures"]


def another_system(data: Any) -> None:
    data["system"]["name"] = "mine"


REFUSED = {
    "a gain that is not proved": (another_gain, "", "the proof of this design does not hold"),
    "a claim that is not proved": (bold, "", "the proof of this design does not hold"),
    "an analysis": (without_figures, "", "has not the figures of a design"),
    "another system": (None, 'system = "auv"\n', "for another system than [design] describes"),
    "keys of the vehicle": (another_system, "loop_delay = 1.0\n", "belong to the system 'auv'"),
    "a gain beside it": (None, "gain = [[0.6432, -0.5679]]\n", "gain beside file: the gain and"),
    "k1 and k2 beside it": (None, "k1 = [0.6]\nk2 = [0.2]\n", "k1, k2 beside file"),
    "an order beside it": (None, "order = 0\n", "order beside file"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_file_that_does_not_fit_is_refused(case: str, tmp_path: Path, native_fmus: Path) -> None:
    """By `run` and by `scenario check`, exit code 2, with file and line."""
    change, table, message = REFUSED[case]
    design = shipped("paper-printed-gain")
    if change is not None:
        change(design)
    path = own(tmp_path, design, table)
    root = ("--fmus", native_fmus.parent, "--json")
    result = cosim("run", path, *root, "--flavour", "native", cwd=tmp_path)
    assert result.code == 2
    assert message in result.err
    assert f"{path}:" in result.error["where"]
    checked = cosim("scenario", "check", path, *root, cwd=tmp_path)
    assert checked.code == 2
    assert message in checked.out


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("nowhere.json", "the design cannot be read"),
        ("mine.json", "not JSON"),
        ("auv-1.52s", "did you mean auv-1.25s"),
    ],
)
def test_a_file_that_is_no_design_is_named(
    value: str, message: str, mine: Path, native_fmus: Path
) -> None:
    """Missing, no JSON, and no name of a shipped design."""
    mine.with_name("mine.json").write_text("{", "utf-8")
    with pytest.raises(InputError) as refused:
        prepared(mine, native_fmus, f'design.file="{value}"')
    assert message in refused.value.text()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("design.envelope={u=0.4,v=0.3,w=0.2,r=0.06,psi=0.35}", "E["),
        ("design.damping=[0.06,0.05,0.05,0.05]", "A1[5,5]"),
        ("design.loop_delay=1.0", "delays (d, feedback, any_age)"),
    ],
)
def test_what_stands_beside_a_file_must_be_what_it_was_made_for(
    setting: str, message: str, native_fmus: Path
) -> None:
    """Envelope, damping and delay of the vehicle, each by its entry."""
    with pytest.raises(InputError, match="another system") as refused:
        prepared("auv-direct", native_fmus, 'design.file="auv-0.15s"', setting)
    assert message in refused.value.text()


# what replaces a file, and what a file replaces


def design_of(name: str, *settings: str) -> dict[str, Any]:
    """The keys of [design], but for the roles."""
    part = load(name, settings).scenario.design
    assert part is not None
    return part.model_dump(exclude_none=True, exclude={"controller", "plant"})


def test_a_setting_of_the_design_replaces_the_file() -> None:
    """A new design is made for it; the other way round, a file replaces how one is made."""
    base = "auv-acoustic"
    assert design_of(base, "design.loop_delay=0.6") == {
        "system": "auv",
        "loop_delay": 0.6,
    }
    assert design_of(base, "run.end=5")["file"] == "auv-1.25s"
    assert design_of(base, "design.plant=plant")["file"] == "auv-1.25s"
    assert design_of(base, "design.loop_delay=0.15", "design.file=auv-0.15s") == {
        "system": "auv",
        "file": "auv-0.15s",
        "loop_delay": 0.15,
    }
    assert design_of(base, "design.file=auv-0.6s") == {
        "system": "auv",
        "file": "auv-0.6s",
    }


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ("[design]\nloop_delay = 0.6", {"system": "auv", "loop_delay": 0.6}),
        ('[design]\nfile = "auv-0.6s"', {"system": "auv", "file": "auv-0.6s"}),
        ('without = ["design.file"]', {"system": "auv", "loop_delay": 1.25}),
        ("[run]\nend = 5.0", {"system": "auv", "loop_delay": 1.25, "file": "auv-1.25s"}),
    ],
)
def test_an_extending_scenario_replaces_the_file(
    table: str, expected: dict[str, Any], tmp_path: Path
) -> None:
    """And `without` takes the file away alone."""
    path = tmp_path / "s.toml"
    path.write_text(f'extends = "auv-acoustic"\ntitle = "t"\n{table}\n', "utf-8")
    assert design_of(str(path)) == expected


def test_the_path_of_a_file_goes_along_with_what_extends(tmp_path: Path) -> None:
    """Like that of an FMU: seen from the folder of the scenario that extends."""
    (tmp_path / "base").mkdir()
    own(tmp_path / "base", {}, "")
    path = tmp_path / "s.toml"
    path.write_text('extends = "base/flight.toml"\ntitle = "t"\n', "utf-8")
    assert design_of(str(path)) == {"file": "base/own.json"}


def test_an_axis_of_a_study_replaces_the_file(native_fmus: Path) -> None:
    """A design is made for every value of an axis in [design]."""
    axis = {"kind": "grid", "path": "design.loop_delay", "values": [0.6, 1.25]}
    study = Study.model_validate(
        {"title": "t", "scenario": "auv-acoustic", "vary": [axis], "metrics": {"s": "status"}}
    )

    def design_of_first(study: Study) -> Any:
        plan = plan_of(study, load("auv-acoustic"), fmus=native_fmus.parent)
        return plan.runner.variations.scenario(plan.runner.points[0]).design

    moved = design_of_first(study)
    assert moved is not None
    assert (moved.file, moved.loop_delay) == (None, 0.6)
    still = {**study.model_dump(), "vary": [{**axis, "path": "run.end", "values": [5.0]}]}
    kept = design_of_first(Study.model_validate(still))
    assert kept is not None
    assert kept.file == "auv-1.25s"


@pytest.mark.usefixtures("no_solver")
def test_setting_another_file_uses_its_delay(native_fmus: Path) -> None:
    """`--set design.file` alone: the delay is that of the file."""
    found = prepared("auv-acoustic", native_fmus, 'design.file="auv-0.6s"')
    assert found.problem is not None
    assert found.problem.vehicle is not None
    assert found.problem.vehicle.loop_delay == 0.6


# a design that a run has to make


@pytest.mark.parametrize("table", ["", "order = 0\n"])
def test_a_design_is_made_once_and_kept(table: str, mine: Path, native_fmus: Path) -> None:
    """The second run takes it with a solver that answers nothing, and is the same run."""
    mine.write_text(MINE + table, "utf-8")
    first = ran(mine, native_fmus)
    beside = mine.with_name("mine.design.json")
    assert first["design"]["made"] is True
    assert first["design"]["file"] == str(beside)
    assert f"kept in {beside}" in first["design"]["words"]
    assert check_certificate(json.loads(beside.read_text())).valid
    before = beside.read_bytes()
    with patch.object(hinf, "design", side_effect=AssertionError("asked a solver")):
        second = ran(mine, native_fmus)
        with open_session(mine, fmus=native_fmus.parent, flavour="native") as session:
            session.step()
        third = run(mine, fmus=native_fmus.parent, flavour="native")
    assert second["design"]["made"] is False
    assert "kept by an earlier run, its proof checked again" in second["design"]["words"]
    assert second["content_hash"] == first["content_hash"]
    assert third.metrics["gamma"] == first["metrics"]["gamma"]
    assert beside.read_bytes() == before


def test_another_solver_does_not_change_a_run_that_has_a_design(
    mine: Path, native_fmus: Path
) -> None:
    """A gain that is 1e-4 larger elsewhere: with the kept file, the run stays what it was."""
    named = system_by_name("paper")
    true = hinf.design

    def elsewhere(*_: Any, **__: Any) -> Any:
        K = np.round(np.array(first_gain) * 1.0001, 6)
        return true(named.system, named.k1, named.k2, gain=K)

    first = ran(mine, native_fmus)
    beside = mine.with_name("mine.design.json")
    first_gain = json.loads(beside.read_text())["K"]
    with patch.object(hinf, "design", elsewhere):
        assert ran(mine, native_fmus)["content_hash"] == first["content_hash"]
        beside.unlink()
        assert ran(mine, native_fmus)["content_hash"] != first["content_hash"]


def test_another_problem_is_designed_again(mine: Path, native_fmus: Path) -> None:
    """Other k1 and k2, or another system: the file is replaced, and the run says so."""
    ran(mine, native_fmus)
    beside = mine.with_name("mine.design.json")
    before = beside.read_bytes()
    # what is not asked for is not in the question: files of older versions still answer it
    assert not {"damping", "within"} & json.loads(before)["made_for"]["question"].keys()
    mine.write_text(MINE + "k1 = [0.5]\nk2 = [0.2]\n", "utf-8")
    again = ran(mine, native_fmus)
    assert again["design"]["made"] is True
    assert "the one kept before answers another question" in again["design"]["words"]
    assert beside.read_bytes() != before
    text = (MINE.replace('"paper"', '"own.toml"'), "[system]\nA=[[-5.0,0.0],[6.0,-10.0]]\n")
    mine.write_text(text[0], "utf-8")
    rest = "B=[[-1.0],[3.0]]\nC=[[4.0],[3.0]]\nD=[[-1.0,0.0],[0.0,-1.0]]\nD2=[[3.0],[-1.0]]\n"
    for extra in ("", "D1=[[0.1],[0.0]]\n"):
        mine.with_name("own.toml").write_text(text[1] + rest + extra, "utf-8")
        message = ran(mine, native_fmus)["design"]["words"]
    assert "the one kept before is for another system: D1[1,1]" in message


def test_a_broken_proof_is_replaced(mine: Path, native_fmus: Path) -> None:
    """The gain in a kept file was changed beyond what its proof bears: a new design is made."""
    first = ran(mine, native_fmus)
    beside = mine.with_name("mine.design.json")
    data = json.loads(beside.read_text())
    data["K"][0][0] += 1.0
    beside.write_text(json.dumps(data), "utf-8")
    again = ran(mine, native_fmus)
    assert "the proof of this design does not hold" in again["design"]["words"]
    assert again["content_hash"] == first["content_hash"]


@pytest.mark.parametrize(
    "content", ["my notes", '{"K": [[1, 2]]}', '{"made_for": {"scenario": "other.toml"}}']
)
def test_a_file_that_no_run_wrote_is_not_overwritten(
    content: str, mine: Path, native_fmus: Path
) -> None:
    """The design is made, used and in the trace; the run says why it is not kept."""
    beside = mine.with_name("mine.design.json")
    beside.write_text(content, "utf-8")
    message = ran(mine, native_fmus)["design"]
    assert beside.read_text("utf-8") == content
    assert (message["made"], message["file"]) == (True, None)
    assert "is not one that a run of mine.toml wrote, and stays as it is" in message["words"]


def test_a_setting_does_not_replace_what_is_kept(mine: Path, native_fmus: Path) -> None:
    """`--set design...` is for one run; what the scenario itself asks stays answered."""
    ran(mine, native_fmus)
    beside = mine.with_name("mine.design.json")
    before = beside.read_bytes()
    message = ran(mine, native_fmus, "--set", "design.gain=[[0.6432, -0.5679]]")["design"]
    assert (message["made"], message["file"]) == (True, None)
    assert "a setting changes [design]" in message["words"]
    assert beside.read_bytes() == before
    assert ran(mine, native_fmus, "--set", "run.end=2")["design"]["made"] is False


def test_design_is_kept_in_the_trace_if_the_folder_is_read_only(
    mine: Path, native_fmus: Path
) -> None:
    """The run says that the folder takes no file."""
    with patch.object(Path, "write_bytes", side_effect=PermissionError(13, "denied")):
        loaded = load(str(mine))
        found = prepare(loaded, FmuCache(native_fmus.parent, loaded.folder, flavour="native"))
    assert found.source is not None
    assert found.source.file is None
    assert "denied" in found.source.words
    assert [p.name for p in mine.parent.iterdir()] == ["mine.toml"]
