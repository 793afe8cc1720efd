"""The words of the glossary: no name bears a retired noun, and every place it names exists."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from cli.commands import every_command

import cosim
from cosim.scenario import builtin_names, json_schema
from cosim.study import Study, builtin_studies

ROOT = Path(cosim.__file__).parents[1]
GLOSSARY = ROOT.joinpath("docs", "glossary.md").read_text("utf-8")


def retired() -> set[str]:
    """The first column of "Words not used", every form that is listed."""
    table = GLOSSARY.split("## Words not used")[1]
    rows = re.findall(r"^\| ([^|]+) \| [^|]+ \|$", table, re.MULTILINE)[1:]
    return {word.strip() for row in rows for word in row.split(",")} - {"---"}


RETIRED = retired()
FILLERS = {"found", "late", "own", "whole"}
LIBRARY = {*builtin_names(), *builtin_studies()}  # users name these: station keeping is a manoeuvre


def words(name: str) -> set[str]:
    """The words of an identifier, option, key or file name, in lower case."""
    return {word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)}


def offending(names: Iterator[tuple[str, str]]) -> list[str]:
    """Those that bear a retired noun, with where they stand."""
    return [f"{where}: {name}" for where, name in names if words(name) & RETIRED]


@cache
def product() -> list[Path]:
    """Every module of the product and of its tests."""
    folders = (ROOT / "cosim", ROOT / "fmu_src", ROOT / "tests")
    return [p for folder in folders for p in folder.rglob("*.py") if "__pycache__" not in p.parts]


@cache
def nodes(path: Path) -> list[ast.AST]:
    """The syntax tree of a module, if its text has a retired noun at all."""
    text = path.read_text("utf-8")
    return list(ast.walk(ast.parse(text))) if words(text) & RETIRED else []


def names_in(path: Path) -> Iterator[tuple[str, str]]:
    """Every class, function, argument, attribute and variable that a module makes."""
    where = str(path.relative_to(ROOT))
    for node in nodes(path):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield f"{where}:{node.lineno}", node.name
        elif isinstance(node, ast.arg):
            yield f"{where}:{node.lineno}", node.arg
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield f"{where}:{node.lineno}", node.attr
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield f"{where}:{node.lineno}", node.id
        elif isinstance(node, ast.alias) and node.asname:
            yield f"{where}:{node.lineno}", node.asname


def keys_in(path: Path) -> Iterator[tuple[str, str]]:
    """Every key of a dictionary that is written out, or that one is asked for."""
    where = str(path.relative_to(ROOT))
    for node in nodes(path):
        keys: list[ast.expr | None] = []
        if isinstance(node, ast.Dict):
            keys = list(node.keys)
        elif isinstance(node, ast.Subscript):
            keys = [node.slice]
        for key in keys:
            if isinstance(key, ast.Constant) and isinstance(key.value, str):
                yield f"{where}:{key.lineno}", key.value


def commands() -> Iterator[tuple[str, str]]:
    """Every command, option and argument of the command line."""
    for found in every_command():
        yield found.words, found.path[-1]
        for parameter in found.command.params:
            for name in (*parameter.opts, parameter.name):
                yield found.words, name


def schema_keys(schema: Any, where: str) -> Iterator[tuple[str, str]]:
    """Every property of a JSON schema, and every word that a property may be."""
    if isinstance(schema, dict):
        for name in schema.get("properties", {}):
            yield where, name
        yield from ((where, str(value)) for value in schema.get("enum", []) if value not in LIBRARY)
        for value in schema.values():
            yield from schema_keys(value, where)
    elif isinstance(schema, list):
        for value in schema:
            yield from schema_keys(value, where)


def test_the_retired_nouns_are_read() -> None:
    """The table is found, and the guard below is not empty."""
    assert {"station", "beat", "crew", "luck", "told"} <= RETIRED
    assert words("LimitedProblem") & RETIRED
    assert not words("heappush_sending") & RETIRED


def test_no_file_or_folder_bears_a_retired_noun() -> None:
    """Modules, tests, libraries."""
    stems = [(str(path), part) for path in product() for part in path.relative_to(ROOT).parts]
    assert offending(iter(stems)) == []


def test_no_name_bears_a_retired_noun() -> None:
    """Classes, functions, arguments, attributes, variables: product and tests alike."""
    assert offending(item for path in product() for item in names_in(path)) == []


@pytest.mark.parametrize("package", ["hinf", "models", "vehicle", "paper"])
def test_no_variable_has_a_filler_for_a_name(package: str) -> None:
    """What is found, late, one's own or the whole has a name: a margin, delays, units, the loop."""
    bad = []
    for path in (p for p in product() if p.is_relative_to(ROOT / "cosim" / package)):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            stored = isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
            name = node.id if stored else node.arg if isinstance(node, ast.arg) else ""
            if name in FILLERS:
                bad.append(f"{path.relative_to(ROOT)}:{node.lineno}: {name}")
    assert bad == []


def test_no_key_of_the_product_bears_a_retired_noun() -> None:
    """JSON, metadata and TOML keys, as the code writes and reads them."""
    code = [path for path in product() if path.relative_to(ROOT).parts[0] != "tests"]
    assert offending(item for path in code for item in keys_in(path)) == []


def test_no_option_bears_a_retired_noun() -> None:
    """Every verb of the command line, hidden ones included."""
    found = list(commands())
    assert len(found) > 150
    assert offending(iter(found)) == []


@pytest.mark.parametrize("what", ["scenario", "study"])
def test_no_key_of_a_schema_bears_a_retired_noun(what: str) -> None:
    """Scenario and study files."""
    schema = json_schema() if what == "scenario" else Study.model_json_schema()
    found = list(schema_keys(schema, what))
    assert len(found) > 20
    assert offending(iter(found)) == []


def test_every_place_that_the_glossary_names_exists() -> None:
    """Modules, and the public names beside them."""
    code: set[str] = set()
    for path in (ROOT / "cosim").rglob("*.py"):
        code.update(re.findall(r"\w+", path.read_text("utf-8")))
    rows = re.findall(r"^\| \*\*.+$", GLOSSARY, re.MULTILINE)
    assert len(rows) > 60
    for row in rows:
        place = re.split(r"(?<!\\)\|", row)[3]
        for pattern in re.findall(r"`([\w/*]+\.py)`", place):
            base = ROOT if pattern.startswith("fmu_src") else ROOT / "cosim"
            assert list(base.glob(pattern)) or list(base.rglob(pattern)), (pattern, row)
        beside = re.sub(r"`[^`]*`", "", place)
        for name in re.findall(r"\b[A-Z][a-z]+[A-Z]\w+\b|\b[a-z]+_[a-z_]+[a-z]\b", beside):
            assert name in code, (name, row)
