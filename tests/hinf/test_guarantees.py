"""A certificate that proves more than gamma: every entry of it counts, on file as in memory."""

from __future__ import annotations

import copy
import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_json import changed, leaves, refused

from cosim.core import InputError
from cosim.hinf import Delay, DelaySystem, Result, analyse, check_certificate, design
from cosim.hinf.certificate import standalone
from cosim.models import paper_example


@pytest.fixture(scope="module")
def found() -> Result:
    """Section 5 with all design constraints at once."""
    return design(
        paper_example.system(),
        (0.6,),
        (0.2,),
        decay=1.0,
        damping=0.6,
        within=6.0,
        gain_limit=0.5,
        peak_control=0.6,
        offset=[1.0, 0.5],
        energy=0.1,
    )


@pytest.fixture(scope="module")
def saved(found: Result) -> Any:
    """Its file's content."""
    return json.loads(json.dumps(found.to_json()))


def _worse(value: Any) -> Any:
    try:
        return str(-Fraction(value) * 1000 - 7)
    except (ValueError, TypeError):
        return f"{value} and more"


def test_a_design_with_guarantees_survives_its_file(found: Result, saved: Any) -> None:
    """Read back it is the same, proofs and all; its claim lists what is proved."""
    assert check_certificate(saved).valid
    assert set(saved["claim"]["guarantees"]) == {"decay", "damping", "gain_limit", "peak_control"}
    again = Result.from_json(saved, where="file")
    assert again.to_json() == found.to_json()
    assert again.guarantees.decay is not None
    assert float(again.guarantees.decay.rate) == 1.0


def test_changing_any_entry_of_the_guarantees_invalidates_the_proof(saved: Any) -> None:
    """Any single one changed for the worse: refused, in the proofs and in the claim."""
    paths = [("guarantees", *path) for path in leaves(saved["guarantees"])]
    paths += [("claim", "guarantees", *path) for path in leaves(saved["claim"]["guarantees"])]
    assert len(paths) > 40
    assert [path for path in paths if not refused(changed(saved, path, _worse))] == []


def test_a_claim_a_little_better_than_its_proof_is_refused(saved: Any) -> None:
    """A rate, a bound or an energy changed by 2^-40 or 0.1 % in claim and table alike."""

    def both(name: str, key: str, index: int | None, factor: Fraction) -> Any:
        data = copy.deepcopy(saved)
        for table in (data["guarantees"][name], data["claim"]["guarantees"][name]):
            place, at = (table, key) if index is None else (table[key], index)
            place[at] = str(Fraction(place[at]) * factor)
        return data

    less, more = 1 - Fraction(1, 1000), 1 + Fraction(1, 1000)
    assert check_certificate(both("decay", "rate", None, less)).valid
    assert check_certificate(both("damping", "ratio", None, less)).valid
    assert check_certificate(both("peak_control", "energy", None, less)).valid
    for data, word in (
        (both("decay", "rate", None, 1 + Fraction(1, 2**40)), "growth"),
        (both("decay", "rate", None, Fraction(20)), "growth"),
        (both("damping", "ratio", None, Fraction(2)), "damping: the ratio"),
        (both("damping", "ratio", None, Fraction(8, 5)), "damping: 2 characteristic roots"),
        (both("damping", "within", None, Fraction(3)), "characteristic roots"),
        (both("damping", "within", None, Fraction(-1)), "within is not positive"),
        (both("damping", "within", None, Fraction(100)), "too great for the longest delay"),
        (both("gain_limit", "bound", None, less), "gain_limit"),
        (both("peak_control", "bounds", 0, less), "peak_control: bounds"),
        (both("peak_control", "offset", 0, more), "peak_control: bounds"),
        (both("peak_control", "energy", None, more), "peak_control: bounds"),
        # squares say nothing of a sign, and a loop that is stable grows no faster than exp(t)
        (both("peak_control", "bounds", 0, Fraction(-1)), "negative"),
        (both("peak_control", "offset", 0, Fraction(-1)), "negative"),
        (both("peak_control", "energy", None, Fraction(-1)), "negative"),
        (both("decay", "rate", None, Fraction(-1)), "rate is not positive"),
        (both("decay", "rate", None, Fraction(0)), "rate is not positive"),
    ):
        assert word in str(check_certificate(data).reason)


def test_a_guarantee_can_be_dropped_but_not_in_the_proof_alone(saved: Any) -> None:
    """Without its proof the claim is no longer made; without both the rest still holds."""
    for name in saved["guarantees"]:
        data = copy.deepcopy(saved)
        del data["theorem"], data["guarantees"][name]
        assert "claim" in str(check_certificate(data).reason)
        del data["claim"]["guarantees"][name]
        assert check_certificate(data).valid
    data = copy.deepcopy(saved)
    del data["theorem"], data["guarantees"]
    assert not check_certificate(data).valid
    del data["claim"]["guarantees"]
    assert check_certificate(data).valid


