"""The proved bound of the nominal norm as a file: every interval of it counts."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import pytest

from cosim.core import InputError
from cosim.hinf import check_certificate
from cosim.hinf.delay_lti import norm_certificate
from cosim.models import paper_example

NORM = 5.027584949594513  # of section 5 with the printed gain, at 22.905 rad/s


@pytest.fixture(scope="module")
def saved() -> Any:
    """Its file's content."""
    system, K = paper_example.system(), [[0.6432, -0.5679]]
    assert norm_certificate(system, K, NORM * 0.99999) is None
    return json.loads(json.dumps(norm_certificate(system, K, NORM * 1.00001)))


def test_the_bound_is_proved_from_its_file(saved: Any) -> None:
    """With the theorem that it is: nothing uncertain, delays exactly as they are."""
    proof = check_certificate(saved)
    assert proof.valid
    assert float(Fraction(proof.claim["gamma"])) == NORM * 1.00001
    assert proof.claim["delays"][0]["age"] == "constant, exactly d"
    assert any("every dA_i = 0" in text for text in saved["theorem"])


def test_no_interval_can_be_left_out(saved: Any) -> None:
    """Each is needed: without it a gap is left, or the end is not reached."""
    for i in range(0, len(saved["steps"]), 5):
        data = copy.deepcopy(saved)
        del data["steps"][i]
        assert not check_certificate(data).valid


CHANGES: dict[str, Callable[[Any], Any]] = {
    "the end further": lambda d: d.update(end=2 * d["end"]),
    "the end nearer": lambda d: d.update(end=d["end"] / 2),
    "a wider interval": lambda d: d["steps"][3].__setitem__(1, 9.0),
    "a negative one": lambda d: d["steps"][3].__setitem__(1, -d["steps"][3][1]),
    "another order": lambda d: d["steps"].reverse(),
    "another gain": lambda d: d["K"][0].__setitem__(0, 9.0),
    "another delay": lambda d: d["system"]["delays"][0].update(d=3.0),
    "a loop that grows": lambda d: d["system"]["A"][0].__setitem__(0, 50.0),
    "a claim of less": lambda d: d["claim"].update(gamma="5"),
    "a bound below the norm": lambda d: [x.update(gamma="5") for x in (d, d["claim"])],
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_proof_is_refused(saved: Any, name: str) -> None:
    """Whatever was changed."""
    data = copy.deepcopy(saved)
    CHANGES[name](data)
    assert not check_certificate(data).valid


@pytest.mark.parametrize("steps", [None, [], [[0.0]], [[float("nan"), 1.0]], [["0", "1"]]])
def test_garbage_is_refused(saved: Any, steps: Any) -> None:
    """With an error or without a proof."""
    try:
        valid = check_certificate({**saved, "steps": steps}).valid
    except InputError:
        valid = False
    assert not valid
