"""What a `check` verb says of a file is what the verb that uses it finds."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from cli.shell import Result, cosim
from fmu.packed import XML, files_of
from shared import sampled

from cosim.core import CheckFailedError
from cosim.vehicle import flight, vehicle_text

SCENARIO = """
title = "one FMU"
[run]
end = "0.1 s"
step = "0.05 s"
[components.it]
fmu = "it.fmu"
"""
Change = Callable[[dict[str, bytes]], list[tuple[str, bytes]]]


def more(*entries: tuple[str, bytes]) -> Change:
    """Entries after those of a sound FMU."""
    return lambda files: [*files.items(), *entries]


def again(name: str) -> Change:
    """An entry there a second time, with the same bytes."""
    return lambda files: [*files.items(), (name, files[name])]


ARCHIVES: dict[str, tuple[Change, str | None]] = {
    "sound": (more(), None),
    "the same description twice": (again(XML), None),
    "the same bytes under ./": (lambda files: [*files.items(), (f"./{XML}", files[XML])], None),
    "a folder twice": (more(("resources/", b""), ("resources/", b"")), None),
    "another description": (more((XML, b"<other/>")), "entry-twice"),
    "other bytes under ./": (more((f"./{XML}", b"<other/>")), "entry-twice"),
    "other bytes at one place": (
        more(("resources/a", b"1"), ("resources//a", b"2")),
        "entry-twice",
    ),
    "a file and a folder": (more(("resources/a", b""), ("resources/a/b", b"")), "entry-folder"),
    "a folder and a file": (more(("resources/a/", b""), ("resources/a", b"")), "entry-folder"),
    "a file in place of resources": (more(("resources", b"")), "entry-folder"),
    "no name": (more((".", b"")), "path-control"),
    "a long name": (more((f"resources/{'a' * 256}", b"")), "path-long"),
    "a long path": (more(("resources/" + "a/" * 600 + "b", b"")), "path-long"),
    "capitals": (more(("resources/a", b""), ("resources/A", b"")), "entry-case"),
    "outside": (more(("../a", b"")), "path-escapes"),
}


@pytest.fixture(scope="module")
def sound(native_fmus: Path) -> dict[str, bytes]:
    """The files of an FMU that runs."""
    return files_of(native_fmus / "WaveField.fmu")


@pytest.mark.parametrize("case", ARCHIVES)
def test_an_archive_is_run_where_check_passes_it(
    case: str, sound: dict[str, bytes], tmp_path: Path
) -> None:
    """What cannot be unpacked is an error of both; an entry doubled with its bytes of neither."""
    change, refused = ARCHIVES[case]
    with zipfile.ZipFile(tmp_path / "it.fmu", "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # zipfile's, of names that are there twice
        for name, content in change(sound):
            archive.writestr(name, content)
    (tmp_path / "it.toml").write_text(SCENARIO)
    load = ["--run"] if refused is None else []
    checked = cosim("fmu", "check", "it.fmu", *load, "--json", cwd=tmp_path)
    errors = [f["code"] for f in checked.json["findings"] if f["level"] == "error"]
    run = cosim("run", "it.toml", cwd=tmp_path)
    looked = cosim("scenario", "check", "it.toml", cwd=tmp_path)
    assert looked.code == run.code
    if refused is None:
        assert (checked.code, errors, run.code) == (0, [], 0), run.err
    else:
        assert (checked.code, run.code) == (1, 2)
        assert refused in errors
        assert "this archive is not unpacked" in run.err


def damaged(sound: dict[str, bytes], path: Path) -> str:
    """One byte of an entry is not the one that was packed."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in {**sound, "resources/table": b"0123456789"}.items():
            archive.writestr(name, content)
    path.write_bytes(path.read_bytes().replace(b"0123456789", b"0123456780"))
    return "the FMU cannot be unpacked"