def test_rate_beyond_the_proved_corner_is_refused(saved: Any) -> None:
    """A rate tripled with a growth that fits it: the LMI at the corners fails."""
    data = copy.deepcopy(saved)
    for table in (data["guarantees"]["decay"], data["claim"]["guarantees"]["decay"]):
        table["rate"] = str(Fraction(table["rate"]) * 30)
    data["guarantees"]["decay"]["growth"] = ["8200"]  # above e^{30 * 0.3}
    assert "decay: -Omega" in str(check_certificate(data).reason)


@pytest.mark.parametrize("garbage", [None, [], {}, "nan", "1/0", "9" * 3000, 1.0, [["1"]]], ids=str)
def test_garbage_among_the_guarantees_is_bad_input_or_refused(saved: Any, garbage: Any) -> None:
    """Wherever it stands; nothing crashes and nothing passes."""
    paths: list[tuple[Any, ...]] = [("guarantees", name) for name in saved["guarantees"]]
    for name, table in saved["guarantees"].items():
        paths += [("guarantees", name, key) for key in table]
        paths += [("guarantees", name, *path) for path in leaves(table)]
        if "variables" in table:
            paths += [("guarantees", name, "variables", key) for key in table["variables"]]
    paths.remove(("guarantees", "decay", "variables", "gamma"))  # null is what belongs there
    paths.remove(("guarantees", "decay", "variables", "gamma"))
    for path in paths:
        assert refused(changed(saved, path, lambda _: garbage)), path
    if garbage != {}:
        assert refused({**saved, "guarantees": garbage})


def test_an_unknown_guarantee_is_named(saved: Any) -> None:
    """A key that is none is bad input, with the nearest that is."""
    data = copy.deepcopy(saved)
    data["guarantees"]["decai"] = data["guarantees"].pop("decay")
    with pytest.raises(InputError, match="did you mean decay"):
        check_certificate(data)


def test_guarantees_of_another_gain_are_refused(saved: Any) -> None:
    """Put into the file of another design, claim and all: they are proved for its own gain."""
    other = analyse(paper_example.system(), [paper_example.PRINTED_K], order=0)
    data = json.loads(json.dumps(other.to_json()))
    data["guarantees"] = saved["guarantees"]
    data["claim"]["guarantees"] = saved["claim"]["guarantees"]
    data["theorem"] += saved["theorem"][-4:]
    proof = check_certificate(data)
    assert not proof.valid
    assert "gain_limit" in str(proof.reason)


@pytest.mark.parametrize(
    ("age", "order"), [({"any_age": True}, None), ({}, 2), ({"sampled": True, "least_age": 0.1}, 1)]
)
def test_guarantees_stand_beside_any_proof_of_gamma(age: dict[str, Any], order: int | None) -> None:
    """Theorem 2, order 2 of a constant delay, a sampled age: one certificate, read again."""
    pendulum = DelaySystem(
        A=[[0, 1], [1, 0]],
        B=[[0], [1]],
        C=[[0], [1]],
        D=[[1, 0], [0, 0]],
        D2=[[0], [0.1]],
        delays=[Delay(0.2, [[0, 0], [0, 0]], feedback=True, **age)],
    )
    found = design(pendulum, decay=0.3, gain_limit=8.0, order=order)
    assert found.order == order
    assert np.linalg.norm(found.K, 2) <= 8.0
    assert found.abscissa is not None
    assert found.abscissa < -0.3
    saved = json.loads(json.dumps(found.to_json()))
    again = Result.from_json(saved, where="file")
    assert again.certificate["claim"]["guarantees"].keys() == {"decay", "gain_limit"}
    assert again.to_json() == saved
    content = json.dumps(again.certificate).encode()
    assert standalone.check(content)["guarantees"] == saved["claim"]["guarantees"]
    saved["guarantees"]["decay"]["rate"] = "1/2"
    assert refused(saved)


def test_peaks_under_a_disturbance_need_a_gamma() -> None:
    """Without one, nothing bounds what w adds to V: the bounds of no w would be claimed."""
    path = Path(__file__).parents[1] / "corpus" / "certificates" / "observer-peaks.json"
    pair = json.loads(path.read_text("utf-8"))["pair"]
    assert check_certificate(pair).valid
    for change in ({"gamma": None}, {"order": 1}):
        table = copy.deepcopy(pair)
        table["guarantees"]["state_peaks"]["variables"] |= change
        assert refused(table)
