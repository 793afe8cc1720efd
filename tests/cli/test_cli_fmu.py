"""`cosim fmu info` and `cosim fmu check`: answers, exit codes, help."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.shell import cosim
from fmu.packed import described_as, files_of, pack, with_file, without

from cosim import build_fmu


def test_info_says_what_an_fmu_is(fmus: Path, tmp_path: Path) -> None:
    """For people and for programs: version, kind, platforms, variables, needs."""
    path = fmus / "AuvPlant.fmu"
    result = cosim("fmu", "info", path, "--json", cwd=tmp_path)
    assert result.code == 0
    found = result.json
    assert found["model"]["fmi_version"] == "2.0"
    assert [kind["kind"] for kind in found["model"]["kinds"]] == ["co-simulation"]
    assert "canGetAndSetFMUstate" in found["model"]["kinds"][0]["capabilities"]
    assert {b["folder"] for b in found["binaries"]} == {"linux64", "win64"}
    assert sum(v["count"] for v in found["model"]["variables"]) == 56
    assert found["findings"]["error"] == found["findings"]["warning"] == 0
    seen = cosim("fmu", "info", path, cwd=tmp_path)
    assert seen.code == 0
    for words in ("AuvPlant", "co-simulation", "ELF for x86_64 linux", "a Python host", "kg.m2"):
        assert words in seen.out


def test_check_of_a_valid_fmu_with_and_without_running_it(fmus: Path, tmp_path: Path) -> None:
    """Exit code 0, notes only; --run adds what was done."""
    path = fmus / "WaveField.fmu"
    quiet = cosim("fmu", "check", path, "--json", cwd=tmp_path)
    assert (quiet.code, quiet.json["valid"], quiet.json["run"]) == (0, True, False)
    ran = cosim("fmu", "check", path, "--run", "--time", "600", cwd=tmp_path)
    assert ran.code == 0
    assert "no errors" in ran.out
    assert "run-done" in ran.out


def test_check_that_finds_errors_leaves_with_1(fmus: Path, tmp_path: Path) -> None:
    """Each finding has code, level, place, fact and reason."""
    files = files_of(fmus / "WaveField.fmu")
    described_as((r'causality="parameter"', 'causality="parametre"'))(files)
    without("documentation/")(files)
    path = pack(files, tmp_path / "wrong.fmu")
    result = cosim("fmu", "check", path, "--json", cwd=tmp_path)
    assert result.code == 1
    assert result.json["valid"] is False
    for each in result.json["findings"]:
        assert set(each) == {"code", "level", "where", "what", "why", "number", "sections"}
    codes = [each["code"] for each in result.json["findings"]]
    assert codes.index("xml-schema") < codes.index("documentation")
    seen = cosim("fmu", "check", path, cwd=tmp_path)
    assert seen.code == 1
    assert "not valid" in seen.out
    assert "modelDescription.xml:" in seen.out


def test_check_explains_a_rule_by_number_and_by_name(tmp_path: Path) -> None:
    """With its sections and an example; an unknown one gives the nearest."""
    explained = cosim("fmu", "check", "--rule", "start-missing", "--json", cwd=tmp_path)
    assert explained.code == 0
    assert explained.json["sections"] == "FMI 2.0.4, 2.2.7; FMI 3.0.2, 2.4.7.5"
    assert "start=" in explained.json["instead_of"]
    assert "start=" not in explained.json["example"]
    by_number = cosim("fmu", "check", "--rule", explained.json["number"].lower(), cwd=tmp_path)
    assert by_number.code == 0
    assert "start-missing" in by_number.out
    assert explained.json["runs"] is True
    assert "no run takes the FMU" not in by_number.out
    unclear = cosim("fmu", "check", "--rule", "name-twice", cwd=tmp_path)
    assert "error; no run takes the FMU" in unclear.out
    unknown = cosim("fmu", "check", "--rule", "start-mising", cwd=tmp_path)
    assert unknown.code == 2
    assert "start-missing" in unknown.err
    assert cosim("fmu", "check", cwd=tmp_path).code == 2


@pytest.mark.parametrize("verb", ["info", "check"])
def test_what_is_no_fmu_leaves_with_2(tmp_path: Path, verb: str) -> None:
    """A missing file, a text file: input errors."""
    text = tmp_path / "text.fmu"
    text.write_text("no")
    for path in (text, tmp_path / "missing.fmu", tmp_path):
        result = cosim("fmu", verb, path, "--json", cwd=tmp_path)
        assert result.code == 2
        assert str(path) in result.error["where"]


def test_info_without_a_readable_description_points_to_check(fmus: Path, tmp_path: Path) -> None:
    """There is nothing to say of it; check says what is wrong."""
    files = files_of(fmus / "WaveField.fmu")
    with_file("modelDescription.xml", b"<fmi")(files)
    path = pack(files, tmp_path / "broken.fmu")
    result = cosim("fmu", "info", path, "--json", cwd=tmp_path)
    assert result.code == 2
    assert result.error["hint"] == f"cosim fmu check {path}"
    assert cosim("fmu", "check", path, cwd=tmp_path).code == 1


def test_help_of_check_names_options_and_exit_codes(tmp_path: Path) -> None:
    """The help says when a binary is loaded and what the exit codes are."""
    out = cosim("fmu", "check", "--help", cwd=tmp_path).out
    for words in ("--run", "--json", "--time", "Exit code 0", "separate process"):
        assert words in out
    assert "info" in cosim("fmu", "--help", cwd=tmp_path).out
    assert cosim("fmu", "check", "x.fmu", "--time", "0", "--json", cwd=tmp_path).code == 2


def test_a_built_in_fmu_is_written_by_its_name(tmp_path: Path) -> None:
    """As `build_fmu` writes it; what only other plants take is refused by name."""
    result = cosim("fmu", "build", "Sensor", "--json", cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["model"] == "Sensor"
    assert result.json["binaries"]
    built = build_fmu("Sensor", tmp_path / "fmus")
    assert (tmp_path / "Sensor.fmu").read_bytes() == built.read_bytes()
    refused = cosim("fmu", "build", "Sensor", "--initial", "1,0", cwd=tmp_path)
    assert refused.code == 2
    assert "a built-in FMU is as it is" in refused.err


def test_info_answers_first_and_lists_what_can_be_wired(tmp_path: Path) -> None:
    """Name, version and findings in the first line; inputs, outputs, parameters with units."""
    build_fmu("Sensor", tmp_path)
    path = tmp_path / "Sensor.fmu"
    first = cosim("fmu", "info", path, cwd=tmp_path).out
    assert first.startswith("Sensor: FMI 2.0, co-simulation; has a binary for this machine; cosim")
    for words in ("4 inputs", "5 outputs", "position north, as measured", "rad"):
        assert words in first
    listed = cosim("fmu", "info", path, "--json", cwd=tmp_path).json["model"]["interface"]
    stamp = next(one for one in listed if one["name"] == "stamp")
    assert (stamp["causality"], stamp["type"], stamp["unit"]) == ("output", "Real", "s")
