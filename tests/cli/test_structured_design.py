"""Feedback of single states and integral action from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from shell import cosim

SYSTEM = """
[system]
A = [[0.0, 1.0], [0.0, -0.2]]
B = [[0.0], [1.0]]
C = [[0.0], [1.0]]
D = [[0.3, 0.0], [0.0, 0.0]]
D2 = [[0.0], [1.0]]
[[system.delays]]
d = 0.5
feedback = true
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Give a folder with the system."""
    (tmp_path / "axis.toml").write_text(SYSTEM, "utf-8")
    return tmp_path


def test_an_integral_is_designed_saved_and_checked(folder: Path) -> None:
    """The certificate is of the augmented system, and the answer names the integral."""
    made = cosim(
        "design", "axis.toml", "--integral", "1", "--order", "0", "--save", "d.json", cwd=folder
    )
    assert made.code == 0, made.err
    assert "integrals" in made.out
    saved = json.loads((folder / "d.json").read_text("utf-8"))
    assert saved["system"]["integrals"] == 1
    assert saved["system"]["feedback"] == [False, False, True]
    assert all(saved["K"][0])
    checked = cosim("certificate", "check", "d.json", "--json", cwd=folder)
    assert checked.code == 0, checked.err


def test_one_measured_state_is_enough_here(folder: Path) -> None:
    """Position alone, late, holds the axis; the other column is zero."""
    made = cosim("design", "axis.toml", "--measured", "1", "--order", "1", "--json", cwd=folder)
    assert made.code == 0, made.err
    assert made.json["K"][0][0] < 0
    assert made.json["K"][0][1] == 0
    assert made.json["exact_norm"] <= made.json["gamma"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--measured", "3"), ("measured", "from 1 to 2")),
        (("--integral", "0"), ("--integral", "whole numbers from 1 on")),
        (("--integral", "1", "--integral-age=-1"), ("integral.age",)),
        (("--measured", "1", "--decay", "0.1"), ("whole state",)),
        (("--measured", "1", "--max-delay", "--gamma", "9"), ("whole state",)),
    ],
)
def test_wrong_numbers_and_combinations_are_refused(
    folder: Path, options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    """Exit code 2, and what was expected."""
    made = cosim("design", "axis.toml", *options, cwd=folder)
    assert made.code == 2, made.out
    assert all(word in made.err for word in words), made.err
