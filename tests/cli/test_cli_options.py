"""What `cosim design` can be asked beside gamma: proved, saved, checked, and refused by name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli.shell import cosim

PAPER = ("design", "paper", "--k1", "0.6", "--k2", "0.2")

SYSTEM = """
[system]
A = [[0.0, 1.0], [1.0, -0.2]]
B = [[0.0], [1.0]]
C = [[0.0], [1.0]]
D = [[1.0, 0.0], [0.0, 0.0]]
D2 = [[0.0], [1.0]]
weights = [2.0, 1.0]

[[system.delays]]
d = 0.1
feedback = true
any_age = true

[design]
decay = 0.3
"""


def test_all_constraints_together_are_proved_and_checked_from_the_file(tmp_path: Path) -> None:
    """Decay, gain, peak: in the JSON, for people, and in the file that is checked again."""
    options = (
        *("--decay", "1", "--gain-limit", "0.5", "--peak-control", "0.6"),
        *("--offset", "1,0.5", "--energy", "0.1"),
    )
    done = cosim(*PAPER, *options, "--save", "gain.json", "--json", cwd=tmp_path)
    assert done.code == 0, done.err
    found = done.json
    assert found["decay"] == 1.0
    assert found["gain_limit"] <= 0.5
    assert found["peak_control"][0] <= 0.6
    assert (found["offset"], found["energy"]) == ([1.0, 0.5], 0.1)
    assert found["weights"] is None
    assert found["certified"] is True
    checked = cosim("certificate", "check", "gain.json", "--json", cwd=tmp_path)
    assert checked.code == 0
    assert set(checked.json["claim"]["guarantees"]) == {"decay", "gain_limit", "peak_control"}
    seen = cosim("certificate", "check", "gain.json", cwd=tmp_path).out
    assert "decays at least" in seen
    assert "singular value" in seen
    data = json.loads((tmp_path / "gain.json").read_text("utf-8"))
    data["claim"]["guarantees"]["decay"]["rate"] = "2"
    (tmp_path / "gain.json").write_text(json.dumps(data), "utf-8")
    assert cosim("certificate", "check", "gain.json", cwd=tmp_path).code == 1
    people = cosim(*PAPER, *options, cwd=tmp_path).out
    for word in ("rate of decay", "|K|", "peak of u_1", "certified"):
        assert word in people


@pytest.mark.slow
def test_damping_is_proved_by_both_verbs_and_checked_from_the_file(tmp_path: Path) -> None:
    """In the file, the command line last; for people with the roots it is for; not proved: why."""
    text = SYSTEM.replace("decay = 0.3", "damping = 0.5\nwithin = 9.0")
    (tmp_path / "my-system.toml").write_text(text, "utf-8")
    done = cosim(
        *("design", "my-system.toml", "--damping", "0.6", "--save", "gain.json", "--json"),
        cwd=tmp_path,
    )
    assert done.code == 0, done.err
    assert (done.json["damping"], done.json["within"]) == (0.6, 9.0)
    seen = cosim("certificate", "check", "gain.json", cwd=tmp_path).out
    assert "0.6 within 9 1/s" in seen
    assert "damping ratio -Re s / |s| > ratio" in " ".join(seen.split())
    loop = ("analyse", "my-system.toml", "--gain", json.dumps(done.json["K"]), "--within", "9")
    people = cosim(*loop, "--damping", "0.55", "--save", "loop.json", cwd=tmp_path).out
    assert "damping ratio" in people
    assert "Re s >= -9" in people
    checked = cosim("certificate", "check", "loop.json", "--json", cwd=tmp_path).json
    assert checked["claim"]["guarantees"]["damping"]["within"] == "9"
    missed = cosim(*loop, "--damping", "0.999", "--json", cwd=tmp_path).json
    assert (missed["certified"], missed["damping"]) == (True, None)
    assert "characteristic roots" in missed["damping_reason"]
    assert "not proved" in cosim(*loop, "--damping", "0.999", cwd=tmp_path).out


def test_without_design_constraints_nothing_is_reported(tmp_path: Path) -> None:
    """All of them null."""
    found = cosim(*PAPER, "--json", cwd=tmp_path).json
    names = ("decay", "damping", "within", "gain_limit", "peak_control", "offset", "energy")
    assert [found[name] for name in (*names, "weights")] == [None] * 8


def test_a_system_file_needs_no_k1_k2(tmp_path: Path) -> None:
    """Weights and decay as its file says; the command line has the last word."""
    (tmp_path / "my-system.toml").write_text(SYSTEM, "utf-8")
    own = cosim("design", "my-system.toml", "--json", cwd=tmp_path)
    assert own.code == 0, own.err
    assert own.json["weights"] == [2.0, 1.0]
    assert own.json["decay"] == 0.3
    assert own.json["abscissa"] <= -0.3
    other = cosim(
        *("design", "my-system.toml", "--weights", "1,1", "--decay", "0.5", "--json"),
        cwd=tmp_path,
    ).json
    assert other["weights"] == [1.0, 1.0]
    assert other["decay"] == 0.5
    assert other["gamma"] < own.json["gamma"]


@pytest.mark.parametrize(
    ("options", "code", "word"),
    [
        (("--decay", "-1"), 2, "rate of decay"),
        (("--damping", "0.5"), 2, "give both"),
        (("--damping", "2", "--within", "1"), 2, "between 0 and 1"),
        (("--gain-limit", "0"), 2, "gain_limit"),
        (("--peak-control", "1"), 2, "from nothing"),
        (("--peak-control", "1,2", "--energy", "1"), 2, "one per input"),
        (("--peak-control", "x", "--energy", "1"), 2, "--peak-control"),
        (("--offset", "1,1"), 2, "peak_control"),
        (("--weights", "1"), 2, "--weights"),
        (("--weights", "1,-1"), 2, "--weights"),
        (("--decay", "1", "--gamma", "6", "--max-delay"), 2, "for gamma alone"),
        (("--decay", "60"), 5, "decay at 60"),
    ],
)
def test_invalid_constraints_are_named(
    options: tuple[str, ...], code: int, word: str, tmp_path: Path
) -> None:
    """Exit code 2 for what makes no sense, 5 for what cannot be had."""
    done = cosim(*PAPER, *options, "--json", cwd=tmp_path)
    assert done.code == code
    reported = done.error
    assert word in " ".join(str(reported[key]) for key in ("what", "where", "expected", "got"))
