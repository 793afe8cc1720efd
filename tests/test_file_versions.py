"""Versions of the keys of scenarios, systems, studies and designs; `cosim migrate`."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from cli.shell import cosim

from cosim.core import (
    DESIGN_FILE,
    SCENARIO_FILE,
    STUDY_FILE,
    SYSTEM_FILE,
    FileKind,
    InputError,
    migrate,
    write_migrated,
)
from cosim.scenario import json_schema, load
from cosim.study import study_schema

SYSTEM = "# my plant\n[system]\nA = [[-1.0]]  # stable\nB = [[1.0]]\n"
FILES = {
    "scenario": ("s.toml", '# mine\r\n\r\nextends = "paper-example"\r\ntitle = "x"\r\n'),
    "system": ("s.toml", SYSTEM),
    "study": (
        "s.toml",
        """title = "x"
scenario = "paper-example"
metrics = { s = "status" }
[[vary]]
kind = "replicates"
count = 2
""",
    ),
    "design": ("s.json", None),
}
READ = {
    "scenario": ("scenario", "show"),
    "system": ("analyse",),
    "study": ("study", "check"),
    "design": ("certificate", "check"),
}


@pytest.fixture
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A file of the kind that the test names."""
    name, text = FILES[request.param]
    if text is None:
        library = Path(__file__).parents[1] / "cosim/scenario/library/designs/paper-late.json"
        text = library.read_text("utf-8")
    (tmp_path / name).write_bytes(text.encode())
    return tmp_path / name


@pytest.mark.parametrize(("file", "kind"), [(k, k) for k in FILES], indirect=["file"])
def test_a_file_says_its_version_and_a_newer_one_is_refused(file: Path, kind: str) -> None:
    """Absent is 1; migrated, it says so and is read alike; the next version is refused by name."""
    verb, folder = READ[kind], file.parent
    before = cosim(*verb, file.name, "--json", cwd=folder)
    assert before.code == 0, before.err
    found = cosim("migrate", "--check", file.name, "--json", cwd=folder)
    assert (found.code, found.json["files"][0]["kind"]) == (1, kind)
    old = file.read_bytes()
    assert cosim("migrate", file.name, cwd=folder).code == 0
    new = file.read_bytes()
    data = json.loads(new) if file.suffix == ".json" else tomllib.loads(new.decode())
    assert data.pop("schema") == 1
    if file.suffix == ".toml":
        assert (
            new.replace(b"schema = 1\r\n", b"").replace(b"schema = 1\n", b"").split() == old.split()
        )
    assert cosim(*verb, file.name, "--json", cwd=folder).out == before.out
    assert cosim("migrate", "--check", file.name, cwd=folder).code == 0
    file.write_bytes(
        new.replace(b"schema = 1", b"schema = 2").replace(b'"schema": 1', b'"schema": 2')
    )
    refused = cosim(*verb, file.name, "--json", cwd=folder)
    assert refused.code == 2
    assert f"this {kind} has schema version 2" in refused.error["what"]


def test_what_is_no_version_is_refused(tmp_path: Path) -> None:
    """Neither a text, nor zero, nor a truth value."""
    for wrong in ('"1"', "0", "true", "1.0"):
        with pytest.raises(InputError, match="not a schema version"):
            SYSTEM_FILE.from_toml(f"schema = {wrong}\n{SYSTEM}", "here")
    (tmp_path / "x.toml").write_text("a = 1\n", "utf-8")
    with pytest.raises(InputError, match="not a file whose keys have a version"):
        migrate(tmp_path / "x.toml")


def test_each_version_is_made_of_the_one_before(tmp_path: Path) -> None:
    """A kind with two steps: read at once, and written; comments that are lost stay beside it."""

    def renamed(data: dict[str, Any]) -> dict[str, Any]:
        return {"b" if key == "a" else key: value for key, value in data.items()}

    def doubled(data: dict[str, Any]) -> dict[str, Any]:
        return {**data, "b": 2 * data["b"]}

    kind = FileKind("thing", "{file}", (renamed, doubled))
    assert kind.version == 3
    assert kind.current({"a": 4}, "x") == kind.current({"schema": 2, "b": 4}, "x") == {"b": 8}
    assert kind.current({"schema": 3, "b": 8}, "x") == {"b": 8}
    path = tmp_path / "t.toml"
    path.write_text("# why\na = 4\n", "utf-8")
    kept = write_migrated(path, migrate(path, kind))
    assert tomllib.loads(path.read_text("utf-8")) == {"schema": 3, "b": 8}
    assert kept == tmp_path / "t.toml.v1"
    assert kept.read_text("utf-8") == "# why\na = 4\n"
    assert not migrate(path, kind).changes


def test_new_files_say_their_version(tmp_path: Path) -> None:
    """Those of `scenario new` and `design --save`; the schemas for editors know the key."""
    assert cosim("scenario", "new", "mine", cwd=tmp_path).code == 0
    assert cosim("scenario", "new", "more", "--from", "paper-example", cwd=tmp_path).code == 0
    assert (
        cosim(
            "design", "paper", "--k1", "0.6", "--k2", "0.2", "--save", "d.json", cwd=tmp_path
        ).code
        == 0
    )
    for name in ("mine.toml", "more.toml", "d.json"):
        assert not migrate(tmp_path / name).changes
    load(str(tmp_path / "mine.toml"))
    schema = json_schema()
    shapes = (schema["then"], schema["else"], study_schema())
    assert [s["properties"]["schema"]["maximum"] for s in shapes] == [1, 1, 1]
    assert {k.version for k in (SCENARIO_FILE, SYSTEM_FILE, STUDY_FILE, DESIGN_FILE)} == {1}
