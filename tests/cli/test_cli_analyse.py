"""`cosim analyse`: what a given gain guarantees, for programs and for people."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli.shell import cosim
from shared import sampled

from cosim.core import InputError
from cosim.hinf import Result

BENCHMARK = """
[system]
A = [[-2.0, 0.0], [0.0, -0.9]]
A1 = [[-1.0, 0.0], [-1.0, -1.0]]
d = 1.0
"""
"""Stable exactly for d < 6.172581371 (published)."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the benchmark in it."""
    (tmp_path / "benchmark.toml").write_text(BENCHMARK, "utf-8")
    return tmp_path


def test_the_printed_gain_and_its_certificate(folder: Path) -> None:
    """Theorem 1 gives 5.0455 for the printed K; the certificate is proved from its file."""
    words = ("analyse", "paper", "--gain", "[[0.6432, -0.5679]]")
    found = cosim(*words, "--save", "a.json", "--json", cwd=folder).json
    assert found["certified"] is True
    assert found["gamma"] == pytest.approx(5.0455, abs=1e-4)
    assert 5.0 < found["exact_norm"] < found["gamma"]
    assert found["K"] == [[0.6432, -0.5679]]
    assert found["delays"] == [0.3]
    assert (found["k1"], found["k2"], found["reason"]) == (None, None, None)
    assert found["certificate"] == "a.json"
    checked = cosim("certificate", "check", "a.json", "--json", cwd=folder)
    assert checked.json["valid"] is True
    seen = cosim("certificate", "check", "a.json", "--details", cwd=folder)
    assert "Theorem 1" in seen.out
    data = json.loads((folder / "a.json").read_text("utf-8"))
    data["variables"]["gamma"] = data["claim"]["gamma"] = "5"
    (folder / "b.json").write_text(json.dumps(data), "utf-8")
    assert cosim("certificate", "check", "b.json", cwd=folder).code == 1
    assert "5.04547" in cosim(*words, cwd=folder).out


def test_a_scenario_is_analysed_with_the_gain_it_gives(folder: Path) -> None:
    """The scenario of the paper flies with the printed K."""
    found = cosim("analyse", "paper-example", "--json", cwd=folder).json
    assert found["K"] == [[0.6432, -0.5679]]
    assert found["gamma"] == pytest.approx(5.0455, abs=1e-4)


@pytest.mark.parametrize(
    ("order", "ladder"), sampled([(1, 6.059), (0, 4.472), (2, 6.1689), (3, 6.1725)], 1)
)
def test_the_greatest_delay_of_the_system_as_it_is(folder: Path, order: int, ladder: float) -> None:
    """The published ladder of greatest delays, each below the exact one."""
    words = ("analyse", "benchmark.toml", "--max-delay", "--order", str(order))
    found = cosim(*words, "--json", cwd=folder).json
    assert found["certified"] is True
    assert ladder <= found["delays"][0] < min(found["not_certified_at"], 6.172581371)
    assert found["limit_reached"] is False
    assert found["up_to_delays"] is True
    assert (found["gamma"], found["K"], found["exact_norm"]) == (None, None, None)
    assert "not certified at" in cosim(*words, cwd=folder).out


def test_what_is_not_certified_is_a_result(folder: Path) -> None:
    """Exit code 0: an unstable delay, a delay beyond Theorem 1 alone, a gamma below |D1| = 5."""
    paper = ("paper", "--gain", "[[0.6432, -0.5679]]", "--gamma", "5")
    benchmark = "benchmark.toml"
    beyond = (benchmark, "--delays", "4.4722", "--order", "0")
    for words in (paper, (benchmark, "--delays", "6.2"), beyond):
        result = cosim("analyse", *words, "--save", "none.json", "--json", cwd=folder)
        assert result.code == 0
        assert result.json["certified"] is False
        assert result.json["reason"]
        assert (result.json["gamma"], result.json["certificate"]) == (None, None)
        assert not (folder / "none.json").exists()
        assert "not certified" in cosim("analyse", *words, cwd=folder).out


