"""The default gains of the controllers are certified for the built-in systems."""

from __future__ import annotations

import hashlib
import json
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import certified_gains
import numpy as np
import pytest

from cosim.fmu import build_fmu
from cosim.fmu.export import CATALOGUE
from cosim.hinf import characteristic_roots, check_certificate, hinf_norm, system_by_name
from cosim.hinf.certificate import certificate_bytes, system_from_json
from cosim.hinf.delay_lti import close
from cosim.models import paper_example

CONTROLLERS = {"HinfController": "auv", "PaperController": "paper"}


def certificate_of(name: str) -> bytes:
    certificate = CATALOGUE[name].certificate
    assert certificate is not None
    return certificate


@pytest.mark.parametrize("name", CONTROLLERS)
def test_certificate_is_valid(name: str) -> None:
    """Checked from its bytes in rational arithmetic, without a solver."""
    data = json.loads(certificate_of(name))
    assert check_certificate(data).valid
    assert certificate_of(name) == certificate_bytes(data)  # one certificate, one SHA-256


@pytest.mark.parametrize("name", CONTROLLERS)
def test_start_values_are_the_certified_gain(name: str) -> None:
    """K[i,j] of the specification, double by double."""
    K = json.loads(certificate_of(name))["K"]
    starts = {v.name: v.start for v in CATALOGUE[name].variables if v.name.startswith("K[")}
    assert starts == {f"K[{i},{j}]": v for i, row in enumerate(K, 1) for j, v in enumerate(row, 1)}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_certificate_describes_the_built_in_system(name: str) -> None:
    """Every matrix and delay, up to the last digits, in which libraries may differ."""
    proved = system_from_json(json.loads(certificate_of(name))["system"])
    own = system_by_name(CONTROLLERS[name]).system
    for letter in ("A", "B", "C", "D", "D1", "D2", "E", "H"):
        np.testing.assert_allclose(
            getattr(proved, letter), getattr(own, letter), rtol=1e-12, atol=0, err_msg=letter
        )
    for mine, theirs in zip(proved.delays, own.delays, strict=True):
        assert (mine.d, mine.feedback, mine.any_age) == (theirs.d, theirs.feedback, theirs.any_age)
        np.testing.assert_array_equal(mine.A, theirs.A)
        np.testing.assert_array_equal(mine.H, theirs.H)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_norm_of_the_nominal_loop_is_below_gamma(name: str) -> None:
    """Computed without the LMI: stable roots, and the H-infinity norm."""
    data = json.loads(certificate_of(name))
    loop = close(system_by_name(CONTROLLERS[name]).system, data["K"])
    norm = hinf_norm(loop)
    p, q = map(int, data["claim"]["gamma"].split("/"))
    assert norm is not None
    assert norm.bound < p / q < 1.5 * norm.value
    assert characteristic_roots(loop, 4)[0].real < 0.0


def test_the_paper_controller_has_the_printed_gain() -> None:
    """K = (0.6432 -0.5679), with the least gamma of Theorem 1 in three digits."""
    data = json.loads(certificate_of("PaperController"))
    assert data["K"] == [list(paper_example.PRINTED_K)]
    assert eval(data["claim"]["gamma"]) == pytest.approx(5.0455, abs=1e-4)  # noqa: S307 - p/q


@pytest.mark.parametrize("name", CONTROLLERS)
def test_fmu_and_page_contain_the_certificate(fmus: Path, name: str) -> None:
    """resources/certificate.json byte by byte; gamma, delays, hash and conditions on the page."""
    with zipfile.ZipFile(fmus / f"{name}.fmu") as archive:
        embedded = archive.read("resources/certificate.json")
        page = archive.read("documentation/index.html").decode()
    assert embedded == certificate_of(name)
    claim = json.loads(embedded)["claim"]
    p, q = map(int, claim["gamma"].split("/"))
    assert f"gamma = {p / q!r}" in page
    for delay in claim["delays"]:
        assert f"d = {delay['d']:g} s, age {delay['age']}" in page
    assert hashlib.sha256(embedded).hexdigest() in page
    assert "Any other K voids this" in page
    assert ("feedback without any delay" in page) == (name == "PaperController")


@pytest.mark.parametrize("name", sorted(set(CATALOGUE) - set(CONTROLLERS)))
def test_other_fmus_contain_no_certificate(fmus: Path, name: str) -> None:
    """Neither plants nor the sea have one."""
    with zipfile.ZipFile(fmus / f"{name}.fmu") as archive:
        assert "resources/certificate.json" not in archive.namelist()
        assert "What is certified" not in archive.read("documentation/index.html").decode()


def page_about(certificate: Any, folder: Path) -> str:
    """The page of a controller with this certificate, which nobody proves here."""
    spec = replace(CATALOGUE["PaperController"], certificate=json.dumps(certificate).encode())
    with zipfile.ZipFile(build_fmu(spec, folder, "python")) as archive:
        return archive.read("documentation/index.html").decode()


def test_a_bound_is_never_printed_too_small(tmp_path: Path) -> None:
    """5 + 1/3 is not a double and is rounded up; 5.05 as a double is printed as it is."""
    data = json.loads(certificate_of("PaperController"))
    data["claim"]["gamma"] = "16/3"
    assert "gamma = 5.333333334<" in page_about(data, tmp_path)
    data["claim"]["gamma"] = "2843146517341798/562949953421312"
    data["claim"]["delays"] = []
    assert f"gamma = {2843146517341798 / 562949953421312!r}<" in page_about(data, tmp_path)
    data["claim"]["gamma"] = None
    _, begin, page = page_about(data, tmp_path).partition('<h2 id="certified">')
    section, end, _ = page.partition("<h2")
    assert begin
    assert end
    assert "gamma" not in section


@pytest.mark.slow
@pytest.mark.parametrize("file", certified_gains.MADE_BY)
def test_regenerated_certificate_has_the_same_gamma(file: str) -> None:
    """The program that writes the files finds gamma again within 1e-3."""
    old = json.loads((certified_gains.ROOT / file).read_bytes())
    new = certified_gains.MADE_BY[file]()
    gammas = [p / q for p, q in (map(int, d["claim"]["gamma"].split("/")) for d in (old, new))]
    assert gammas[1] == pytest.approx(gammas[0], rel=1e-3)
    np.testing.assert_allclose(new["K"], old["K"], atol=0.02)
