"""Files of an earlier version: read, checked and run as that version did."""

from __future__ import annotations

import json
import platform
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from corpus.answers import ANSWERS, ask, asked, machine
from corpus.faces import FACES
from corpus.files import FOLDERS, HERE, PACKED, corpus, kept
from corpus.make import AFTER, BEFORE, CASES
from shared import sampled, spread

from cosim.study import read_table

RECORDED: dict[str, Any] = json.loads(ANSWERS.read_text("utf-8"))
CORRECTED: list[dict[str, Any]] = tomllib.loads((HERE / "corrected.toml").read_text("utf-8")).get(
    "corrected", []
)
MOST_BYTES = 5_000_000
RUN_AGAIN = ("scenario", "rerun", "ssp", "study")
"""Faces that fly again."""
CORRECTABLE = (*RUN_AGAIN, "certificate")
"""Faces whose answers may be corrected: a system file is read anew beside its certificate."""
WORDS = ("not_met", "words")
"""Of runs that are run again compared only where a correction says them."""
BOUND = ("content_hash", "digest", "identical", "code", "differences")
"""What is the same on machines of one kind alone, of runs that are run again."""
LET_GO = {"ssp": ("tools",)}
"""What no version answers any more: which tools take an archive, by rules."""
ITERATED = ("abscissa", "exact_norm")
"""Figures that an iteration finds: their last digits are not what a version says."""
FITTED = ("link",)
"""Faces whose numbers are fits and means: their last digits depend on the processor."""
SUPPORT = ("scenarios/waves.csv", "studies/delays.toml", "store/")
"""Files that others need; they have no answer of their own."""
DEFAULT = {"report": 2, "rerun": 8, "export": 6, "certificate": 56, "diff": 12}
"""So many files of a face are asked about by default, and the others when slow tests run."""

linux = pytest.mark.skipif(
    (platform.system(), platform.machine()) != ("Linux", "x86_64"),
    reason="the FMUs of the corpus have binaries for x86_64 Linux alone",
)


def members() -> Iterator[Any]:
    """Every face with every file, the slow ones marked."""
    for face in FACES:
        of_face = [(one, name) for one, name in asked() if one == face]
        yield from sampled(of_face, DEFAULT.get(face, len(of_face)))


def same(old: Any, new: Any, where: str, *, exact: bool) -> None:
    """Compare an answer with a recorded one; a newer version may say more."""
    if isinstance(old, Mapping):
        assert isinstance(new, Mapping), where
        for key, value in old.items():
            assert key in new, f"{where}: no {key!r} any more"
            same(value, new[key], f"{where}.{key}", exact=exact and key not in ITERATED)
    elif isinstance(old, list):
        assert isinstance(new, list), where
        assert len(old) == len(new), where
        for i, (one, other) in enumerate(zip(old, new, strict=True)):
            same(one, other, f"{where}[{i}]", exact=exact)
    elif isinstance(old, float) and not exact and isinstance(new, int | float):
        assert new == pytest.approx(old, rel=1e-6, abs=1e-6), where
    else:
        assert new == old, where


def expected(face: str, name: str, *, here: bool) -> dict[str, Any]:
    """The recorded answer, corrected; without what is bound to another kind of machine."""
    left_out = LET_GO.get(face, ())
    if face in RUN_AGAIN:
        left_out += WORDS if here else (*WORDS, *BOUND)
    recorded: dict[str, Any] = RECORDED[face][name]
    answer = {key: value for key, value in recorded.items() if key not in left_out}
    for entry in CORRECTED:
        if (entry["face"], entry["file"]) == (face, name):
            answer = merged(answer, entry["answer"])
    return answer


