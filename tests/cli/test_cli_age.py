"""`cosim age`: as a table, as JSON, as a picture; facts of a modem; what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.shell import cosim

LOOP = """
[system]
A = [[0.5]]
B = [[1.0]]
C = [[1.0]]
D = [[1.0], [0.0]]
D2 = [[0.0], [0.3]]
"""
FACTS = ("--bit-rate", "1000", "--packet", "5", "--range", "15", "--slot", "0.1", "--losses", "1")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with an unstable plant of one state in it."""
    (tmp_path / "loop.toml").write_text(LOOP, "utf-8")
    return tmp_path


@pytest.mark.slow
def test_facts_of_a_modem_become_the_age_to_design_for(folder: Path) -> None:
    """Least age .04 + .01, greatest .05 + 2 x .1; the text and the picture say the same."""
    words = ("age", "loop.toml", *FACTS)
    found = cosim(*words, "--picture", "age.png", "--json", cwd=folder).json
    assert found["assumption"] == "sampled"
    assert found["least_age_s"] == pytest.approx(0.05)
    assert [row["age_s"] for row in found["rows"]] == pytest.approx([0.15, 0.25])
    assert found["gain_age_s"] == pytest.approx(0.25)
    assert [row["certified"] for row in found["rows"]] == [True] * 2
    gammas = [row["gamma"] for row in found["rows"]]
    assert gammas == sorted(gammas)
    limits = {limit["assumption"]: limit["age"] for limit in found["limits"]}
    assert limits["sampled"] > 0.25
    assert limits["any"] <= limits["constant"] <= limits["exact"]
    assert (folder / "age.png").read_bytes().startswith(b"\x89PNG")
    seen = cosim(*words, cwd=folder).out
    for text in ("8 x 5 byte / 1000 bit/s", "15 m / 1500 m/s", "(1 in a row + 1) x slot", "0.25 s"):
        assert text in seen
    assert f"{gammas[-1]:.5g}" in seen
    assert f"{limits['sampled']:.4g} s" in seen


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--range", "100"), "its bit rate and packet size are missing"),
        (("--bit-rate", "100"), "the time that a message takes to leave needs both"),
        (("--ages", "now"), "not a list of numbers"),
        (("--ages", "-1"), "not an age of messages"),
        (("--assumption", "old"), "old"),
        ((*FACTS, "--slot", "0.001"), "a message does not fit into its slot"),
        (("--ages", "0.1", "--gain", "[[1, 2]]"), "the gain does not fit"),
        (("--picture", "age.xyz", "--ages", "0.1"), "the picture cannot be written"),
    ],
)
def test_what_it_refuses(folder: Path, words: tuple[str, ...], message: str) -> None:
    """With exit code 2 and a message, and no file."""
    result = cosim("age", "loop.toml", *words, cwd=folder)
    assert result.code == 2
    assert message in result.err
    assert [path.name for path in folder.iterdir()] == ["loop.toml"]


@pytest.mark.slow
def test_an_age_that_no_gain_bears_ends_with_exit_code_5(folder: Path) -> None:
    """And what to do."""
    result = cosim("age", "loop.toml", "--ages", "30", "--gamma", "0.5", cwd=folder)
    assert result.code == 5
    assert "younger messages" in result.err
