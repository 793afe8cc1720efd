"""Run the notebooks of docs/notebooks as a reader does, and store what they show.

python -m docs_site.notebook_run            # all of them, in folders of their own
python -m docs_site.notebook_run flight     # one
"""

from __future__ import annotations

import ast
import base64
import io
import json
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import chdir, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt

NOTEBOOKS = Path(__file__).parents[1] / "docs" / "notebooks"
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")
_DPI = 70


@dataclass
class Cell:
    """What a cell of code has shown: printed text, the value of its last expression, pictures."""

    printed: str
    value: Any
    pictures: list[bytes]

    def outputs(self, number: int) -> Iterator[dict[str, Any]]:
        """Yield the outputs as a notebook stores them."""
        if self.printed:
            yield {"name": "stdout", "output_type": "stream", "text": _lines(self.printed)}
        for picture in self.pictures:
            image = base64.b64encode(picture).decode()
            data = {"image/png": image, "text/plain": ["<Figure>"]}
            yield {"data": data, "metadata": {}, "output_type": "display_data"}
        if self.value is not None:
            data = {"text/plain": _lines(repr(self.value))}
            html = getattr(self.value, "_repr_html_", None)
            if html is not None:
                data["text/html"] = _lines(html())
            about = {"execution_count": number, "metadata": {}, "output_type": "execute_result"}
            yield {"data": data, **about}


def read(name: str) -> Any:
    """Read a notebook, whose form is checked."""
    import nbformat  # noqa: PLC0415 - two seconds, where it has grammars of addresses to compile

    notebook: Any = nbformat.read(NOTEBOOKS / name, as_version=4)  # type: ignore[no-untyped-call] # it has no types
    nbformat.validate(notebook)
    return notebook


def run_notebook(name: str, folder: Path) -> tuple[dict[str, Any], list[Cell]]:
    """Run every cell in `folder`; return the names at the end, and what each cell has shown."""
    plt.close("all")  # those of whoever ran before in this process
    plt.switch_backend("Agg")
    names: dict[str, Any] = {}
    cells = read(name).cells
    with chdir(folder):
        shown = [_run(cell.source, names) for cell in cells if cell.cell_type == "code"]
    return names, shown


def _run(source: str, names: dict[str, Any]) -> Cell:
    """Run a cell."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    value = None
    with redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), names)  # noqa: S102 - a notebook of this repository
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)  # noqa: S307
    pictures = []
    for number in plt.get_fignums():
        picture = io.BytesIO()
        plt.figure(number).savefig(picture, format="png", dpi=_DPI)
        pictures.append(picture.getvalue())
    plt.close("all")
    return Cell(printed.getvalue(), value, pictures)


def texts_of(outputs: Any) -> list[str]:
    """Return the texts of outputs, with every number as #, and how many pictures there are."""
    found = []
    for output in outputs:
        data = output.get("data", {})
        text = output.get("text", data.get("text/plain", ""))
        words = text if isinstance(text, str) else "".join(text)
        found.append("picture" if "image/png" in data else _NUMBER.sub("#", words))
    return found


def store(name: str) -> None:
    """Run a notebook in a folder of its own, and write what it shows into its file."""
    path = NOTEBOOKS / name
    notebook = json.loads(path.read_text("utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        _, shown = run_notebook(name, Path(folder))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, (cell, found) in enumerate(zip(code, shown, strict=True), 1):
        cell["execution_count"] = number
        cell["outputs"] = list(found.outputs(number))
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", "utf-8")


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


if __name__ == "__main__":
    for stem in sys.argv[1:] or sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb")):
        store(f"{stem}.ipynb")
