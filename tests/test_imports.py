"""No module imports one that imports it in turn, by whatever way round."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def _modules() -> dict[str, Path]:
    """Every module of the product, by its dotted name; a package is its __init__."""
    found = {}
    for top in ("cosim", "fmu_src"):
        for path in (ROOT / top).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def _imported(text: str, package: str, modules: set[str]) -> set[str]:
    """What a module of this package imports, in functions and for types alone as well."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) + 1 - node.level]
            base = ".".join([*(above if node.level else []), *filter(None, [node.module])])
            for alias in node.names:
                full = f"{base}.{alias.name}"
                found.add(full if full in modules else base)
    return found & modules


def _ring(texts: dict[str, str]) -> list[str]:
    """Modules that import each other in this order, the first one again at the end; or none."""
    names = set(texts)
    packages = {name.rpartition(".")[0] for name in names}
    graph = {
        name: _imported(text, name if name in packages else name.rpartition(".")[0], names) - {name}
        for name, text in texts.items()
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        ring: list[str] = error.args[1]
        return ring
    return []


def test_imports_go_round_in_no_circle() -> None:
    """Neither at the top, nor inside a function, nor under TYPE_CHECKING."""
    texts = {name: path.read_text("utf-8") for name, path in _modules().items()}
    assert len(texts) > 400
    ring = _ring(texts)
    assert not ring, " <- ".join(ring)


@pytest.mark.parametrize(
    "back",
    [
        "import p.a",
        "from p import a",
        "from p.a import x",
        "from . import a",
        "from .a import x",
        "def f():\n    from p.a import x",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from p.a import x",
    ],
)
def test_a_circle_is_found_wherever_it_is_closed(back: str) -> None:
    """The check itself: a imports b, b imports a in each of these ways."""
    assert set(_ring({"p": "", "p.a": "from p.b import y", "p.b": back})) == {"p.a", "p.b"}
    assert not _ring({"p": "", "p.a": "from p.b import y", "p.b": "import json"})
