"""A design is a value: nothing in it changes, its content makes it equal, its K is the proof's."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim import hinf
from cosim.core import InputError
from cosim.hinf import Delay, DelaySystem, analyse, check_certificate
from cosim.models import Measurement, paper_example

DESIGNS = Path(str(files("cosim.scenario").joinpath("library", "designs")))
NAMES = ("auv-0.6s", "auv-outages-1.25s", "auv-playout-1.25s", "auv-remote", "paper-late")


@cache
def data_of(name: str) -> Any:
    """A pinned design, as its file holds it."""
    return json.loads((DESIGNS / f"{name}.json").read_text("utf-8"))


def read(name: str) -> Any:
    """The same, read."""
    return hinf.Result.from_json(copy.deepcopy(data_of(name)), where=name)


def arrays_in(value: Any, seen: set[int] | None = None) -> list[np.ndarray[Any, Any]]:
    """Every array that a value contains, however deep."""
    seen = set() if seen is None else seen
    if id(value) in seen:
        return []
    seen.add(id(value))
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, (tuple, list)):
        inner = list(value)
    elif isinstance(value, dict):
        inner = list(value.values())
    else:
        inner = list(vars(value).values()) if hasattr(value, "__dict__") else []
    return [array for one in inner for array in arrays_in(one, seen)]


@pytest.mark.parametrize("name", NAMES)
def test_no_array_of_a_design_can_be_written(name: str) -> None:
    """Not even after `setflags`, and not after a copy or a pickle."""
    found = read(name)
    for one in (found, pickle.loads(pickle.dumps(found)), copy.deepcopy(found), replace(found)):  # noqa: S301
        arrays = arrays_in(one)
        assert len(arrays) > 8
        for array in arrays:
            with pytest.raises(ValueError, match="WRITEABLE"):
                array.setflags(write=True)
            if array.size:
                with pytest.raises(ValueError, match="read-only"):
                    array[...] = 5
    with pytest.raises((ValueError, FrozenInstanceError)):
        found.K[0, 0] *= 5
    with pytest.raises(FrozenInstanceError):
        found.gamma = 0.1


@pytest.mark.parametrize("name", NAMES)
def test_designs_of_one_file_are_equal(name: str) -> None:
    """And have one hash, pickled ones too; another file's is another design."""
    one, two = read(name), read(name)
    again = pickle.loads(pickle.dumps(one))  # noqa: S301
    assert one is not two
    assert one == two == again
    assert len({one, two, again}) == 1
    assert one.system == two.system
    assert hash(one.system) == hash(again.system)
    assert (one.guarantees, one.observer) == (two.guarantees, two.observer)
    assert one.to_json() == {k: x for k, x in data_of(name).items() if k != "schema"}
    assert all(one != read(other) for other in NAMES if other != name)
    assert one.certified


@pytest.mark.parametrize("name", NAMES)
def test_no_design_has_another_gain_than_its_proof(name: str) -> None:
    """Not by `replace`, with or without another certificate: refused, or not certified."""
    found = read(name)
    K = found.K * 5
    observed = found.observer is not None
    for changes in ({"K": K}, {"observer": replace(found.pair, K=K)} if observed else {"K": K}):
        with pytest.raises(InputError, match="what is said is not what is proved"):
            replace(found, **changes)
    with pytest.raises(InputError, match="gamma"):
        replace(found, gamma=0.5)
    if not observed:
        forged = {**found.certificate, "K": K.tolist()}
        assert not replace(found, K=K, certificate=forged).certified
        other = replace(found.system, A=found.system.A + 1)
        with pytest.raises(InputError, match=r"system: A\[1,1\]"):
            replace(found, system=other)
    noted = replace(found, certificate={**found.certificate, "made_for": "a note"})
    assert noted.certified
    assert noted != found


def test_an_analysis_is_about_the_gain_of_its_proof() -> None:
    """So too one of u = 0, whose certificate has zeros."""
    K = [[0.6432, -0.5679]]
    found = analyse(paper_example.system(), K)
    assert found == analyse(paper_example.system(), K)
    with pytest.raises(InputError, match=r"K\[1,1\]: 1.0 and 0.6432"):
        replace(found, K=np.ones((1, 2)))
    with pytest.raises(InputError, match="a certificate where something is proved"):
        replace(found, certificate=None)
    alone = analyse(DelaySystem([[-1.0]], [[1.0]]))
    assert not alone.K.any()
    with pytest.raises(InputError, match=r"K\[1,1\]"):
        replace(alone, K=np.ones((1, 1)))


CHANGES: dict[str, Callable[[Any], Any]] = {
    "a key": lambda c: c.__setitem__("K", [[0.0]]),
    "an entry": lambda c: c["K"][0].__setitem__(0, 0.0),
    "a row": lambda c: c["K"].append([0.0]),
    "deep": lambda c: c["claim"]["delays"][0].update(d=9.0),
    "a deletion": lambda c: c.pop("claim"),
    "in place": lambda c: c.__ior__({"K": []}),
    "a list in place": lambda c: c["K"].__iadd__([[0.0]]),
    "a default": lambda c: c.setdefault("note", 1),
    "order": lambda c: c["K"].reverse(),
    "all": lambda c: c.clear(),
    "again": lambda c: c.__init__({"K": []}),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_certificate_cannot_be_changed(change: Callable[[Any], Any]) -> None:
    """At any depth."""
    certificate = read("auv-0.6s").certificate
    before = json.dumps(certificate)
    with pytest.raises(TypeError, match="cannot be changed"):
        change(certificate)
    assert json.dumps(certificate) == before


def test_a_certificate_is_still_a_dictionary() -> None:
    """To JSON, to dictionaries, to pickle; a changed copy is a plain one, and is checked anew."""
    certificate = read("auv-0.6s").certificate
    plain = json.loads(json.dumps(certificate))
    assert certificate == plain
    assert plain == certificate
    assert type(plain["claim"]) is dict
    again = pickle.loads(pickle.dumps(certificate))  # noqa: S301
    assert again == certificate
    assert hash(again) == hash(certificate)
    more = certificate | {"note": 1}
    assert type(more) is dict
    assert check_certificate(more).valid
    plain["K"][0][0] *= 5
    assert not check_certificate(plain).valid
    assert hinf.certificate.certificate_hash(certificate) != hinf.certificate.certificate_hash(
        plain
    )


def test_systems_delays_and_measurements_are_equal_by_content() -> None:
    """Each field counts; -0.0 is 0.0; other kinds of things are other things."""
    one, two = paper_example.system(), paper_example.system()
    assert one == two
    assert hash(one) == hash(two)
    assert one != replace(one, name="another")
    assert one != replace(one, A=one.A + 1e-9)
    assert one != replace(one, delays=())
    assert one != 5
    assert Delay(0.5, [[0.0]]) == Delay(0.5, [[-0.0]])
    assert hash(Delay(0.5, [[0.0]])) == hash(Delay(0.5, [[-0.0]]))
    assert Delay(0.5, [[0.0]]) != Delay(0.5, [[0.0]], any_age=True)
    assert Measurement("y", [[1.0]], 0.5) == Measurement("y", [[1.0]], 0.5)
    assert Measurement("y", [[1.0]], 0.5) != Measurement("y", [[1.0]], 0.5, over="onboard")
    assert copy.copy(one) is one
