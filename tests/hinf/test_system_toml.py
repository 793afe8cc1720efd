"""Systems as TOML and JSON: what is read is what stands there, and what is wrong is named."""

from __future__ import annotations

import gc
import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp

from cosim.core import InputError, parse_toml
from cosim.hinf.certificate import MATRICES, system_from_json, system_to_json
from cosim.hinf.problem import load_system, system_from_toml
from cosim.models import Delay, DelaySystem, paper_example

PAPER = """
[system]
A = [[-5, 0], [6, -10]]
A1 = [[-1, 0], [2, 1]]
B = [[-1], [3]]
C = [[4.0], [3.0]]
D = [[-1, 0], [0, -1]]
D1 = [[4], [3]]
D2 = [[3], [-1]]
E = [[-0.1, 0], [0, -0.1]]
H = [[0.2, 0], [1, 2]]
H1 = [[-1, 2], [0, -0.3]]
d = 0.3

[design]
k1 = 0.6
k2 = [0.2]
gamma = 5.05
"""

SEVERAL = """
[system]
name = "loop"
A = [[0.0, 1.0], [0.0, 0.0]]
B = [[0.0], [1.0]]

[[system.delays]]
d = 0.5
A = [[0.0, 0.0], [0.0, -0.1]]

[[system.delays]]
d = 1.25
feedback = true
any_age = true
"""


def _read(text: str) -> Any:
    return system_from_toml(text, where="file.toml", name="file")


def _same(a: DelaySystem, b: DelaySystem) -> None:
    for key in MATRICES:
        np.testing.assert_array_equal(getattr(a, key), getattr(b, key), strict=True)
    assert len(a.delays) == len(b.delays)
    for x, y in zip(a.delays, b.delays, strict=True):
        np.testing.assert_array_equal(x.A, y.A, strict=True)
        np.testing.assert_array_equal(x.H, y.H, strict=True)
        assert (x.d, x.feedback, x.any_age) == (y.d, y.feedback, y.any_age)


def test_the_papers_letters_give_the_papers_system(tmp_path: Any) -> None:
    """Section 5 typed from the paper is the built-in example, named after its file."""
    path = tmp_path / "section5.toml"
    path.write_text(PAPER, encoding="utf-8")
    read = load_system(path)
    _same(read.system, paper_example.system())
    assert read.system.name == "section5"
    assert (read.k1, read.k2, read.gamma) == ((0.6,), (0.2,), 5.05)


def test_several_delays_and_what_is_absent() -> None:
    """Absent matrices are zero or without size; a delay may carry the control alone."""
    read = _read(SEVERAL)
    system = read.system
    assert system.name == "loop"
    assert [x.d for x in system.delays] == [0.5, 1.25]
    assert [x.feedback for x in system.delays] == [False, True]
    assert [x.any_age for x in system.delays] == [False, True]
    np.testing.assert_array_equal(system.delays[1].A, np.zeros((2, 2)))
    assert not system.has_performance
    assert system.E.shape == (2, 0)
    assert (read.k1, read.k2, read.gamma) == (None, None, None)


