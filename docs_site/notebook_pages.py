"""Notebooks as pages: text as it is, cells as blocks of Python, and what they have shown."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any


def page(path: Path) -> str:
    """Return a notebook in Markdown, with a link to its file."""
    cells = json.loads(path.read_text("utf-8"))["cells"]
    parts = []
    for cell in cells:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
        for output in cell.get("outputs", ()):
            parts += _output(output)
    title, _, rest = parts[0].partition("\n")
    link = f"[Download the notebook]({path.name})"
    return "\n\n".join([title, link, rest.strip(), *parts[1:]]) + "\n"


def _output(output: Any) -> Iterator[str]:
    """Yield what a cell has shown, in Markdown."""
    data = output.get("data", {})
    if "image/png" in data:
        yield f'<img alt="" src="data:image/png;base64,{data["image/png"]}">'
    elif "text/html" in data:
        yield "<div>" + "".join(data["text/html"]).replace("\n", "") + "</div>"
    else:
        text = "".join(output.get("text", data.get("text/plain", ())))
        yield f"```text\n{text.rstrip()}\n```"
