"""Both checkers say which entries of a file decide nothing; what they do not name, they read."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from changed_json import changed, leaves, refused
from cli.shell import cosim as cosim_command
from shared import sampled

from cosim.hinf import check_certificate
from cosim.hinf.certificate import standalone
from cosim.hinf.certificate.standalone import RefusedError, loaded

DESIGNS = Path(str(files("cosim.scenario").joinpath("library", "designs")))
NAMES = ("paper-late", "auv-outages-1.25s", "auv-playout-1.25s", "auv-remote")
LABELS = ("integrals",)  # read, and on no proof's way: another value may also be refused


@cache
def data_of(name: str) -> Any:
    """A pinned design, as its file holds it."""
    return json.loads((DESIGNS / f"{name}.json").read_text("utf-8"))


def not_read_by_the_second(data: Any) -> list[str]:
    """What it lists."""
    return list(standalone.not_read(loaded(json.dumps(data).encode())))


def refused_by_the_second(data: Any) -> bool:
    """Whether it refuses it."""
    try:
        standalone.check(json.dumps(data).encode())
    except RefusedError:
        return True
    return False


def as_text(path: tuple[Any, ...]) -> str:
    """A path as the checkers write it: measurements[0].over."""
    return "".join(f"[{x}]" if isinstance(x, int) else f".{x}" for x in path).lstrip(".")


def listed(path: tuple[Any, ...], keys: Any) -> bool:
    """Whether an entry stands under one of these keys."""
    return any(as_text(path[:k]) in keys for k in range(1, len(path) + 1))


def garbage(value: Any) -> Any:
    """No number, no truth value, another text."""
    return f"{value}, more or less"


def places(data: Any, keys: Any, step: int) -> list[tuple[Any, ...]]:
    """Some entries of a file: of its short parts, and of all."""
    found = list(leaves(data))
    few = [p for p in found if not listed(p, keys) and "variables" not in p and "A" not in p]
    return [*few[:: max(len(few) // step, 1)], *found[:: max(len(found) // step, 1)]]


@pytest.mark.parametrize("name", sampled(NAMES, 2))
def test_what_is_not_listed_is_read(name: str) -> None:
    """Garbage in place of any entry is refused, by both, or the entry is listed."""
    data = data_of(name)
    first, second = check_certificate(data).not_read, not_read_by_the_second(data)
    for path in places(data, first, 8 if name == "auv-remote" else 40):
        other = changed(data, path, garbage)
        assert refused(other) or listed(path, first), path
        assert refused_by_the_second(other) or listed(path, second), path


@pytest.mark.parametrize("name", sampled(NAMES, 2))
def test_what_is_listed_decides_nothing(name: str) -> None:
    """Whatever stands there, the claim is proved."""
    data = data_of(name)
    for keys, is_refused in (
        (check_certificate(data).not_read, refused),
        (not_read_by_the_second(data), refused_by_the_second),
    ):
        assert "figures" in keys
        for path in leaves(data):
            if as_text(path) in keys and path[-1] not in ("schema", "over", *LABELS):
                assert not is_refused(changed(data, path, garbage)), path
        for key in keys:
            if key in data and key != "schema":
                assert not is_refused({**data, key: {"anything": 1}}), key


def test_each_kind_lists_its_notes() -> None:
    """By key, those of the pair of an observer too; sentences where only one of them reads them."""
    data = data_of("auv-remote") | {"note": "mine"}
    first = set(check_certificate(data).not_read)
    second = set(not_read_by_the_second(data))
    assert {"note", "figures", "plant_note", "plant.name", "pair.system.name"} <= first
    assert {f"measurements[{i}].over" for i in range(len(data["measurements"]))} <= first
    assert second - first == {
        *("theorem", "claim.hypotheses", "pair.theorem", "pair.claim.hypotheses"),
    }
    assert first <= second
    wrong = changed(data, ("theorem", 0), garbage)
    assert refused(wrong)  # derived from the claim, and compared
    assert not refused_by_the_second(wrong)


def test_the_command_and_the_second_checker_print_them(tmp_path: Path) -> None:
    """In text and in JSON; "nothing" where nothing is left."""
    path = DESIGNS / "paper-late.json"
    result = cosim_command("certificate", "check", str(path), "--json", cwd=tmp_path)
    assert json.loads(result.out)["not_read"] == ["figures", "system.name"]
    text = " ".join(cosim_command("certificate", "check", str(path), cwd=tmp_path).out.split())
    assert "not read figures, system.name: nothing proves these" in text
    program = [sys.executable, "-m", "standalone"]
    shutil.copytree(Path(standalone.__file__).parent, tmp_path / "standalone")
    bare = {key: x for key, x in data_of("paper-late").items() if key not in ("figures", "theorem")}
    del (bare := json.loads(json.dumps(bare)))["system"]["name"]
    (tmp_path / "bare.json").write_text(json.dumps(bare), "utf-8")
    for file, line in (
        (path, "not read: figures, system.name"),
        (tmp_path / "bare.json", "not read: nothing"),
    ):
        done = subprocess.run(  # noqa: S603
            [*program, file], capture_output=True, text=True, check=True, cwd=tmp_path
        )
        assert done.stdout.splitlines()[-1] == line
