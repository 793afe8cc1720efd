"""Measurements in system files: fed back as they are, or sent to an observer; refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim

from cosim.core import InputError
from cosim.hinf import DelaySystem
from cosim.hinf.problem import fed_back, system_from_toml
from cosim.models import Measurement

AXIS = """
[system]
A = [[0.0, 1.0], [0.0, 0.0]]
B = [[0.0], [1.0]]
C = [[0.0], [1.0]]
D = [[0.1, 0.0], [0.0, 0.0]]
D2 = [[0.0], [1.0]]
"""
POSITION = """
[[measurements]]
name = "position"
states = [1]
d = 1.0
any_age = true
"""
SPEED = """
[[measurements]]
name = "speed"
C = [[0.0, 1.0]]
d = 0.2
sampled = true
least_age = 0.05
over = "onboard"
"""


def _read(text: str) -> Any:
    return system_from_toml(text, where="file.toml", name="file")


def test_whole_states_are_fed_back_at_their_ages() -> None:
    """Each through a delay of its own; a fresh one at once."""
    found = _read(AXIS + POSITION + SPEED)
    assert found.observer is None
    assert [x.feedback for x in found.system.delays] == [(True, False), (False, True)]
    assert [(x.d, x.least_age, x.sampled) for x in found.system.delays] == [
        *((1.0, 0.0, False), (0.2, 0.05, True)),
    ]
    both = [Measurement("a", [[1, 0]]), Measurement("b", [[0, 1]], 0.5)]
    fresh = fed_back(DelaySystem(np.zeros((2, 2)), np.eye(2)), both)
    assert fresh.feedback == (True, False)
    assert fresh.delays[0].feedback == (False, True)


@pytest.mark.parametrize(
    "more",
    [POSITION, POSITION + SPEED + "noise = 0.1\n", POSITION + SPEED + "[observer]\n"],
    ids=["half the state", "noise", "asked for"],
)
def test_anything_else_needs_an_observer(more: str) -> None:
    """A state that is not measured, noise, or the table [observer]."""
    found = _read(AXIS + more)
    assert found.observer is not None
    assert found.system.immediate_feedback
    assert found.observer.measurements[0].states == (0,)
    assert found.observer.gain is None


def test_an_observer_has_its_settings_and_gains() -> None:
    """Known states from 1, the age of the command, K and L by the measurement's name."""
    lagged = """
[system]
A = [[0.0, 1.0], [0.0, -2.0]]
B = [[0.0], [2.0]]
C = [[1.0], [0.0]]
"""
    observer = """
[observer]
known = [2]
command_age = 0.5
command_any_age = true
K = [[-0.1, -0.5]]
[observer.L]
position = [[0.5], [0.0]]
"""
    found = _read(lagged + POSITION + observer).observer
    assert found.estimated == (True, False)
    assert (found.command_age, found.command_any_age) == (0.5, True)
    np.testing.assert_array_equal(found.gain, [[-0.1, -0.5]])
    np.testing.assert_array_equal(found.injections[0], [[0.5], [0.0]])


def test_a_measurement_is_of_any_age_unless_the_file_says_that_it_is_constant() -> None:
    """Measurements and commands; one without an age is at once."""
    plain = POSITION.replace("any_age = true\n", "")
    for more, any_age in (("", True), ("any_age = false\n", False), ("any_age = true\n", True)):
        own = _read(AXIS + plain + more).observer.measurements[0]
        assert (own.d, own.any_age) == (1.0, any_age)
    own = _read(AXIS + plain + "least_age = 0.4\n").observer.measurements[0]
    assert (own.least_age, own.any_age, own.sampled) == (0.4, True, False)
    assert not _read(AXIS + plain.replace("d = 1.0\n", "")).observer.measurements[0].any_age
    for more, late in (("", True), ("command_any_age = false\n", False)):
        found = _read(AXIS + plain + "[observer]\ncommand_age = 0.5\n" + more).observer
        assert (found.command_age, found.command_any_age) == (0.5, late)
    assert not _read(AXIS + plain + "[observer]\n").observer.command_any_age