def test_a_system_without_delay() -> None:
    """Neither d nor delays: an ordinary linear system."""
    assert _read("[system]\nA = [[-1.0]]").system.delays == ()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "A1 = [[-1, 0], [2, 1]]",
            "A1 = [[-1, 0, 0], [2, 1, 0]]",
            ["file.toml:4: system.A1", "(2, 3)"],
        ),
        ("A1 = [[-1, 0], [2, 1]]", "A1 = [[-1, 0], [2]]", ["system.A1", "1 and 2"]),
        ("B = [[-1], [3]]", "B = [[-1], [3], [4]]", ["B", "(2, any)", "(3, 1)"]),
        ("B = [[-1], [3]]", "B = [-1, 3]", ["system.B", "not a matrix", "[[4.0], [3.0]]"]),
        ("B = [[-1], [3]]", 'B = [["-1"], [3]]', ["system.B[0][0]", "'-1'"]),
        ("B = [[-1], [3]]", "B = [[true], [3]]", ["system.B[0][0]", "True"]),
        ("B = [[-1], [3]]", "B = [[nan], [3]]", ["system.B[0][0]", "finite"]),
        ("B = [[-1], [3]]", "B = [[-inf], [3]]", ["system.B[0][0]", "-inf"]),
        ("B = [[-1], [3]]", "B = [[9007199254740993], [3]]", ["system.B[0][0]"]),
        ("B = [[-1], [3]]", f"B = [[0x{'f' * 5000}], [3]]", ["system.B[0][0]", "digits"]),
        ("B = [[-1], [3]]", f"B = [[{'9' * 5000}], [3]]", ["file.toml", "malformed"]),
        ("B = [[-1], [3]]", "B = " + "[" * 50_000, ["file.toml", "malformed"]),
        ("B = [[-1], [3]]", "B1 = [[-1], [3]]", ["file.toml:5", "system.B1'", "did you mean", "B"]),
        ("B = [[-1], [3]]", "B = [[-1], [3]", ["file.toml:6", "malformed TOML"]),
        ("B = [[-1], [3]]", "B = [[-1], [3]]\nB = [[1], [2]]", ["file.toml:6", "B = [[1], [2]]"]),
        ("B = [[-1], [3]]", "name = 3", ["system.name", "a text"]),
        ("d = 0.3", "d = -0.3", ["-0.3", "or equal to 0"]),
        ("d = 0.3", 'd = "0.3 s"', ["system.d", "'0.3 s'"]),
        ("d = 0.3", "", ["half a delay", "A1, H1"]),
        ("d = 0.3", "d = 0.3\n[[system.delays]]\nd = 1", ["one delay and a list"]),
        ("E = [[-0.1, 0], [0, -0.1]]", "", ["H without E"]),
        ("[system]", "[sytem]", ["'sytem'", "system"]),
        ("[design]", "[desing]", ["'desing'", "did you mean design"]),
        ("k2 = [0.2]", "k2 = [0.2, 0.3]", ["design.k2", "a list of 1", "2 of them"]),
        ("k2 = [0.2]", "k2 = 0", ["design.k2", "zero"]),
        ("k2 = [0.2]", "k3 = 0.2", ["design.k3'", "k1"]),
        ("gamma = 5.05", "gamma = -1", ["design.gamma", "greater than 0"]),
        ("gamma = 5.05", 'gamma = "least"', ["design.gamma", "'least'"]),
    ],
)
def test_wrong_value_in_a_file_is_named(old: str, new: str, words: list[str]) -> None:
    """One fault put into the paper's file: the message has the place and what stood there."""
    assert PAPER.count(old) == 1
    with pytest.raises(InputError) as caught:
        _read(PAPER.replace(old, new))
    message = str(caught.value)
    assert message.startswith("file.toml")
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("feedback = true", "feedback = 1", ["delays[1].feedback", "true or false"]),
        (
            "feedback = true",
            "feedbak = true",
            ["system.delays[1].feedbak'", "did you mean feedback"],
        ),
        ("d = 1.25", "", ["file.toml:11", "system.delays[1].d' is missing"]),
        ("d = 0.5", "d = 0.5\nfeedback = true", ["at most one"]),
        ("[[system.delays]]\nd = 1.25", "[[system.delays]]\nd = inf", ["delays[1].d", "inf"]),
        ("A = [[0.0, 0.0], [0.0, -0.1]]", "A = [[1.0]]", ["delay 1", "(2, 2)", "(1, 1)"]),
        ("any_age = true", "any_age = true\n[design]\ngamma = 3", ["no gain to bound"]),
        ("A = [[0.0, 1.0], [0.0, 0.0]]", "", ["system.A' is missing"]),
    ],
)
def test_wrong_value_in_a_list_of_delays_is_named(old: str, new: str, words: list[str]) -> None:
    """The same for a file of several delays."""
    assert SEVERAL.count(old) == 1
    with pytest.raises(InputError) as caught:
        _read(SEVERAL.replace(old, new))
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("text", ["", "system = 3", "[system]", "[system.delays]\nd = 1"])
def test_a_file_without_a_system_is_refused(text: str) -> None:
    """Nothing, a number, an empty table: no system."""
    with pytest.raises(InputError):
        _read(text)


def test_delays_need_double_brackets() -> None:
    """[system.delays] is one table, not a list of them."""
    text = SEVERAL.split("[[system.delays]]", maxsplit=1)[0] + "[system.delays]\nd = 1.0\n"
    with pytest.raises(InputError, match="double brackets"):
        _read(text)


def test_an_unreadable_file_is_bad_input(tmp_path: Any) -> None:
    """Not there, a folder, or no text."""
    broken = tmp_path / "broken.toml"
    broken.write_bytes(b"\xff\xfe")
    for path in (tmp_path / "none.toml", tmp_path, broken):
        with pytest.raises(InputError, match="cannot be read"):
            load_system(path)


