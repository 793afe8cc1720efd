"""Run a notebook of docs/notebooks as a reader does, cell by cell in one namespace."""

from __future__ import annotations

import ast
import re
from contextlib import chdir
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"


def read(name: str) -> Any:
    """Read a notebook, whose form is checked."""
    import nbformat  # noqa: PLC0415 - two seconds, where it has grammars of addresses to compile

    notebook = nbformat.read(NOTEBOOKS / name, as_version=4)
    nbformat.validate(notebook)
    return notebook


def run_notebook(name: str, folder: Path) -> tuple[dict[str, Any], list[Any]]:
    """Run every cell in `folder`; return the names at the end, and the value of each cell."""
    names: dict[str, Any] = {}
    cells = read(name).cells
    with chdir(folder):
        values = [_run(cell.source, names) for cell in cells if cell.cell_type == "code"]
    plt.close("all")
    return names, values


def _run(source: str, names: dict[str, Any]) -> Any:
    """Run a cell, and return the value of its last expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)  # noqa: S102 - a notebook of this repository
    if not isinstance(last, ast.Expr):
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)  # noqa: S307


def is_clean(name: str) -> bool:
    """Whether there is no output, no count of executions, nothing of the machine it is from."""
    path = NOTEBOOKS / name
    notebook = read(name)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    return (
        len(code) > 5
        and all(cell.outputs == [] and cell.execution_count is None for cell in code)
        and set(notebook.metadata) == {"kernelspec", "language_info"}
        and notebook.metadata.language_info == {"name": "python"}
        and not re.search(r"/(home|tmp|work|root|Users)/|[A-Z]:\\\\", path.read_text("utf-8"))
    )