@pytest.mark.parametrize(
    ("text", "place"),
    [
        (AXIS + "[observer]\n", "observer of nothing"),
        (AXIS + POSITION + POSITION, "measurements have one name"),
        (AXIS + POSITION.replace("[[", "[").replace("]]", "]"), "double brackets"),
        (
            AXIS + POSITION.replace("states = [1]", "states = [3]"),
            "file.toml:11: measurements[0].states",
        ),
        (AXIS + POSITION.replace("states = [1]", ""), "either C"),
        (AXIS + POSITION.replace("states = [1]", "C = [[1.0]]"), "position: C"),
        (AXIS + POSITION.replace("states = [1]", "C = [[0.0, 0.0]]"), "not all zero"),
        (AXIS + POSITION.replace('"position"', "3"), "'measurements[0].name' is not allowed"),
        (AXIS + POSITION.replace("d = 1.0", "d = -1.0"), "greater than or equal to 0"),
        (AXIS + POSITION.replace("d = 1.0", "d = '1 s'"), "0.3 for 300 ms"),
        (AXIS + POSITION.replace("any_age = true", "any_age = 1"), "any_age"),
        (AXIS + POSITION + "noise = [0.1, 0.2]\n", "1 numbers >= 0"),
        (AXIS + POSITION + "noise = -0.1\n", "numbers >= 0"),
        (AXIS + POSITION + 'over = "radio"\n', "over"),
        (AXIS + POSITION + "sigma = 0.1\n", "sigma"),
        (AXIS + POSITION + "[observer]\nknown = [5]\n", "observer.known"),
        (AXIS + POSITION + "[observer]\nknown = [1]\n", "state 1"),
        (AXIS + POSITION + "[observer]\ncommand_age = -1.0\n", "command_age"),
        (AXIS + POSITION + "[observer]\ncommand_any_age = 1\n", "command_any_age"),
        (AXIS + POSITION + "[observer]\nK = [[1.0]]\n", "observer: K"),
        (AXIS + POSITION + "[observer]\noffset = [1.0]\n", "observer.offset"),
        (AXIS + POSITION + "[observer]\nenergy = 1.0\n", "no initial state"),
        (AXIS + POSITION + "[observer]\nL = [[1.0]]\n", "observer.L"),
        (AXIS + "feedback = [true, false]\n" + POSITION, "feedback beside measurements"),
        (AXIS.replace("D2", "measurements = []\nD2"), "[[measurements]] of its own"),
    ],
)
def test_what_is_wrong_is_refused_by_name(text: str, place: str) -> None:
    """The message names the file, the table and what was expected."""
    with pytest.raises(InputError) as refused:
        _read(text)
    assert place in str(refused.value)
    assert "file.toml" in str(refused.value)


def test_only_whole_states_without_noise_are_fed_back() -> None:
    """What an observer would take is refused with that hint."""
    system = DelaySystem([[0, 1], [0, 0]], [[0], [1]])
    for x in (Measurement("y", [[1, 1]]), Measurement("y", [[1, 0]], noise=[0.1])):
        with pytest.raises(InputError, match="observer takes any"):
            fed_back(system, [x])
    twice = [Measurement("a", [[1, 0]], 1.0), Measurement("b", [[1, 0]], 2.0)]
    with pytest.raises(InputError, match="fed back 2 times"):
        fed_back(system, twice)


def test_the_verbs_design_analyse_and_check_an_output_feedback(tmp_path: Path) -> None:
    """One file from its design to its proof; options of a state feedback are refused."""
    slow = tmp_path / "slow.toml"
    text = "[system]\nA = [[-0.1]]\nB = [[1.0]]\nC = [[1.0]]\nD = [[1.0], [0.0]]\n"
    text += 'D2 = [[0.0], [1.0]]\n[[measurements]]\nname = "depth"\nstates = [1]\nnoise = 0.125\n'
    slow.write_text(text + "[observer]\nK = [[-0.5]]\nL = {depth = [[0.5]]}\n", "utf-8")
    saved = tmp_path / "slow.json"
    for verb in ("design", "analyse"):
        found = cosim(verb, slow, "--json", "--save", saved, cwd=tmp_path).json
        assert found["certified"]
        assert found["exact_norm"] <= found["gamma"] < 1.1 * found["exact_norm"]
        assert found["L"] == {"depth": [[0.5]]}
    check = ("certificate", "check", saved, "--system", slow, "--json")
    assert cosim(*check, cwd=tmp_path).json["valid"]
    slow.write_text(text.replace("0.125", "0.25"), "utf-8")
    checked = cosim(*check, cwd=tmp_path)
    assert checked.code == 1
    assert "depth, noise: [0.125] and [0.25]" in checked.json["differences"]
    refused = cosim("design", slow, "--decay", "0.1", cwd=tmp_path)
    assert refused.code == 2
    assert "--decay" in refused.err
    assert "K and L in [observer]" in cosim("analyse", slow, cwd=tmp_path).err
