"""`cosim certificate check`: what it says, and the exit code it leaves with."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from solver_points import solved

from cosim.cli.application import main
from cosim.hinf import certificate_hash
from cosim.hinf.certificate.certificate import certificate_to_json
from cosim.models import paper_example

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def cosim(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """The command line: exit code, standard output, standard error."""

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["cosim", *arguments])
        with pytest.raises(SystemExit) as left:
            main()
        out, err = capsys.readouterr()
        return int(left.value.code or 0), out, err

    return run


@pytest.fixture(scope="module")
def certificate() -> Any:
    """Section 5 at gamma = 5.05, as a file holds it."""
    system = paper_example.system()
    _, K, variables = solved(system, (0.6,), (0.2,), 5.05)
    return json.loads(json.dumps(certificate_to_json(system, K, variables)))


def _file(folder: Path, data: Any) -> str:
    path = folder / "certificate.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    return str(path)


def test_a_certificate_is_proved_from_its_file(
    cosim: Run, certificate: Any, tmp_path: Path
) -> None:
    """Exit 0, in JSON with the claim of the file, for people with the bound."""
    path = _file(tmp_path, certificate)
    code, out, err = cosim("certificate", "check", path, "--json")
    assert (code, err) == (0, "")
    output = json.loads(out)
    assert output == {
        "file": path,
        "container": "file",
        "sha256": certificate_hash(certificate),
        "valid": True,
        "reason": None,
        "claim": certificate["claim"],
    }
    assert Fraction(output["claim"]["gamma"]) == Fraction(5.05)
    code, out, _ = cosim("certificate", "check", path)
    assert code == 0
    assert "proved" in out
    assert "5.05" in out


def _places(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    if not isinstance(data, dict | list):
        return [path]
    items = data.items() if isinstance(data, dict) else enumerate(data)
    return [place for key, value in items for place in _places(value, (*path, key))]


def _worse(value: Any) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, float):
        return value + 1000.0
    try:
        return str(-1000 * Fraction(value) - 7)
    except ValueError:
        return f"{value}, more or less"


def test_every_entry_that_is_tampered_with_is_noticed(
    cosim: Run, certificate: Any, tmp_path: Path
) -> None:
    """Any number, flag or word of the claim changed for the worse: exit 1, or 2 if malformed."""
    for place in _places(certificate):
        if place == ("system", "name"):
            continue  # nothing is claimed about a name
        data = copy.deepcopy(certificate)
        target = data
        for key in place[:-1]:
            target = target[key]
        target[place[-1]] = _worse(target[place[-1]])
        code, out, _ = cosim("certificate", "check", _file(tmp_path, data), "--json")
        assert code in {1, 2}, place
        output = json.loads(out)
        assert output["error"]["exit_code"] == 2 if code == 2 else output["valid"] is False
        if code == 1:
            assert output["reason"]


def test_a_smaller_gamma_is_not_proved(cosim: Run, certificate: Any, tmp_path: Path) -> None:
    """gamma = 5 = ||D1|| cannot be had: claimed consistently, it is refused with exit 1."""
    data = copy.deepcopy(certificate)
    data["variables"]["gamma"] = data["claim"]["gamma"] = "5"
    code, out, _ = cosim("certificate", "check", _file(tmp_path, data))
    assert code == 1
    assert "not proved" in out
    assert "positive definite" in " ".join(out.split())


@pytest.mark.parametrize("text", ["", "{", "[]", '{"claim": {}}', "[" * 100_000])
def test_malformed_certificate_is_refused(cosim: Run, text: str, tmp_path: Path) -> None:
    """Exit 2 with a message, in JSON as well, for files that hold something else."""
    path = tmp_path / "other.json"
    path.write_text(text, encoding="utf-8")
    code, out, err = cosim("certificate", "check", str(path), "--json")
    assert code == 2
    assert json.loads(out)["error"]["exit_code"] == 2
    assert err
    assert cosim("certificate", "check", str(tmp_path / "absent.json"))[0] == 2