def of_another_machine(sound: dict[str, bytes], path: Path) -> str:
    """There is no binary for this one."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in sound.items():
            folder, _, rest = name.removeprefix("binaries/").partition("/")
            other = f"binaries/{folder}-of-another/{rest}"
            archive.writestr(other if name.startswith("binaries/") else name, content)
    return "the FMU cannot be loaded"


@pytest.mark.parametrize("made", [damaged, of_another_machine])
def test_what_cannot_be_loaded_is_a_problem_of_its_scenario(
    made: Callable[[dict[str, bytes], Path], str], sound: dict[str, bytes], tmp_path: Path
) -> None:
    """The check asks what the run asks before any foreign code runs, and says the same."""
    words = made(sound, tmp_path / "it.fmu")
    (tmp_path / "it.toml").write_text(SCENARIO)
    looked = cosim("scenario", "check", "it.toml", "--json", cwd=tmp_path)
    run = cosim("run", "it.toml", "--json", cwd=tmp_path)
    assert looked.code == 2
    (problem,) = looked.json["scenarios"][0]["problems"]
    assert words in problem["what"]
    assert run.code in (2, 4)
    assert words in run.out


REMUS, ROV = vehicle_text("remus100"), vehicle_text("bluerov2-heavy")
QUATERNION = "degrees_of_freedom = 6\nattitude = 'quaternion'"
OF_OTHERS = """
[[sensors]]
name = "a"
measures = ["eta.psi"]
interval = 0.1
age = 0.2
[trim]
u = 1.5
[control]
states = ["nu.v"]
"""
VEHICLES: dict[str, tuple[str, str | None]] = {
    "sound": (ROV, None),
    "fins without lag": (REMUS.replace("lag = 0.1\n", ""), None),
    "a quaternion": (REMUS.replace("degrees_of_freedom = 6", QUATERNION), None),
    "fins that act at once": (REMUS.replace("lag = 0.1\n", "lag = 0.0\n"), "depends on the state"),
    "no such key": (ROV.replace("mass =", "mas ="), "mas"),
    "a state that nothing shows": (
        ROV.replace('measures = ["eta.z"]', 'measures = ["nu.u"]'),
        "cannot be estimated",
    ),
    "sensors of other states alone": (
        REMUS.split("[[sensors]]")[0] + OF_OTHERS,
        "no sensor measures a controlled state",
    ),
    "a speed that nothing holds": (ROV.replace("[trim]\nu = 0.0", "[trim]\nu = 90.0"), "trim"),
}


@pytest.mark.parametrize("case", sampled(VEHICLES, 3))
def test_a_vehicle_is_designed_for_where_check_passes_it(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both say the same of it; the flight is stopped where the design begins."""

    def begin(*_: object) -> None:
        raise CheckFailedError("the design begins")

    monkeypatch.setattr(flight, "certified_design", begin)
    text, refused = VEHICLES[case]
    assert text not in (ROV, REMUS) or case == "sound"
    (tmp_path / "mine.toml").write_text(text)
    checked = cosim("vehicle", "check", "mine.toml", "--json", cwd=tmp_path)
    (found,) = checked.json["vehicles"]
    errors = [each for each in found["findings"] if each["level"] == "error"]
    answer: Result = cosim("vehicle", "fly", "mine.toml", "--out", "it", "--json", cwd=tmp_path)
    if refused is None:
        assert (checked.code, errors) == (0, [])
        assert answer.error["what"] == "the design begins"
    else:
        assert checked.code == 2
        assert any(answer.error["what"] == each["what"] for each in errors)
        assert refused in answer.err


STUDY = """
title = "one FMU, varied"
scenario = "it.toml"
vary = [{ kind = "grid", name = "until", path = "run.end", values = [0.1, 0.15, 0.2] }]
metrics = { state = "status" }
"""
STUDIES: dict[str, tuple[str, str | None]] = {
    "sound": (SCENARIO, None),
    "a parameter that is none": (f"{SCENARIO}parameters = {{ nope = 1.0 }}\n", "nope"),
    "no such connection": (f'connect = ["it.x -> it.y"]\n{SCENARIO}', "no output"),
    "no such FMU": (SCENARIO.replace("it.fmu", "other.fmu"), "other.fmu"),
}


@pytest.mark.parametrize("case", STUDIES)
def test_a_study_of_impossible_runs_is_refused_by_both(
    case: str, sound: dict[str, bytes], tmp_path: Path
) -> None:
    """With the same words, before a run."""
    text, refused = STUDIES[case]
    with zipfile.ZipFile(tmp_path / "it.fmu", "w") as archive:
        for name, content in sound.items():
            archive.writestr(name, content)
    (tmp_path / "it.toml").write_text(text)
    (tmp_path / "study.toml").write_text(STUDY)
    checked = cosim("study", "check", "study.toml", "--json", cwd=tmp_path)
    run = cosim("study", "run", "study.toml", "--json", cwd=tmp_path)
    assert checked.code == run.code
    if refused is None:
        assert run.code == 0, run.err
    else:
        assert checked.error["what"] == run.error["what"]
        assert refused in checked.err
