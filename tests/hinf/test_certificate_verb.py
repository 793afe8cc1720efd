"""`cosim certificate check`: what it says, and the exit code it leaves with."""

from __future__ import annotations

import copy
import json
import math
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from cli.shell import cosim
from solver_points import solved

from cosim.hinf.certificate import certificate_hash
from cosim.models import paper_example


def check(*arguments: str) -> tuple[int, str, str]:
    """Run `cosim certificate check`: exit code, standard output, standard error."""
    result = cosim("certificate", "check", *arguments, cwd=Path.cwd())
    return result.code, result.out, result.err


@pytest.fixture(scope="module")
def certificate() -> Any:
    """Section 5 at gamma = 5.05, as a file holds it."""
    system = paper_example.system()
    _, K, point = solved(system, (0.6,), (0.2,), 5.05)
    return json.loads(json.dumps(point.document(system, K)))


def _file(folder: Path, data: Any) -> str:
    path = folder / "certificate.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    return str(path)


def test_a_certificate_is_proved_from_its_file(certificate: Any, tmp_path: Path) -> None:
    """Exit 0, in JSON with the claim of the file, for people with the bound."""
    path = _file(tmp_path, certificate)
    code, out, err = check(path, "--json")
    assert (code, err) == (0, "")
    output = json.loads(out)
    assert output == {
        "answer": f"proved: {path}: stability and H-infinity gain <= gamma; gamma 5.05",
        "file": path,
        "container": "file",
        "sha256": certificate_hash(certificate),
        "valid": True,
        "reason": None,
        "claim": certificate["claim"],
        "not_read": ["system.name"],
        "system": output["system"],
        "theorem": certificate["theorem"],
        "compared_with": None,
        "differences": None,
    }
    assert output["system"]["name"] == "paper"
    assert output["system"]["matrices"].startswith("A, B, C, D, D1, D2, E, H, A1, H1")
    assert Fraction(output["claim"]["gamma"]) == Fraction(5.05)
    code, out, _ = check(path, "--details")
    assert code == 0
    assert "proved" in out
    assert "5.05" in out
    assert "2 states, 1 input" in out
    assert "[dA_0 ... dA_N] = E F(t) [H_0 ... H_N]" in " ".join(out.split())


def test_a_certificate_is_compared_with_a_system(certificate: Any, tmp_path: Path) -> None:
    """The same system: exit 0. One last bit of one entry, or a delay: exit 1, and where."""
    path = _file(tmp_path, certificate)
    code, out, _ = check(path, "--system", "paper", "--json")
    assert (code, json.loads(out)["differences"]) == (0, [])
    other = tmp_path / "other.toml"
    a = certificate["system"]
    own = {key: a[key] for key in ("A", "B", "C", "D", "D1", "D2", "E", "H")}
    late = a["delays"][0]
    for name, value in (("B", None), ("d", 0.2), ("A1", None)):
        table = copy.deepcopy(own) | {"A1": late["A"], "H1": late["H"], "d": late["d"]}
        if value is not None:
            table[name] = value
        else:
            table[name] = copy.deepcopy(table[name])
            table[name][1][0] = math.nextafter(table[name][1][0], 9.0)
        lines = (f"{key} = {json.dumps(entry)}" for key, entry in table.items())
        other.write_text("\n".join(["[system]", *lines]), encoding="utf-8")
        code, out, _ = check(path, "--system", str(other), "--json")
        found = json.loads(out)
        assert (code, found["valid"]) == (1, False)
        assert len(found["differences"]) == 1
        assert found["differences"][0].startswith("delays" if name == "d" else f"{name}[2,1]: ")
        assert "another system" in found["reason"]


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


def test_every_entry_that_is_tampered_with_is_noticed(certificate: Any, tmp_path: Path) -> None:
    """Any number, flag or word of the claim changed for the worse: exit 1, or 2 if malformed."""
    for place in _places(certificate):
        if place == ("system", "name"):
            continue  # nothing is claimed about a name
        data = copy.deepcopy(certificate)
        target = data
        for key in place[:-1]:
            target = target[key]
        target[place[-1]] = _worse(target[place[-1]])
        code, out, _ = check(_file(tmp_path, data), "--json")
        assert code in {1, 2}, place
        output = json.loads(out)
        assert output["error"]["exit_code"] == 2 if code == 2 else output["valid"] is False
        if code == 1:
            assert output["reason"]


def test_a_smaller_gamma_is_not_proved(certificate: Any, tmp_path: Path) -> None:
    """gamma = 5 = ||D1|| cannot be had: claimed consistently, it is refused with exit 1."""
    data = copy.deepcopy(certificate)
    data["variables"]["gamma"] = data["claim"]["gamma"] = "5"
    code, out, _ = check(_file(tmp_path, data))
    assert code == 1
    assert "not proved" in out
    assert "positive definite" in " ".join(out.split())


@pytest.mark.parametrize("text", ["", "{", "[]", '{"claim": {}}', "[" * 100_000])
def test_malformed_certificate_is_refused(text: str, tmp_path: Path) -> None:
    """Exit 2 with a message, in JSON as well, for files that hold something else."""
    path = tmp_path / "other.json"
    path.write_text(text, encoding="utf-8")
    code, out, err = check(str(path), "--json")
    assert code == 2
    assert json.loads(out)["error"]["exit_code"] == 2
    assert err
    assert check(str(tmp_path / "absent.json"))[0] == 2
