"""A design as a file: saved, loaded, checked; delays without a matrix; the loop."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cosim import Delay, DelaySystem, Result, analyse, link
from cosim.core import InputError
from cosim.hinf import system_by_name

SYSTEM = system_by_name("paper").system


@pytest.fixture(scope="module")
def found() -> Result:
    return analyse(SYSTEM, [[0.3148, 0.2392]])


def test_a_design_that_is_loaded_is_the_one_that_was_saved(found: Result, tmp_path: Path) -> None:
    path = found.save(tmp_path / "g.json")
    assert Result.load(path) == found
    assert Result.load(str(path)).check().valid


def test_a_file_with_another_gain_is_refused(found: Result, tmp_path: Path) -> None:
    """The proof is about its own numbers."""
    path = found.save(tmp_path / "g.json")
    data = json.loads(path.read_text("utf-8"))
    data["K"][0][0] += 0.5
    path.write_text(json.dumps(data), "utf-8")
    with pytest.raises(InputError, match="proof of this design does not hold"):
        Result.load(path)


def test_a_design_without_a_proof_is_not_saved(tmp_path: Path) -> None:
    nothing = analyse(DelaySystem(A=[[1.0]], B=[[1.0]], C=[[1.0]], D=[[1.0]]), [[0.0]])
    with pytest.raises(InputError, match="nothing is proved"):
        nothing.save(tmp_path / "g.json")
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_named(found: Result, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", "utf-8")
    with pytest.raises(InputError, match="the design cannot be written"):
        found.save(tmp_path / "file" / "g.json")


def test_the_loop_is_the_nominal_closed_loop(found: Result) -> None:
    """Its norm is that of the figures."""
    assert found.loop.norm().value == pytest.approx(found.exact_norm, rel=1e-6)


def test_a_delay_without_a_matrix_is_one_with_a_zero_matrix() -> None:
    """As where the control alone acts through it; `link` says that in a word."""
    zero = Delay(0.3, np.zeros((2, 2)), feedback=True, any_age=True)
    parts = {"A": np.eye(2), "B": [[0], [1]], "C": np.eye(2), "D": np.eye(2)}
    expected = DelaySystem(**parts, delays=[zero])
    assert DelaySystem(**parts, delays=[Delay(0.3, feedback=True, any_age=True)]) == expected
    assert DelaySystem(**parts, delays=[link(0.3)]) == expected
    assert expected.with_(delays=[link(0.5)]).delays[0].d == 0.5
    chosen = Delay(0.3, feedback=[True, False], any_age=True)
    assert DelaySystem(**parts, delays=[chosen]).delays[0].A.shape == (2, 2)