doubles = st.floats(allow_nan=False, allow_infinity=False)


@given(
    A=hnp.arrays(np.float64, (2, 2), elements=doubles),
    d=st.floats(0, 1e308),
    flags=st.tuples(st.booleans(), st.booleans()),
)
def test_json_brings_back_every_double(A: Any, d: float, flags: tuple[bool, bool]) -> None:
    """Any finite doubles, denormals and negative zeros included, through JSON's text."""
    system = DelaySystem(A, A, E=A, H=A[:1], delays=[Delay(d, A, None, *flags)])
    again = system_from_json(json.loads(json.dumps(system_to_json(system))))
    _same(again, system)
    np.testing.assert_array_equal(np.signbit(again.A), np.signbit(system.A))


def test_the_paper_and_a_bare_system_survive_json() -> None:
    """With everything, and with nothing but A: shapes without entries come back, too."""
    for system in (paper_example.system(), DelaySystem([[-1.0]]), _read(SEVERAL).system):
        _same(system_from_json(system_to_json(system)), system)


@pytest.mark.parametrize("data", [None, 3, [], {}, {"A": 3}, {"A": [[1.0]], "delays": 3}])
def test_json_that_is_no_system_is_bad_input(data: Any) -> None:
    """Whatever stands in place of a system's table is refused."""
    with pytest.raises(InputError):
        system_from_json(data)


def test_weights_and_design_constraints_are_read() -> None:
    """`weights` scale the rows of z; what a design is to meet stands in [design]."""
    text = PAPER.replace("d = 0.3\n", "d = 0.3\nweights = [0.5, 2]\n")
    text += "decay = 0.5\ngain_limit = 2\npeak_control = [3]\noffset = [1, 0.5]\nenergy = 1.0\n"
    read = _read(text)
    np.testing.assert_array_equal(read.system.D, np.diag([0.5, 2.0]) @ read.unweighted.D)
    assert read.weights == (0.5, 2.0)
    assert read.design_constraints.decay == 0.5
    assert read.design_constraints.gain_limit == 2.0
    assert (read.design_constraints.peak_control, read.design_constraints.offset) == (
        (3.0,),
        (1.0, 0.5),
    )
    assert read.design_constraints.energy == 1.0
    assert not _read(PAPER).design_constraints.any


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("decai = 0.5", ["design.decai'", "did you mean decay"]),
        ("peak = 0.5", ["design.peak'", "peak_control"]),
        ("decay = -0.5", ["decay", "positive"]),
        ('decay = "fast"', ["design.decay", "'fast'"]),
        ("peak_control = [1, 2]\noffset = [1, 0]", ["design.peak_control", "one per input"]),
        ("peak_control = 1\noffset = 1", ["design.offset", "a list"]),
        ("peak_control = 1\noffset = [1]", ["design.offset", "one per state"]),
        ("peak_control = 1", ["design.peak_control", "from nothing"]),
        ("energy = 1", ["design.energy", "peak_control"]),
        ("gain_limit = 0", ["design.gain_limit", "positive"]),
    ],
)
def test_wrong_design_constraints_are_named(line: str, words: list[str]) -> None:
    """The key, what was expected, and the nearest key where it is misspelt."""
    with pytest.raises(InputError) as caught:
        _read(f"{PAPER}{line}\n")
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("weights = [1.0]", ["system.weights", "2 numbers"]),
        ("weights = 3", ["system.weights", "a list"]),
        ("weights = [1, 0]", ["system.weights", "positive"]),
        ("wheights = [1, 1]", ["system.wheights'", "did you mean weights"]),
    ],
)
def test_weights_that_are_wrong_are_named(line: str, words: list[str]) -> None:
    """The same for the rows of z."""
    with pytest.raises(InputError) as caught:
        _read(PAPER.replace("d = 0.3\n", f"d = 0.3\n{line}\n"))
    for word in words:
        assert word in str(caught.value)


def test_nothing_is_collected_where_nesting_uses_up_the_stack(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A finaliser would fail there and print why; the collector goes on afterwards."""
    seen: list[bool] = []

    def loads(_text: str) -> dict[str, object]:
        seen.append(gc.isenabled())
        raise RecursionError

    monkeypatch.setattr("cosim.core.toml_text.tomllib.loads", loads)
    with pytest.raises(InputError, match="malformed TOML"):
        parse_toml("", "here")
    assert seen == [False]
    assert gc.isenabled()
