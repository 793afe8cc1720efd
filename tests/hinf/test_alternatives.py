"""A refusal names what can be had instead, and following it to the letter succeeds."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import Result, cosim

from cosim import Delay, DelaySystem
from cosim.core import NotAchievableError
from cosim.hinf import design
from cosim.hinf.problem import with_delays

FIRST_ORDER = """[system]
A = [[1.0]]
B = [[1.0]]
[[system.delays]]
d = 2.0
feedback = true
any_age = true
"""
PENDULUM = """[system]
A = [[0.0, 1.0], [1.0, 0.0]]
B = [[0.0], [1.0]]
C = [[0.0], [1.0]]
D = [[1.0, 0.0], [0.0, 0.0]]
D2 = [[0.0], [1.0]]
[[system.delays]]
d = 0.3
feedback = true
any_age = true
"""
LATE_ANGLE = """[system]
A = [[0.0, 1.0], [1.0, 0.0]]
B = [[0.0], [1.0]]
[[measurements]]
name = "angle"
states = [1]
d = 3.0
any_age = true
"""
SEEDS = range(24)


def unstable(seed: int) -> tuple[DelaySystem, float | None]:
    """A random system of one or two states with a long delay, and a gamma for half of them."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 3))
    A = rng.normal(size=(n, n))
    A += (rng.uniform(0.3, 1.0) - np.linalg.eigvals(A).real.max()) * np.eye(n)
    more: dict[str, Any] = {}
    if seed % 2:
        more = {
            "C": rng.normal(size=(n, 1)),
            "D": np.vstack([np.eye(n)[:1], np.zeros((1, n))]),
            "D2": [[0.0], [1.0]],
        }
    kinds: list[dict[str, bool]] = [{"any_age": True}, {}, {"any_age": True, "sampled": True}]
    age = Delay(rng.uniform(3.0, 8.0), np.zeros((n, n)), feedback=True, **kinds[seed % 3])
    system = DelaySystem(A=A, B=rng.normal(size=(n, 1)), delays=[age], **more)
    return system, float(np.exp(rng.uniform(-1.0, 2.0))) if seed % 4 == 1 else None


def refusal(system: DelaySystem, gamma: float | None, **how: Any) -> NotAchievableError | None:
    """The error of a design; None where it is certified."""
    try:
        design(system, gamma=gamma, **how)
    except NotAchievableError as error:
        return error
    return None


def follow(system: DelaySystem, gamma: float | None, **how: Any) -> None:
    """Design; where it is refused, what the error names is certified when it is asked for."""
    error = refusal(system, gamma, **how)
    if error is None:
        return
    text = str(error)
    assert "envelope" not in text
    assert "k1" not in text
    if error.delays is None and error.gamma is None:
        assert "or more could be certified either" in text or "no gain stabilises" in text
    asked = [(error.delays, gamma), (None, error.gamma)]
    if error.together:
        asked = [(error.delays, error.gamma)]
    for delays, bound in asked:
        if (delays, bound) != (None, None):
            there = system if delays is None else with_delays(system, delays)
            assert design(there, gamma=bound, alternatives=False, **how).certified
        for number in delays or ():
            assert f"{number:g}" in str(error.hint)


@pytest.mark.parametrize("seed", [0, 1, 3, 4])
def test_what_theorem_2_has_instead_is_certified(seed: int) -> None:
    """A random system refused by Theorem 2: another delay or gamma, that it certifies."""
    follow(*unstable(seed), order=None)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_what_a_refusal_names_is_certified(seed: int) -> None:
    """The same where every route is tried, for ages of every kind."""
    follow(*unstable(seed))


def options(result: Result) -> list[str]:
    """The options that a refusal names last."""
    assert result.code == 5, result.err
    found = re.search(r": (--(?:gamma|delays|ages) \S+)", result.error["hint"])
    assert found is not None, result.err
    return found[1].rstrip(";").split()


def test_the_options_of_a_refusal_are_taken(tmp_path: Path) -> None:
    """A delay and a gamma: the command with the option that the message names is certified."""
    (tmp_path / "first.toml").write_text(FIRST_ORDER, "utf-8")
    (tmp_path / "pendulum.toml").write_text(PENDULUM, "utf-8")
    for command in (
        ("design", "first.toml", "--order", "theorem-2"),
        ("design", "pendulum.toml", "--order", "theorem-2", "--gamma", "1.5"),
        ("design", "paper", "--gamma", "5"),
    ):
        more = options(cosim(*command, "--json", cwd=tmp_path))
        kept = [x for x in command if x not in {"--gamma", "1.5", "5"}]
        assert cosim(*kept, *more, "--json", cwd=tmp_path).json["certified"], more


def test_an_analysis_says_what_its_gain_has(tmp_path: Path) -> None:
    """Unstable at the delay, or above the gamma: the option that the view names is certified."""
    (tmp_path / "p.toml").write_text(PENDULUM, "utf-8")
    given = ("analyse", "p.toml", "--gain", "[[-3.0, -3.0]]", "--json")
    for asked, option in ((("--delays", "2.0"), "--delays"), (("--gamma", "1.0"), "--gamma")):
        found = cosim(*given, *asked, cwd=tmp_path).json
        assert not found["certified"]
        named = re.search(rf"{option} \S+", found["hint"])
        assert named is not None, found["hint"]
        assert cosim(*given, *named[0].split(), cwd=tmp_path).json["certified"]


def test_a_hopeless_goal_says_so(tmp_path: Path) -> None:
    """A decay that no delay lets |K| allow: no delay is named, and the constraint is."""
    (tmp_path / "first.toml").write_text(FIRST_ORDER.replace("2.0", "0.2"), "utf-8")
    asked = ("--gain-limit", "0.5", "--order", "theorem-2")
    error = cosim("design", "first.toml", *asked, "--json", cwd=tmp_path).error
    assert "no age of 0.001 s or more could be certified either" in error["got"]
    assert error["hint"].startswith("weaker constraints than |K| <= 0.5: without any")


@pytest.mark.slow
def test_younger_messages_and_measurements(tmp_path: Path) -> None:
    """`age` names an age, and an observer the ages of its measurements; both are certified."""
    (tmp_path / "first.toml").write_text(FIRST_ORDER, "utf-8")
    more = options(cosim("age", "first.toml", "--ages", "2,3", "--json", cwd=tmp_path))
    assert cosim("age", "first.toml", *more, "--json", cwd=tmp_path).code == 0
    late = tmp_path / "late.toml"
    late.write_text(LATE_ANGLE, "utf-8")
    hint = cosim("design", "late.toml", "--json", cwd=tmp_path).error["hint"]
    age = re.search(r"angle of at most (\S+) s", hint)
    assert age is not None, hint
    late.write_text(LATE_ANGLE.replace("3.0", age[1]), "utf-8")
    assert cosim("design", "late.toml", "--json", cwd=tmp_path).json["certified"]
