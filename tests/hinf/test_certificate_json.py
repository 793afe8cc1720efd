"""The certificate as JSON: it survives a file, and no entry can be changed for the worse."""

from __future__ import annotations

import copy
import json
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from changed_json import changed, leaves, refused
from solver_points import benchmark, solved

from cosim.core import InputError
from cosim.hinf import check_certificate
from cosim.hinf.certificate import read_certificate
from cosim.hinf.exact import MAX_DIGITS
from cosim.models import paper_example


@pytest.fixture(scope="module")
def paper_json() -> Any:
    """Certificate of section 5 at gamma = 5.05, once through a file's text."""
    system = paper_example.system()
    _, K, point = solved(system, (0.6,), (0.2,), 5.05)
    return json.loads(json.dumps(point.document(system, K)))


def test_a_certificate_survives_its_file(paper_json: Any, tmp_path: Any) -> None:
    """Written, read and checked again, it says the same; the gain is the same doubles."""
    path = tmp_path / "certificate.json"
    path.write_text(json.dumps(paper_json), encoding="utf-8")
    data = read_certificate(path)
    assert data == paper_json
    certificate = check_certificate(data)
    assert certificate.valid
    assert certificate.claim == paper_json["claim"]


def _much_worse(value: Any) -> Any:
    """A well-formed value of the same kind under which the claim is false or unproved."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, float):
        return value + 1000.0
    try:
        return str(-Fraction(value) * 1000 - 7)
    except ValueError:
        return f"{value} and more"


def test_changing_any_entry_invalidates_the_proof(paper_json: Any) -> None:
    """A well-formed change of any single entry that breaks the proof is refused."""
    places = [path for path in leaves(paper_json) if path != ("system", "name")]
    assert {path[0] for path in places} == {"theorem", "claim", "system", "variables", "K"}
    accepted = [path for path in places if not refused(changed(paper_json, path, _much_worse))]
    assert accepted == []


@pytest.mark.parametrize(
    "garbage",
    [
        None,
        [],
        {},
        "",
        "nan",
        "1/0",
        "1e5",
        "1e999999999",
        " 1",
        "1.5",
        "9" * (MAX_DIGITS + 1),
        "1/" + "9" * (MAX_DIGITS + 1),
        "1/" + "3" * 41,
        float("nan"),
        float("inf"),
        10**5000,
        [[10**5000]],
        "\u0661",
    ],
    ids=lambda x: str(x)[:12] if not isinstance(x, int | list) else f"{type(x).__name__}",
)
def test_garbage_in_any_place_is_refused_at_once(paper_json: Any, garbage: Any) -> None:
    """What is no number, or one too long, is bad input wherever it stands; nothing hangs."""
    places = [path for path in leaves(paper_json) if path != ("system", "name")]
    places += [("variables", key) for key in paper_json["variables"]]
    places += [("system", key) for key in paper_json["system"]]
    places += [(key,) for key in paper_json]
    for path in places:
        if path == ("system", "name") and isinstance(garbage, str):
            continue  # a name is any text, and nothing is claimed about it
        assert refused(changed(paper_json, path, lambda _: garbage)), path


def test_a_missing_key_is_named(paper_json: Any) -> None:
    """Every key is needed: in the certificate, among the variables, in the claim.

    Only the theorem in words is not: older certificates are without it.
    """
    without = {key: value for key, value in paper_json.items() if key != "theorem"}
    assert check_certificate(without).valid
    for path in [(key,) for key in without] + [("variables", k) for k in paper_json["variables"]]:
        data = copy.deepcopy(paper_json)
        del (data[path[0]] if len(path) == 2 else data)[path[-1]]
        with pytest.raises(InputError, match=path[-1]):
            check_certificate(data)
    for key in paper_json["claim"]:
        data = copy.deepcopy(paper_json)
        del data["claim"][key]
        assert refused(data)


def test_symmetry_and_the_product_with_the_deployed_gain_are_exact(paper_json: Any) -> None:
    """A difference of 2^-200 in X, Y, Q or R off the diagonal, or one bit of K, is seen."""

    def nudged(text: str) -> str:
        return str(Fraction(text) + Fraction(1, 2**200))

    for path, reason in (
        (("variables", "X", 0, 1), "X is not symmetric"),
        (("variables", "Q", 0, 0, 1), "Q[0] is not symmetric"),
        (("variables", "R", 0, 1, 0), "R[0] is not symmetric"),
        (("variables", "Y", 0, 0), "Y is not K X"),
    ):
        assert check_certificate(changed(paper_json, path, nudged)).reason == reason
    bit = changed(paper_json, ("K", 0, 0), lambda k: float(np.nextafter(k, 1)))
    assert check_certificate(bit).reason == "Y is not K X"
    lower = changed(paper_json, ("claim", "gamma"), lambda g: str(Fraction(g) - Fraction(1, 2**60)))
    assert "claim" in str(check_certificate(lower).reason)


def test_gain_without_inputs_is_refused() -> None:
    """Without an input the only gain is the empty one; any other in the file is refused."""
    _, K, v = solved(benchmark(1.0), (0.0,), (0.2,), None)
    data = v.document(benchmark(1.0), K)
    assert data["K"] == []
    data["K"] = [[1.0, 2.0]]
    with pytest.raises(InputError, match="K"):
        check_certificate(data)


def test_an_enormous_system_is_refused_before_the_work() -> None:
    """A file of many delays would take hours: it is refused by its number of rows."""
    N = 200
    one = {"d": 1.0, "A": [[0.0]]}
    variables = {
        "X": [["1"]],
        "Y": [],
        "Q": [[["1"]]] * N,
        "R": [[["1"]]] * N,
        "eps": None,
        "k1": ["0"] * N,
        "k2": ["1"] * N,
        "gamma": None,
    }
    delay_claim = {"d": 1.0, "age": "constant, up to d", "feedback": False}
    claim = {
        "property": "stability",
        "gamma": None,
        "delays": [delay_claim] * N,
        "uncertain": False,
        "inputs": "doubles",
    }
    system = {"A": [[-1.0]], "delays": [one] * N}
    data = {"claim": claim, "system": system, "variables": variables, "K": []}
    with pytest.raises(InputError, match="too large"):
        check_certificate(data)


@pytest.mark.parametrize("text", ["", "{", "[1,", '{"K": ' + "9" * 5000 + "}", "[" * 100_000])
def test_a_file_that_is_no_json_is_bad_input(tmp_path: Any, text: str) -> None:
    """Malformed, endless or too deep: the message names the file."""
    path = tmp_path / "broken.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"broken\.json"):
        read_certificate(path)


def test_bytes_that_are_no_text_are_bad_input(tmp_path: Any) -> None:
    """So are a file that is not UTF-8, one that does not exist, and data that is no object."""
    path = tmp_path / "broken.json"
    path.write_bytes(b"\xff\xfe\x00")
    for place in (path, tmp_path / "none.json"):
        with pytest.raises(InputError):
            read_certificate(place)
    with pytest.raises(InputError):
        check_certificate([1, 2])