def test_a_search_that_ends_at_its_limit_reports_it(folder: Path) -> None:
    """The printed loop is stable for every delay."""
    words = ("analyse", "paper-example", "--max-delay", "--delay-limit", "30")
    found = cosim(*words, "--json", cwd=folder).json
    assert found["delays"] == [30.0]
    assert found["limit_reached"] is True
    assert found["not_certified_at"] is None
    assert "longer delays may be certified too" in cosim(*words, cwd=folder).out


REFUSED = [
    (["papr"], "did you mean paper?"),
    (["paper", "--gain", "[[1]"], "not a matrix"),
    (["paper", "--gain", "0.6"], "not a matrix"),
    (["paper", "--gain", "[[NaN, 1]]"], "not a finite number"),
    (["paper", "--gain", "[[1]]"], "does not fit"),
    (["paper", "--order", "-1"], "not an order"),
    (["paper", "--order", "99"], "not an order"),
    (["paper", "--gamma", "-1"], "gamma must be a positive number"),
    (["benchmark.toml", "--gamma", "1"], "no gain to bound"),
    (["benchmark.toml", "--max-delay", "--delay-limit", "0"], "not a limit"),
    (["benchmark.toml", "--max-delay", "--gamma", "1"], "no gain"),
    (["benchmark.toml", "--delays", "1,2"], "delays"),
]


@pytest.mark.parametrize(("arguments", "message"), REFUSED, ids=str)
def test_analyse_refuses(arguments: list[str], message: str, folder: Path) -> None:
    """Bad input: exit 2, one JSON object, and what is wrong."""
    result = cosim("analyse", *arguments, "--json", cwd=folder)
    assert result.code == 2
    error = result.error
    assert message in " ".join(str(value) for value in error.values())


def test_an_analysis_is_no_design(folder: Path) -> None:
    """A valid proof about a gain that was given is not taken for a design to fly."""
    cosim("analyse", "benchmark.toml", "--save", "a.json", cwd=folder)
    data = json.loads((folder / "a.json").read_text("utf-8"))
    data["figures"] = {}
    with pytest.raises(InputError, match="not a design"):
        Result.from_json(data, where="a.json")


NETWORKED = """
[system]
A = [[0, 1], [0, -0.1]]
B = [[0], [0.1]]
[[system.delays]]
d = 1.3
feedback = true
"""


def test_ages_from_the_file_and_from_the_command_line(folder: Path) -> None:
    """A sampled feedback bears what an age of any variation does not; both say which it was."""
    (folder / "file.toml").write_text(
        NETWORKED + "sampled = true\nleast_age = 0.2\n", encoding="utf-8"
    )
    (folder / "plain.toml").write_text(NETWORKED + "any_age = true\n", encoding="utf-8")
    words = ("--gain", "[[-3.75, -11.5]]", "--order", "1")
    options = ("--least-ages", "0.2", "--sampled")
    one = cosim("analyse", "file.toml", *words, "--save", "a.json", "--json", cwd=folder).json
    other = cosim("analyse", "plain.toml", *words, *options, "--json", cwd=folder).json
    age = {"feedback": True, "any_age": True, "least_age": 0.2, "sampled": True}
    for found in (one, other):
        assert found["certified"] is True
        assert found["terms"] == [age]
    assert cosim("analyse", "plain.toml", *words, "--json", cwd=folder).json["certified"] is False
    seen = cosim("certificate", "check", "a.json", "--details", cwd=folder)
    assert seen.code == 0
    assert "ages as they are, order 1" in seen.out
    assert "a sampled age, a = least_age" in seen.out
    assert "sampled: grows at rate one" in cosim("analyse", "file.toml", *words, cwd=folder).out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--least-ages", "0.2,0.3"), "the least ages do not fit the system"),
        (("--least-ages", "1.3"), "less than d"),
        (("--least-ages", "0.2"), "constant delay"),
    ],
)
def test_impossible_ages_are_refused(folder: Path, options: tuple[str, ...], message: str) -> None:
    """With what was expected."""
    (folder / "plain.toml").write_text(NETWORKED, encoding="utf-8")
    found = cosim("analyse", "plain.toml", *options, cwd=folder)
    assert found.code == 2
    assert message in found.err
