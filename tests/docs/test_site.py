"""What the site generates from the code is complete: keys, commands, public names, settings."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path
from typing import Any

import pytest
from cli.commands import listed_commands

import cosim
from cosim.core import InputError
from cosim.hinf.problem import system_from_toml, system_schema
from cosim.scenario import json_schema
from cosim.study import Study
from docs_site import api_pages, cli_page, toml_pages
from docs_site.offline import loaded_from_elsewhere

ROOT = Path(cosim.__file__).parents[1]
SETTINGS = ROOT.joinpath("mkdocs.yml").read_text("utf-8")


def properties(schema: Any, where: str = "top level") -> list[tuple[str, str, Any]]:
    """Return table, key and what is said of it, for every key of a JSON schema."""
    parts = {where: schema, **schema.get("$defs", {})}
    tables = [(name, part) for name, part in parts.items() if "properties" in part]
    tables += [("else", schema["else"])] if "else" in schema else []
    return [
        (table, key, value) for table, part in tables for key, value in part["properties"].items()
    ]


@pytest.mark.parametrize("what", ["scenario", "study", "system"])
def test_every_key_of_a_file_is_described(what: str) -> None:
    """In the schema, where editors find it, and so on the page."""
    schemas = {"scenario": json_schema, "study": Study.model_json_schema, "system": system_schema}
    found = properties(schemas[what]())
    assert len(found) > 40
    bare = [f"{table}: {key}" for table, key, value in found if not value.get("description")]
    assert bare == []
    name = {"scenario": "scenarios", "study": "studies", "system": "systems"}[what]
    page = toml_pages.pages()[f"reference/{name}.md"]
    missing = [
        key for table, key, _ in found if "In_extension" not in table and f"`{key}`" not in page
    ]
    assert missing == []


MEASURED = '[system]\nA = [[-1.0]]\nB = [[1.0]]\n[[measurements]]\nname = "y"\nstates = [1]\n'
TABLES = {
    "SystemTable": "[system]\nA = [[-1.0]]\n",
    "DelayPart": "[system]\nA = [[-1.0]]\n[[system.delays]]\nd = 1.0\n",
    "IntegralPart": "[system]\nA = [[-1.0]]\n[system.integral]\nof = [1]\n",
    "FilterPart": "[system]\nA = [[-1.0]]\n[weights.z]\n",
    "FiltersPart": "[system]\nA = [[-1.0]]\n[weights]\n",
    "DesignPart": "[system]\nA = [[-1.0]]\n[design]\n",
    "SensorPart": MEASURED,
    "ObserverPart": f"{MEASURED}[observer]\n",
}
"""Every table of a system file by the name of its part, in a file that has little else."""


def refusal(table: str, key: str) -> InputError:
    """Return what is said of a system file with this key, and no value that fits it."""
    start = TABLES[table]
    text = re.sub(rf"(?m)^{key} = .*\n", "", start) if start.count(f"\n{key} = ") else start
    if text != start and table == "SystemTable":
        text = "[system]\n"
    with pytest.raises(InputError) as refused:
        system_from_toml(f'{text}{key} = {{ x = "y" }}\n', where="file", name="file")
    return refused.value


def test_every_table_of_a_system_file_is_tried_here() -> None:
    """A new one is given a text above."""
    assert set(system_schema()["$defs"]) == {*TABLES}


@pytest.mark.parametrize("table", TABLES)
def test_a_system_file_has_the_keys_that_are_documented(table: str) -> None:
    """The reader knows each of them, refuses another one, and then names these."""
    keys = system_schema()["$defs"][table]["properties"]
    for key in keys:
        assert not re.search(rf"no key '.*\b{key}'", refusal(table, key).what)
    unknown = refusal(table, "no_such_key")
    assert "there is no key" in unknown.what
    assert set(str(unknown.expected).split(", ")) == set(keys)
    page = toml_pages.pages()["reference/systems.md"]
    assert all(f"| `{key}` |" in page for key in keys)


def test_every_command_and_option_is_on_the_page() -> None:
    """Hidden ones excepted; each with words beside it."""
    page = cli_page.page()

    found = list(listed_commands())
    assert {"run", "study run", "trace rerun"} < {each.words for each in found}
    for each in found:
        assert f"# cosim {each.words}\n" in page
        for parameter in each.command.params:
            if not parameter.hidden:
                assert parameter.help, (each.words, parameter.name)
    assert page.count("\n| `--") > 100


def documented(place: str) -> bool:
    """Whether the source has a docstring, or a string below an assignment, at this place."""
    module, _, name = place.rpartition(".")
    path = ROOT.joinpath(*module.split("."))
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    itself = ROOT.joinpath(*place.split("."))
    if itself.is_dir() or itself.with_suffix(".py").exists():
        return importlib.import_module(place).__doc__ is not None  # a module
    body = ast.parse(path.read_text("utf-8")).body
    for node, below in zip(body, [*body[1:], ast.Pass()], strict=True):
        if (
            isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
            and node.name == name
        ):
            return bool(ast.get_docstring(node))
        targets = getattr(node, "targets", [getattr(node, "target", getattr(node, "name", None))])
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            return isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
    return False


def test_every_public_name_is_documented() -> None:
    """All of them: each name of each face has a docstring, and stands on a page."""
    pages = api_pages.pages()
    text = "\n".join(pages.values())
    faces = ("cosim", *api_pages.FACES)
    names = {face: api_pages.names_of(face) for face in faces}
    for face, found in names.items():
        assert set(found) == set(importlib.import_module(face).__all__)
    places = {place for found in names.values() for place in found.values()}
    assert len(places) > 350
    assert sorted(place for place in places if not documented(place)) == []
    version = "cosim.core.version.__version__"
    assert sorted(place for place in places if f"::: {place}\n" not in text) == [version]


def test_an_undocumented_name_is_seen() -> None:
    """The check above, of names that have no docstring."""
    assert documented("cosim.models.delay_system.DelaySystem")
    assert not documented("cosim.hinf.problem.system_toml._ONE_DELAY")
    assert not documented("cosim.hinf.problem.system_toml.no_such_name")


def test_the_site_is_strict_and_needs_no_network(tmp_path: Path) -> None:
    """Warnings are errors, links and anchors are looked at, no font is fetched."""
    assert "\nstrict: true\n" in SETTINGS
    assert "  font: false" in SETTINGS
    assert "not_found: warn, anchors: warn" in SETTINGS
    assert "://" not in SETTINGS
    (tmp_path / "a.html").write_text('<a href="https://x.org/"><img src="c.png">', "utf-8")
    assert not list(loaded_from_elsewhere(tmp_path))
    (tmp_path / "b.html").write_text('<script src="https://x.org/a.js"></script>', "utf-8")
    (tmp_path / "c.css").write_text("@import url(//fonts.example/x.css)", "utf-8")
    assert len(list(loaded_from_elsewhere(tmp_path))) == 2


def test_warnings_are_counted() -> None:
    """A quiet build does not see its warnings, and would end well with broken links."""
    makefile = ROOT.joinpath("Makefile").read_text("utf-8")
    (command,) = re.findall(r"mkdocs build.*", makefile)
    assert "--strict" in command
    assert "--quiet" not in command
    assert "project docs" in ROOT.joinpath(".ci", "run").read_text("utf-8")