def merged(answer: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """An answer with the entries of another one, inside its tables too."""
    found = dict(answer)
    for key, value in other.items():
        own = found.get(key)
        both = isinstance(own, Mapping) and isinstance(value, Mapping)
        found[key] = merged(own, value) if both else value
    return found


@linux
@pytest.mark.parametrize(("face", "name"), sampled(spread(members(), 3), 80))
def test_the_answer_is_the_recorded_one(face: str, name: str, tmp_path: Path) -> None:
    """Of the command line and both checkers; what was wrong then stands in corrected.toml."""
    here = machine() == RECORDED["machine"]
    if face == "study" and not here:
        pytest.skip("a study continues with the versions that it was begun with")
    answer = ask(face, name, tmp_path)
    exact = here and face not in FITTED
    same(expected(face, name, here=here), answer, f"{face} {name}", exact=exact)


def test_every_file_has_its_answers_and_every_answer_its_file() -> None:
    """Neither a file that nobody asks about, nor an answer about one that is gone."""
    assert {face: sorted(names) for face, names in RECORDED.items() if face != "machine"} == {
        face: sorted(name for one, name in asked() if one == face) for face in FACES
    }
    about = {name for _, name in asked()}
    studies = tuple(name.removesuffix("study.json") for name in about if "/study.json" in name)
    alone = {name for name in kept() if not name.startswith((*SUPPORT, *studies))}
    assert alone <= about | {"results/part-1", "results/part-2"}, alone - about


def test_every_file_is_made_by_a_command_that_the_readme_names() -> None:
    """Each case of make.py has its files, and stands in the README with its command."""
    readme = (HERE / "README.md").read_text("utf-8")
    names = [name for name, _ in CASES] + [*BEFORE, *AFTER]
    for name in names:
        assert f"`{name}`" in readme, name
        assert any(one == name or one.startswith(f"{name}/") for one in kept()), name
    for name, words in CASES:
        assert f"`cosim {words} {name}`" in readme, name
    made = tuple(f"{name}/" for name in names)
    sources = ("systems/", "scenarios/", "studies/")
    for name in kept():
        assert name in {*names, "traces/recovered.mcap"} or name.startswith((*made, *sources)), name


def test_the_corpus_is_small_and_its_folders_are_known() -> None:
    """Less than five megabytes; a file in a folder that nobody lists would be forgotten."""
    files = [path for path in HERE.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    assert sum(path.stat().st_size for path in files) < MOST_BYTES
    folders = {path.relative_to(HERE).parts[0] for path in files if path.parent != HERE}
    assert folders - {"__pycache__"} == set(FOLDERS)
    for path in files:
        packed = path.suffix == ".xz"
        assert packed == any(path.match(pattern) for pattern in PACKED), path


def test_every_correction_is_about_an_answer_and_says_why() -> None:
    """Of a run that is run again, once, with another answer than the recorded one."""
    about = [(entry["face"], entry["file"]) for entry in CORRECTED]
    assert len(set(about)) == len(about)
    for entry in CORRECTED:
        assert set(entry) == {"face", "file", "reason", "answer"}
        assert entry["face"] in CORRECTABLE
        assert len(entry["reason"]) > 10
        recorded = RECORDED[entry["face"]][entry["file"]]
        assert set(entry["answer"]) <= set(recorded)
        assert any(recorded[key] != value for key, value in entry["answer"].items())


def test_the_corpus_has_every_kind_that_a_file_can_be() -> None:
    """Kinds of certificates, words for ages, guarantees; statuses, types of signals."""
    certificates = [
        json.loads((corpus() / name).read_text("utf-8"))
        for name in kept()
        if name.startswith("certificates/")
    ]
    assert {one.get("kind") for one in certificates} == {
        None, "analysis", "ages", "refutation", "gamma floor", "norm", "output-feedback",
    }  # fmt: skip
    claims = [one["claim"] for one in certificates]
    assert {delay["age"] for claim in claims for delay in claim.get("delays", ())} == {
        "any, however it varies, from least_age to d",
        "any, however it varies, up to d",
        "constant, exactly d",
        "constant, it or more",
        "constant, up to d",
        "from least_age to d, |age'| <= rate",
        "sampled: from least_age at rate one to d at most",
    }
    assert {key for claim in claims for key in claim.get("guarantees", ())} == {
        "damping", "decay", "gain_limit", "outages", "peak_control", "state_peaks",
    }  # fmt: skip
    traces = RECORDED["trace"].values()
    outcomes = [one["outcome"] for one in traces]
    assert {one and one["status"] for one in outcomes} == {
        None, "diverged", "failed", "finished", "stopped",
    }  # fmt: skip
    assert {one["verdict"] for one in traces} == {None, "good", "open", "bad"}
    schemas = {schema for one in traces for _, schema, _ in one["topics"].values()}
    assert {"foxglove.PoseInFrame", "foxglove.SceneUpdate", "foxglove.Log"} <= schemas


def test_a_half_done_study_has_runs_left() -> None:
    """Some of the runs are in its log, and no table: continuing it is no matter of reading."""
    table, manifest = read_table(corpus() / "results" / "half")
    assert 0 < table.num_rows < manifest["count"]
    assert not (corpus() / "results" / "half" / "results.parquet").exists()
