"""Same scenario and seed, same content; everything that matters changes it."""

from __future__ import annotations

from pathlib import Path

from cli.shell import BUILT_IN, SCENARIOS, cosim, shared_run, trace_of

from cosim.trace import content_hash

LINKED = (SCENARIOS / "valid" / "over-a-packet-link.toml").read_text("utf-8")


def hash_of(text: str, fmus: Path, folder: Path) -> str:
    """Content hash of a scenario run from a new folder."""
    folder.mkdir()
    (folder / "given.toml").write_text(text, "utf-8")
    result = cosim("run", "given.toml", "--json", "--fmus", fmus.parent, cwd=folder)
    assert result.code == 0, result.err
    found: str = result.json["content_hash"]
    return found


def test_twice_in_one_process_from_two_folders(fmus: Path, tmp_path: Path) -> None:
    """Neither what ran before in the process nor the working directory is in the content."""
    assert hash_of(LINKED, fmus, tmp_path / "a") == hash_of(LINKED, fmus, tmp_path / "b")


def test_another_seed_gives_another_content_hash(fmus: Path, tmp_path: Path) -> None:
    """The seed is what the links draw from."""
    other = LINKED.replace("step = 0.1", "step = 0.1\nseed = 2", 1)
    assert hash_of(LINKED, fmus, tmp_path / "a") != hash_of(other, fmus, tmp_path / "b")


def test_printed_hash_is_that_of_the_file() -> None:
    """What `run` prints is what anyone computes from the trace; the runs differ."""
    printed = {name: shared_run(name).json["content_hash"] for name in BUILT_IN}
    assert printed == {name: content_hash(trace_of(name)) for name in BUILT_IN}
    assert len(set(printed.values())) == len(BUILT_IN)
